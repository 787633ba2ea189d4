"""The files of one run: its catalogue, its rejections, and its stores."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from palpate import seal
from palpate.batch import read_rejections
from palpate.catalogue import CatalogueEntry, read_catalogue, sources_of
from palpate.configuration import ConfigError, absolute, read_yaml
from palpate.rebuild_command import BATCHES, RECORD, REJECTED, rebuild_advice, rebuild_command
from palpate.seal import DamagedFile, Seal
from palpate.sensor import Sensor
from palpate.stages import DATASET_STORES, RELEASED, STAGES
from palpate.store.contract import CONTRACT, reading
from palpate.store.files import Store, StoreError

# Stores whose headers are remembered, the latest used: some 16 kB each (studies/benchmarks/reading.py).
REMEMBERED_STORES = 1024


class Run:
    """The files of one run, shared by a dataset, its views and its records. Stores are opened when they are read. Safe
    to pickle and to fork: nothing stays open, and what is remembered is small (names, array headers), of the catalogue
    and of the `REMEMBERED_STORES` stores that were used last. batch: the only one that it has; else the catalogue's."""

    def __init__(self, folder: Path | str, batch: str | None = None):
        self.folder, self._batch = Path(folder), batch
        self._stores: dict[tuple[str, str], Store] = {}
        self._read: dict[str, dict[Path, tuple[str, Seal]]] = {}  # of each batch: digests and seals of what was read

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_stores": {}, "_read": {}}

    @cached_property
    def catalogue(self) -> dict[str, CatalogueEntry]:
        """Rows of the catalogue by object, in its order. Raises CatalogueError if it is missing or broken."""
        name = f"catalogue/{self._batch}.csv" if self._batch else "catalogue.csv"
        return {entry.object: entry for entry in read_catalogue(self.folder / name)}

    @cached_property
    def config(self) -> dict[str, Any]:
        """The config that the run was last started with; empty without. Raises StoreError if it is lost or damaged."""
        path = self.folder / RECORD
        if not path.is_file():
            if (self.folder / BATCHES).exists():  # the workflow has written both
                raise StoreError(f"{path} does not exist; {rebuild_advice(path)}")
            return {}
        try:
            if sealed := seal.find(path):
                sealed.require()
            config = read_yaml(path)
        except (ConfigError, DamagedFile) as error:
            raise StoreError(str(error)) from None
        return config if isinstance(config, dict) else {}

    @property
    def sources(self) -> Path | None:
        """The folder of the source files, by the config; None if it isn't there, as in a run that was moved."""
        path = self.config.get("source", {}).get("path") or self.folder / "sources"
        path = Path(absolute(path, Path(__file__).parents[2]))  # an editable install, of the workflow's folder
        return path if path.is_dir() else None

    @cached_property
    def values(self) -> dict[str, Any]:
        """Values of the config by their path. A store that is read adds what it states besides."""
        return seal.by_path(self.config)

    @cached_property
    def _entries(self) -> dict[str, list[CatalogueEntry]]:  # by batch
        found: dict[str, list[CatalogueEntry]] = {}
        for entry in self.catalogue.values():
            found.setdefault(entry.batch, []).append(entry)
        return found

    @property
    def batches(self) -> list[str]:
        """Names of the catalogue's batches. Files of others remain from an earlier config."""
        return list(self._entries)

    @property
    def stages(self) -> list[str]:
        """The stages that the run has a store of."""
        return list(filter(self.has, CONTRACT))

    @property
    def asked_stores(self) -> tuple[str, ...]:
        """The stores of the dataset that the config asks for; those that are there, if there is no config."""
        if not self.config:
            return tuple(filter(self.has, DATASET_STORES))
        released = self.config.get("source", {}).get("kind") == RELEASED
        stages = [STAGES[name] for name in DATASET_STORES if not (released and STAGES[name].simulated)]
        return tuple(stage.name for stage in stages if stage.is_asked(self.config))

    def rejections(self, batch: str | None = None, stages: Iterable[str] | None = None) -> list[dict[str, str]]:
        """Rows object, stage, reason, of one batch or of all, at some stages or at any. Of
        `rejected/<stage>/<batch>.csv`, or of `rejected.csv` if no stage has written its own yet. Raises StoreError if
        one can't be read, or is missing though the batch's store is there. Whether a table is that of the store is
        compared when the store is read: of other batches both may just be made again."""
        made = sorted(path.name for path in self.folder.glob("rejected/*"))
        batches = self.batches if batch is None else [batch]
        paths = {self.folder / f"rejected/{stage}/{name}.csv": (stage, name) for stage in made for name in batches}
        # A store is written after its rejections.
        tables = [path for path, (stage, name) in paths.items() if path.exists() or self._store(stage, name).exists()]
        whole = self.folder / "rejected.csv"
        try:
            rows = read_rejections(tables or ([whole] if whole.exists() else []))
        except DamagedFile as error:
            raise StoreError(str(error)) from None
        return [row._asdict() for row in rows if stages is None or row.stage in set(stages)]

    def _store(self, stage: str, batch: str) -> Path:
        return self.folder / (STAGES[stage].path(batch) if stage in STAGES else f"{stage}/{batch}")

    def rejected(self, stages: Iterable[str] | None = None) -> set[str]:
        return {row["object"] for row in self.rejections(stages=stages)}

    def require_config(self, path: Path) -> None:
        """Raise StoreError if an output was made with another config than the run's."""
        with reading(path):
            sealed = seal.find(path)
        if sealed and (difference := sealed.difference(self.values, lambda label: None)):
            raise StoreError(sealed.refusal(difference))

    def usable(self, stages: Iterable[str]) -> dict[str, CatalogueEntry]:
        """The catalogue without the objects that these stages, or those that they read, rejected so far."""
        asked = [STAGES[name] for name in set(stages) & set(STAGES)]
        asked = [stage for stage in asked if not self.config or stage.is_asked(self.config)]
        rejected = self.rejected({RELEASED, *(each for stage in asked for each in stage.rejecting)})
        return {name: entry for name, entry in self.catalogue.items() if name not in rejected}

    def has(self, stage: str) -> bool:
        return any(self._store(stage, batch).exists() for batch in self.batches)

    def store(self, stage: str, batch: str) -> Store:
        """One batch's store, remembered. Raises StoreError if the run has none of this stage, or not this one."""
        found = self._stores.pop((stage, batch), None)
        if found is None and not self.has(stage):
            numbers = [each.removeprefix("batch-") for each in self.batches]
            in_row = len(numbers) > 2 and int(numbers[-1]) - int(numbers[0]) == len(numbers) - 1
            names = [f"batch-{{{numbers[0]}..{numbers[-1]}}}"] if in_row else self.batches
            targets = [CONTRACT[stage].path(each) for each in names]
            raise StoreError(f"{self.folder} has no {stage}; build it with: {rebuild_command(self.folder, *targets)}")
        if found is None:
            found = Store(self._store(stage, batch))
            self._require_fitting(batch, found.seal)
            if len(self._stores) >= REMEMBERED_STORES:
                del self._stores[next(iter(self._stores))]
        self._stores[stage, batch] = found  # as the latest
        return found

    def meshes(self, batch: str) -> Path:
        """The folder of one batch's meshes. Raises StoreError if they do not fit the run."""
        folder = self.folder / "meshes" / batch
        if folder not in self._read.get(batch, {}) and (folder / seal.NAME).exists():
            with reading(folder):
                self._require_fitting(batch, seal.read(folder))
        return folder

    @cached_property
    def _sources(self) -> dict[str, str]:  # digests of the batches' source files, by the names that seals have for them
        return {label: digest for entries in self._entries.values() for label, digest in sources_of(entries).items()}

    def digest(self, label: str) -> str | None:
        """The digest of an output that the run has now, by its label in seals; None if it has none."""
        return self._sources.get(label) or seal.digest_in(self.folder, label)

    def require_current(self, path: Path) -> None:
        """Raise StoreError if an output is not as it was written, or was made from something else than the run has."""
        with reading(path):
            if sealed := seal.find(path):
                sealed.require()
                self._require_current(sealed)

    def _require_current(self, sealed: Seal) -> None:
        """Raise StoreError if an output was made from something else than the run has, naming the first that was: not
        a table of rejections, which is made with its store."""
        if not sealed.difference(self.values, self.digest):
            return
        paths = [self.folder / label for label in sealed.inputs if not label.startswith(REJECTED)]
        for each in [*(seal.read(path) for path in paths if path.exists()), sealed]:
            if difference := each.difference(self.values, self.digest):
                raise StoreError(each.refusal(difference))

    def _require_fitting(self, batch: str, sealed: Seal) -> None:
        """Raise StoreError if an output does not fit the run, or one of the batch that was read before no longer does.
        What was read before stays what the run has: this finds outputs that are made again in the meantime."""
        read = self._read.setdefault(batch, {})
        with reading(sealed.path):
            self._require_current(sealed)
        for digest, before in read.values():
            if before.path == sealed.path and digest != sealed.digest:
                raise StoreError(sealed.refusal("anew while the run was read"))
            if before.inputs.get(sealed.label, sealed.digest) != sealed.digest:
                raise StoreError(before.refusal(f"from other {sealed.label} than the run has"))
        self.values.update({key: value for key, value in sealed.config.items() if key not in self.values})
        read[sealed.path] = sealed.digest, replace(sealed, files={})

    def read(self, stage: str, name: str, entry: CatalogueEntry, index: tuple[int | slice, ...] = ()) -> np.ndarray:
        """What `index` picks of the object's row of an array, as it is stored; but for readings: see `fill_untouched`.
        Those of frames, whose stores have none, are shaded from whole depth maps. Raises StoreError as `store` and
        `row` do."""
        if (stage, name) == ("frames", "reading"):
            return shaded(self.read(stage, "depth", entry, index), self.store(stage, entry.batch).sensor)
        row, store = self.row(stage, entry), self.store(stage, entry.batch)
        values = store.get(name, (row, *index))
        if (stage, name) != ("touch", "reading"):
            return values
        success = store.get("success", (row, *index[:2]))  # its axes are those of grasps and sensors
        return fill_untouched(values, success, store.get("empty_reading", index[2:]))

    def row(self, stage: str, entry: CatalogueEntry) -> int:
        """Row of the object in its batch's store. Raises StoreError, with the object's rejection, if it has none."""
        store = self.store(stage, entry.batch)
        if entry.object in store.rows:
            return store.rows[entry.object]
        why = f"the catalogue puts in {entry.batch}; {rebuild_advice(store.path)}"
        for row in self.rejections(entry.batch):
            if row["object"] == entry.object:
                reason = f"was rejected at {row['stage']}: {row['reason']}"
                why = f"{reason}; open the dataset with this stage to omit it"
                break
        raise StoreError(f"{store.path} does not hold {entry.object}, which {why}")

    def grasps(self, entry: CatalogueEntry) -> int:
        """Grasps of the object, by the first stage that has grasps."""
        stages = [stage for stage, spec in CONTRACT.items() if any("g" in each.shape for each in spec.arrays.values())]
        stage = next(filter(self.has, stages), stages[0])
        name = next(name for name, array in CONTRACT[stage].arrays.items() if "g" in array.shape)
        return self._count(stage, name, entry)

    def presses(self, entry: CatalogueEntry) -> int:
        """Presses of the object."""
        return self._count("press", "force", entry)

    def _count(self, stage: str, name: str, entry: CatalogueEntry) -> int:
        self.row(stage, entry)
        return self.store(stage, entry.batch).header(name)[0][1]


def fill_untouched(reading: np.ndarray, success: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """Readings in which sensors that touched nothing read the empty gel; stores omit these, so that they are 0.
    success: bool, of any shape; reading: (*success.shape, *empty.shape). empty: the empty gel, (r, c, 3) or a part."""
    return np.where(np.asarray(success)[(..., *[None] * np.ndim(empty))], reading, empty)


def shaded(depth: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Readings (..., r, c, 3) uint8 of depth maps (..., r, c), m: those of frames, whose stores have none."""
    from palpate.touch import empty_reading, shade

    reading = np.broadcast_to(empty_reading(sensor), (*depth.shape, 3)).copy()
    for touched in zip(*np.nonzero(np.isfinite(depth).any(axis=(-2, -1))), strict=True):
        reading[touched] = shade(depth[touched], sensor)
    return reading
