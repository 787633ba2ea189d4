"""What every export has beside its samples: meshes, sensors, a table of objects, descriptions and checksums.

<folder>/objects.csv              object, class, split; mesh: path of its mesh, empty if the run has no meshes
        /meshes/<object>.glb      the mesh that was rendered and touched, in its own frame, z up
        /sensor.json              the touch sensor, as a sensor's file has it; its frame, units and names on the hand
        /README.md                the data card
        /croissant.json           MLCommons' description, for tools
        /SHA256SUMS               of all files above, and of the samples
"""

import csv
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from palpate import checksums
from palpate.atomic import atomic_write
from palpate.dataset import Dataset, GraspDataset, ObjectRecord
from palpate.interchange.card import write_card
from palpate.interchange.croissant import write_croissant
from palpate.remedy import command
from palpate.store.contract import FRAMES, UNITS
from palpate.store.files import StoreError


@contextmanager
def export_folder(
    folder: Path | str, dataset: Dataset, splits: Mapping[str, GraspDataset], files: str, licence: str, source: str
) -> Iterator[Path]:
    """A new folder for the samples of an export, which gets all else after the block; it appears whole or not at all.

    splits: the grasps that are written, by split. files, licence, source: as `write_card` takes them. Raises StoreError
    if batches have different sensors, DamagedFile, naming the mesh, if one is missing or not as it was written.
    """
    with atomic_write(Path(folder)) as partial:
        partial.mkdir()
        yield partial
        _write_objects(partial, dataset)
        if "touch" in dataset.stages:
            (partial / "sensor.json").write_text(json.dumps(_sensor(dataset), indent=1) + "\n")
        write_croissant(partial, dataset, splits, licence, source)
        write_card(partial / "README.md", dataset, splits, files, licence, source)
        lines = [f"{digest}  {name}\n" for name, (_, digest) in checksums.manifest_of(partial).items()]
        (partial / "SHA256SUMS").write_text("".join(lines))


def _write_objects(folder: Path, dataset: Dataset) -> None:
    """Write the table of objects and their meshes; a released dataset, which was not simulated here, has none."""
    with (folder / "objects.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["object", "class", "split", "mesh"])
        for record in dataset:
            mesh = _copy_mesh(record, folder) if "grasps" in dataset.stages else ""
            table.writerow([record.name, record.class_name, record.split, mesh])


def _copy_mesh(record: ObjectRecord, folder: Path) -> str:
    """Copy an object's mesh; returns its path in the export. What was copied is compared with its checksum."""
    batch, name = record.mesh.parent, f"meshes/{record.name}.glb"
    remedy = f"remove {batch} and build it again with: {command(batch)}"
    stated = checksums.read_manifest(batch, remedy).get(f"{record.name}/visual.glb")
    (folder / "meshes").mkdir(exist_ok=True)
    try:
        shutil.copyfile(record.mesh / "visual.glb", folder / name)
    except FileNotFoundError:
        stated = None
    if stated is None or checksums.measure(folder / name) != stated:
        raise checksums.DamagedFile(f"{record.mesh / 'visual.glb'} is missing or not as it was written; {remedy}")
    return name


def _sensor(dataset: Dataset) -> dict:
    """The sensor of all batches. Raises StoreError if they have different ones."""
    first, *others = [record.grasps[0] for record in {record.batch: record for record in dataset}.values()]
    for other in others:
        if other.sensor.description() != first.sensor.description() or other.sensors != first.sensors:
            raise StoreError(f"{dataset!r}: {first} and {other} have different sensors: build the run from one config")
    sensor = {"names": list(first.sensors), "sensor": first.sensor.description(), "frame": FRAMES["sensor"]}
    return sensor | {"units": {"length": UNITS["length"], "lights.angles": "degree"}}
