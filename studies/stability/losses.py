"""Stability of losses and training: degenerate clouds, charts, meshes, touches, batches and scales."""

import csv
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import Tensor

from palpate.architectures import GCN, Architecture, Encoder
from palpate.camera import paper_camera
from palpate.charts import sample_faces, sphere, touch_chart
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.charts.fit import placed
from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.learners import Diverged, ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.recipes import ReconstructionSettings
from palpate.learning.samples import Assembler, Sample
from palpate.mesh import OBJECT_POSITION, load_collision
from palpate.models import Reconstruction, TouchDepth
from palpate.models.losses import Target, Truth, reconstruction_loss
from palpate.models.templates import Templates
from palpate.touch.reading import RESOLUTION
from studies.stability.cases import Cases, Finding, at_least, at_most, equal, rejects
from studies.subjects import Subject

CASES = Cases()
GRASPS = 5
EXPERIMENT = Experiment("charts_unoccluded_touch_5", "charts", "unoccluded", True, GRASPS)
Change = Callable[[Tensor], Tensor]
LAYERS = Architecture(
    Encoder([8, 16], [1, 2], [1, 3], norm="instance", padding=1),
    GCN(4, 32),
    **{"failed_charts": "fixed", "normalise_positions": True, "init": "he", "last_layer_scale": 0.01},
)
TRAINING = {"rate": 1e-3, "schedule": "constant", "clip": 1.0}
TRAINING |= {"batch": 1, "steps": 12, "epochs": None, "evaluate_every": 4, "patience": None, "epoch": "objects"}
TRAINING |= {"loss_points": 500, "validation_points": 500, "validation_samples": 1}
SETTINGS = ReconstructionSettings(architecture=LAYERS, **TRAINING)


def seeded(seed: int = 0) -> torch.Generator:
    """Random numbers, the same every time."""
    return torch.Generator().manual_seed(seed)


def cloud_of(subject: Subject, seed: int = 0) -> Tensor:
    """2,000 points (n, 3) of the object's collision mesh in the world, metres."""
    mesh = load_collision(subject.folder)
    vertices = torch.tensor(mesh.vertices + np.array(OBJECT_POSITION), dtype=torch.float32)
    return sample_faces(vertices[None], torch.tensor(np.asarray(mesh.faces)), 2000, seeded(seed))[0]


def count_nonfinite(*tensors: Tensor) -> int:
    """Count numbers that are NaN or infinite."""
    return sum(int((~torch.isfinite(tensor)).sum()) for tensor in tensors)


def gradients(model: torch.nn.Module) -> Tensor:
    """All gradients of a model in one vector."""
    return torch.cat([weights.grad.flatten() for weights in model.parameters() if weights.grad is not None])


