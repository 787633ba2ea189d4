"""Stability of losses and training: degenerate clouds, charts, meshes, touches, batches and scales."""

import csv
import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import Tensor

from palpate import Dataset, store
from palpate.architectures import GCN, Architecture, Encoder
from palpate.camera import paper_camera
from palpate.charts import chamfer_distance, fit_adam, fit_direct, sample_faces, touch_chart
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.charts.fit import placed
from palpate.experiments import Experiment
from palpate.inference.data import ExperimentData, ExperimentDataError
from palpate.inference.machine import Machine
from palpate.inference.samples import Assembler, Sample
from palpate.inference.touches import predict_depth
from palpate.mesh import OBJECT_POSITION, load_collision
from palpate.models import Reconstruction, TouchDepth
from palpate.models.pooling import PerceptualPooling, relative_camera
from palpate.sensor import DIGIT
from palpate.touch.sensor import RESOLUTION, SENSOR_WIDTH
from palpate.training.learners import Diverged, ReconstructionLearner
from palpate.training.loop import train
from palpate.training.losses import Truth, reconstruction_loss, touch_depth_loss
from palpate.training.recipes import ReconstructionSettings
from palpate.training.touches import read_touches
from studies.stability.cases import Cases, Finding, at_least, at_most, equal, rejects
from studies.subjects import Subject

CASES = Cases()
ROUNDING = 1e-5  # relative, of sums of thousands of numbers in float32
GRASPS = 5
EXPERIMENT = Experiment("charts_unoccluded_touch_5", "charts", "unoccluded", True, GRASPS)
Change = Callable[[Tensor], Tensor]
REFUSED = "was touched: more objects are needed"
LAYERS = Architecture(
    Encoder([8, 16], [1, 2], [1, 3], norm="instance", padding=1),
    GCN(4, 32),
    **{"failed_charts": "fixed", "normalise_positions": True, "init": "he", "last_layer_scale": 0.01},
)
TRAINING = {"optimiser": "adam", "rate": 1e-3, "schedule": "constant", "weight_decay": 0, "clip": 1.0, "ema": None}
TRAINING |= {"batch": 1, "steps": 12, "epochs": None, "evaluate_every": 4, "patience": None}
TRAINING |= {"loss_points": 500, "validation_points": 500, "validation_samples": 1}
SETTINGS = ReconstructionSettings(architecture=LAYERS, **TRAINING)


def seeded(seed: int = 0) -> torch.Generator:
    """Random numbers, the same every time."""
    return torch.Generator().manual_seed(seed)


def mesh_of(subject: Subject) -> tuple[Tensor, Tensor]:
    """The object's collision mesh in the world: vertices (V, 3) float32 metres, faces (F, 3)."""
    mesh = load_collision(subject.folder)
    vertices = torch.tensor(mesh.vertices + np.array(OBJECT_POSITION), dtype=torch.float32)
    return vertices, torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)


def cloud_of(subject: Subject, n: int = 2000, seed: int = 0) -> Tensor:
    """n points (n, 3) of its surface."""
    vertices, faces = mesh_of(subject)
    return sample_faces(vertices[None], faces, n, seeded(seed))[0]


def brute_force(a: Tensor, b: Tensor) -> float:
    """Chamfer distance of two clouds from all pairs, in double precision."""
    distances = np.square(a.double().numpy()[:, None] - b.double().numpy()[None]).sum(axis=2)
    return float(distances.min(axis=1).mean() + distances.min(axis=0).mean())


def chamfer(a: Tensor, b: Tensor) -> tuple[float, Tensor]:
    """Chamfer distance of two clouds, and its gradient by the points of the first."""
    a = a.detach().clone().requires_grad_()
    distance = chamfer_distance([a], [b])[0]
    distance.backward()
    return float(distance.detach()), a.grad


def relative(value: float, expected: float) -> float:
    """Relative difference."""
    return abs(value - expected) / abs(expected)


def count_nonfinite(*tensors: Tensor) -> int:
    """How many numbers are NaN or infinite."""
    return sum(int((~torch.isfinite(tensor)).sum()) for tensor in tensors)


def backward_nonfinite(loss: Tensor, model: torch.nn.Module, *tensors: Tensor) -> int:
    """Take the gradients of a loss; how many numbers of it, of them, and of further tensors are NaN or infinite."""
    loss.backward()
    return count_nonfinite(loss, gradients(model), *(tensor.detach() for tensor in tensors))


