"""Errors of trained models on every object of a split, every ring around its touches, and every touch."""

import logging
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from torch import Tensor
from tqdm import tqdm

from palpate import checksums, training
from palpate.charts import build_tree, chamfer_distance, face_areas, sample_faces, touch_chart
from palpate.dataset import Dataset
from palpate.dataset.reader import GraspRecord, ObjectRecord
from palpate.evaluation.metrics import score, seeded
from palpate.evaluation.rings import SAMPLES, ring_distances, ring_points
from palpate.evaluation.rows import COLUMNS, RING_COLUMNS, TOUCH_COLUMNS, EvaluationError
from palpate.evaluation.surface_quality import surface_quality, topology
from palpate.experiments import SPLITS
from palpate.models import Reconstruction, SingleImageModel, TouchDepth
from palpate.protocol import CHAMFER_SCALE, RINGS
from palpate.rebuild_command import rebuild_command
from palpate.sensor import Sensor
from palpate.training import Assembler, Machine, Sample, TrainingData, windows
from palpate.training.checkpoints import require_sensor
from palpate.training.losses import sheet
from palpate.training.touches import channels_first, predict_depth

log = logging.getLogger(__name__)

BATCH_SIZE = 8  # samples that a model predicts together
POINTS = 10_000  # on a prediction, and on the truth (the published evaluation)


class Trained(NamedTuple):
    """A trained model, with its experiment's name and row, seed, training steps and device."""

    model: Reconstruction | SingleImageModel
    name: str
    experiment: Mapping[str, Any]
    seed: int
    steps: int
    device: torch.device = torch.device("cpu")


def load(
    model: Path | str, summary: Path | str, name: str, experiment: Mapping[str, Any], seed: int, device: str
) -> Trained:
    """A model from its `best.ckpt` and `training.json`; device: `auto`, `cpu` or `gpu`.

    Raises what `palpate.training.load` raises for a checkpoint of another experiment or schema version.
    """
    on = Machine(device).torch_device()
    trained = training.load(model, experiment).to(on)
    return Trained(trained, name, experiment, seed, training_steps(summary), on)


def training_steps(summary: Path | str) -> int:
    """Number of training steps of a model, from its `training.json`.

    Raises EvaluationError, naming the file and the remedy, if it is missing, damaged or does not say.
    """
    summary = Path(summary)
    remedy = f"remove it and train the model again with: {rebuild_command(summary)}"
    try:
        return int(checksums.read_record(summary, remedy)["steps"])
    except checksums.DamagedFile as error:
        raise EvaluationError(str(error)) from None
    except (KeyError, TypeError, ValueError):
        raise EvaluationError(f"{summary} does not say how many steps were trained; {remedy}") from None


def evaluate(
    trained: Trained, data: TrainingData, points: int = POINTS, splits: Sequence[str] = SPLITS
) -> pd.DataFrame:
    """Score every sample of some splits: `rows.COLUMNS`, a row a sample.

    A sample is an object with a window of its grasps, and a view or camera (see `palpate.training.windows`).
    `points` are sampled on the predicted mesh, from random numbers that depend on the object only, so that
    models differ by their meshes only. `seconds` is the prediction's time, an equal share of its batch's. Raises
    EvaluationError, naming the object, for a prediction that is not finite.
    """
    rows, last = [], None
    surface = topology(trained.experiment["strategy"])
    for sample, vertices, seconds in predictions(trained, data, splits):
        name = data.objects[sample.object]
        if last != sample.object:
            cloud, last = torch.from_numpy(data["points"][sample.object]).to(trained.device), sample.object
            tree = build_tree(cloud)
        scores = score(_sampled(trained, vertices, points, name), cloud, tree)
        quality = surface_quality(vertices.cpu().numpy(), surface, tree)
        rows.append(_row(trained, data, sample) | scores._asdict() | quality._asdict() | {"seconds": seconds})
    return pd.DataFrame(rows, columns=COLUMNS)


