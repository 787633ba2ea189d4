"""One array of a stage, joined over a run's batches: read where it is indexed, or loaded and checked."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.catalogue import CatalogueEntry
from palpate.dataset.run import Run
from palpate.rebuild_command import rebuild_advice
from palpate.sensor import Sensor
from palpate.store.contract import CONTRACT
from palpate.store.files import Store, StoreError
from palpate.touch import empty_reading, shade

# Greatest coordinate of the world, metres: a larger one is in another unit, or broken.
MAX_COORDINATE = 10.0
MAX_ROTATION = 1.001  # greatest element of a rotation matrix, with its rounding
SENSOR_AXES = len(CONTRACT["touch"].arrays["success"].shape)  # axes that count objects, grasps and sensors

Index = int | slice | Sequence[int] | np.ndarray


class JoinedArray(Sequence):
    """One array of many batches as if it were one, `(o, ...)` or `(o, g, ...)`; read where it is indexed.

    Values are as they are stored, but for `reading`: a sensor that touched nothing reads the empty gel, which stores
    omit. Rows of local clouds past their `point_count` are 0.
    """

    def __init__(self, run: Run, stage: str, name: str, entries: list[CatalogueEntry]):
        self._run, self._stage, self._name, self._entries = run, stage, name, entries
        self._spec = CONTRACT[stage].arrays[name]

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
        return len(self._spec.shape)

    @property
    def size(self) -> int:
        """Number of its elements."""
        return int(np.prod(self.shape, dtype=object))

    @property
    def nbytes(self) -> int:
        """Bytes that the whole takes in memory."""
        return self.size * self.dtype.itemsize

    @property
    def attrs(self) -> dict[str, Any]:
        """What the contract says of the array (stage, axes, unit, meaning), and the attributes of the first store.

        Those are units, frames, seed, schema version, digest of the config and versions of what made it.
        """
        spec = {"stage": self._stage, "axes": self._spec.axes, "unit": self._spec.unit, "meaning": self._spec.meaning}
        return spec | (self._run.store(self._stage, self._entries[0].batch).attributes if self._entries else {})

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, index: Index | tuple) -> np.ndarray:
        """Indexes as numpy does: numbers, slices and `...`, and in the first place also one list or mask of objects.

        Only the chunks that these need are read. Raises IndexError for an index out of range and for any other, which
        the result takes: `array[:][mask]`.
        """
        given = index if isinstance(index, tuple) else (index,)
        place = next((place for place, item in enumerate(given) if item is Ellipsis), None)
        if place is not None:
            given = (*given[:place], *[slice(None)] * (self.ndim - len(given) + 1), *given[place + 1 :])
        first, *further = given or (slice(None),)
        of_objects = _is_basic(first) or np.ndim(first) == 1
        if len(given) > self.ndim or not of_objects or not all(map(_is_basic, further)):
            raise IndexError(
                f"{self!r} takes up to {self.ndim} numbers and slices, one `...`, and one list of objects in the first "
                "place: index the result by anything else"
            )
        try:
            return self._read(first, tuple(further))
        except (IndexError, TypeError) as error:
            raise IndexError(f"{self!r}: {error}") from None

    def _read(self, first: Index, further: tuple[int | slice, ...]) -> np.ndarray:
        """One object, or the objects of a slice, a list or a mask, and of each what `further` picks."""
        shape, dtype = self._record()
        shape = np.broadcast_to(0, shape)[further].shape  # raises for an index that can't be
        if isinstance(first, int | np.integer):
            entry = self._entries[first]
            row = self._run.row(self._stage, entry)
            return self._filled(entry.batch, self._store(entry.batch).get(self._name, (row, *further)), row, further)
        entries = [self._entries[number] for number in np.arange(len(self))[first]]
        text = self._spec.dtype == "string"
        result = np.empty((len(entries), *shape), object if text else dtype)
        places: dict[str, list[int]] = {}
        for place, entry in enumerate(entries):
            places.setdefault(entry.batch, []).append(place)
        for batch, of_batch in places.items():
            rows = np.array([self._run.row(self._stage, entries[place]) for place in of_batch])
            values = self._store(batch).get(self._name, (rows, *further))
            result[of_batch] = self._filled(batch, values, rows, further)
        return result.astype(str) if text else result

    def _filled(self, batch: str, values: np.ndarray, rows: int | np.ndarray, further: tuple) -> np.ndarray:
        """Values of a batch; in readings, the empty gel for sensors that touched nothing."""
        if (self._stage, self._name) != ("touch", "reading"):
            return values
        store = self._run.store(self._stage, batch)
        success = store.get("success", (rows, *further[: SENSOR_AXES - 1]))
        return fill_untouched(values, success, store.get("empty_reading", further[SENSOR_AXES - 1 :]))

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
        if not self._entries:
            return f"JoinedArray({self._stage} {self._name!r} {self._spec.axes}, no object)"
        unit = f", {self._spec.unit}" if self._spec.unit else ""
        return f"JoinedArray({self._stage} {self._name!r} {self._spec.axes}, shape {self.shape}, {self.dtype}{unit})"

    def load(self) -> np.ndarray:
        """The whole array in memory, its values checked.

        Raises StoreError, naming file, object and remedy, if a floating-point value is NaN or infinite (+inf may
        stand where the contract's fill value is +inf), if a length is above 10 m, or an element of a rotation above
        1.001. Rows of local clouds past their `point_count` are 0, whatever is stored there.
        """
        values, spec = self[:], self._spec
        if spec.shape[-2:] == ("rc", 3):
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
            f"{path}: {self._name} of {entry.object} is {above}; {rebuild_advice(path, 'the store')}; "
            "or omit the object"
        )


def _is_basic(item: Any) -> bool:
    return isinstance(item, int | np.integer | slice) and not isinstance(item, bool)


def fill_untouched(reading: np.ndarray, success: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """Readings in which sensors that touched nothing read the empty gel; stores omit these, so that they are 0.

    success: bool, of any shape; reading: (*success.shape, *empty.shape). empty: the empty gel, (r, c, 3) or a part.
    """
    return np.where(np.asarray(success)[(..., *[None] * np.ndim(empty))], reading, empty)


def shaded(depth: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Readings (..., r, c, 3) uint8 of depth maps (..., r, c), m: those of frames, whose stores have none."""
    reading = np.broadcast_to(empty_reading(sensor), (*depth.shape, 3)).copy()
    for touched in zip(*np.nonzero(np.isfinite(depth).any(axis=(-2, -1))), strict=True):
        reading[touched] = shade(depth[touched], sensor)
    return reading
