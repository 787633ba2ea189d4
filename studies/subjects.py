"""The objects of a run that reports use."""

import logging
from collections.abc import Callable, Iterable, Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import NamedTuple, TypeVar

from palpate.batch import read_rejections
from palpate.catalogue import read_catalogue

log = logging.getLogger(__name__)
Item = TypeVar("Item")


class Subject(NamedTuple):
    """One object of a run. folder: its meshes, `meshes/<batch>/<object>`."""

    name: str
    class_name: str
    batch: str
    folder: Path


def round_robin(items: Iterable[Item], class_of: Callable[[Item], str]) -> list[Item]:
    """Reorder items: one of each class in turn, classes and their items in order of appearance."""
    classes: dict[str, list[Item]] = {}
    for item in items:
        classes.setdefault(class_of(item), []).append(item)
    return [item for item in chain(*zip_longest(*classes.values())) if item is not None]


def pick(run: Path | str, objects: int, batches: Sequence[str] | None = None) -> list[Subject]:
    """The first usable objects of a run, one of each class in turn.

    At most `objects`; batches: to select from, None for all in `catalogue/`.

    Raises ValueError if no object is usable, with what to do about it.
    """
    run = Path(run)
    tables = sorted((run / "catalogue").glob("*.csv"))
    tables = [table for table in tables if batches is None or table.stem in batches]
    paths = [path for table in tables for path in (run / "rejected").glob(f"*/{table.name}")]
    rejected = {rejection.object for rejection in read_rejections(paths)}
    usable = []
    for table in tables:
        for entry in read_catalogue(table):
            folder = run / "meshes" / entry.batch / entry.object
            if entry.object not in rejected and (folder / "mesh.json").is_file():
                usable.append(Subject(entry.object, entry.class_name, entry.batch, folder))
    selected = round_robin(usable, lambda subject: subject.class_name)[:objects]
    if not selected:
        raise ValueError(f"{run}: no usable object for a report: see {run / 'rejected'}")
    log.info("objects: %s", ", ".join(subject.name for subject in selected))
    return selected