def gradients(model: torch.nn.Module) -> Tensor:
    """All gradients of a model in one vector."""
    return torch.cat([weights.grad.flatten() for weights in model.parameters() if weights.grad is not None])


def synthetic_sensors(cloud: Tensor, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Twenty sensors that look at points of a cloud from 2 cm.

    Returns: position (g, 4, 3), rotation (g, 4, 3, 3), planar charts (g, 4, 81, 3) at the points.
    """
    places = cloud[torch.randperm(len(cloud), generator=seeded(seed))[: 4 * GRASPS]]
    away = torch.nn.functional.normalize(places - cloud.mean(dim=0), dim=1)
    position, grid = places + 0.02 * away, touch_chart().grid
    side = torch.nn.functional.normalize(torch.linalg.cross(away, away.roll(1, dims=1) + 0.1), dim=1)
    rotation = torch.stack([-away, side, torch.linalg.cross(-away, side)], dim=2)
    plane = torch.cat([torch.full((len(grid), 1), 0.02), grid], dim=1)
    charts = placed(plane.expand(len(places), -1, -1), position, rotation)
    return tuple(values.unflatten(0, (GRASPS, 4)) for values in (position, rotation, charts))


def density_image(cloud: Tensor, pixels: int = 32) -> np.ndarray:
    """An image of a cloud's density, seen along y: (p, p, 3) uint8."""
    counts = np.histogram2d(*(cloud[:, [2, 0]] - torch.tensor([0.6, 0])).T.numpy(), pixels, [[-0.3, 0.3]] * 2)
    return np.repeat((255 * np.minimum(counts[0] / 8, 1)).astype(np.uint8)[..., None], 3, axis=2)


def small_data(subject: Subject, successful: bool = True, **changed: np.ndarray) -> ExperimentData:
    """Training data in memory: the object in three sizes, two of them to train on. changed: arrays to replace."""
    centre = torch.tensor(OBJECT_POSITION)
    clouds = [(cloud_of(subject, seed=k) - centre) * size + centre for k, size in enumerate((1.0, 0.8, 0.9))]
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
        "unoccluded": np.stack([density_image(cloud) for cloud in clouds])[:, None],
        "image_camera": np.tile(paper_camera(32).matrix().astype(np.float32), (len(clouds), 1, 1, 1)),
        "success": success,
        "position": position,
        "rotation": rotation,
        "charts": charts,
    }
    return ExperimentData(arrays | changed)


def model_and_batch(
    subject: Subject, successful: bool = True, last_layer_scale: float = 0.1
) -> tuple[Reconstruction, dict[str, Tensor], Truth]:
    """An untrained model whose vertices move by centimetres, a batch of two objects, and their points."""
    data = small_data(subject, successful)
    torch.manual_seed(0)
    layers = replace(LAYERS, last_layer_scale=last_layer_scale)
    batch = Assembler(data, EXPERIMENT)([Sample(number, tuple(range(GRASPS))) for number in (0, 1)])
    model = Reconstruction(EXPERIMENT, layers)
    return model, batch, Truth(torch.from_numpy(data["points"]))


def loss_of(model: Reconstruction, vertices: Tensor, truth: Truth, n: int = 1000) -> Tensor:
    """The training loss of the batch of `model_and_batch`."""
    return reconstruction_loss(vertices, model.faces, truth, [0, 1], n, seeded()).mean()


class PerturbedLearner(ReconstructionLearner):
    """Training that applies a function to the losses of one step, or of every step (None).

    epsilon: factor of Adam's.
    """

    def __init__(
        self,
        data: ExperimentData,
        settings: ReconstructionSettings,
        change: Change,
        step: int | None,
        epsilon: float = 1.0,
    ):
        super().__init__(data, EXPERIMENT, settings, seed=0)
        self.change, self.step, self.epsilon = change, step, epsilon

    def losses(self, batch_samples, generator, model, validation=False):
        losses = super().losses(batch_samples, generator, model, validation)
        now = self.step is None or self.global_step == self.step
        return self.change(losses) if now and not validation else losses

    def configure_optimizers(self) -> dict[str, Any]:
        configured = super().configure_optimizers()
        configured["optimizer"].param_groups[0]["eps"] *= self.epsilon
        return configured


