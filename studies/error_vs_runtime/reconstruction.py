"""Models of other sizes, trained in the same way: error against the time of inference and of training.

Every model is trained from scratch on the same number of samples, much fewer than in the run: a larger model would
gain more from a long training. Always on the CPU.
"""

import copy
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import lightning
import numpy as np
import torch
from scipy.spatial import cKDTree

from palpate.evaluation.evaluate import BATCH_SIZE
from palpate.experiments import Experiment
from palpate.inference.data import ExperimentData
from palpate.inference.machine import Machine
from palpate.inference.samples import Assembler, Sample, windows
from palpate.mesh.distance import sample
from palpate.models import Reconstruction
from palpate.protocol import CHAMFER_SCALE
from palpate.training.learners import ReconstructionLearner
from palpate.training.loop import train
from palpate.training.recipes import Recipe, ReconstructionSettings
from studies.error_vs_runtime.study import ALL, Method, Study, variants
from studies.subjects import Subject
from studies.training_steps import TrainingSteps

# The experiment with vision that trains fastest: one image an object.
EXPERIMENT = Experiment("charts_unoccluded", "charts", "unoccluded", False, 1)
SAMPLES = 200  # on which each model is trained
SEEDS = (0, 1)
TYPES = {"float64": torch.float64, "float32": torch.float32, "bfloat16": torch.bfloat16}


class Variant(NamedTuple):
    """A model and its training. width, layers: of the graph network. precision: Lightning's name. batch: samples a
    step."""

    width: int
    layers: int
    deformations: int
    precision: str
    batch: int
    seed: int


class Result(NamedTuple):
    """Predictions (n, V, 3) m of the validation samples by a variant; timed: whether inference was timed, not
    training."""

    vertices: np.ndarray
    variant: Variant
    timed: bool


class ReconstructionStudy(Study):
    """All validation objects of the run as one case, whatever the report's `objects`."""

    stage = "reconstruction"
    units = {
        "Chamfer distance, of inference": "m^2 x 9000",
        "Chamfer distance, of training": "m^2 x 9000",
        "rounding": "mm",
    }
    panels = 2

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
        self._results: dict[Variant, np.ndarray] = {}

    @property
    def reference(self) -> str:
        return (
            f"the true points of {len(self.samples)} validation samples, and {self.points} points spread "
            "evenly on each, by scipy's k-d trees in double precision; for rounding the same model in "
            f"float64. Each model was trained on {SAMPLES} samples, with one seed: the rows of the knob seed "
            f"say what is chance. Seconds are for {len(self.samples)} predictions, or for training on "
            f"{self.timed_samples} samples"
        )

    @property
    def timed_samples(self) -> int:
        return max(value for knob, value in self._knobs() if knob == "batch")

    def cases(self) -> Iterable[tuple[str, list[Sample]]]:
        yield ALL, self.samples

    def _knobs(self) -> list[tuple[str, Any]]:
        base = self.base
        values = {
            "width": (base.width // 2, 2 * base.width),
            "layers": (max(1, base.layers // 2), 2 * base.layers),
            "deformations": (1, 2, 3, 4),
            "precision": ("32-true", "bf16-mixed"),
            "batch": (2 * base.batch,),
            "seed": SEEDS,
        }
        return [(knob, value) for knob, of in values.items() for value in sorted({*of, getattr(base, knob)})]

    def methods(self) -> list[Method]:
        methods, base, predict = [], self.base, partial(partial, self._predict)
        for knob, value in self._knobs():
            variant, own = base._replace(**{knob: value}), getattr(base, knob) == value
            methods.append(Method("training", knob, value, partial(self._train, variant), own))
            if knob in ("width", "layers", "deformations"):
                methods.append(Method("inference", knob, value, predict(variant), own))
        counts = sorted({1, BATCH_SIZE, 4 * BATCH_SIZE})
        methods += variants("inference", "batch", counts, lambda count: predict(base, batch_size=count), BATCH_SIZE)
        return methods + variants("inference", "precision", TYPES, lambda t: predict(base, dtype=TYPES[t]), "float32")

    def errors(self, case: list[Sample], result: Result) -> dict[str, float]:
        errors, faces = dict.fromkeys(self.units, float("nan")), self.trained(result.variant)[0].faces.numpy()
        distances = [
            chamfer(vertices.astype(np.float64), faces, self.data["points"][sample.object], self.points)
            for vertices, sample in zip(result.vertices, case, strict=True)
        ]
        if not result.timed:
            return errors | {"Chamfer distance, of training": float(np.mean(distances))}
        squared_distance = np.square(result.vertices - self._exact(result.variant, case)).sum(axis=2).mean()
        errors["rounding"] = 1e3 * float(squared_distance**0.5)
        return errors | {"Chamfer distance, of inference": float(np.mean(distances))}

    def _exact(self, variant: Variant, case: list[Sample]) -> np.ndarray:
        if variant not in self._results:
            self._results[variant] = self._predict(variant, case, dtype=torch.float64).vertices
        return self._results[variant]

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
            model = copy.deepcopy(learner.eval_model).float().eval()
            fabric = lightning.Fabric(accelerator="cpu", devices=1, precision=variant.precision)
            self._trained[variant] = model, TrainingSteps(learner.train(), fabric.autocast)
        return self._trained[variant]

    def _train(self, variant: Variant, case: list[Sample]) -> Result:
        _, step = self.trained(variant)
        for number in range(self.timed_samples // variant.batch):
            step(number)
        return Result(self._exact(variant, case), variant, False)

    def _predict(
        self, variant: Variant, case: list[Sample], batch_size: int = BATCH_SIZE, dtype: torch.dtype = torch.float32
    ) -> Result:
        """Predict in batches; bfloat16 by autocast as in Lightning, the other types throughout."""
        model, mixed = self.trained(variant)[0], dtype == torch.bfloat16
        result_type = torch.float32 if mixed else dtype
        model = model if result_type == torch.float32 else copy.deepcopy(model).to(result_type)
        assemble, parts = Assembler(self.data, EXPERIMENT), []
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=mixed):
            for start in range(0, len(case), batch_size):
                batch = assemble(case[start : start + batch_size])
                batch = {k: v.to(result_type) if v.is_floating_point() else v for k, v in batch.items()}
                parts.append(model(batch).to(result_type))
        return Result(torch.cat(parts).double().numpy(), variant, True)


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
