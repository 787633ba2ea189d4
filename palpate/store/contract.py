"""The dataset contract: which arrays each store has, and their shapes, types, units and frames, as data.

The arrays are in `contract.csv`, symbols of their shapes, units and frames in `contract.yaml`; all code that writes,
reads, checks or documents a store uses them. Within one store a symbol stands for one number. `record` says how many
leading axes are cut into chunks of length one, so that one object's or one sensor's data is one read. A `shape` has
symbols, and `<name>:<length>` for axes that their symbol does not name.
"""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from palpate.configuration import read_yaml
from palpate.rebuild_command import rebuild_advice
from palpate.seal import DamagedFile
from palpate.stages import STAGES, Stage

SCHEMA_VERSION = 7
# The Allegro's, in the order of every axis that counts sensors; of another hand it is that of `hand/sensor_names`.
SENSOR_NAMES = ("index", "middle", "ring", "thumb")

_TERMS = read_yaml(Path(__file__).with_suffix(".yaml"))
SYMBOLS, UNITS, FRAMES = _TERMS["symbols"], _TERMS["units"], _TERMS["frames"]
DIMENSIONS = _TERMS["dimensions"]


class StoreError(ValueError):
    """A store, or arrays to be written, violate the contract; the message names the file."""


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Context in which any error of a library that reads a store becomes a StoreError, naming file and remedy."""
    try:
        yield
    except (StoreError, IndexError, PermissionError):  # not about what the file holds
        raise
    except DamagedFile as error:
        raise StoreError(str(error)) from None
    except Exception as error:
        raise StoreError(f"{path} can't be read ({type(error).__name__}: {error}); {rebuild_advice(path)}") from error


@dataclass(frozen=True)
class ArraySpec:
    """One array of one store: one row of the table."""

    name: str
    shape: tuple[str | int, ...]
    dtype: str
    record: int
    fill: float | str
    unit: str
    meaning: str
    optional: bool = False  # what a store that was not simulated here may lack
    asked: bool = False  # optional, since only a config that asks for it has it
    dimensions: tuple[str, ...] = ()  # a name for each axis, as xarray takes it: `("object", "grasp", "sensor")`

    @property
    def axes(self) -> str:
        """The symbolic shape as it is printed, for example `(o, g, s, r, c)` or `(o,)`."""
        return f"({', '.join(map(str, self.shape))}{',' if len(self.shape) == 1 else ''})"

    @property
    def of_objects(self) -> bool:  # whether the first axis counts the batch's objects
        return self.shape[0] == "o"

    @property
    def row(self) -> str:
        """What it has a row of: each "object", "grasp", "frame" of a grasp or "press"; empty if it is the batch's."""
        match self.shape:
            case ("o", "g", "f" | "h", *_):  # of all frames, or of those that have images
                return "frame"
            case ("o", "g" | "t" as second, *_):
                return DIMENSIONS[second]
        return "object" if self.of_objects else ""

    @property
    def of_cameras(self) -> bool:  # whether it has an axis of cameras, after those of objects, grasps and frames
        return "k" in self.shape

    def chunk(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Shape of one record; never 0 along an axis."""
        return tuple(1 if axis < self.record else max(length, 1) for axis, length in enumerate(shape))


@dataclass(frozen=True)
class StoreSpec:
    """One kind of store: the stage that writes it, one a batch, and its arrays by their names."""

    stage: Stage
    arrays: dict[str, ArraySpec]

    @property
    def attributes(self) -> tuple[str, ...]:
        """Attributes that its writer has to give."""
        return ("made_from", "seed", *self.stage.states)

    @property
    def all_attributes(self) -> tuple[str, ...]:
        """Attributes of its stores: those, and what `palpate.store.write` adds."""
        return (*self.attributes, "schema_version", "stage", "units", "frames", "versions")

    def path(self, batch: str) -> str:
        return self.stage.path(batch)


_ROWS = [*csv.DictReader(Path(__file__).with_suffix(".csv").read_text(encoding="utf-8").splitlines())]


def _arrays(stage: str) -> dict[str, ArraySpec]:
    rows = [row for row in _ROWS if row["store"] == stage]
    axes = {row["array"]: [axis.rpartition(":") for axis in row["shape"].split()] for row in rows}
    return {
        row["array"]: ArraySpec(
            name=row["array"],
            shape=tuple(int(size) if size.isdigit() else size for _, _, size in axes[row["array"]]),
            dimensions=tuple(name or DIMENSIONS[size] for name, _, size in axes[row["array"]]),
            dtype=row["type"],
            record=int(row["record"]),
            fill="" if row["type"] == "string" else float(row["fill"]),
            unit=row["unit"],
            meaning=row["meaning"],
            optional=bool(row["optional"]),
            asked=row["optional"] == "asked",
        )
        for row in rows
    }


CONTRACT = {name: StoreSpec(stage, _arrays(name)) for name, stage in STAGES.items() if stage.suffix}


def arrays_by_name(row: str) -> dict[str, tuple[str, ArraySpec]]:
    """Stage and contract, by name, of the arrays that have a row of each "object", "grasp", "frame" or "press".
    The array `object` is not among them. Raises ValueError if two have one name: they are attributes of one record."""
    named: dict[str, tuple[str, ArraySpec]] = {}
    specs = [(stage, spec) for stage, store in CONTRACT.items() for spec in store.arrays.values()]
    for stage, spec in specs:
        if spec.row == row and spec.name != "object":
            other, _ = named.setdefault(spec.name, (stage, spec))
            if other != stage:
                raise ValueError(f"contract.csv: {other} and {stage} both have an array {spec.name!r}: rename one")
    return named
