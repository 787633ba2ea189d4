"""The stages of the pipeline that write one output a batch, as one table: every list of stages follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

# Stands in for the simulated stages where a dataset is read that was not made here: it writes all of its stores.
RELEASED = "released"


@dataclass(frozen=True)
class Stage:
    """One stage: what its rule reads and writes, at `<run>/<name>/<batch><suffix>`."""

    name: str  # of its folder, its rule and its script
    suffix: str  # of its store; empty: a folder of meshes
    reads: tuple[str, ...]  # names of the stages that it reads, in the order in which an object goes through them
    rejects: bool  # whether it can reject objects, in `rejected/<name>/<batch>.csv`
    in_dataset: bool  # whether its output is part of the dataset; the others belong to models
    engines: tuple[str, ...] = ()  # packages whose versions its stores record
    simulated: bool = False  # whether a dataset that was read, not simulated, lacks it
    groups: tuple[str, ...] = ()  # of further arrays that its stores may hold
    states: tuple[str, ...] = ()  # attributes that only its stores have
    # The key of the config that asks for the stage; empty if every run has it. A stage with such a key may lack arrays
    # that the contract calls optional, also in a run that was simulated here.
    asked_by: str = ""

    def is_asked(self, config: Mapping[str, Any]) -> bool:
        """Whether a run with this config has it."""
        section, _, key = self.asked_by.partition(".")
        return not section or bool(config.get(section, {}).get(key))

    def path(self, batch: str = "{batch}") -> str:
        """Its output of one batch, relative to the run's folder; by default the pattern of all batches."""
        return f"{self.name}/{batch}{self.suffix}"

    @property
    def rejecting(self) -> tuple[str, ...]:
        """The stages that may have rejected an object that its output lacks: the last one first."""
        before = [name for stage in reversed(self.reads) for name in STAGES[stage].rejecting]
        return tuple(dict.fromkeys([self.name] * self.rejects + before))


_TEXT = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
_ROWS: dict[str, dict[str, Any]] = yaml.load(_TEXT, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
STAGES: dict[str, Stage] = {}
for _name, _row in _ROWS.items():
    _row |= {key: tuple(value) for key, value in _row.items() if isinstance(value, list)}
    STAGES[_name] = Stage(_name, **_row)
# What makes a dataset, simulated or read, and the stores among it.
DATASET_STAGES = (RELEASED, *(stage.name for stage in STAGES.values() if stage.in_dataset))
DATASET_STORES = tuple(stage.name for stage in STAGES.values() if stage.in_dataset and stage.suffix)