def short_training(
    folder: Path,
    subject: Subject,
    change: Change = lambda losses: losses,
    step: int | None = None,
    data: ExperimentData | None = None,
    precision: str = "32-true",
    epsilon: float = 1.0,
    **settings: Any,
) -> tuple[dict[str, Any], list[float], Tensor]:
    """A short training: its summary, its validation losses, and its best weights in one vector."""
    learner = PerturbedLearner(data or small_data(subject), replace(SETTINGS, **settings), change, step, epsilon)
    summary = train(learner, folder / "model", folder / "work", Machine("cpu", precision=precision), "trust")
    with (folder / "model/history.csv").open(newline="") as file:
        history = [float(row["validation_loss"]) for row in csv.DictReader(file)]
    return summary, history, weights_of(folder / "model/best.ckpt")


def weights_of(path: Path) -> Tensor:
    """All weights of a checkpoint in one vector."""
    weights = torch.load(path, weights_only=True)["weights"]
    return torch.cat([values.flatten().double() for values in weights.values()])


@CASES.case("coincident points", "chamfer")
def coincident_points(subject: Subject) -> Iterator[Finding]:
    """Every point three times; all points in one place."""
    cloud, other = cloud_of(subject, 600), cloud_of(subject, 500, seed=1)
    expected = brute_force(cloud, other)
    value, gradient = chamfer(cloud.repeat(3, 1), other)
    yield at_most("threefold cloud: relative error", relative(value, expected), ROUNDING)
    alone = chamfer(cloud, other)[1]
    threefold = gradient.unflatten(0, (3, -1)).sum(dim=0)
    # Of the three copies any one may be the nearest of the other cloud's points.
    error = float((threefold - alone).abs().max() / alone.abs().max())
    yield at_most("gradient of the copies together: relative error", error, ROUNDING)
    heap = cloud[:1].repeat(1000, 1)
    value, gradient = chamfer(heap, other)
    yield at_most("heap: relative error", relative(value, brute_force(heap[:1], other)), ROUNDING)
    yield equal("heap: NaN or infinite gradients", count_nonfinite(gradient), 0)


@CASES.case("identical clouds", "chamfer")
def identical_clouds(subject: Subject) -> Iterator[Finding]:
    """Zero distance, where a square root would have no derivative."""
    cloud = cloud_of(subject)
    value, gradient = chamfer(cloud, cloud[torch.randperm(len(cloud), generator=seeded())])
    yield equal("distance", value, 0.0, "m^2")
    yield equal("largest gradient", float(gradient.abs().max()), 0.0)


@CASES.case("a cloud of one point", "chamfer")
def one_point(subject: Subject) -> Iterator[Finding]:
    """Against the closed form of distance and gradient."""
    cloud = cloud_of(subject, 10000)
    point = torch.tensor([[0.3, -0.2, 0.9]])
    value, gradient = chamfer(point, cloud)
    apart = point.double() - cloud.double()
    squared = apart.square().sum(dim=1)
    yield at_most("relative error", relative(value, float(squared.min() + squared.mean())), ROUNDING)
    expected = 2 * (apart[squared.argmin()] + apart.mean(dim=0))
    error = float((gradient[0].double() - expected).norm() / expected.norm())
    yield at_most("gradient: relative error", error, ROUNDING)
    yield at_most("point on point", abs(chamfer(point, point)[0]), 0.0, "m^2")


@CASES.case("two points equally near", "chamfer")
def ties(subject: Subject) -> Iterator[Finding]:
    """The distance has a kink: its gradient must be that to one of the two points."""
    low, high = mesh_of(subject)[0].double().aminmax(dim=0)
    ends = torch.stack([low, high])
    middle = (low + high)[None] / 2
    value, gradient = chamfer(middle, ends)
    # One of the two is the nearest, and both contribute as points of the other cloud.
    pulls = 2 * (middle - ends) + 2 * (middle - ends).mean(dim=0)
    yield equal("NaN or infinite gradients", count_nonfinite(gradient), 0)
    yield at_most("off the nearer of the two gradients", float((pulls - gradient).norm(dim=1).min()), 1e-12)
    steps = 1e-3 * torch.randn(64, 1, 3, dtype=torch.float64, generator=seeded())
    above = max(
        chamfer(middle + step, ends)[0] - value - float((gradient * step).sum()) - 2 * float(step.square().sum())
        for step in steps
    )
    yield at_most("of 64 steps, farthest above the gradient's paraboloid", above, 1e-12, "m^2")


