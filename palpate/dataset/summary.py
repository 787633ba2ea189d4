"""What a run holds, in lines for the terminal."""

import contextlib
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from palpate.catalogue import SPLITS, CatalogueError, Source, assign_split, copies, copy_lines, listed, unread_lines
from palpate.configuration import ConfigError
from palpate.dataset.reader import Dataset
from palpate.dataset.run import Run
from palpate.mesh import FACTS
from palpate.seal import DamagedFile
from palpate.text_files import read_record

MOST_REASONS = 3


def summary(folder: Path | str) -> list[str]:
    """Lines on the objects of a run: how many are used, rejected with the commonest reasons, and in each split. An
    object is used if no stage has rejected it so far. Empty if the run has no catalogue yet."""
    run = Run(folder)
    try:
        entries = run.catalogue
    except CatalogueError:
        return []
    rows = [row for row in run.rejections() if row["object"] in entries]
    rejected = {row["object"] for row in rows}
    used = Counter(entry.split for name, entry in entries.items() if name not in rejected)
    counts = ", ".join(f"{split} {used[split]}" for split in SPLITS)
    lines = [f"objects: {len(entries)}, used {len(entries) - len(rejected)} ({counts}), rejected {len(rejected)}"]
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        reasons.setdefault((row["stage"], kind_of_reason(row["reason"])), []).append(without_place(row["reason"]))
    for (stage, _), same in sorted(reasons.items(), key=lambda each: -len(each[1]))[:MOST_REASONS]:
        lines.append(f"  {len(same)} at {stage}: {same[0]}{' (the first; numbers differ)' if len({*same}) > 1 else ''}")
    if len(reasons) > MOST_REASONS:
        lines.append(f"  and {len(reasons) - MOST_REASONS} other reasons")
    return [*lines, *_remarks(run, rejected)]


def _remarks(run: Run, rejected: set[str]) -> Iterator[str]:
    """Lines on missing textures, copies, splits that were filled, and files that were passed over."""
    entries = run.catalogue
    facts: dict[str, dict[str, Any]] = {}
    for batch in run.batches:
        with contextlib.suppress(OSError, DamagedFile):  # not made yet, or damaged
            facts |= read_record(run.folder / "meshes" / f"{batch}{FACTS}")
    facts = {name: each for name, each in facts.items() if name in entries and name not in rejected}
    problems = {
        name: [f"{file[-60:]}: {what}" for file, what in each["problems"].items()] for name, each in facts.items()
    }
    if lacking := [f"{name} ({', '.join(files)})" for name, files in problems.items() if files]:
        plural = "s" * (len(lacking) > 1)
        yield f"{len(lacking)} object{plural} without a texture that the file names: {listed(lacking, MOST_REASONS)}"
    checksums = {name: entry.checksum for name, entry in entries.items()}
    splits = {name: entry.split for name, entry in entries.items()}
    groups = copies(checksums, {name: each["shape"] for name, each in facts.items()})
    yield from copy_lines(groups, checksums, splits)
    ratios = run.config.get("split")
    by_name = ratios and ratios.get("held_out") != "styles"
    if by_name and {assign_split(name, ratios) for name in entries} < {entry.split for entry in entries.values()}:
        yield "splits: names alone leave one empty, so objects are spread over all; with more objects, names decide"
    with contextlib.suppress(ConfigError, KeyError):  # the config of an older version
        project = Path(__file__).parents[2]  # an editable install, of the workflow's folder
        yield from unread_lines(Source.from_config(run.config, project))


def kind_of_reason(reason: str) -> str:
    """A reason without what differs from object to object: its file's path in front, and the numbers.

    >>> kind_of_reason("/a/b.stl: holds 12 points, no triangles: export the object's faces")
    "holds N points, no triangles: export the object's faces"
    """
    return re.sub(r"\d[\d,.]*(?:e[+-]?\d+)?", "N", without_place(reason))


def without_place(reason: str) -> str:
    """A reason in one line, without its file's path in front."""
    start, colon, rest = reason.partition(": ")
    return " ".join((rest if colon and "/" in start else reason).split())


def run_lines(dataset: Dataset) -> list[str]:
    """Objects by class and split, rejections, stages, models and tables of a dataset's run."""
    folder = dataset.folder
    lines = [f"{folder}: {len(dataset)} objects", *summary(folder)]
    counts = Counter((record.class_name, record.split) for record in dataset)
    lines += [
        f"  {name}: {', '.join(f'{split} {counts[name, split]}' for split in SPLITS if counts[name, split])}"
        for name in dataset.classes
    ]
    models = sorted(path.parent.relative_to(folder / "models") for path in folder.glob("models/**/best.ckpt"))
    tables = sorted(path.name for path in folder.glob("tables/*.csv"))
    found = {"stages": dataset.stages, "models": map(str, models), "tables": tables}
    return [*lines, *(f"{what}: {', '.join(names) or 'none'}" for what, names in found.items())]
