"""An export: samples in one of the layouts, and what every export has beside them (docs/export.md):

objects.csv, meshes/<object>.glb, sensor.json, figures/*.png, README.md (the data card), croissant.json, SHA256SUMS
"""

import csv
import json
import shutil
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from palpate import checksums
from palpate.atomic import atomic_write
from palpate.dataset import Dataset
from palpate.interchange.card import write_card
from palpate.interchange.croissant import write_croissant
from palpate.interchange.items import CARD, grasps_by_split
from palpate.interchange.parquet import write_parquet
from palpate.interchange.webdataset import write_webdataset
from palpate.mesh import mesh_file
from palpate.store.contract import FRAMES, UNITS
from palpate.store.files import StoreError

# By the names that the command has for them: what writes the samples, and the pattern of a split's files.
FORMATS = {
    "webdataset": (write_webdataset, "{}-*.tar"),
    "parquet": (write_parquet, "{}/**"),
}


def export(
    dataset: Dataset,
    folder: Path | str,
    layout: str = "webdataset",
    arrays: Iterable[str] | None = None,
    licence: str = "unknown",
    source: str = "",
) -> int:
    """Write the grasps of a dataset in one of `FORMATS`, atomically; the same run gives the same bytes. Returns their
    number.

    arrays: as for `Dataset.grasps`. licence, source: as for `write_card`. Raises StoreError without objects, or for
    batches with different sensors; KeyError for an unknown array; DamagedFile for a missing or changed mesh; and what
    writing the samples raises.
    """
    write, pattern = FORMATS[layout]
    splits = grasps_by_split(dataset, arrays)
    if not source and dataset.config.get("source", {}).get("kind") == "procedural":
        source = "procedural, made by palpate (no one's meshes)"
    with atomic_write(Path(folder)) as partial:
        partial.mkdir()
        if "touch" in dataset.stages:
            (partial / "sensor.json").write_text(json.dumps(_sensor(dataset), indent=1) + "\n")
        write(partial, splits)
        _write_objects(partial, dataset)
        _copy_figures(partial, dataset)
        files = sorted(path for path in partial.rglob("*") if path.is_file())
        with ThreadPoolExecutor(2) as pool:
            found = pool.map(checksums.size_and_sha256, files)
            manifest = {path.relative_to(partial).as_posix(): each for path, each in zip(files, found, strict=True)}
        write_croissant(partial / "croissant.json", dataset, splits, manifest, licence, source)
        write_card(partial / CARD, dataset, splits, pattern, {}, licence, source)
        manifest |= {name: checksums.size_and_sha256(partial / name) for name in ("croissant.json", CARD)}
        lines = [f"{digest}  {name}\n" for name, (_, digest) in sorted(manifest.items())]
        (partial / "SHA256SUMS").write_text("".join(lines))
    return sum(map(len, splits.values()))


def _write_objects(folder: Path, dataset: Dataset) -> None:
    """Write the table of objects and their meshes; a released dataset has no meshes."""
    with_meshes = "grasps" in dataset.stages
    with (folder / "objects.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["object", "class", "split", "mesh"])
        for record in dataset:
            mesh = ""
            if with_meshes:
                mesh = f"meshes/{record.name}.glb"
                (folder / "meshes").mkdir(exist_ok=True)
                shutil.copyfile(mesh_file(record.mesh, "visual.glb"), folder / mesh)
            table.writerow([record.name, record.class_name, record.split, mesh])


def _copy_figures(folder: Path, dataset: Dataset) -> None:
    """Copy the run's figures of data: one data point, and examples of each class; those that it has."""
    names = ["data_point.png", *(f"examples_{name}.png" for name in dataset.classes)]
    for figure in filter(Path.is_file, (dataset.folder / "figures" / name for name in names)):
        (folder / "figures").mkdir(exist_ok=True)
        shutil.copyfile(figure, folder / "figures" / figure.name)


def _sensor(dataset: Dataset) -> dict:
    """The sensor of all batches. Raises StoreError if they have different ones."""
    grasps = [record.grasps[0] for record in {record.batch: record for record in dataset}.values()]
    (names, sensor), *others = [(list(grasp.sensors), grasp.sensor.description()) for grasp in grasps]
    for number, other in enumerate(others, start=1):
        if other != (names, sensor):
            raise StoreError(f"{grasps[0]} and {grasps[number]} have different sensors: build the run from one config")
    units = {"length": UNITS["length"], "lights.angles": "degree"}
    return {"names": names, "sensor": sensor, "frame": FRAMES["sensor"], "units": units}