def evaluate_rings(
    trained: Trained, data: TrainingData, dataset: Dataset, splits: Sequence[str], points: int = SAMPLES
) -> pd.DataFrame:
    """Distances from the true surface in the rings around each touch to the predictions of some splits.

    Columns `rows.RING_COLUMNS`; a row for each sample, successful touch and ring. The touches are those of the
    sample's grasps, or of all grasps if no input of the model depends on a grasp.
    dataset: the run's, with its stores of touch and rings. `distance` (m^2) is nan for a ring without surface.
    """
    rows, touches, last = [], [], None
    for sample, vertices, _ in predictions(trained, data, splits):
        name = data.objects[sample.object]
        if last != name:
            touches, last = _touches(dataset[name], dataset.sensor), name
        # An object's touches in one search: its prediction and the search's start cost as much as a touch.
        numbers = sample.grasps or range(len(touches))
        chosen = [touch for number in numbers for touch in touches[number]]
        rings = [ring for touch in chosen for ring in touch.rings]
        distances = ring_distances(rings, _sampled(trained, vertices, points, name))
        of_sample = _row(trained, data, sample)
        places = ((touch, ring) for touch in chosen for ring in RINGS)
        for (touch, ring), in_ring, distance in zip(places, rings, distances, strict=True):
            of_ring = {"grasp": touch.grasp, "sensor": touch.sensor, "ring": ring}
            rows.append(of_sample | of_ring | {"points": len(in_ring), "distance": distance})
    return pd.DataFrame(rows, columns=RING_COLUMNS)


class _Touch(NamedTuple):
    """A successful touch and the true surface points of the rings around it."""

    grasp: int
    sensor: int
    rings: list[np.ndarray]


def _touches(item: ObjectRecord, kind: Sensor) -> list[list[_Touch]]:
    """The successful touches of each grasp of an object, of a kind of sensor."""
    found = []
    for number, grasp in enumerate(item.grasps):
        poses = {sensor: (grasp.position[sensor], grasp.rotation[sensor]) for sensor in np.flatnonzero(grasp.success)}
        found.append(
            [
                _Touch(number, sensor, ring_points(grasp.ring_depth[sensor], *pose, kind))
                for sensor, pose in poses.items()
            ]
        )
    return found


def predictions(trained: Trained, data: TrainingData, splits: Sequence[str]) -> Iterator[tuple[Sample, Tensor, float]]:
    """Each sample of some splits with what the model predicts, its vertices (V, 3), and the seconds it took.

    Of the published single-image networks: what their `stages` describe.
    Raises EvaluationError if there is no object, or a prediction is not finite; CheckpointError if the touches are of
    another sensor than the model's.
    """
    samples = windows(data, trained.experiment, *splits)
    if not samples:
        raise EvaluationError(
            f"{data.source}: no object in {' or '.join(splits)}: more objects are needed (config classes)"
        )
    model = trained.model
    if trained.experiment["touch"]:
        require_sensor(model.hand_sensors, model.sensor, data.hand_sensors, data.sensor, f"model {trained.name}")
    assemble = Assembler(data, trained.experiment, trained.device)
    label = f"{trained.name} seed {trained.seed}"
    bar = tqdm(total=len(samples), desc=label, unit="sample", disable=not sys.stderr.isatty())
    done = 0
    for part in _batches(samples):
        start = time.perf_counter()
        batch = assemble(part)
        one_image = len({(sample.object, sample.view) for sample in part}) == 1
        if trained.experiment["vision"] == "unoccluded" and one_image:
            batch["image"] = batch["image"][:1].expand_as(batch["image"])  # encoded once
        with torch.inference_mode():
            vertices = trained.model(batch).float()
        if trained.device.type == "cuda":
            torch.cuda.synchronize()
        seconds = (time.perf_counter() - start) / len(part)
        for sample, predicted in zip(part, vertices, strict=True):
            if not torch.isfinite(predicted).all():
                raise EvaluationError(
                    f"{label}: the prediction for {data.objects[sample.object]} is not finite; train it again"
                )
            yield sample, predicted, seconds
        bar.update(len(part))
        done += len(part)
        log.info("%s: %d of %d samples", label, done, len(samples))
    bar.close()


def _batches(samples: Sequence[Sample]) -> Iterator[list[Sample]]:
    """Samples that are predicted together: of one object where it has several, else of several objects."""
    of_objects = [list(group) for _, group in groupby(samples, lambda sample: sample.object)]
    for left in map(iter, of_objects if len(samples) > len(of_objects) else [samples]):
        while part := list(islice(left, BATCH_SIZE)):
            yield part


