"""The items of each report, from items.yaml: the files of a run and the config keys that each depends on.

The workflow takes the inputs of its jobs from here, so this module imports no engine.
"""

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import yaml


class Item(NamedTuple):
    """One table of a report, made by the module `studies.<report>.<item>`; attributes as in items.yaml."""

    reads: list[str]
    settings: list[str]
    stages: list[str]


_DECLARED = yaml.safe_load(Path(__file__).with_name("items.yaml").read_text())
FILES: dict[str, str | list[str]] = _DECLARED["files"]
TIMED: list[str] = _DECLARED["timed"]
REPORTS = {
    report: {name: Item(**item) for name, item in items.items()} for report, items in _DECLARED["reports"].items()
}


def items_of_stages(report: str, stages: str | Collection[str]) -> list[str]:
    """The items of a report that `stages` (the value of `reports.stages`) selects; all of them for "all"."""
    return [name for name, item in REPORTS[report].items() if stages == "all" or set(item.stages) & set(stages)]
