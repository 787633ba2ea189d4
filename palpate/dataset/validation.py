"""Validation of a run: batch by batch, so that a workflow can do it in parallel, then joined to one table."""

import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate import seal
from palpate.batch import progress, read_rejections
from palpate.catalogue import SPLITS, CatalogueEntry, is_unchanged, read_catalogue
from palpate.dataset import checks
from palpate.dataset.checks import CHECKS, CheckedObject, Measured
from palpate.dataset.run import Run
from palpate.hand import MAX_PENETRATION, Hand
from palpate.rebuild_command import BATCHES, rebuild_command
from palpate.seal import NOTHING, DamagedFile, DigestOf, MadeFrom, Seal
from palpate.sensor import DIGIT, Sensor
from palpate.stages import DATASET_STORES, STAGES
from palpate.store.contract import CONTRACT, SENSOR_NAMES
from palpate.store.files import Store, StoreError, check_headers
from palpate.text_files import read_rows, write_rows
from palpate.touch import empty_reading, shade_pressed

if TYPE_CHECKING:
    import pandas as pd

NAMED = 5  # how many failures a row names
# What jobs write into a run's folder, file by file.
SEALED = (
    *("batches.json", "catalogue.csv", "config.yaml", "rejected.csv"),
    *("catalogue", "evaluations", "figures", "meshes", "models", "rejected", "reports", "tables", "tuning"),
)


class Finding(NamedTuple):
    """What one check found: in an object, or in a whole store (no object), or in the whole run (no batch)."""

    check: str
    store: str
    batch: str
    object: str
    where: str
    value: float
    limit: float

    @property
    def ok(self) -> bool:
        """Whether the check passed; NaN fails."""
        return self.value <= self.limit


