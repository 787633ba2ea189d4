"""Errors of trained models on every object of a split, every ring around its touches, and every touch."""

import logging
import time
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from palpate.batch import progress
from palpate.charts import build_tree, chamfer_distance, face_areas, sample_faces, touch_chart
from palpate.dataset import Dataset
from palpate.dataset.reader import GraspRecord
from palpate.experiments import SPLITS, Experiment
from palpate.learning import checkpoints
from palpate.learning.data import ExperimentData
from palpate.learning.inputs import INPUTS
from palpate.learning.machine import Machine
from palpate.learning.metrics import ring_distances, score, seeded
from palpate.learning.rings import SAMPLES, ring_points
from palpate.learning.rows import COLUMNS, RING_COLUMNS, TOUCH_COLUMNS, EvaluationError
from palpate.learning.samples import Assembler, Sample, in_batches, windows
from palpate.learning.surface_quality import surface_quality, topology
from palpate.learning.touch_charts import masked_clouds, predict_depth
from palpate.models import Reconstruction, SingleImageModel, TouchDepth
from palpate.models.retrieval import Objects, Retrieval
from palpate.protocol import CHAMFER_SCALE, RINGS
from palpate.rebuild_command import rebuild_command
from palpate.seal import DamagedFile
from palpate.sensor import DIGIT
from palpate.text_files import read_record

log = logging.getLogger(__name__)

BATCH_SIZE = 8  # samples that a model predicts together
POINTS = 10_000  # on a prediction, and on the truth (the published evaluation)
Mesh = tuple[Tensor, Tensor]  # vertices (V, 3) m, world frame, and faces (F, 3), of points none


class Trained(NamedTuple):
    """A trained model, with its experiment, seed, training steps and device."""

    model: Reconstruction | SingleImageModel | Retrieval
    experiment: Experiment
    seed: int
    steps: int
    device: torch.device = torch.device("cpu")


def load(model: Path | str, summary: Path | str, experiment: Experiment, seed: int, device: str) -> Trained:
    """A model from its `best.ckpt` and `training.json`; device: `auto`, `cpu`, `gpu`. Raises what `checkpoints.load`
    does."""
    on = Machine(device).torch_device()
    return Trained(checkpoints.load(model, experiment).to(on), experiment, seed, training_steps(summary), on)


def retrieval(run: Path | str, experiment: Experiment, seed: int) -> Trained:
    """The baseline of strategy `retrieval`, from the objects of a run's train split. Nothing is trained."""
    sensor = Dataset(run, ["touch"]).sensor if experiment.touch else DIGIT
    model = Retrieval(_training_objects(run, experiment.has_vision), experiment.correction, sensor)
    return Trained(model, experiment, seed, steps=0)


@cache
def _training_objects(run: Path | str, has_vision: bool) -> Objects:
    arrays = [INPUTS[name] for name in ("points", *["unoccluded_silhouette"] * has_vision)]
    data = ExperimentData.read(Dataset(run, [item.stage for item in arrays]), arrays, ["train"])
    return Objects(*(torch.from_numpy(data[item.name]) for item in arrays))


def training_steps(summary: Path | str) -> int:
    """Training steps, from a `training.json`. Raises EvaluationError if it is missing, damaged, or says none."""
    try:
        return int(read_record(summary)["steps"])
    except DamagedFile as error:
        raise EvaluationError(str(error)) from None
    except (KeyError, TypeError, ValueError):
        remedy = f"remove it and train the model again with: {rebuild_command(Path(summary))}"
        raise EvaluationError(f"{summary} does not say how many steps were trained; {remedy}") from None


