"""What a run, or one of its objects, holds, in lines for the terminal."""

from collections import Counter

from palpate.catalogue import SPLITS
from palpate.dataset.reader import Dataset, ObjectRecord
from palpate.dataset.summary import summary
from palpate.store.contract import CONTRACT
from palpate.store.files import StoreError


def run_lines(dataset: Dataset) -> list[str]:
    """Objects by class and split, rejections, every array with its shape, models and tables of a dataset's run."""
    folder = dataset.folder
    lines = [f"{folder}: {len(dataset)} objects", *summary(folder)]
    counts = Counter((record.class_name, record.split) for record in dataset)
    lines += [
        f"  {name}: {', '.join(f'{split} {counts[name, split]}' for split in SPLITS if counts[name, split])}"
        for name in dataset.classes
    ]
    for stage in dataset.stages:
        lines.append(f"{stage}:")
        for name, spec in CONTRACT[stage].arrays.items():
            if spec.of_objects and name != "object":
                lines.append(f"  {name} {spec.axes} {_shape(dataset, stage, name)} {spec.dtype} {spec.unit}".rstrip())
    models = sorted(path.parent.relative_to(folder / "models") for path in folder.glob("models/**/best.ckpt"))
    if models:
        lines.append(f"models: {', '.join(map(str, models))}")
    tables = sorted(path.name for path in folder.glob("tables/*.csv"))
    if tables:
        lines.append(f"tables: {', '.join(tables)}")
    return lines


def _shape(dataset: Dataset, stage: str, name: str) -> str:
    """The shape of an array; where its stage is not finished, or it is optional, "not there"."""
    try:
        return str(dataset.array(stage, name).shape)
    except StoreError:
        return "not there"


def object_lines(record: ObjectRecord) -> list[str]:
    """One object's class, split, batch, mesh and grasps."""
    lines = [f"{record.name}: class {record.class_name}, {record.split} split, {record.batch}"]
    if record.mesh.is_dir():
        lines.append(f"meshes: {record.mesh}")
    for grasp in record.grasps if {"touch", "grasps"} & set(record.stages) else ():
        touches = grasp.success if "touch" in record.stages else grasp.touches
        touching = [name for name, success in zip(grasp.sensors, touches, strict=True) if success]
        lines.append(f"grasp {grasp.number}: touched by {', '.join(touching) or 'no sensor'}")
    return lines
