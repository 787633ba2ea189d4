"""Verdicts, and what becomes of errors and warnings in a case."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

from studies.stability.cases import COLUMNS, FAILS, HOLDS, REJECTED, Cases, at_least, at_most, equal, rejects, report


@pytest.mark.parametrize(
    ("finding", "verdict"),
    [
        (at_most("depth", 1.0, 1.0, "mm"), HOLDS),
        (at_most("depth", 1.1, 1.0, "mm"), FAILS),
        (at_most("depth", float("nan"), 1.0, "mm"), FAILS),
        (at_least("depth", float("nan"), 1.0), FAILS),
        (at_least("points", 3, 2), HOLDS),
        (equal("points", 3, 3), HOLDS),
        (equal("points", 3, 2), FAILS),
        (rejects("mesh", lambda: int("x"), ValueError, "invalid literal"), REJECTED),
        (rejects("mesh", lambda: int("x"), ValueError, "no such reason"), FAILS),
        (rejects("mesh", lambda: int("1"), ValueError, "invalid literal"), FAILS),
    ],
)
def test_verdict(finding, verdict):
    assert finding.verdict == verdict


def test_an_unexpected_error_in_rejects_is_not_swallowed():
    with pytest.raises(KeyError):
        rejects("mesh", lambda: {}["x"], ValueError, "x")


def test_report_holds_every_finding_error_and_warning():
    cases = Cases()

    @cases.case("fine", "grasps")
    def fine(subject):
        yield at_most("of the subject", subject, 5)

    @cases.case("stops half way", "grasps", short=False)
    def stops(subject):
        yield at_most("before", 1, 5)
        raise RuntimeError("boom")

    @cases.case("warns", "touch")
    def warns(subject):
        yield at_most("quotient", float(np.minimum(np.float64(1) / np.zeros(1), 1)[0]), 5)

    @cases.case("empty", "touch")
    def empty(subject):
        return iter(())

    table = report("contact", cases, 3)
    assert tuple(table.columns) == COLUMNS and (table["suite"] == "contact").all()
    verdicts = table.groupby("case", sort=False)["verdict"].agg(list).to_dict()
    assert verdicts == {"fine": [HOLDS], "stops half way": [HOLDS, FAILS], "warns": [HOLDS, FAILS], "empty": [FAILS]}
    assert "boom" in table.set_index("quantity").loc["runs to its end", "note"].iloc[0]
    assert "divide by zero" in table.set_index("quantity").loc["numerical warnings", "note"]
    assert [case.short for case in cases] == [True, False, True, True]


def test_notes_name_files_without_their_temporary_folder(tmp_path_factory):
    cases = Cases()

    @cases.case("a file", "meshes")
    def case(subject):
        with tempfile.TemporaryDirectory() as folder:
            yield rejects("mesh", (Path(folder) / "source.ply").read_bytes, OSError, "No such file")

    (note,) = report("geometry", cases, None)["note"]
    assert note.endswith("'source.ply'")