@CASES.case("clouds in bfloat16 and float16", "chamfer")
def half_clouds(subject: Subject) -> Iterator[Finding]:
    """Against all pairs of the same rounded points, in double precision."""
    for dtype in (torch.bfloat16, torch.float16):
        cloud, other = (cloud_of(subject, 500, seed).to(dtype) for seed in (0, 1))
        near = (cloud.double() + 1e-4).to(dtype)
        for what, points in (("", other), (", 0.1 mm apart", near)):
            name = str(dtype).removeprefix("torch.") + what
            value, gradient = chamfer(cloud, points)
            yield at_most(f"{name}: relative error", relative(value, brute_force(cloud, points)), 1e-6)
            yield equal(f"{name}: NaN or infinite gradients", count_nonfinite(gradient), 0)
            yield equal(f"{name}: the gradient's type", gradient.dtype, dtype)
            yield at_least(f"{name}: gradients other than 0", int((gradient != 0).sum()), 1)


@CASES.case("clouds far from the origin and of any size", "chamfer")
def offsets_and_sizes(subject: Subject) -> Iterator[Finding]:
    """Float32 clouds 1 km away, and 1e-6 to 1e6 times as large; against all pairs of the same points."""
    cloud, other = cloud_of(subject, 500), cloud_of(subject, 500, seed=1)
    moved = [points + 1000 for points in (cloud, other)]
    value, gradient = chamfer(*moved)
    yield at_most("1 km away: relative error", relative(value, brute_force(*moved)), ROUNDING)
    yield equal("1 km away: NaN or infinite gradients", count_nonfinite(gradient), 0)
    for size in (1e-6, 1e6):
        scaled = [points * size for points in (cloud, other)]
        error = relative(chamfer(*scaled)[0], brute_force(*scaled))
        yield at_most(f"times {size:g}: relative error", error, ROUNDING)


@CASES.case("faces without area", "sampling")
def faces_without_area(subject: Subject) -> Iterator[Finding]:
    """For each proper face one that is a point and one that is a line."""
    vertices, faces = mesh_of(subject)
    flat = torch.stack([faces[:, 0], faces[:, 1], faces[:, 1]], dim=1)
    points, lines = faces[:, :1].expand(-1, 3), flat
    mixed = torch.stack([points, faces, lines], dim=1).flatten(0, 1)
    baseline = sample_faces(vertices[None], faces, 3000, seeded())
    moved = float((sample_faces(vertices[None], mixed, 3000, seeded()) - baseline).abs().max())
    note = "the same random numbers with and without faces that have no area"
    yield at_most("samples that move", moved, 1e-6, "m", note)
    moving = vertices[None].clone().requires_grad_()
    sample_faces(moving, mixed, 3000, seeded()).square().sum().backward()
    yield equal("NaN or infinite gradients", count_nonfinite(moving.grad), 0)
    yield rejects("no face with area", lambda: sample_faces(vertices[None], flat, 10), ValueError, "zero area")


@CASES.case("slivers of aspect 1e6", "sampling")
def slivers(subject: Subject) -> Iterator[Finding]:
    """Slivers with half of the area: they get half of the points."""
    size = float((mesh_of(subject)[0].amax(dim=0) - mesh_of(subject)[0].amin(dim=0)).max())
    count, width = 500, size * 1e-6
    along = torch.arange(count, dtype=torch.float64) * width
    low = torch.stack([along, torch.zeros(count), torch.zeros(count)], dim=1)
    step, up = torch.tensor([width, 0, 0]), torch.tensor([0, size, 0.0])
    thin = torch.stack([low, low + step, low + up], dim=1).flatten(0, 1)
    area = 0.5 * width * size * count
    fat = torch.tensor([[0, 0, 0], [2 * area, 0, 0], [0, 1.0, 0]], dtype=torch.float64)
    fat = fat + torch.tensor([0, 0, 1.0])
    vertices = torch.cat([thin, fat]).float()
    faces = torch.arange(len(vertices)).view(-1, 3)
    corners = vertices[faces].numpy().astype(np.longdouble)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    expected = float(areas[:-1].sum() / areas.sum())
    n = 40000
    share = float((sample_faces(vertices[None], faces, n, seeded())[..., 2] < 0.5).double().mean())
    deviation = abs(share - expected) / np.sqrt(expected * (1 - expected) / n)
    yield at_most("share of the slivers: standard deviations off", deviation, 4.0)


