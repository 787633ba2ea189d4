"""A run's dataset in the layout of the authors' released dataset."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from palpate import stages
from palpate.atomic import atomic_write
from palpate.camera import paper_camera
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.released.arrays import SENSORS, SHEET_IN_CHART
from palpate.released.layout import EMPTY_READING, SPLITS, ReleasedObject
from palpate.sensor import DIGIT
from palpate.store.files import StoreError

# That an exported object must have come through.
STAGES = tuple(each for each in stages.DATASET_STORES if not stages.STAGES[each].simulated)
NOTHING = 1.0  # m, their depth where nothing is in range: their loader cuts at 1


def export(dataset, folder: Path | str) -> int:
    """Write a dataset's surfaces, images and touches in the layout of the released dataset; sheets if it has charts.

    dataset: a `palpate.Dataset` of the stages `STAGES`. folder: written atomically. Returns the number of objects.
    Raises StoreError without objects, surface, touch or vision, or if the run has other sensors, cameras or a
    transparent background.
    """
    if not len(dataset):
        raise StoreError(f"{dataset!r}: no object with surface, touch and vision: nothing to export")
    difference, sensors = DIGIT.geometry_difference(dataset.sensor), dataset.array("touch", "success").shape[2]
    if difference or sensors != SENSORS:
        raise StoreError(
            f"{dataset!r}: the released layout holds {SENSORS} sensors a grasp, as the DIGIT; this run has {sensors}, "
            f"{dataset.sensor.name}{f' ({difference})' if difference else ''}: it can't be exported"
        )
    _require_paper_camera(dataset)
    with atomic_write(Path(folder)) as root:
        splits: dict[str, list[str]] = {name: [] for name in SPLITS}
        theirs = {ours: name for name, ours in SPLITS.items()}
        for record in dataset:
            entry = ReleasedObject(record.class_name, record.name.removeprefix(f"{record.class_name}-"))
            _export_object(record, root, entry, "charts" in dataset.stages)
            splits[theirs[record.split]].append(entry.split_name)
        _save(root / "split.npy", splits)
        _save(root / EMPTY_READING, dataset.empty_reading.transpose(1, 0, 2))
    return len(dataset)


def _require_paper_camera(dataset) -> None:
    """Raise StoreError if images are not as the layout, which states no camera, takes them to be."""
    *_, size, channels = dataset.array("vision", "unoccluded").shape
    found, paper = dataset.cameras(), paper_camera(size).matrix()
    if found.shape[1] != 1 or not np.allclose(found, paper, rtol=1e-6):
        raise StoreError(
            f"{dataset!r}: the authors' layout has images of the paper's one camera, but this run has "
            f"{'others' if found.shape[1] == 1 else found.shape[1]}: export a run with vision.cameras null"
        )
    if channels != 3:
        raise StoreError(f"{dataset!r}: the authors' layout has opaque images: export a run with a vision.background")


def _export_object(record, root: Path, entry: ReleasedObject, charts: bool) -> None:
    """Write the files of one object record of a dataset below `root`."""
    _save(entry.surface(root), (record.points.astype(np.float64) - OBJECT_POSITION) / DIAGONAL)
    entry.image(root).parent.mkdir(parents=True)
    Image.fromarray(record.unoccluded).save(entry.image(root))
    for number, grasp in enumerate(record.grasps):
        Image.fromarray(grasp.occluded).save(entry.image(root, number))
        depth = np.where(np.isfinite(grasp.depth), grasp.depth, np.float32(NOTHING))
        with warnings.catch_warnings():  # where several angles give the same rotation, any will do
            warnings.simplefilter("ignore", UserWarning)
            angles = Rotation.from_matrix(grasp.rotation).as_euler("xyz")  # about fixed x, then y, then z
        scene = {
            "touch_success": grasp.success,
            "cam_pos": grasp.position,
            "cam_rot": angles,
            "depth": list(depth.transpose(0, 2, 1)),
            "gel": list(grasp.reading.transpose(0, 2, 1, 3)),
            "points": list(grasp.points),
        }
        _save(entry.scene(root, number), scene)
        for sensor in range(SENSORS) if charts else ():
            sheet = grasp.vertices[sensor][SHEET_IN_CHART] if grasp.success[sensor] else np.zeros(1)
            _save(entry.sheet(root, number, sensor), sheet)


def _save(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, value)