def evaluate(
    trained: Trained, data: ExperimentData, points: int = POINTS, splits: Sequence[str] = SPLITS
) -> pd.DataFrame:
    """Score every sample (`palpate.learning.samples.windows`) of some splits: `rows.COLUMNS`, a row a sample. `points`
    are sampled on the predicted mesh, by random numbers of the object only. `seconds` is the prediction's time, an
    equal share of its batch's. Raises EvaluationError, naming the object, for a prediction that is not finite."""
    rows, last = [], None
    surface = topology(trained.experiment.plan.start)
    for sample, (vertices, faces), seconds in predictions(trained, data, splits):
        if last != sample.object:
            tree, last = build_tree(torch.from_numpy(data["points"][sample.object])), sample.object
        scores = score(points_on(vertices, faces, points, data.objects[sample.object]), tree)
        quality = surface_quality(vertices.cpu().numpy(), surface, tree)
        rows.append(row_of(trained, data, sample) | scores._asdict() | quality._asdict() | {"seconds": seconds})
    return pd.DataFrame(rows, columns=COLUMNS)


def evaluate_rings(
    trained: Trained, data: ExperimentData, dataset: Dataset, splits: Sequence[str], points: int = SAMPLES
) -> pd.DataFrame:
    """Distances from the true surface in the rings around each touch to the predictions: `rows.RING_COLUMNS`, a row for
    each sample, successful touch of its grasps (or of all, if no input depends on a grasp) and ring. `distance` (m^2)
    is nan for a ring without surface. dataset: the run's, with its stores of touch and rings."""
    rows, last = [], None
    touches: list[dict[int, list[np.ndarray]]] = []  # of each grasp, by sensor, the true points of the rings around it
    for sample, mesh, _ in predictions(trained, data, splits):
        name = data.objects[sample.object]
        if last != name:
            last, touches = name, []
            for record in dataset[name].grasps:
                sensors = np.flatnonzero(record.success)
                seen = zip(record.ring_depth[sensors], record.position[sensors], record.rotation[sensors], strict=True)
                touches.append({s: ring_points(*each, dataset.sensor) for s, each in zip(sensors, seen, strict=True)})
        # An object's touches in one search: its prediction and the search's start cost as much as a touch.
        numbers = sample.grasps or range(len(touches))
        chosen = [(number, sensor) for number in numbers for sensor in touches[number]]
        rings = [ring for number, sensor in chosen for ring in touches[number][sensor]]
        distances = ring_distances(rings, points_on(*mesh, points, name))
        places = ((*touch, ring) for touch in chosen for ring in RINGS)
        for (grasp, sensor, ring), in_ring, distance in zip(places, rings, distances, strict=True):
            ring_row = {"grasp": grasp, "sensor": sensor, "ring": ring, "points": len(in_ring), "distance": distance}
            rows.append(row_of(trained, data, sample) | ring_row)
    return pd.DataFrame(rows, columns=RING_COLUMNS)


def predictions(trained: Trained, data: ExperimentData, splits: Sequence[str]) -> Iterator[tuple[Sample, Mesh, float]]:
    """Each sample of some splits with what is predicted, and the seconds it took. Raises EvaluationError if there is no
    object, and what `predict` raises; CheckpointError if the touches are of another sensor."""
    model, experiment = trained.model, trained.experiment
    samples = windows(data, experiment, *splits)
    if not samples:
        missing = f"no object in {' or '.join(splits)}"
        raise EvaluationError(f"{data.source}: {missing}: more objects are needed (config classes)")
    if experiment.touch:
        sensors = model.hand_sensors, model.sensor, data.hand_sensors, data.sensor
        checkpoints.require_sensor(*sensors, f"model {experiment.name}")
    assemble, label = Assembler(data, experiment, trained.device), f"{experiment.name} seed {trained.seed}"
    bar = progress(total=len(samples), desc=label, unit="sample")
    # Together are samples of one object where it has several, else of several objects.
    by_object = [list(group) for _, group in groupby(samples, lambda sample: sample.object)]
    groups = by_object if len(samples) > len(by_object) else [samples]
    done = 0
    for chosen in (batch for group in groups for batch in in_batches(group, BATCH_SIZE)):
        start = time.perf_counter()
        meshes = predict(trained, assemble, chosen, data)
        seconds = (time.perf_counter() - start) / len(chosen)
        yield from ((sample, mesh, seconds) for sample, mesh in zip(chosen, meshes, strict=True))
        bar.update(len(chosen))
        done += len(chosen)
        log.info("%s: %d of %d samples", label, done, len(samples))
    bar.close()


