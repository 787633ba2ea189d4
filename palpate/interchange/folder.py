"""An export: samples in one of the layouts, and what every export has beside them (docs/export.md):

objects.csv, meshes/<object>.glb, hand.json, sensor.json, empty_reading.png, cameras.json, figures/*.png,
README.md (the data card), croissant.json, SHA256SUMS, seal.json
"""

import csv
import json
import shutil
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from palpate import seal
from palpate.atomic import atomic_write
from palpate.catalogue import file_name
from palpate.dataset import Dataset, ObjectRecord
from palpate.hand import Hand
from palpate.interchange.card import spdx, write_card
from palpate.interchange.croissant import write_croissant
from palpate.interchange.layouts import CARD, FORMATS, Contents, png, samples_by_split
from palpate.mesh import mesh_file
from palpate.store.contract import CONTRACT, FRAMES, UNITS
from palpate.store.files import StoreError

# Of hand.json, besides what `Hand` says of itself.
FRAMES_OF_HAND = (
    "Links and sensors are in the order of the arrays' axes, numbers of links from 0. Position and rotation of a link "
    "are in its parent's frame, with all joints at 0; those of a geom or a sensor in its link's frame. A joint follows "
    "its `joint_driver` by `joint_coupling`, factors of powers 0 to 4. `palm_anchor`: x its normal, z to the fingers."
)
# Of sensor.json.
PIXELS = (
    "in the sensor's frame y = ((column + 0.5) / columns - 0.5) width and z = ((row + 0.5) / rows - 0.5) height are a "
    "pixel's centre; empty_reading.png is the image of the untouched gel"
)


def export(
    dataset: Dataset,
    folder: Path | str,
    layout: str = "webdataset",
    arrays: Iterable[str] | None = None,
    licence: str = "unknown",
    source: str = "",
    samples: str = "grasps",
) -> int:
    """Write the grasps of a dataset in one of `FORMATS`, atomically; the same run gives the same bytes. Returns their
    number.
    folder: a new one, or an empty one. arrays: as for `Dataset.grasps`; without, all of the stages that the run should
    have. licence: as for `spdx`. source: of the meshes, with their terms, as text, verbatim. samples: `grasps`, or
    `presses`. Raises FileExistsError for a folder that holds anything; StoreError without objects, for a store that is
    missing, or for batches with different hands or sensors; KeyError for an unknown array; DamagedFile for a missing or
    changed mesh; and what writing the samples raises."""
    folder = Path(folder)
    _require_new(folder)
    if not source and dataset.config.get("source", {}).get("kind") == "procedural":
        source = "procedural, made by palpate (no one's meshes)"
    splits = samples_by_split(dataset, arrays, samples)
    contents = Contents(dataset, splits, FORMATS[layout], spdx(licence), source)
    if (report := dataset.folder / "reports/validation.csv").exists():
        dataset.require_current(report)
    digests = dataset.digests(None if arrays is None else {stage for stage, _ in contents.grasps.sources.values()})
    inputs = [dataset.folder / CONTRACT[stage].path(batch) for stage, batch in digests]
    inputs.append(dataset.folder / "catalogue.csv")
    with atomic_write(folder) as partial:
        partial.mkdir()
        _write_descriptions(partial, dataset, samples)
        contents.layout.write(partial, splits)
        with (partial / "objects.csv").open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(["object", "class", "split", "mesh"])
            for record in dataset:
                mesh = ""  # a released dataset has none
                if "grasps" in dataset.stages:
                    mesh = f"meshes/{record.name}.glb"
                    (partial / "meshes").mkdir(exist_ok=True)
                    shutil.copyfile(mesh_file(record.mesh, "visual.glb"), partial / mesh)
                table.writerow([record.name, record.class_name, record.split, mesh])
        names = ["data_point.png", *(f"examples_{file_name(name)}.png" for name in dataset.classes)]
        for figure in filter(Path.is_file, (dataset.folder / "figures" / name for name in names)):
            dataset.require_current(figure)
            (partial / "figures").mkdir(exist_ok=True)
            shutil.copyfile(figure, partial / "figures" / figure.name)
        files = sorted(filter(Path.is_file, partial.rglob("*")))
        with ThreadPoolExecutor(2) as pool:
            sums = pool.map(seal.size_and_sha256, files)
            manifest = dict(zip((path.relative_to(partial).as_posix() for path in files), sums, strict=True))
        write_croissant(partial / "croissant.json", contents, manifest)
        write_card(partial / CARD, contents, digests)
        manifest |= {name: seal.size_and_sha256(partial / name) for name in ("croissant.json", CARD)}
        lines = [f"{digest}  {name}\n" for name, (_, digest) in sorted(manifest.items())]
        (partial / "SHA256SUMS").write_text("".join(lines))
        manifest["SHA256SUMS"] = seal.size_and_sha256(partial / "SHA256SUMS")
        seal.write(partial, seal.made_of(inputs), manifest)
        _require_new(folder)  # still
    return sum(map(len, splits.values()))