@CASES.case("meshes of 1e-19 to 1e19 times the size", "sampling")
def sizes_of_meshes(subject: Subject) -> Iterator[Finding]:
    """Sampled with the same random numbers, scaling by a power of two changes no point."""
    vertices, faces = mesh_of(subject)
    baseline = sample_faces(vertices[None], faces, 2000, seeded())
    for power in (-66, 66):
        scaled = sample_faces(vertices[None] * 2.0**power, faces, 2000, seeded()) / 2.0**power
        yield equal(f"times 2^{power}: samples that move", int((scaled != baseline).sum()), 0)


@CASES.case("collinear charts", "charts")
def collinear_charts(subject: Subject) -> Iterator[Finding]:
    """Touches of one pixel, row or column give charts without area: their fit, and a model with them."""
    depth = torch.full((3, RESOLUTION, RESOLUTION), 0.019)
    valid = torch.zeros(3, RESOLUTION, RESOLUTION, dtype=torch.bool)
    valid[0, 40, 60], valid[1, 10], valid[2, :, 99] = True, True, True
    position, rotation = (values[0, :3] for values in synthetic_sensors(cloud_of(subject))[:2])
    charts = fit_direct(depth, valid, position, rotation)
    yield equal("direct fit: NaN or infinite vertices", count_nonfinite(charts), 0)
    off = ((charts - position[:, None]) @ rotation)[..., 0] - 0.019
    yield at_most("direct fit: vertices off the sheet they touch", float(off.abs().max()), 1e-6, "m")
    reach = float((charts - charts.mean(dim=1, keepdim=True)).norm(dim=2).max())
    yield at_most("direct fit: half the length of a line", reach, SENSOR_WIDTH / 2, "m")

    model, batch, truth = model_and_batch(subject)
    batch["charts"][:, :3] = charts
    vertices = model(batch)
    wrong = backward_nonfinite(loss_of(model, vertices, truth), model, vertices)
    yield equal("model and loss: NaN or infinite", wrong, 0)


@CASES.case("collinear clouds", "charts")
def collinear_clouds(subject: Subject) -> Iterator[Finding]:
    """The paper's fit by Adam to one point and to a line: the chart shrinks onto them."""
    position, rotation = (values[0, :2] for values in synthetic_sensors(cloud_of(subject))[:2])
    spread = torch.linspace(-0.01, 0.01, 200)[:, None]
    local = torch.cat([torch.full((200, 1), 0.019), spread, torch.zeros(200, 1)], dim=1)
    clouds = list(placed(torch.stack([local * torch.tensor([1.0, 0, 0]), local]), position, rotation))
    charts = fit_adam(clouds, position, rotation, steps=120, samples=500, generator=seeded())
    yield equal("NaN or infinite vertices", count_nonfinite(charts), 0)
    faces = touch_chart().faces
    for name, chart, cloud in zip(("one point", "a line"), charts, clouds, strict=True):
        distance = float(chamfer_distance(sample_faces(chart[None], faces, 500, seeded(1)), [cloud])[0])
        yield at_most(f"{name}: root of the Chamfer distance", distance**0.5 * 1e3, 2.0, "mm")


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
    wrong = backward_nonfinite(loss_of(model, vertices, truth), model, vertices)
    yield equal("NaN or infinite", wrong, 0)
    alone = sample_faces(vertices, model.faces, 2000, seeded()).detach()
    at_tips = (alone[:, :, None] == batch["position"][:, None]).all(dim=3).sum()
    yield equal("samples on charts without area", int(at_tips), 0)


