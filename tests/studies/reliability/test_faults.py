"""The study of faults: it counts what it should, and leaves the run as it was."""

import shutil

import numpy as np
import pytest

from palpate.dataset.validation import validate_batch, write_findings
from studies.reliability import faults
from studies.reliability.faults import COLUMNS, Try, row
from tests.store.conftest import *  # noqa: F403


@pytest.fixture(scope="module")
def copy(built, tmp_path_factory):
    run = shutil.copytree(built, tmp_path_factory.mktemp("faults") / "run")
    for batch in ("batch-0000", "batch-0001"):
        write_findings(run / f"reports/validation/{batch}.csv", validate_batch(run, batch))
    return run


def contents(run):
    return {path.relative_to(run): path.read_bytes() for path in run.rglob("*") if path.is_file()}


@pytest.mark.parametrize("kind", [kind for kind in faults.KINDS if kind.name in ("surface store", "grasps store")])
@pytest.mark.parametrize("damage", faults.DAMAGES.values())
def test_no_fault_of_a_store_is_silent(copy, kind, damage):
    before = contents(copy)
    tries = faults.apply(kind, damage, copy, np.random.default_rng(0), 3)
    assert len(tries) == 3 and {found.noticed for found in tries} <= {"reader", "validate", "unchanged"}
    assert contents(copy) == before


def test_what_nobody_notices_is_silent(copy):
    def rename(content, rng):
        return content.replace(b"ball-0002", b"ball-0003")

    kind = next(kind for kind in faults.KINDS if kind.name == "catalogue.csv")  # without a checksum beside it here
    rng = np.random.default_rng(0)
    assert {found.noticed for found in faults.apply(kind, rename, copy, rng, 1)} == {"silent"}


def test_a_row_counts_each_outcome(tmp_path):
    tries = [Try("reader", f"StoreError: {tmp_path}/touch is damaged\nmore"), Try("silent"), Try("reader")]
    found = row("cut", tries, tmp_path)
    assert list(found) == list(COLUMNS)
    assert list(found.values()) == ["cut", 3, 2, 0, 0, 1, "StoreError: RUN/touch is damaged"]
