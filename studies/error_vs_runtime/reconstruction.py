"""Models of other sizes, each trained from scratch in the same way: error against the time of training.

All are trained on the same number of samples, much fewer than in the run: a larger model would gain more from a long
training. Always on the CPU.
"""

import copy
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from lightning_fabric import Fabric
from scipy.spatial import cKDTree

from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.evaluate import BATCH_SIZE
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.recipes import Recipe, ReconstructionSettings
from palpate.learning.samples import Assembler, Sample, windows
from palpate.models import Reconstruction
from palpate.protocol import CHAMFER_SCALE
from studies.error_vs_runtime.study import ALL, Method, Study, variants
from studies.subjects import Subject
from studies.surface_distance import sample
from studies.training_steps import TrainingSteps

# The experiment with vision that trains fastest: one image an object.
EXPERIMENT = Experiment("charts_unoccluded", "charts", "unoccluded", False, 1)
SAMPLES = 200  # on which each model is trained
SEEDS = (0, 1)


class Variant(NamedTuple):
    """A model and its training. width, layers: of the graph network. precision: as of `Machine`. batch: samples a
    step."""

    width: int
    layers: int
    deformations: int
    precision: str
    batch: int
    seed: int


class ReconstructionStudy(Study):
    """All validation objects of the run as one case, whatever the report's `objects`. A result is a `Variant`."""

    stage = "reconstruction"
    units = {"Chamfer distance": "m^2 x 9000"}

    def __init__(self, data: ExperimentData, settings: ReconstructionSettings, machine: Mapping[str, Any], points: int):
        """settings: of the experiment, from the run's recipe. machine: the config's `training`. points: sampled in an
        evaluation."""
        self.data, self.settings, self.machine, self.points = data, settings, machine, points
        gcn, deformations = settings.architecture.gcn, settings.architecture.deformations
        setup = gcn.width, gcn.layers, deformations, machine["precision"], settings.batch, SEEDS[0]
        self.base = Variant(*setup)
        # A short training is better at a higher rate (docs/evidence/training.md), but varies more with the seed.
        total_samples = ReconstructionLearner(data, EXPERIMENT, settings, SEEDS[0]).steps * settings.batch
        self.rate = settings.rate * max(1.0, total_samples / SAMPLES) ** 0.25
        self.samples = windows(data, EXPERIMENT, "validation")
        self._trained: dict[Variant, tuple[Reconstruction, TrainingSteps]] = {}

    @property
    def reference(self) -> str:
        """The true points, in words, with the numbers of samples."""
        return (
            f"the true points of {len(self.samples)} validation samples, and {self.points} points spread evenly on "
            f"each, by scipy's k-d trees in double precision. Each model was trained on {SAMPLES} samples, with one "
            "seed: the rows of the knob seed say what is chance. Seconds are for training on "
            f"{self.timed_samples} samples"
        )

    @property
    def timed_samples(self) -> int:
        """Number of samples of the timed training steps, the same for all variants."""
        return 2 * self.base.batch

    def cases(self) -> Iterable[tuple[str, list[Sample]]]:
        """All validation samples, as one case."""
        yield ALL, self.samples

    def methods(self) -> list[Method]:
        """Trainings with one property of the model changed."""
        base, methods = self.base, []
        values = {
            "width": (base.width // 2, 2 * base.width),
            "layers": (max(1, base.layers // 2), 2 * base.layers),
            "deformations": (1, 2, 3, 4),
            "precision": ("32-true", "bf16-mixed"),
            "batch": (2 * base.batch,),
            "seed": SEEDS,
        }
        for knob, others in values.items():
            own = getattr(base, knob)
            make = lambda value, knob=knob: partial(self._train, base._replace(**{knob: value}))  # noqa: E731
            methods += variants("training", knob, sorted({*others, own}), make, own)
        return methods

    def errors(self, case: list[Sample], result: Variant) -> dict[str, float]:
        """The mean Chamfer distance of the trained model's predictions."""
        faces, vertices = self.trained(result)[0].faces.numpy(), self.predict(result, case)
        distances = [
            chamfer(mesh, faces, self.data["points"][sample.object], self.points)
            for mesh, sample in zip(vertices, case, strict=True)
        ]
        return {"Chamfer distance": float(np.mean(distances))}

    def trained(self, variant: Variant) -> tuple[Reconstruction, TrainingSteps]:
        """The trained model, on the CPU in float32, and its training; trained at the first call."""
        if variant not in self._trained:
            architecture = self.settings.architecture
            gcn = replace(architecture.gcn, width=variant.width, layers=variant.layers)
            architecture = replace(architecture, gcn=gcn, deformations=variant.deformations)
            steps = -(-SAMPLES // variant.batch)
            changed = {"architecture": architecture, "batch": variant.batch, "rate": self.rate, "steps": steps}
            changed |= {"evaluate_every": steps, "validation_samples": 1, "epochs": None, "patience": None}
            learner = ReconstructionLearner(self.data, EXPERIMENT, replace(self.settings, **changed), variant.seed)
            machine = Machine("cpu", precision=variant.precision, threads=self.machine["threads"])
            with tempfile.TemporaryDirectory() as folder:
                train(learner, f"{folder}/model", f"{folder}/checkpoints", machine, str(variant))
            model = copy.deepcopy(learner.model).float().eval()
            fabric = Fabric(accelerator="cpu", devices=1, precision=variant.precision)
            self._trained[variant] = model, TrainingSteps(learner.train(), fabric.autocast)
        return self._trained[variant]

    def _train(self, variant: Variant, case: list[Sample]) -> Variant:
        """Make further steps of a training. The error is of its end before them."""
        for number in range(self.timed_samples // variant.batch):
            self.trained(variant)[1](number)
        return variant

    def predict(self, variant: Variant, case: list[Sample]) -> np.ndarray:
        """Vertices (n, V, 3), metres, of samples by the trained model."""
        (model, _), assemble = self.trained(variant), Assembler(self.data, EXPERIMENT)
        with torch.inference_mode():
            parts = [model(assemble(case[k : k + BATCH_SIZE])) for k in range(0, len(case), BATCH_SIZE)]
        return torch.cat(parts).double().numpy()


def chamfer(vertices: np.ndarray, faces: np.ndarray, truth: np.ndarray, count: int) -> float:
    """Chamfer distance (m^2 x 9000) of a mesh, by `count` points spread evenly on it, to a cloud (n, 3)."""
    points, truth = sample(vertices, faces, count), truth.astype(np.float64)
    there, back = cKDTree(truth).query(points)[0], cKDTree(points).query(truth)[0]
    return CHAMFER_SCALE * float(np.mean(there**2) + np.mean(back**2))


def study(run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]) -> ReconstructionStudy:
    """The study of a run; ignores the subjects.

    Reads `recipe` (resolved), `training` (precision, threads) and `evaluation.points` of the settings, and the run's
    stores of surface and vision.
    """
    data = ExperimentData.load(run, EXPERIMENT, ("train", "validation"))
    of_experiment = Recipe.from_row(settings["recipe"]).settings(EXPERIMENT)
    return ReconstructionStudy(data, of_experiment, settings["training"], settings["evaluation"]["points"])