@CASES.case("readings that show nothing", "models")
def faint_readings(subject: Subject) -> Iterator[Finding]:
    """A touch with no visible impression still gets a chart; the loss of the U-Net rejects it."""
    torch.manual_seed(0)
    model = TouchDepth(8).eval()
    empty = torch.full((3, RESOLUTION, RESOLUTION), 90, dtype=torch.uint8)
    readings = empty.repeat(3, 1, 1, 1)
    readings[1, 0, 20, 30] += 2
    readings[2] = 255
    depth, valid = predict_depth(model, readings, empty)
    yield equal("pixels in contact", valid.flatten(1).sum(dim=1).tolist(), [1, 1, RESOLUTION**2])
    yield equal("the pixel that differs is it", bool(valid[1, 20, 30]), True)
    position, rotation = (values[0, :3] for values in synthetic_sensors(cloud_of(subject))[:2])
    yield equal("NaN or infinite charts", count_nonfinite(fit_direct(depth, valid, position, rotation)), 0)
    nowhere = torch.full_like(depth, torch.inf)
    for what, seen, truth, reason in (
        ("nothing is in range", valid, nowhere, "pixel in range"),
        ("no pixel is in contact", valid & False, depth, "valid pixel"),
    ):
        loss = partial(touch_depth_loss, depth, seen, truth, None, seeded())
        yield rejects(f"loss where {what}", loss, ValueError, f"touch 0 of the batch has no {reason}")