def _sampled(trained: Trained, prediction: Tensor, count: int, name: str) -> Tensor:
    """(count, 3) points on the mesh, from random numbers that depend on the object's name only.

    Of a model that predicts points, these as they are.
    """
    return trained.model.sample(prediction[None], count, seeded(0, name, "evaluation"))[0]


def _row(trained: Trained, data: TrainingData, sample: Sample) -> dict[str, Any]:
    return {
        "experiment": trained.name,
        "seed": trained.seed,
        "object": data.objects[sample.object],
        "class": data.classes[sample.object],
        "split": data.splits[sample.object],
        "window": sample.window,
        "steps": trained.steps,
    }


def evaluate_touch(
    model: TouchDepth, steps: int, dataset: Dataset, points: int = POINTS, splits: Sequence[str] = SPLITS
) -> pd.DataFrame:
    """Score the local predictions at every successful touch of some splits: `rows.TOUCH_COLUMNS`.

    `cloud` is the Chamfer distance (m^2 x 9000) of the predicted local cloud (the pixels whose reading
    differs from the untouched one, at the predicted depth) to the true one; `chart` that of `points` sampled
    on the touch chart that was fitted to it.

    Args:
        model: in evaluation mode, on any device; steps: those it was trained for.
        dataset: the run's, with its stores of touch and charts.

    Raises EvaluationError if these splits have no successful touch; CheckpointError if they are of another sensor.
    """
    require_sensor(None, model.sensor, None, dataset.sensor, "the model of touches")
    records = [record for record in dataset if record.split in splits]
    rows, empty = [], channels_first(dataset.empty_reading)
    for record in tqdm(records, desc="touch depth", unit="object", disable=not sys.stderr.isatty()):
        for grasp in record.grasps:
            sensors = np.flatnonzero(grasp.success)
            draw = seeded(0, record.name, str(grasp.number), "evaluation")
            scores = _local_scores(model, grasp, sensors, empty, points, draw)
            for sensor, cloud, chart in zip(sensors, *scores, strict=True):
                rows.append((record.name, record.class_name, record.split, grasp.number, sensor, cloud, chart, steps))
        log.info("%s: %d touches so far", record.name, len(rows))
    if not rows:
        raise EvaluationError(f"no successful touch in {' or '.join(splits)}: more objects are needed (config classes)")
    return pd.DataFrame(rows, columns=TOUCH_COLUMNS)


def _on_charts(charts: Tensor, points: int, draw: torch.Generator) -> list[Tensor]:
    """So many points on each of touch charts (T, 81, 3); its vertices where a contact of one pixel left it no area."""
    faces = touch_chart().faces.to(charts.device)
    sheets = face_areas(charts[:, faces]).sum(dim=1) > 0
    sampled = iter(sample_faces(charts[sheets], faces, points, draw))
    return [next(sampled) if sheet else chart for chart, sheet in zip(charts, sheets, strict=True)]


def _local_scores(
    model: TouchDepth, grasp: GraspRecord, sensors: np.ndarray, empty: Tensor, points: int, draw: torch.Generator
) -> tuple[list[float], list[float]]:
    """Errors (m^2 x 9000) of the clouds and of the charts of some sensors of one grasp."""
    if not len(sensors):
        return [], []
    device, size = next(model.parameters()).device, model.sensor.size
    depth, valid = predict_depth(model, channels_first(grasp.reading[sensors]).to(device), empty.to(device))
    true = torch.from_numpy(grasp.depth[sensors]).to(device)
    # A distance does not depend on the frame: clouds are compared in the sensor's, charts in the world.
    clouds = [cloud[mask] for cloud, mask in zip(sheet(depth, size), valid, strict=True)]
    truths = [cloud[mask] for cloud, mask in zip(sheet(true, size), torch.isfinite(true), strict=True)]
    chart = torch.from_numpy(grasp.vertices[sensors]).to(device)
    on_charts = _on_charts(chart, points, draw)
    world = [torch.from_numpy(grasp.points[sensor]).to(device) for sensor in sensors]
    scores = chamfer_distance(clouds, truths), chamfer_distance(on_charts, world)
    return tuple((CHAMFER_SCALE * errors).tolist() for errors in scores)
