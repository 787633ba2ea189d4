"""The data card of an exported run: a README with the header that Hugging Face reads, made from the run."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from palpate import __version__
from palpate.catalogue import SPLITS
from palpate.dataset import Dataset, GraspDataset
from palpate.dataset.summary import kind_of_reason

# Number of samples below which Hugging Face has a name, and that name.
SIZES = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M", 1e7: "1M<n<10M"}


def write_card(
    path: Path,
    dataset: Dataset,
    grasps: GraspDataset,
    files: Mapping[str, str],
    licence: str = "unknown",
    source: str = "",
) -> None:
    """Write the card: what is in the export, how it was made, how good it is, on what terms it may be used.

    grasps: whose arrays were written. files: pattern of the files by split. licence: of the data, by the name that
    Hugging Face has for it. source: where the meshes are from and on what terms, as text.
    """
    number = sum(len(dataset.grasps(split, grasps.arrays)) for split in files)
    header = {
        "license": licence,
        "pretty_name": f"Palpate run {dataset.name}",
        "size_categories": [next((name for limit, name in SIZES.items() if number < limit), "n>10M")],
        "tags": ["tactile", "vision", "robotics", "3d", "simulation", "palpate"],
        "configs": [
            {
                "config_name": "default",
                "data_files": [{"split": split, "path": pattern} for split, pattern in files.items()],
            }
        ],
    }
    parts = [
        f"---\n{yaml.safe_dump(header, sort_keys=False)}---",
        f"# Palpate run {dataset.name}",
        f"{number} simulated grasps of {len(dataset)} objects: what touch sensors and cameras record of each. "
        f"Made by palpate {__version__}. A sample is a grasp. Touch is geometry within the sensor's range; no "
        "mechanics of the gel is simulated.",
        f"## Terms\n\n- Licence of the data: {licence}.\n- Source of the meshes: {source or _source(dataset.config)}.",
        f"## Counts\n\n{_counts(dataset)}",
        "## Arrays\n\nMetres and radians; world frame with z up. A sensor that touched nothing reads the empty gel."
        f"\n\n{_arrays(grasps)}",
        f"## Objects left out\n\n{_rejections(dataset)}",
        f"## Checks and errors\n\n{_checks(dataset.folder)}\n\n{_errors(dataset.folder)}",
        f"## Config\n\n```yaml\n{yaml.safe_dump(_public(dataset.config), sort_keys=False)}```",
    ]
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _table(rows: list[list[Any]], *heads: str) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def _source(config: Mapping[str, Any]) -> str:
    kind = config.get("source", {}).get("kind", "unknown")
    return "procedural, made by palpate (no one's meshes)" if kind == "procedural" else f"{kind}, terms not stated"


def _public(config: Mapping[str, Any]) -> dict[str, Any]:
    """The config without places on this machine: of the source's path just the last name."""
    path = config.get("source", {}).get("path")
    source = {"source": {**config["source"], "path": Path(path).name}} if path else {}
    return {key: value for key, value in (dict(config) | source).items() if key != "results"}


def _counts(dataset: Dataset) -> str:
    counts = Counter((record.class_name, record.split) for record in dataset)
    rows = [[name, *(counts[name, split] for split in SPLITS)] for name in dataset.classes]
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
    reasons = Counter((row["stage"], kind_of_reason(row["reason"])) for row in dataset.rejections())
    return (
        _table([[n, *each] for each, n in reasons.most_common()], "objects", "stage", "reason") if reasons else "None."
    )


def _checks(run: Path) -> str:
    """What the validation found: from its report."""
    path = run / "reports/validation.csv"
    if not path.is_file():
        return "The run was not validated."
    checks = pd.read_csv(path)
    failed = int((~checks.passed.astype(bool)).sum())
    return f"{len(checks)} checks of files and values: {f'{failed} failed' if failed else 'all passed'}."


def _errors(run: Path) -> str:
    """Mean errors of the run's models on test objects."""
    rows = []
    for path in sorted(run.glob("evaluations/*/seed-*.csv")):
        table = pd.read_csv(path)
        if {"split", "chamfer"} <= set(table) and len(test := table[table.split == "test"]):
            rows.append([path.parent.name, path.stem, len(test), f"{test.chamfer.mean():.4g}"])
    if not rows:
        return "No model was evaluated."
    return (
        "Mean Chamfer distance of the run's models on its test objects, in the unit of the run's tables:\n\n"
        + _table(rows, "model", "seed", "predictions", "Chamfer distance")
    )