class _Batch:
    """One batch under validation: its opened stores, and the findings so far."""

    def __init__(self, run: Run, name: str, stages: Sequence[str], max_penetration: float):
        self.run, self.name = run, name
        self.limits = {check: spec.limit for check, spec in CHECKS.items()}
        self.limits["penetration"] = float(np.float32(max_penetration))  # as it is stored
        self.limits["in hand"] = max_penetration
        self.sensor_names: tuple[str, ...] = SENSOR_NAMES
        self.catalogue = [entry.object for entry in read_catalogue(run.folder / f"catalogue/{name}.csv")]
        self.rejected = run.rejections(name)
        self.findings: list[Finding] = []
        self.stores: dict[str, Store] = {}
        self.arrays: dict[str, set[str]] = {}
        self.objects: dict[str, list[str]] = {}
        for stage in stages:
            self.open(stage)

    def add(self, check: str, store: str, value: float, object: str = "", where: str = "") -> None:
        value, limit = float(value), float(self.limits[check])
        self.findings.append(Finding(check, store, self.name, object, where, value, limit))

    @contextmanager
    def reading(
        self, stage: str, object: str = "", beside: Iterable[str] = (), check: str = "readable"
    ) -> Iterator[None]:
        """Context in which an error of reading a store becomes a finding and ends the block. So does an error of arrays
        that do not fit the stores `beside`, as those of another hand: it is a finding of `check`."""
        try:
            yield
        except StoreError as error:
            self.add("readable", stage, 1, object, str(error))
        except (LookupError, TypeError, ValueError) as error:  # what numpy and Hand raise for other shapes
            path, others = self.run.folder / CONTRACT[stage].path(self.name), ", ".join(beside) or "the run"
            why = f"{type(error).__name__}: {error}; build them again from one config"
            self.add(check, stage, np.inf, object, f"{path} does not fit {others}: {why}")

    def open(self, stage: str) -> None:
        """Open the store; adds a finding if its names, shapes or types violate the contract."""
        path = self.run.folder / CONTRACT[stage].path(self.name)
        with self.reading(stage):
            store = Store(path)
            objects = store.get("object").tolist()
            self.add("readable", stage, 0)
            missing = sorted(set(CONTRACT[stage].all_attributes) - set(store.attributes))
            self.add("attributes", stage, len(missing), where=", ".join(missing))
            try:
                headers = {name: store.header(name) for name in store.names()}
                check_headers(path, CONTRACT[stage], headers, optional=bool(STAGES[stage].asked_by))
            except StoreError as error:
                self.add("arrays", stage, 1, where=str(error))
                return
            self.add("arrays", stage, 0)
            self.stores[stage], self.objects[stage], self.arrays[stage] = store, objects, set(headers)

    def hand(self) -> Hand | None:
        """The hand in the grasps store; None, with a finding, if it is incomplete."""
        if "grasps" not in self.stores:
            return None
        store = self.stores["grasps"]
        try:
            hand = Hand.from_arrays(store, prefix="hand/")
            self.sensor_names = hand.sensor_names
            return hand
        except (KeyError, ValueError) as error:  # ValueError: StoreError, or a hand that makes no sense
            self.add("readable", "grasps", 1, where=f"hand: {type(error).__name__}: {error}")
            return None

    def sensor(self) -> Sensor:
        """The sensor that the touch store states; the default, with a finding, if it states none."""
        for stage in ("touch", "press"):
            with self.reading(stage):
                if stage in self.stores:
                    return self.stores[stage].sensor
        return DIGIT

    def check_objects(self, stage: str) -> None:
        """The store's objects are the catalogue's except the rejected ones, in order."""
        stages = {*STAGES[stage].rejecting, *({row["stage"] for row in self.rejected} - set(DATASET_STORES))}
        rejected = {row["object"] for row in self.rejected if row["stage"] in stages}
        expected = [name for name in self.catalogue if name not in rejected]
        found = self.objects[stage]
        wrong = ", ".join(sorted({*expected} ^ {*found})) or "another order" * (found != expected)
        self.add("objects", stage, len({*expected} ^ {*found}) or found != expected, where=wrong)

    def check_empty_reading(self, sensor: Sensor) -> None:
        # Whether a store without objects is of pressed gels, it does not say.
        for stage in [name for name in ("touch", "press") if self.objects.get(name)]:
            with self.reading(stage):
                stored, pressed = self.stores[stage].empty_reading.astype(int), "indentation" in self.arrays[stage]
                expected = shade_pressed(np.zeros(sensor.resolution), sensor) if pressed else empty_reading(sensor)
                same = stored.shape == expected.shape
                self.add("empty reading", stage, np.abs(stored - expected).max() if same else np.inf)

    def check_object(self, name: str, hand: Hand | None, sensor: Sensor) -> None:
        item = CheckedObject({}, self.run.folder / "meshes" / self.name / name, hand, sensor)
        try:
            self.measure("meshes", name, checks.check_mesh(item))
        except Exception as error:  # the reader raises whatever a broken file makes it trip over
            self.add("readable", "meshes", 1, name, f"{item.folder}: {type(error).__name__}: {error}")
            return
        self.add("readable", "meshes", 0, name)
        for stage in self.stores:
            if name in self.objects[stage] and not (stage in ("grasps", "frames") and hand is None):
                row, specs = self.objects[stage].index(name), CONTRACT[stage].arrays
                stored = (key for key, spec in specs.items() if spec.of_objects and key in self.arrays[stage])
                with self.reading(stage, name, beside=[*item.rows]):
                    item.rows[stage] = {key: self.stores[stage].get(key, row) for key in stored}
                    check = checks.OF_STAGE.get(stage, partial(checks.check_values, stage))
                    self.measure(stage, name, check(item))
        if {"grasps", "touch"} <= set(item.rows):
            with self.reading("touch", name, beside=["grasps"], check="sensor poses"):
                self.measure("touch", name, checks.check_together(item))

    def measure(self, store: str, name: str, measured: Measured) -> None:
        """Add the worst value of each check; NaN counts as infinite."""
        sensors = dict(enumerate(self.sensor_names))  # of the hand: a store made with another may have more
        for check, values in measured:
            values = np.asarray(values, dtype=float)
            values = np.where(np.isnan(values), np.inf, values)
            worst, where = values.max(initial=0), ""
            if worst > 0 and values.ndim:  # "grasp 2, sensor thumb"
                number, *sensor = np.unravel_index((values == worst).argmax(), values.shape)
                unit = "press" if store == "press" else "grasp"
                where = ", ".join([f"{unit} {number}", *(f"sensor {sensors.get(i, i)}" for i in sensor)])
            self.add(check, store, worst, name, where)


def check_files(run: Run, batch: str, stages: Sequence[str] | None = None, others: bool = True) -> list[Finding]:
    """Compare all files of a batch with their seals, and the seals with what the run has now: meshes, the stores of
    `stages`, by default those of the run's dataset, and `others` that are there. `where` of a finding of files that
    passed is the digest of their seal: as long as it stays, so do the findings of their values."""
    findings, stages = [], ("meshes", *(stages or run.asked_stores))
    paths = {name: run.folder / stage.path(batch) for name, stage in STAGES.items()}
    paths["exr"] = run.folder / "exr" / batch
    for stage, path in paths.items():
        if stage in stages or (path.exists() and (others or stage == "exr")):
            damage, difference, sealed = look_at(run, path)
            findings.append(_finding("files", stage, batch, [damage], sealed.digest if sealed else ""))
            if sealed:
                findings.append(_finding("made from", stage, batch, [difference]))
    return findings