def predict(trained: Trained, assemble: Assembler, chosen: Sequence[Sample], data: ExperimentData) -> list[Mesh]:
    """What a model predicts of samples that have as many grasps each. Raises EvaluationError, naming the object, if a
    prediction is not finite."""
    batch = assemble(chosen)
    one_image = len({(sample.object, sample.view) for sample in chosen}) == 1
    if trained.experiment.vision == "unoccluded" and one_image and "image" in batch:
        batch["image"] = batch["image"][:1].expand_as(batch["image"])  # encoded once
    with torch.inference_mode():
        meshes = trained.model.meshes(batch)
    if trained.device.type == "cuda":
        torch.cuda.synchronize()
    for sample, (vertices, _) in zip(chosen, meshes, strict=True):
        if not torch.isfinite(vertices).all():
            label, name = f"{trained.experiment.name} seed {trained.seed}", data.objects[sample.object]
            raise EvaluationError(f"{label}: the prediction for {name} is not finite; train it again")
    return meshes


def points_on(vertices: Tensor, faces: Tensor, count: int, name: str) -> Tensor:
    """(count, 3) points on a mesh, or its vertices if it has no faces; random by the object's name only."""
    return sample_faces(vertices[None], faces, count, seeded(0, name, "evaluation"))[0] if len(faces) else vertices


def row_of(trained: Trained, data: ExperimentData, sample: Sample) -> dict[str, Any]:
    return {
        "experiment": trained.experiment.name,
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
    """Score the local predictions at every successful touch of some splits: `rows.TOUCH_COLUMNS`. `cloud` is the
    Chamfer distance (m^2 x 9000) of the predicted local cloud (the pixels that differ from the untouched reading) to
    the true one; `chart` that of `points` on the touch chart. model: trained for `steps`. dataset: with its stores of
    touch and charts. Raises EvaluationError if there is no touch; CheckpointError for another sensor's."""
    checkpoints.require_sensor(None, model.sensor, None, dataset.sensor, "the model of touches")
    records = [record for record in dataset if record.split in splits]
    rows, empty = [], dataset.empty_reading
    for record in progress(records, desc="touch depth", unit="object"):
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


def _local_scores(
    model: TouchDepth, grasp: GraspRecord, sensors: np.ndarray, empty: np.ndarray, points: int, draw: torch.Generator
) -> tuple[list[float], list[float]]:
    """Errors (m^2 x 9000) of the clouds and of the charts of some sensors of one grasp."""
    if not len(sensors):
        return [], []
    device, size = next(model.parameters()).device, model.sensor.size
    depth, valid = predict_depth(model, grasp.reading[sensors], empty)
    true = torch.from_numpy(grasp.depth[sensors]).to(device)
    clouds, truths = masked_clouds(depth, valid, size), masked_clouds(true, torch.isfinite(true), size)
    charts, faces = torch.from_numpy(grasp.vertices[sensors]).to(device), touch_chart().faces.to(device)
    has_area = face_areas(charts[:, faces]).sum(dim=1) > 0
    sampled = iter(sample_faces(charts[has_area], faces, points, draw))
    # A contact of one pixel gives a chart without area; its vertices are then its points.
    on_charts = [next(sampled) if area else chart for chart, area in zip(charts, has_area, strict=True)]
    world = [torch.from_numpy(grasp.points[sensor]).to(device) for sensor in sensors]
    of_clouds, of_charts = chamfer_distance(clouds, truths), chamfer_distance(on_charts, world)
    return (CHAMFER_SCALE * of_clouds).tolist(), (CHAMFER_SCALE * of_charts).tolist()