@CASES.case("data in which nothing was touched", "training")
def data_without_touches(subject: Subject) -> Iterator[Finding]:
    """Reconstruction trains without touches; training the U-Net raises an error."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        data = small_data(subject, successful=False)
        summary, history, weights = short_training(folder, subject, data=data, steps=8)
        yield equal("NaN or infinite losses and weights", count_nonfinite(torch.tensor(history), weights), 0)
        yield at_most("validation loss, of the first", summary["validation_loss"] / history[0], 1.0)
        yield rejects("U-Net", lambda: read_untouched(folder, subject), ExperimentDataError, REFUSED)


def read_untouched(folder: Path, subject: Subject) -> Any:
    """Read the touches of a run with one object of the train split, which nothing touched."""
    sizes, arrays = {"o": 1, "g": 2, "s": 4, "r": 4, "c": 4, "rc": 16}, {}
    for name, spec in store.CONTRACT["touch"].arrays.items():
        arrays[name] = np.zeros([sizes.get(axis, axis) for axis in spec.shape], spec.dtype.replace("string", "U64"))
    arrays["object"] = np.array([subject.name])
    path = folder / store.CONTRACT["touch"].path("batch-0000")
    store.write(path, "touch", arrays, {"seed": 0, "made_from": {}, "sensor": DIGIT.description()})
    row = f"{subject.name},{subject.class_name},train,batch-0000"
    (folder / "catalogue.csv").write_text(f"object,class,split,batch\n{row}\n")
    return read_touches(Dataset(folder, ["touch"]), "train")


@CASES.case("an image and readings of one colour", "models")
def one_colour(subject: Subject) -> Iterator[Finding]:
    """Feature maps without variance, by which normalisation divides."""
    baseline, batch, truth = model_and_batch(subject)
    batch |= {"image": torch.full_like(batch["image"], 1.0)}
    batch["reading"] = torch.full((2, 4 * GRASPS, 3, RESOLUTION, RESOLUTION), 0.3)
    batch["rotation"] = torch.eye(3).expand(2, 4 * GRASPS, 3, 3)
    torch.manual_seed(0)
    for model in (baseline, Reconstruction(replace(EXPERIMENT, strategy="sphere"), LAYERS)):
        vertices = model(batch)
        wrong = backward_nonfinite(loss_of(model, vertices, truth), model, vertices)
        yield equal(f"{model.experiment.strategy}: NaN or infinite", wrong, 0)


@CASES.case("vertices at the camera and behind it", "models")
def at_the_camera(subject: Subject) -> Iterator[Finding]:
    """Perspective projection divides by depth, and early in training a vertex may be anywhere."""
    size = 256
    camera = relative_camera(torch.from_numpy(paper_camera(size).matrix()), size)
    centre = -torch.linalg.solve(camera[:, :3], camera[:, 3])
    ahead = torch.linalg.solve(camera[:, :3], torch.tensor([0, 0, 1.0], dtype=torch.float64))
    steps = torch.tensor([0, 1e-12, -1e-12, -1.0, 1e6, -1e6], dtype=torch.float64)
    places = (centre + steps[:, None] * ahead).float()[:, None].requires_grad_()
    maps = [torch.rand(1, 4, 16, 16, generator=seeded())]
    features = PerceptualPooling()(maps, places, camera.float(), size)
    features.sum().backward()
    yield equal("NaN or infinite features and gradients", count_nonfinite(features.detach(), places.grad), 0)
    yield at_most("largest feature", float(features.detach().abs().max()), 1.0)


@CASES.case("bfloat16", "training")
def bfloat16(subject: Subject) -> Iterator[Finding]:
    """Autocast, forward and backward, against float32; weights in bfloat16 raise an error."""
    model, batch, truth = model_and_batch(subject)
    found = {}
    for enabled in (False, True):
        model.zero_grad()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=enabled):
            vertices = model(batch).float()
        loss = loss_of(model, vertices, truth)
        loss.backward()
        found[enabled] = vertices.detach(), float(loss.detach()), gradients(model)
    (baseline, loss, gradient), (half, half_loss, half_gradient) = found[False], found[True]
    yield equal("NaN or infinite", count_nonfinite(half, half_gradient), 0)
    moved = 1e3 * float((half - baseline).norm(dim=2).square().mean().sqrt())
    yield at_most("root mean square of vertices moved", moved, 1.0, "mm")
    yield at_most("loss: relative error", relative(half_loss, loss), 0.02)
    yield at_least("cosine of the gradients", float(torch.cosine_similarity(half_gradient, gradient, dim=0)), 0.95)
    torch.manual_seed(0)
    network, reading = TouchDepth(8).eval(), torch.rand(2, 3, RESOLUTION, RESOLUTION, generator=seeded())
    with torch.inference_mode():
        depth = network(reading)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            error = 1e3 * float((network(reading).float() - depth).abs().mean())
    yield at_most("U-Net: mean error of the depth", error, 0.02, "mm")
    with TemporaryDirectory() as name:
        refused = lambda: short_training(Path(name), subject, precision="bf16-true")  # noqa: E731
        yield rejects("weights in bfloat16", refused, ValueError, "choose one of 32-true")


@CASES.case("bfloat16: a short training", "training", short=False)
def trained_in_bfloat16(subject: Subject) -> Iterator[Finding]:
    """40 steps in autocast reduce the loss as much as in float32.

    The final losses of two trainings differ by chance by a tenth: rounding changes which faces are sampled.
    """
    with TemporaryDirectory() as name:
        baseline, half = (
            short_training(Path(name) / precision, subject, precision=precision, steps=40)[1]
            for precision in ("32-true", "bf16-mixed")
        )
    share = (baseline[0] - min(half)) / (baseline[0] - min(baseline))
    yield at_least("fall of the validation loss, of float32's", share, 0.95)


@CASES.case("loss times 1e-6 to 1e6: its gradient", "training")
def scaled_gradients(subject: Subject) -> Iterator[Finding]:
    """A power of two scales every gradient exactly, unless a number leaves float32's range."""
    model, batch, truth = model_and_batch(subject)
    loss = loss_of(model, model(batch), truth)

    def of(scale: float) -> Tensor:
        model.zero_grad()
        (scale * loss).backward(retain_graph=True)
        return gradients(model)

    baseline = of(1.0)
    for power in (-20, 20):
        changed = int((of(2.0**power) / 2.0**power != baseline).sum())
        yield equal(f"times 2^{power}: gradients that change, of {len(baseline)}", changed, 0)
    yield at_least("smallest gradient that is not 0", float(baseline[baseline != 0].abs().min()), 2.0**-106)


@CASES.case("loss times 1e-6 to 1e6: what is learnt", "training", short=False)
def scaled_training(subject: Subject) -> Iterator[Finding]:
    """Adam cancels the scale of the loss, but for its epsilon of 1e-8. Clipping, which cancels all of it, is off."""
    settings = {"steps": 24, "evaluate_every": 24, "clip": None}
    one, down, up = 1.0, 2.0**-20, 2.0**20
    reached = {}
    with TemporaryDirectory() as name:
        for scale, epsilon in ((one, one), (down, one), (2.0**-10, one), (up, one), (down, down), (up, up)):
            folder, change = Path(name) / f"{scale:g} {epsilon:g}", lambda losses, scale=scale: scale * losses
            reached[scale, epsilon] = short_training(folder, subject, change, epsilon=epsilon, **settings)
    loss, weights = reached[one, one][0]["validation_loss"], reached[one, one][2]
    for (scale, epsilon), (summary, _, found) in reached.items():
        if scale == one:
            continue
        what = f"times 2^{np.log2(scale):.0f}"
        if epsilon != one:
            largest = float((found - weights).abs().max())
            yield at_most(f"{what}, and epsilon with it: largest change of a weight", largest, 1e-6)
        else:
            # Where small gradients are no longer far above epsilon, the weights differ, but the loss is no worse.
            yield at_most(f"{what}: validation loss, of that at 1", summary["validation_loss"] / loss, 1.25)


