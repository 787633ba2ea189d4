"""One array of a stage, joined over a run's batches: read where it is indexed, or loaded and checked."""

from collections.abc import Sequence
from operator import index as integer
from typing import Any

import numpy as np

from palpate.catalogue import CatalogueEntry
from palpate.dataset.run import Run
from palpate.remedy import command
from palpate.store.contract import CONTRACT
from palpate.store.files import Store, StoreError

# Greatest coordinate of the world, metres: a larger one is in another unit, or broken.
MAX_COORDINATE = 10.0
MAX_ROTATION = 1.001  # greatest element of a rotation matrix, with its rounding

Index = int | slice | Sequence[int] | np.ndarray


class JoinedArray(Sequence):
    """One array of many batches as if it were one, `(o, ...)` or `(o, g, ...)`; read where it is indexed.

    Values are as they are stored: `reading` of a sensor that touched nothing is 0 (`Dataset.readings` gives the
    empty gel instead), and rows of local clouds past their `point_count` are 0.
    """

    def __init__(self, run: Run, stage: str, name: str, entries: list[CatalogueEntry]):
        self._run, self._stage, self._name, self._entries = run, stage, name, entries

    def _record(self) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of one object's record; StoreError if there is no object to tell it by."""
        if not self._entries:
            raise StoreError(
                f"{self._run.folder}: no object to take {self._stage} {self._name!r} of; rejected.csv says why"
            )
        shape, dtype = self._run.store(self._stage, self._entries[0].batch).header(self._name)
        return shape[1:], dtype

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the whole."""
        return (len(self), *self._record()[0])

    @property
    def dtype(self) -> np.dtype:
        """Type of its elements."""
        return self._record()[1]

    @property
    def ndim(self) -> int:
        """Number of its axes."""
        return len(CONTRACT[self._stage].arrays[self._name].shape)

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, index: Index | tuple) -> np.ndarray:
        """Indexes as a numpy array does; reads only the chunks that are needed.

        The first axis (objects) takes a number, a slice, a list of numbers or a boolean mask; the others take numbers
        and slices with a positive step. Raises IndexError for any other index, or one out of range.
        """
        first, further = self._split(index)
        if isinstance(first, int | np.integer):
            entry = self._entries[first]
            return self._store(entry.batch).get(self._name, (self._run.row(self._stage, entry), *further))
        entries = [self._entries[number] for number in np.arange(len(self))[first]]
        shape, dtype = self._record()
        shape = [axis for axis in map(_length, shape, further) if axis is not None] + list(shape[len(further) :])
        text = CONTRACT[self._stage].arrays[self._name].dtype == "string"
        result = np.empty((len(entries), *shape), object if text else dtype)
        places: dict[str, list[int]] = {}
        for place, entry in enumerate(entries):
            places.setdefault(entry.batch, []).append(place)
        for batch, of_batch in places.items():
            rows = [self._run.row(self._stage, entries[place]) for place in of_batch]
            result[of_batch] = self._store(batch).rows(self._name, rows, *further)
        return result.astype(str) if text else result

    def _split(self, index: Index | tuple) -> tuple[Index, tuple[int | slice, ...]]:
        """The index of the first axis, and those of the further axes that have one."""
        given = index if isinstance(index, tuple) else (index,)
        place = next((place for place, item in enumerate(given) if item is Ellipsis), None)
        if place is not None:
            missing = (slice(None),) * (self.ndim - len(given) + 1)
            given = given[:place] + missing + given[place + 1 :]
        first, *further = given or (slice(None),)
        if len(given) > self.ndim:
            raise IndexError(f"{self!r} has {self.ndim} axes, but the index has {len(given)}")
        for item in further:
            if not (isinstance(item, slice) and (item.step is None or item.step > 0) or _is_integer(item)):
                raise IndexError(f"axes after the first take numbers and slices with a positive step, not {item!r}")
        lengths = self._record()[0]
        within = [
            item if isinstance(item, slice) else range(length)[item]
            for length, item in zip(lengths, further, strict=False)
        ]
        return first, tuple(within)

    def _store(self, batch: str) -> Store:
        """The store of a batch. Raises StoreError if its records have another shape than those of the first."""
        store, (shape, _) = self._run.store(self._stage, batch), self._record()
        found = store.header(self._name)[0][1:]
        if found != shape:
            first = self._run.store(self._stage, self._entries[0].batch).path
            raise StoreError(
                f"{store.path}: {self._name} of an object is {found}, but {shape} in {first}; "
                "build both again from one config"
            )
        return store

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self[:] if dtype is None else self[:].astype(dtype)

    def __repr__(self) -> str:
        return f"JoinedArray({self._stage} {self._name!r}, shape {self.shape}, {self.dtype})"

    def load(self) -> np.ndarray:
        """The whole array in memory, its values checked.

        Raises StoreError, naming file, object and remedy, if a floating-point value is NaN or infinite (+inf may
        stand where the contract's fill value is +inf), if a length is above 10 m, or an element of a rotation above
        1.001. Rows of local clouds past their `point_count` are 0, whatever is stored there.
        """
        values = self[:]
        spec = CONTRACT[self._stage].arrays[self._name]
        if spec.shape[-2:] == ("rr", 3):
            count = JoinedArray(self._run, self._stage, "point_count", self._entries)[:]
            values[np.arange(values.shape[-2]) >= count[..., None]] = 0
        if values.dtype.kind == "f":
            limit = MAX_ROTATION if "rotation" in spec.name else MAX_COORDINATE if spec.unit == "m" else np.inf
            right = (np.abs(values) <= limit) & (np.abs(values) < np.inf)  # False for NaN
            if spec.fill == np.inf:
                right |= values == np.inf
            wrong = ~right.reshape(len(values), -1).all(axis=1)
            if wrong.any():
                raise self._wrong_value(self._entries[int(wrong.argmax())], limit)
        return values

    def _wrong_value(self, entry: CatalogueEntry, limit: float) -> StoreError:
        path = self._run.store(self._stage, entry.batch).path
        above = f"NaN, infinite or above {limit:g}" if np.isfinite(limit) else "NaN or infinite"
        return StoreError(
            f"{path}: {self._name} of {entry.object} is {above}; remove the store and build it again with: "
            f"{command(path)}; or omit the object"
        )


def _is_integer(item: Any) -> bool:
    try:
        integer(item)
    except TypeError:
        return False
    return not isinstance(item, bool | np.bool_)


def _length(axis: int, index: int | slice) -> int | None:
    """Length of an axis that is indexed; None if it disappears."""
    return len(range(axis)[index]) if isinstance(index, slice) else None


def fill_untouched(reading: np.ndarray, success: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """Readings (..., r, r, 3) in which sensors that touched nothing (`success` (...) False) read the empty gel.

    Stores omit these readings: there they are 0. empty: (r, r, 3). The result is `reading` itself, changed.
    """
    reading[~success] = empty
    return reading
