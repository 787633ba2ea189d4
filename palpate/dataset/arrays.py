"""One array of a stage, joined over a run's batches and read where it is indexed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.catalogue import CatalogueEntry
from palpate.dataset.run import Run
from palpate.store.contract import CONTRACT
from palpate.store.files import StoreError

Index = int | slice | Sequence[int] | np.ndarray


class JoinedArray(Sequence):
    """One array of many batches as if it were one, `(o, ...)` or `(o, g, ...)`; read where it is indexed.

    Values are as they are stored, but for `reading`: a sensor that touched nothing reads the empty gel, which stores
    omit.
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
    def attrs(self) -> dict[str, Any]:
        """What the contract says of the array (stage, axes, unit, meaning), and the attributes of the first store.

        Those are units, frames, seed, schema version, digest of the config and versions of what made it.
        """
        spec = {"stage": self._stage, "axes": self._spec.axes, "unit": self._spec.unit, "meaning": self._spec.meaning}
        return spec | (self._run.store(self._stage, self._entries[0].batch).attributes if self._entries else {})

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, index: Index | tuple) -> np.ndarray:  # type: ignore[override]  # one type, however indexed
        """Indexes as numpy does: numbers and slices, and in the first place also one list or mask of objects.

        Only the chunks that these need are read. Raises IndexError for an index out of range and for any other, which
        the result takes: `array[:][mask]`. Raises StoreError if objects differ in shape.
        """
        first, *further = (index if isinstance(index, tuple) else (index,)) or (slice(None),)
        if not all(isinstance(part, int | np.integer | slice) for part in further):
            raise IndexError(f"{self!r} takes numbers and slices, and one list of objects in the first place")
        if isinstance(first, int | np.integer):
            return self._run.read(self._stage, self._name, self._entries[first], tuple(further))
        entries = [self._entries[number] for number in np.arange(len(self))[first]]
        records = (self._run.read(self._stage, self._name, entry, tuple(further)) for entry in entries)
        if self._spec.dtype == "string":
            return np.array([*records], dtype=str)
        shape, dtype = self._record()
        result = np.empty((len(entries), *np.broadcast_to(0, shape)[tuple(further)].shape), dtype)
        for place, (entry, values) in enumerate(zip(entries, records, strict=True)):
            if values.shape != result.shape[1:]:
                paths = [self._run.store(self._stage, other.batch).path for other in (entry, self._entries[0])]
                raise StoreError(
                    f"{paths[0]}: {self._name} of an object is {values.shape}, but {result.shape[1:]} in {paths[1]}; "
                    "build both again from one config"
                )
            result[place] = values
        return result

    def __repr__(self) -> str:
        if not self._entries:
            return f"JoinedArray({self._stage} {self._name!r} {self._spec.axes}, no object)"
        unit = f", {self._spec.unit}" if self._spec.unit else ""
        return f"JoinedArray({self._stage} {self._name!r} {self._spec.axes}, shape {self.shape}, {self.dtype}{unit})"