class LogCapture(logging.Handler):
    """Captures warnings of one logger."""

    def __init__(self, name: str):
        super().__init__(logging.WARNING)
        self.messages: list[str] = []
        self.logger = logging.getLogger(name)

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())

    def __enter__(self) -> "LogCapture":
        self.logger.addHandler(self)
        return self

    def __exit__(self, *_: Any) -> None:
        self.logger.removeHandler(self)


@CASES.case("one step's loss times 1e6", "training", short=False)
def spike(subject: Subject) -> Iterator[Finding]:
    """With clipping the step has no lasting effect; without, the best model before it is kept."""

    def spiked(losses: Tensor) -> Tensor:
        return 2.0**20 * losses

    at, every = 20, SETTINGS.evaluate_every
    before = at // every  # evaluations
    with TemporaryDirectory() as name, LogCapture("palpate.training.learners") as log:
        folder = Path(name)
        baseline = short_training(folder / "plain", subject, steps=48)[1]
        history = short_training(folder / "hit", subject, spiked, at, steps=48)[1]
        yield at_most("clipped: loss after it, of that without", history[before] / baseline[before], 1.01)
        yield at_most("clipped: last loss, of that before it", history[-1] / history[before - 1], 0.5)
        yield equal("clipped: warnings", len(log.messages), 0)
        summary, history, weights = short_training(folder / "free", subject, spiked, at, steps=48, clip=None)
    yield at_most("not clipped: kept, of the best before", summary["validation_loss"] / min(history[:before]), 1.0)
    yield equal("not clipped: NaN or infinite weights and losses", count_nonfinite(weights, torch.tensor(history)), 0)
    worse = history[-1] / min(history[:before])
    warned = [line for line in log.messages if f"in step {at}: {subject.name}" in line]
    note = f"without clipping the last loss is {worse:.1f} times the best before; {'; '.join(warned)}"
    yield equal("not clipped: warnings that name the sample", len(warned), 1, note=note)


class Infinite(torch.autograd.Function):
    """Identity with an infinite gradient."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        return values.clone()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        return gradient * torch.inf


@CASES.case("a step whose loss or gradient is not finite", "training")
def diverging(subject: Subject) -> Iterator[Finding]:
    """Training stops before a weight changes, and names the sample; the best model so far is kept."""
    # Step 7 is the last before a validation. Clipping would turn an infinite gradient into NaN.
    changes = {
        "NaN loss": (lambda losses: losses * torch.nan, 6, 1.0),
        "infinite gradient": (Infinite.apply, 6, 1.0),
        "infinite gradient, not clipped": (Infinite.apply, 6, None),
        "infinite gradient before a validation": (Infinite.apply, 7, 1.0),
        "infinite gradient before a validation, not clipped": (Infinite.apply, 7, None),
    }
    for what, (change, step, clip) in changes.items():
        named = rf"(loss|gradient) is NaN or infinite.*step {step}.*{subject.name}.*best model so far is"
        with TemporaryDirectory() as name:
            folder = Path(name)
            run = partial(short_training, folder, subject, change, step, clip=clip)
            yield rejects(what, run, Diverged, named)
            yield equal(f"{what}: models written", int((folder / "model").exists()), 0)
            kept = weights_of(folder / "work/best.ckpt")
            yield equal(f"{what}: NaN or infinite weights kept", count_nonfinite(kept), 0)
            last = torch.load(folder / "work/last.ckpt", weights_only=False)["state_dict"]
            wrong = count_nonfinite(*(values for values in last.values() if values.is_floating_point()))
            yield equal(f"{what}: NaN or infinite weights to go on from", wrong, 0)
    with TemporaryDirectory() as name:
        run = partial(short_training, Path(name), subject, rate=1e30, clip=None)
        yield rejects("rate 1e30", run, Diverged, "NaN or inf")
