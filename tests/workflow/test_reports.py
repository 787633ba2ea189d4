"""Reports are made of just what the config asks for, and from just the stores that they need."""

import dataclasses

import pandas as pd
import pytest

from tests.workflow.conftest import EVERY_SPLIT

RULES = {"report_item", "report", "reports"}


def report_files(jobs) -> set[str]:
    """The items that the joined reports ask for."""
    return {path for job in jobs for path in job.inputs if path.startswith("reports/") and path.count("/") == 2}


@pytest.mark.parametrize(
    ("stages", "files"),
    [
        (["gel"], {"error_vs_runtime/gel", "stability/gel", "omitted/gel"}),
        (["touch"], {"error_vs_runtime/touch", "stability/rays", "omitted/touch"}),
        (
            ["renders", "decimation"],
            {
                "error_vs_runtime/renders",
                "error_vs_runtime/decimation",
                "stability/geometry",
                "omitted/renders",
            },
        ),
    ],
)
def test_a_subset_of_stages(finished, stages, files):
    jobs = finished.changed(reports={"stages": stages}).jobs("reports")
    assert {job.rule for job in jobs} == RULES
    assert report_files(jobs) == {f"reports/{file}.csv" for file in files}


def test_all_stages_and_what_they_are_made_from(make_workflow):
    jobs = make_workflow(split=EVERY_SPLIT).jobs("reports")
    assert len(report_files(jobs)) == 11 + 7 + 5
    assert {"meshes", "surface", "grasps", "touch", "vision", "touch_depth"} <= {job.rule for job in jobs}
    of_touch = make_workflow(split=EVERY_SPLIT, reports={"stages": ["touch"]}).planned("reports")
    assert {"meshes", "surface", "grasps"} <= of_touch and not {"touch", "vision", "touch_depth"} & of_touch


def test_reports_are_no_part_of_a_run(finished):
    assert not RULES & finished.planned("all")


@pytest.mark.parametrize("reports", [{"stages": ["tuoch"]}, {"rounds": 1}, {"stages": []}])
def test_a_mistake_in_the_config_is_an_error(make_workflow, reports):
    result = make_workflow(reports=reports)("reports", "--dry-run")
    assert result.returncode and f"reports.{next(iter(reports))}" in result.stdout + result.stderr


# Python runs a sitecustomize when it starts: one tolerance of the slow method, of four.
FEWER = """
import sys

if any(".report_item." in each for each in sys.orig_argv):
    from studies.error_vs_runtime import touch

    touch.TOLERANCES = touch.TOLERANCES[:1]
"""


def test_reports_on_a_folder_of_meshes(finished, tmp_path):
    """One stage, for real: the items joined, every method timed on every object; in a copy of the run."""
    (tmp_path / "sitecustomize.py").write_text(FEWER)
    workflow = finished.copied(tmp_path, reports={"stages": ["touch"], "objects": 2})
    result = dataclasses.replace(workflow, python_path=str(tmp_path))("reports")
    assert result.returncode == 0, result.stderr
    reports = workflow.run / "reports"
    table = pd.read_csv(reports / "error_vs_runtime.csv")
    assert set(table["object"]) == {"brick-millimetres", "can-nested-flat", "all"}
    assert table.groupby("object").size().nunique() == 1 and table["chosen"].any()
    verdicts = pd.read_csv(reports / "stability.csv")
    assert set(verdicts["suite"]) == {"rays"} and "fails" not in set(verdicts["verdict"])
    omitted = pd.read_csv(reports / "omitted.csv")
    assert (omitted.loc[omitted["omitted"], "verdict"] == "same").all()
    assert all((reports / f"{name}.png").stat().st_size for name in ("error_vs_runtime", "stability", "omitted"))
