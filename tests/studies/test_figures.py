"""The reports' figures are drawn from every kind of row, and show what they should."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from studies import figures
from studies.error_vs_runtime.study import ALL, over_objects
from studies.stability.cases import Cases, at_least, at_most, equal, rejects, report


def study_rows(stage: str, errors, seconds, chosen: int, objects=("a", ALL)) -> list[dict]:
    return [
        {
            "stage": stage,
            "object": name,
            "method": "fast" if k < 2 else "exact",
            "knob": "steps",
            "value": k,
            "chosen": k == chosen,
            "measure": measure,
            "drawn": measure == "depth",
            "error": error,
            "unit": "mm",
            "seconds": time,
            "seconds_low": 0.9 * time,
            "seconds_high": 1.2 * time,
            "front": k != 1,
            "noisy": k == 2,
        }
        for name in objects
        for measure in ("depth", "angle")
        for k, (error, time) in enumerate(zip(errors, seconds, strict=True))
    ]


def test_fronts(tmp_path):
    stages = ["decimation", "touch", "grasps", "renders"]
    rows = [row for s in stages for row in study_rows(s, [1.0, 2.0, 0.1, 0.0], [0.01, 0.02, 0.1, 1.0], 2)]
    rows += study_rows("one object, all exact or unknown", [0.0, np.nan], [1.0, 2.0], 0, objects=("a",))
    table = pd.DataFrame(rows)
    figures.fronts(table, tmp_path / "fronts.png")
    picture = imread(tmp_path / "fronts.png")
    assert (picture[..., :3].min(axis=2) < 0.9).mean() > 0.01
    drawn = over_objects(table).groupby("stage")["object"].unique().map(list).to_dict()
    assert drawn == {**dict.fromkeys(stages, [ALL]), "one object, all exact or unknown": ["a"]}


@pytest.mark.parametrize(
    ("finding", "margin"),
    [
        (at_most("q", 0.5, 2.0), 0.25),
        (at_most("q", 4.0, 2.0), 2.0),
        (at_least("q", 4.0, 2.0), 0.5),
        (at_most("q", 0.0, 0.0), 1e-6),
        (at_most("q", 0.1, 0.0), 1.0),
        (at_most("q", float("nan"), 2.0), 1e6),
        (equal("q", 3, 3), 1e-6),
        (rejects("q", lambda: int("x"), ValueError, "invalid"), 1e-6),
    ],
)
def test_margin(finding, margin):
    assert figures._margin(pd.Series(finding._asdict())) == pytest.approx(margin)


def test_margins(tmp_path):
    cases = Cases()

    @cases.case("a case", "grasps")
    def case(subject):
        yield at_most("penetration", 0.2, 1.0, "mm")
        yield at_most("energy", 3.0, 1.0, "J")
        yield rejects("a long quantity " * 8, lambda: int("x"), ValueError, "invalid")

    table = pd.concat([report(suite, cases, None) for suite in ("contact", "rays")])
    figures.margins(table, tmp_path / "margins.png")
    red, green = np.array([213, 94, 0]) / 255, np.array([0, 158, 115]) / 255
    pixels = imread(tmp_path / "margins.png")[..., :3]
    for colour in (red, green):
        assert (np.abs(pixels - (0.7 * colour + 0.3)).max(axis=2) < 0.03).sum() > 5


def test_savings(tmp_path):
    items = [("gravity", 0.1, np.nan), ("visual geometry", 0.97, 8.0), ("friction", 0.5, 1)]
    rows = [
        {
            "stage": "grasp",
            "item": item,
            "state": "not modelled" if k == 2 else "omitted",
            "seconds_with": 1.0,
            "seconds_without": share,
            "bytes_with": size,
            "bytes_without": 0.5 * size,
            "verdict": "differs" if k == 2 else "same",
            "noisy": k == 1,
        }
        for k, (item, share, size) in enumerate(items)
    ]
    figures.savings(pd.DataFrame(rows), tmp_path / "savings.png")
    assert (imread(tmp_path / "savings.png")[..., :3].min(axis=2) < 0.9).mean() > 0.01