def synthetic_sensors(cloud: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Twenty sensors that look at points of a cloud from 2 cm.

    Returns: position (g, 4, 3), rotation (g, 4, 3, 3), planar charts (g, 4, 81, 3) at the points.
    """
    places = cloud[torch.randperm(len(cloud), generator=seeded())[: 4 * GRASPS]]
    away = torch.nn.functional.normalize(places - cloud.mean(dim=0), dim=1)
    position, grid = places + 0.02 * away, touch_chart().grid
    side = torch.nn.functional.normalize(torch.linalg.cross(away, away.roll(1, dims=1) + 0.1), dim=1)
    rotation = torch.stack([-away, side, torch.linalg.cross(-away, side)], dim=2)
    plane = torch.cat([torch.full((len(grid), 1), 0.02), grid], dim=1)
    charts = placed(plane.expand(len(places), -1, -1), position, rotation)
    return tuple(values.unflatten(0, (GRASPS, 4)) for values in (position, rotation, charts))


def small_data(subject: Subject, successful: bool = True) -> ExperimentData:
    """Training data in memory: the object in three sizes, two of them to train on; images are of its density."""
    centre = torch.tensor(OBJECT_POSITION)
    clouds = [(cloud_of(subject, seed=k) - centre) * size + centre for k, size in enumerate((1.0, 0.8, 0.9))]
    seen = [(cloud - centre)[:, [2, 0]].T.numpy() for cloud in clouds]
    images = np.stack([np.histogram2d(*of, 32, [[-0.3, 0.3]] * 2)[0] for of in seen])[:, None, ..., None]
    sensors = zip(*map(synthetic_sensors, clouds), strict=True)
    position, rotation, charts = (torch.stack(values).numpy() for values in sensors)
    success = np.full(position.shape[:3], successful)
    if not successful:
        charts = np.repeat(position[..., None, :], TOUCH_VERTICES, axis=3)
    arrays = {
        "object": np.array([f"{subject.name}-{number}" for number in range(3)]),
        "class": np.array([subject.class_name] * 3),
        "split": np.array(["train", "train", "validation"]),
        "points": torch.stack(clouds).numpy(),
        "unoccluded": np.repeat((255 * np.minimum(images / 8, 1)).astype(np.uint8), 3, axis=-1),
        "image_camera": np.tile(paper_camera(32).matrix().astype(np.float32), (len(clouds), 1, 1, 1)),
        "success": success,
        "position": position,
        "rotation": rotation,
        "charts": charts,
    }
    return ExperimentData(arrays)


def model_and_batch(subject: Subject, successful: bool = True) -> tuple[Reconstruction, dict[str, Tensor], Truth]:
    """An untrained model whose vertices move by centimetres, a batch of two objects, and their points."""
    data = small_data(subject, successful)
    torch.manual_seed(0)
    batch = Assembler(data, EXPERIMENT)([Sample(number, tuple(range(GRASPS))) for number in (0, 1)])
    model = Reconstruction(EXPERIMENT, replace(LAYERS, last_layer_scale=0.1))
    return model, batch, Truth(torch.from_numpy(data["points"]))


def loss_of(model: Reconstruction, vertices: Tensor, truth: Truth) -> Tensor:
    """The training loss of the batch of `model_and_batch`."""
    return reconstruction_loss(vertices, model.faces, Target(truth, [0, 1], 1000, seeded())).mean()


class PerturbedLearner(ReconstructionLearner):
    """Training that applies a function to the losses of one step."""

    def __init__(self, data: ExperimentData, settings: ReconstructionSettings, change: Change, step: int | None):
        super().__init__(data, EXPERIMENT, settings, seed=0)
        self.change, self.at = change, step

    def losses(self, batch_samples, generator, validation=False):
        """As `ReconstructionLearner.losses`, changed in one step of the training."""
        losses = super().losses(batch_samples, generator, validation)
        return self.change(losses) if self.step == self.at and not validation else losses


def short_training(
    folder: Path,
    subject: Subject,
    change: Change = lambda losses: losses,
    step: int | None = None,
    **settings: Any,
) -> tuple[dict[str, Any], list[float], Tensor]:
    """A short training: its summary, its validation losses, and the weights it keeps in one vector."""
    learner = PerturbedLearner(small_data(subject), replace(SETTINGS, **settings), change, step)
    summary = train(learner, folder / "model", folder / "work", Machine("cpu"), "trust")
    with (folder / "model/history.csv").open(newline="") as file:
        history = [float(row["validation_loss"]) for row in csv.DictReader(file)]
    return summary, history, weights_of(folder / "model/best.ckpt")


def weights_of(path: Path) -> Tensor:
    """All weights of a checkpoint in one vector."""
    weights = torch.load(path, weights_only=True)["weights"]
    return torch.cat([values.flatten().double() for values in weights.values()])


@CASES.case("all twenty touches unsuccessful", "models")
def no_touch(subject: Subject) -> Iterator[Finding]:
    """Five grasps without a touch: the model must not read the charts, and still uses the image."""
    model, batch, truth = model_and_batch(subject, successful=False)
    vertices = model(batch)
    unread = model(batch | {"charts": torch.full_like(batch["charts"], torch.nan)})
    yield equal("coordinates that change with what is in the charts", int((vertices != unread).sum()), 0)
    fingertips = batch["position"].repeat_interleave(TOUCH_VERTICES, dim=1)
    off = float((vertices[:, -fingertips.shape[1] :] - fingertips).abs().max().detach())
    yield equal("held charts off the fingertip", off, 0.0, "m")
    loss = loss_of(model, vertices, truth)
    loss.backward()
    yield equal("NaN or infinite", count_nonfinite(loss, gradients(model), vertices), 0)
    alone = sample_faces(vertices, model.faces, 2000, seeded()).detach()
    at_tips = (alone[:, :, None] == batch["position"][:, None]).all(dim=3).sum()
    yield equal("samples on charts without area", int(at_tips), 0)


@CASES.case("touched points moved by a micrometre", "reconstruction")
def nudged(subject: Subject) -> Iterator[Finding]:
    """The start of strategy `template`, by touch alone, from a hundred ellipsoids: which face a touched point is
    nearest to may change, and the start must not jump."""
    _, batch, _ = model_and_batch(subject)
    centre, spread = torch.tensor(OBJECT_POSITION), 0.1 + 0.9 * torch.rand(100, 1, 3, generator=seeded())
    templates = Templates(centre + spread * (sphere()[0] - centre))
    start, random = templates(batch), seeded()
    moved = [
        templates(batch | {"charts": batch["charts"] + 1e-6 * torch.randn(batch["charts"].shape, generator=random)})
        for _ in range(6)
    ]
    most = max(float((vertices - start).norm(dim=2).max()) for vertices in moved)
    yield at_most("vertex moved the most", 1e3 * most, 0.1, "mm")


@CASES.case("bfloat16", "training")
def bfloat16(subject: Subject) -> Iterator[Finding]:
    """Autocast, forward and backward, against float32."""
    model, batch, truth = model_and_batch(subject)
    results = {}
    for enabled in (False, True):
        model.zero_grad()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=enabled):
            vertices = model(batch).float()
        loss = loss_of(model, vertices, truth)
        loss.backward()
        results[enabled] = vertices.detach(), float(loss.detach()), gradients(model)
    (baseline, loss, gradient), (half, half_loss, half_gradient) = results[False], results[True]
    yield equal("NaN or infinite", count_nonfinite(half, half_gradient), 0)
    moved = 1e3 * float((half - baseline).norm(dim=2).square().mean().sqrt())
    yield at_most("root mean square of vertices moved", moved, 1.0, "mm")
    yield at_most("loss: relative error", abs(half_loss / loss - 1), 0.02)
    yield at_least("cosine of the gradients", float(torch.cosine_similarity(half_gradient, gradient, dim=0)), 0.95)
    torch.manual_seed(0)
    network, reading = TouchDepth(8).eval(), torch.rand(2, 3, RESOLUTION, RESOLUTION, generator=seeded())
    with torch.inference_mode():
        depth = network(reading)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            error = 1e3 * float((network(reading).float() - depth).abs().mean())
    yield at_most("U-Net: mean error of the depth", error, 0.02, "mm")


@CASES.case("one step's loss times 1e6", "training", short=False)
def spike(subject: Subject) -> Iterator[Finding]:
    """With clipping the step has no lasting effect; without, the best model before it is kept."""
    spiked = {"change": lambda losses: 2.0**20 * losses, "step": 20, "steps": 48}
    before = spiked["step"] // SETTINGS.evaluate_every  # evaluations
    with TemporaryDirectory() as name:
        folder = Path(name)
        baseline = short_training(folder / "plain", subject, steps=48)[1]
        history = short_training(folder / "hit", subject, **spiked)[1]
        yield at_most("clipped: loss after it, of that without", history[before] / baseline[before], 1.01)
        yield at_most("clipped: last loss, of that before it", history[-1] / history[before - 1], 0.5)
        summary, history, weights = short_training(folder / "free", subject, **spiked, clip=None)
    yield at_most("not clipped: kept, of the best before", summary["validation_loss"] / min(history[:before]), 1.0)
    yield equal("not clipped: NaN or infinite weights and losses", count_nonfinite(weights, torch.tensor(history)), 0)


def infinite_gradient(losses: Tensor) -> Tensor:
    """The same losses, whose gradient is infinite."""
    losses = losses.clone()
    losses.register_hook(lambda gradient: gradient * torch.inf)
    return losses


@CASES.case("a step whose loss or gradient is not finite", "training")
def diverging(subject: Subject) -> Iterator[Finding]:
    """Training stops before a weight changes, and names the sample; the model so far is kept."""
    # Step 7 is the last before a validation. Clipping would turn an infinite gradient into NaN.
    changes = {
        "NaN loss": (lambda losses: losses * torch.nan, 6, 1.0),
        "infinite gradient": (infinite_gradient, 6, 1.0),
        "infinite gradient before a validation, not clipped": (infinite_gradient, 7, None),
    }
    for what, (change, step, clip) in changes.items():
        named = rf"(loss|gradient) is NaN or infinite.*step {step}.*{subject.name}.*the model so far is"
        with TemporaryDirectory() as name:
            folder = Path(name)
            run = partial(short_training, folder, subject, change, step, clip=clip)
            yield rejects(what, run, Diverged, named)
            yield equal(f"{what}: models written", int((folder / "model").exists()), 0)
            kept = weights_of(folder / "work/best.ckpt")
            yield equal(f"{what}: NaN or infinite weights kept", count_nonfinite(kept), 0)
            last = torch.load(folder / "work/last.ckpt", weights_only=True)["model"]
            wrong = count_nonfinite(*(values for values in last.values() if values.is_floating_point()))
            yield equal(f"{what}: NaN or infinite weights to go on from", wrong, 0)
    with TemporaryDirectory() as name:
        run = partial(short_training, Path(name), subject, rate=1e30, clip=None)
        yield rejects("rate 1e30", run, Diverged, "NaN or inf")
