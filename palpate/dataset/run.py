"""The files of one run: its catalogue, its rejections, and its stores."""

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

from palpate.batch import read_rejections
from palpate.catalogue import CatalogueEntry, read_catalogue
from palpate.checksums import DamagedFile
from palpate.configuration import ConfigError
from palpate.remedy import command
from palpate.sensor import Sensor
from palpate.store.contract import CONTRACT
from palpate.store.files import Store, StoreError


class Run:
    """The files of one run, shared by a dataset, its views and its records.

    Safe to pickle and to fork: nothing stays open, and what is remembered is small (names, array headers).
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self._stores: dict[Path, Store] = {}
        self._objects: dict[tuple[str, str], dict[str, int]] = {}
        self._sensors: dict[str, Sensor] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_stores": {}}

    @cached_property
    def catalogue(self) -> dict[str, CatalogueEntry]:
        """Rows of `catalogue.csv` by object, in its order. Raises CatalogueError if it is missing or broken."""
        return {entry.object: entry for entry in read_catalogue(self.folder / "catalogue.csv")}

    @cached_property
    def batches(self) -> list[str]:
        """Names of the catalogue's batches. Files of others remain from an earlier config."""
        return list(dict.fromkeys(entry.batch for entry in self.catalogue.values()))

    def rejections(self, batch: str | None = None, stages: Iterable[str] | None = None) -> list[dict[str, str]]:
        """Rows object, stage, reason, of one batch or of all, at some stages or at any.

        Of `rejected/<stage>/<batch>.csv`, or of `rejected.csv` if no stage has written its own yet. Raises StoreError
        if one can't be read, or is missing though the batch's store is there.
        """
        found = sorted(path.name for path in self.folder.glob("rejected/*"))
        batches = self.batches if batch is None else [batch]
        paths = {self.folder / f"rejected/{stage}/{name}.csv": (stage, name) for stage in found for name in batches}
        paths = {path: made for path, made in paths.items() if path.exists() or self._was_made(*made)}
        whole = self.folder / "rejected.csv"
        try:
            rows = read_rejections(paths or ([whole] if whole.exists() else []))
        except DamagedFile as error:
            raise StoreError(str(error)) from None
        return [row._asdict() for row in rows if stages is None or row.stage in set(stages)]

    def _was_made(self, stage: str, batch: str) -> bool:
        """Whether a stage has finished a batch: its store is written after its rejections."""
        path = CONTRACT[stage].path(batch) if stage in CONTRACT else f"{stage}/{batch}"
        return (self.folder / path).exists()

    def rejected(self, stages: Iterable[str] | None = None) -> set[str]:
        """Objects rejected so far, at some stages or at any."""
        return {row["object"] for row in self.rejections(stages=stages)}

    def has(self, stage: str) -> bool:
        """Whether any batch of this stage is there."""
        return any((self.folder / CONTRACT[stage].path(batch)).exists() for batch in self.batches)

    def store(self, stage: str, batch: str) -> Store:
        """One batch's store, remembered. Raises StoreError if the run has none of this stage, or not this one."""
        path = self.folder / CONTRACT[stage].path(batch)
        if path not in self._stores:
            if not self.has(stage):
                numbers = [each.removeprefix("batch-") for each in self.batches]
                in_row = len(numbers) > 2 and int(numbers[-1]) - int(numbers[0]) == len(numbers) - 1
                names = [f"batch-{{{numbers[0]}..{numbers[-1]}}}"] if in_row else self.batches
                targets = [CONTRACT[stage].path(each) for each in names]
                raise StoreError(f"{self.folder} has no {stage}; build it with: {command(self.folder, *targets)}")
            self._stores[path] = Store(path)
        return self._stores[path]

    def sensor(self, batch: str) -> Sensor:
        """The touch sensor of one batch, remembered. Raises StoreError, naming the file, if it states none."""
        if batch not in self._sensors:
            store = self.store("touch", batch)
            try:
                self._sensors[batch] = Sensor.from_description(store.attributes["sensor"], store.get("empty_reading"))
            except (KeyError, ConfigError) as error:
                raise StoreError(
                    f"{store.path} does not state its sensor ({error}); remove it and build it again with: "
                    f"{command(store.path)}"
                ) from None
        return self._sensors[batch]

    def objects(self, stage: str, batch: str) -> dict[str, int]:
        """Row of each object in one batch's store, remembered."""
        key = (stage, batch)
        if key not in self._objects:
            names = self.store(*key).get("object")
            self._objects[key] = {str(name): row for row, name in enumerate(names)}
        return self._objects[key]

    def row(self, stage: str, entry: CatalogueEntry) -> int:
        """Row of the object in its batch's store. Raises StoreError, with the object's rejection, if it has none."""
        objects = self.objects(stage, entry.batch)
        if entry.object in objects:
            return objects[entry.object]
        path = self.store(stage, entry.batch).path
        for row in self.rejections(entry.batch):
            if row["object"] == entry.object:
                raise StoreError(
                    f"{path} does not hold {entry.object}, which was rejected at {row['stage']}: "
                    f"{row['reason']}; open the dataset with this stage to omit it"
                )
        raise StoreError(
            f"{path} does not hold {entry.object}, which the catalogue puts in {entry.batch}; "
            f"remove it and build it again with: {command(path)}"
        )

    def grasps(self, entry: CatalogueEntry) -> int:
        """Grasps of the object, by the first stage that has grasps."""
        stages = [stage for stage, spec in CONTRACT.items() if any(array.of_grasps for array in spec.arrays.values())]
        stage = next((stage for stage in stages if self.has(stage)), stages[0])
        name = next(name for name, array in CONTRACT[stage].arrays.items() if array.of_grasps)
        self.row(stage, entry)
        return self.store(stage, entry.batch).header(name)[0][1]