def look_at(run: Run, path: Path, digest_of: DigestOf | None = None) -> tuple[str, str, Seal | None]:
    """An output of a run: what is wrong with its files, how it was made from something else than the run has now, both
    with the remedy and empty if nothing is; and its seal, if it is whole. digest_of: by default `Run.digest`."""
    try:
        if sealed := seal.find(path):
            sealed.require()
    except (DamagedFile, OSError) as error:
        return str(error), "", None
    difference = sealed.difference(run.values, digest_of or run.digest) if sealed else ""
    return "", sealed.refusal(difference) if sealed and difference else "", sealed


def _finding(check: str, store: str, batch: str, wrong: Iterable[str], passed: str = "") -> Finding:
    """The finding of a check that passes if nothing is wrong; passed: what `where` says then. Empty texts of what is
    wrong do not count."""
    wrong = sorted(filter(None, wrong))
    return Finding(check, store, batch, "", ", ".join(wrong[:NAMED]) or passed, len(wrong), CHECKS[check].limit)


def outputs(run: Path) -> Iterator[Path]:
    """The files of a run that have, or should have, a seal of their own, but for those of batches: in order."""
    required = (run / BATCHES).exists()
    for place, folders, files in os.walk(run):
        within = Path(place).relative_to(run).parts
        folders[:] = sorted(name for name in folders if not name.startswith(".") and ".zarr" not in name)
        if seal.NAME in files or within[:1] == ("exr",):
            folders[:] = []
            continue
        for path in (Path(place, name) for name in sorted(files) if not name.startswith(".")):
            of_job = within[0] in SEALED if within else path.name in SEALED
            if seal.beside(path).name in files or (of_job and (required or path.suffix in seal.WITHIN)):
                yield path


def validate_batch(
    run: Path | str,
    batch: str,
    max_penetration: float = MAX_PENETRATION,
    stages: Sequence[str] | None = None,
    others: bool = True,
) -> list[Finding]:
    """Check every file and every array of every store of one batch.
    max_penetration: metres, by which the run's grasps were accepted. stages: whose stores are checked, by default those
    of the run's dataset; one that is missing fails. others: whether files of further stores are compared as well. Needs
    `catalogue/<batch>.csv` and the meshes. What is wrong with a store or a mesh never raises: it is a finding."""
    stages = stages or Run(run).asked_stores
    opened = Run(run, batch)  # of all batches the catalogue may not be there yet
    checked = _Batch(opened, batch, stages, max_penetration)
    for stage in checked.stores:
        checked.check_objects(stage)
    hand, sensor = checked.hand(), checked.sensor()
    checked.check_empty_reading(sensor)
    stored = {name for objects in checked.objects.values() for name in objects}
    for name in [name for name in checked.catalogue if name in stored]:
        checked.check_object(name, hand, sensor)
    return [*check_files(opened, batch, stages, others), *checked.findings]


def write_findings(path: Path | str, findings: Iterable[Finding], made_from: MadeFrom = NOTHING) -> None:
    """Write a batch's findings as a table with the columns of `Finding`, and its seal."""
    write_rows(path, Finding._fields, findings, made_from)


def read_findings(path: Path | str) -> list[Finding]:
    rows = (Finding._make(row[name] for name in Finding._fields) for row in read_rows(path, Finding._fields))
    return [row._replace(value=float(row.value), limit=float(row.limit)) for row in rows]


def check_again(
    run: Path | str, batches: Iterable[Path | str], max_penetration: float = MAX_PENETRATION
) -> tuple[list[Finding], int]:
    """The findings of a run whose batches were validated before, and how many batches had to be validated anew.
    batches: tables of `write_findings`, `<batch>.csv`. All files are compared with their checksums. Values are looked
    at again if the files are intact but not those that the table is about, or if there is no table."""
    findings, anew, opened = [], 0, Run(run)
    for path in progress([*map(Path, batches)], desc="validate", unit="batch"):
        if path.exists():
            before, now = read_findings(path), check_files(opened, path.stem)
            states = {finding.store: finding.where for finding in now if finding.ok and finding.check == "files"}
            about = {finding.store: finding.where for finding in before if finding.check == "files"}
            if any(not each.ok for each in now) or all(states.get(store) == state for store, state in about.items()):
                findings += [*now, *(finding for finding in before if finding.check not in ("files", "made from"))]
                continue
        findings += validate_batch(run, path.stem, max_penetration)
        anew += 1
    return findings, anew


