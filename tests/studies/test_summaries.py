"""What the reports' small tables say."""

import pandas as pd

from studies import summaries
from studies.error_vs_runtime.study import ALL
from studies.report import read, write
from studies.stability.cases import Cases, at_most, rejects, report


def test_fronts_hold_what_is_best_or_chosen():
    def row(name, value, error, seconds, front, chosen, noisy=False):
        return {
            "stage": "touch", "object": name, "method": "rays", "knob": "steps", "value": value,
            "chosen": chosen, "measure": "depth", "reference": "every ray", "drawn": True,
            "error": error, "unit": "mm",
            "seconds": seconds, "seconds_low": seconds, "seconds_high": 2 * seconds, "rounds": 5,
            "front": front, "noisy": noisy,
        }  # fmt: skip

    rows = [row("a", 1, 9.0, 9.0, True, True)]
    rows += [row(ALL, 3, 0.1, 0.2, True, False, noisy=True), row(ALL, 2, 1.0, 0.15, False, True)]
    rows += [row(ALL, 1, 0.5, 0.1, True, False), row(ALL, 0, 9.0, 9.0, False, False)]
    summary = summaries.fronts(pd.DataFrame(rows))
    assert summary["knob"].tolist() == ["steps 1", "steps 2", "steps 3"]
    assert summary["ms"].tolist() == ["100 (100 to 200)", "150 (150 to 300)", "200 (200 to 400)?"]
    assert summary["error"].tolist() == ["0.5", "1", "0.1"]
    assert summary["chosen"].tolist() == ["", "chosen", ""]
    assert "- touch: every ray" in summary.attrs["note"]


def test_verdicts_show_what_fails_first(tmp_path):
    cases = Cases()

    @cases.case("good", "grasps")
    def good(subject):
        yield at_most("depth", 0.12345, 1.0, "mm")
        yield rejects("mesh", lambda: int("x"), ValueError, "invalid")

    @cases.case("bad", "grasps")
    def bad(subject):
        yield at_most("depth", 0.1, 1.0, "mm")
        yield at_most("energy", 2.0, 1.0)

    write(report("contact", cases, None), tmp_path / "part.csv")
    summary = summaries.verdicts(read([tmp_path / "part.csv"])).set_index("case")
    assert summary.loc["good", ["holds", "rejected", "fails"]].tolist() == [1, 1, 0]
    assert summary.loc["bad", ["holds", "rejected", "fails"]].tolist() == [1, 0, 1]
    assert summary.loc["good", "for example"] == "depth: 0.123 mm (<= 1)"
    assert summary.loc["bad", "for example"] == "energy: 2 (<= 1)"


def test_savings_are_means_and_the_worst_difference():
    def row(item, difference, verdict, state, noisy):
        return {
            "stage": "grasp", "item": item, "when": "always", "state": state, "seconds_with": 0.2,
            "seconds_without": 0.1, "bytes_with": 2048.0, "bytes_without": 1024.0, "difference": difference,
            "unit": "mm", "verdict": verdict, "noisy": noisy,
        }  # fmt: skip

    rows = [row("gravity", 0.0, "same", "omitted", False), row("gravity", 0.5, "same", "omitted", True)]
    rows += [
        row("friction", 3.0, "differs", "not modelled", True),
        row("self-collision", 1.0, "differs", "stays", False),
    ]
    summary = summaries.savings(pd.DataFrame(rows)).set_index("item")
    assert summary.loc["gravity", "largest difference"] == "0.5 mm" and summary.loc["gravity", "verdict"] == "same"
    assert summary["ms without"].to_dict() == {"gravity": "100", "friction": "100?", "self-collision": "100"}
    assert summary.loc["friction", "verdict"] == "differs, not modelled" and summary.loc["gravity", "KiB with"] == "2"
    assert summary.loc["self-collision", "verdict"] == "differs, stays"