def _require_new(folder: Path) -> None:
    """Raise FileExistsError for a file, or a folder with anything in it: no one's data are replaced."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise FileExistsError(f"{folder} exists: name a new folder, or remove it")


def _write_descriptions(folder: Path, dataset: Dataset, samples: str) -> None:
    """Write hand, sensor, untouched reading and cameras; StoreError if batches have different hands or sensors."""
    stages, records = dataset.stages, [*{record.batch: record for record in dataset}.values()]
    first, *others = [_hand_and_sensor(record, stages) for record in records]
    for record, other in zip(records[1:], others, strict=True):
        if different := [name for name in first if other[name] != first[name]]:
            grasps = f"{records[0].grasps[0]} and {record.grasps[0]}"
            raise StoreError(f"{grasps} have different {different[0]}s: build the run from one config")
    for name, text in first.items():
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
    if samples == "presses":
        (folder / "empty_reading.png").write_bytes(png(dataset[0].presses[0].empty_reading))
    elif "touch" in stages:
        (folder / "empty_reading.png").write_bytes(png(dataset.empty_reading))
    if "vision" in stages:
        about = {name: CONTRACT["vision"].arrays[name].meaning for name in ("intrinsics", "extrinsics")}
        rows = zip(dataset, *(dataset.load("vision", name) for name in about), strict=True)
        objects = {record.name: dict(zip(about, matrices, strict=True)) | record.drawn for record, *matrices in rows}
        size = dataset.array("vision", "unoccluded").shape[2]
        stated = {"about": about, "frame": FRAMES["image"], "size": size, "objects": objects}
        (folder / "cameras.json").write_text(_json(stated), encoding="utf-8")


def _hand_and_sensor(record: ObjectRecord, stages: Iterable[str]) -> dict[str, str]:
    """Texts of sensor.json and hand.json by an object's grasps."""
    texts = {}
    if "touch" in stages:
        grasp, units = record.grasps[0], {"length": UNITS["length"], "lights.angles": "degree"}
        stated = {"names": grasp.sensors, "sensor": grasp.sensor.description(), "frame": FRAMES["sensor"]}
        texts["sensor"] = _json(stated | {"pixels": PIXELS, "units": units})
    if "grasps" in stages:
        values = {field.name: getattr(record.hand, field.name) for field in fields(Hand)}
        texts["hand"] = _json({"about": f"{' '.join((Hand.__doc__ or '').split())} {FRAMES_OF_HAND}"} | values)
    return texts


def _json(values: Mapping[str, Any]) -> str:
    """A JSON object with a line for each key; arrays become nested lists."""
    lines = (f"{json.dumps(key)}: {json.dumps(value, default=np.ndarray.tolist)}" for key, value in values.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"