def validate(
    run: Path | str,
    batches: Sequence[Path | str],
    max_penetration: float = MAX_PENETRATION,
    sources: Path | str | None = None,
) -> tuple[bool, str]:
    """Check a run again: whether all checks passed, and what was checked and found, in words. A run of which no object
    could be used does not pass. Arguments are those of `check_again` and `combine_validation`."""
    start, run = time.perf_counter(), Path(run)
    findings, anew = check_again(run, batches, max_penetration)
    table = combine_validation(findings, run, sources, outputs(run))
    checked = f"{len(table)} checks, {len({finding.object for finding in findings if finding.object})} objects"
    took = f"in {time.perf_counter() - start:.1f} s (values of {anew} of {len(batches)} batches anew)"
    relevant = [check for check in checks.ENGINES if check != "outside" or "press" in Run(run).asked_stores]
    if anew and (unchecked := [check for check in relevant if not checks.can_check(check)]):
        took += f"; not checked: {', '.join(unchecked)}: pip install 'palpate[factory]' brings the engines for that"
    failed = table[~table.passed]
    if len(failed):
        lines = failed.to_string(index=False, max_colwidth=None)
        return False, f"{checked}: {len(failed)} failed, {took}\n{lines}"
    catalogue, rejected = read_catalogue(run / "catalogue.csv"), read_rejections([run / "rejected.csv"])
    if {entry.object for entry in catalogue} <= {rejection.object for rejection in rejected}:
        return False, f"none of {len(catalogue)} objects could be used; the first: {rejected[0].reason}"
    return True, f"{checked}: passed, {took}"


def combine_validation(
    findings: Sequence[Finding],
    run: Path | str,
    sources: Path | str | None = None,
    files: Iterable[Path] | None = None,
) -> "pd.DataFrame":
    """One row a check, store and batch, after the checks that need the whole run.
    findings: of all batches. sources: the folder of the source files, which are compared with the catalogue's checksums
    if it is given. files: that are compared with their seals, by default catalogue and rejections: others may be made
    while a run goes on. Columns: check, store, batch, objects (how many were checked; 0 for a check of a whole store),
    worst, limit, passed, where (what failed: object, grasp, sensor)."""
    import pandas as pd

    run, opened = Path(run), Run(run)
    damaged, outdated, digest_of = [], [], cache(opened.digest)
    for path in [run / "catalogue.csv", run / "rejected.csv"] if files is None else files:
        batch = path.stem.removesuffix(".facts")
        damage, difference, _ = look_at(opened, path, digest_of)
        if damage and path.exists():  # what was removed is built again
            damaged.append(damage)
        if difference and not (batch.startswith("batch-") and batch not in opened.batches):  # of an earlier config
            outdated.append(difference)
    catalogue = read_catalogue(run / "catalogue.csv")
    counts = Counter(entry.object for entry in catalogue)
    misplaced = {each.object for each in catalogue if counts[each.object] > 1 or each.split not in SPLITS}
    of_run = [
        _finding("one split", "catalogue", "", misplaced),
        _finding("tables", "run", "", damaged),
        _finding("made from", "run", "", outdated),
    ]
    if sources is not None:
        of_run.append(_check_sources(run, catalogue, Path(sources)))
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in [*of_run, *findings]:
        groups.setdefault((finding.check, finding.store, finding.batch), []).append(finding)
    rows = []
    for key, group in groups.items():
        failed = [": ".join(filter(None, (each.object, each.where))) for each in group if not each.ok]
        objects, worst = sum(bool(each.object) for each in group), max(each.value for each in group)
        rows.append((*key, objects, worst, group[0].limit, not failed, seal.join_first(failed, NAMED)))
    return pd.DataFrame(rows, columns=["check", "store", "batch", "objects", "worst", "limit", "passed", "where"])


def _check_sources(run: Path, catalogue: list[CatalogueEntry], root: Path) -> Finding:
    """Source files against the catalogue, by their checksums."""
    paths = [(root / entry.source, entry.checksum) for entry in catalogue]
    changed = [str(path) for path, before in paths if not is_unchanged(path, before, root)]
    finding = _finding("sources", "catalogue", "", changed)
    if finding.ok:
        return finding
    again = rebuild_command(run, "dataset")
    return finding._replace(where=f"{finding.where}: not what the run was made from; put it back, or start {again}")
