"""The data card of an exported run: a README with the header that Hugging Face reads, made from the run."""

import csv
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
import yaml

from palpate import __version__
from palpate.catalogue import SPLITS
from palpate.dataset import Dataset, GraspDataset
from palpate.dataset.summary import kind_of_reason

# Number of samples below which Hugging Face has a name, and that name.
SIZES = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M", 1e7: "1M<n<10M"}


def write_card(
    path: Path, dataset: Dataset, splits: Mapping[str, GraspDataset], files: str, licence: str, source: str
) -> None:
    """Write the card: contents of the export, how it was made, its checks and errors, its terms.

    splits: the grasps that were written. files: pattern of a split's files. licence: of the data, by Hugging Face's
    name; source: of the meshes, with their terms, as text: both verbatim. Names and reasons, from meshes, are escaped.
    """
    grasps, number = next(iter(splits.values())), sum(map(len, splits.values()))
    data_files = [{"split": split, "path": files.format(split)} for split in splits]
    header = {
        "license": licence,
        "pretty_name": f"Palpate run {dataset.name}",
        "size_categories": [next((name for limit, name in SIZES.items() if number < limit), "n>10M")],
        "tags": ["tactile", "vision", "robotics", "3d", "simulation", "palpate"],
        "configs": [{"config_name": "default", "data_files": data_files}],
    }
    parts = [
        f"---\n{yaml.safe_dump(header, sort_keys=False)}---",
        f"# Palpate run {escaped(dataset.name)}",
        f"{number} simulated grasps of {len(dataset)} objects: what touch sensors and cameras record of each. "
        f"Made by palpate {__version__}. A sample is a grasp. Touch is geometry within the sensor's range; no "
        "mechanics of the gel is simulated.",
        f"## Terms\n\n- Licence of the data: {licence}.\n- Source of the meshes: {source or _source(dataset.config)}.",
        f"## Counts\n\n{_counts(dataset)}",
        "## Files\n\n`objects.csv` has class, split and mesh of each object. Meshes are in the object's own frame, in "
        "metres, z up; in the world they are centred at (0, 0, 0.6). `sensor.json` has the touch sensor, "
        "`croissant.json` describes the files to tools, and `sha256sum --check SHA256SUMS` compares them.",
        "## Arrays\n\nMetres and radians; world frame with z up. A sensor that touched nothing reads the empty gel."
        f"\n\n{_arrays(grasps)}",
        f"## Objects left out\n\n{_rejections(dataset)}",
        f"## Checks and errors\n\n{_checks(dataset.folder)}\n\n{_errors(dataset.folder)}",
        f"## Config\n\n{indent(yaml.safe_dump(_public(dataset.config), sort_keys=False), '    ')}",
    ]
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _table(rows: list[list[Any]], *heads: str) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def escaped(text: str) -> str:
    """Text in one line that Markdown and HTML show verbatim: no markup, no link, no invisible character."""
    line = " ".join("".join(each if each.isprintable() else " " for each in str(text)).split())
    return re.sub(r"[^\w ,.;%+=()/'-]|(?<!\w)_|_(?!\w)|(?<=www)\.|/(?=/)", lambda found: f"&#{ord(found[0])};", line)


def _source(config: Mapping[str, Any]) -> str:
    kind = escaped(config.get("source", {}).get("kind", "unknown"))
    return "procedural, made by palpate (no one's meshes)" if kind == "procedural" else f"{kind}, terms not stated"


def _public(value: Any) -> Any:
    """A part of the config without the machine's folders: of paths the last name only, and no `results`."""
    if isinstance(value, Mapping):
        return {key: _public(each) for key, each in value.items() if key != "results"}
    if isinstance(value, list):
        return [_public(each) for each in value]
    return Path(value).name if isinstance(value, str) and value.startswith(("/", "~", "..")) else value


def without_folders(text: str) -> str:
    """Text with the last name only of each path in it from the root, a home folder or above.

    >>> without_folders("can't read /home/me/scans/cup.png (named in ../cup.mtl)")
    "can't read cup.png (named in cup.mtl)"
    """
    return re.sub(r"(?<![\w.:/~<-])(?:file:/+|~[\w.-]*/|\.\./|/)(?:[^/\s:;,'\"()]*/)*", "", text)


def _counts(dataset: Dataset) -> str:
    counts = Counter((record.class_name, record.split) for record in dataset)
    rows = [[escaped(name), *(counts[name, split] for split in SPLITS)] for name in dataset.classes]
    total = ["all", *(sum(counts[name, split] for name in dataset.classes) for split in SPLITS)]
    text = _table([*rows, total], "objects", *SPLITS)
    return f"{text}\n\n{dataset.grasps_per_object} grasps an object."


def _arrays(grasps: GraspDataset) -> str:
    item = grasps[0]
    rows = [
        [f"`{name}`", item[name].shape, item[name].dtype, spec.unit, spec.meaning]
        for name, (_, spec) in grasps.sources.items()
    ]
    return _table(rows, "array", "shape", "type", "unit", "meaning")


def _rejections(dataset: Dataset) -> str:
    reasons = Counter((row["stage"], without_folders(kind_of_reason(row["reason"]))) for row in dataset.rejections())
    rows = [[number, escaped(stage), escaped(text)] for (stage, text), number in reasons.most_common()]
    return _table(rows, "objects", "stage", "reason") if rows else "None."


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _checks(run: Path) -> str:
    """What the validation found: from its report."""
    path = run / "reports/validation.csv"
    if not path.is_file():
        return "The run was not validated."
    checks = _rows(path)
    failed = sum(row["passed"] != "True" for row in checks)
    return f"{len(checks)} checks of files and values: {f'{failed} failed' if failed else 'all passed'}."


def _errors(run: Path) -> str:
    """Mean errors of the run's models on test objects."""
    rows = []
    for path in sorted(run.glob("evaluations/*/seed-*.csv")):
        test = [row for row in _rows(path) if row.get("split") == "test"]
        if test and "chamfer" in test[0]:
            mean = np.nanmean([float(row["chamfer"] or "nan") for row in test])
            rows.append([escaped(path.parent.name), escaped(path.stem), len(test), f"{mean:.4g}"])
    if not rows:
        return "No model was evaluated."
    return (
        "Mean Chamfer distance of the run's models on its test objects, in the unit of the run's tables:\n\n"
        + _table(rows, "model", "seed", "predictions", "Chamfer distance")
    )
