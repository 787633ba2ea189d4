"""What is said at the start, before anything runs: splits, targets, seeds, folders, and configs, each in one line."""

import re

import pytest
import yaml

from tests.workflow.conftest import PROJECT, plan

FEW = [{"class": "bottle", "objects": 3}]


def lines(result) -> list[str]:
    """What is printed from the building of the graph of jobs on, or all that is printed."""
    text = result.stdout + result.stderr
    return text.rpartition("Building DAG of jobs...")[2].strip().splitlines()


def test_too_few_objects_for_a_split_is_said_at_the_start_with_the_way_to_set_it(make_workflow):
    workflow = make_workflow(source={"kind": "procedural"}, classes=FEW)
    for target in ("models/charts_occluded/seed-0/best.ckpt", "models/touch_depth/best.ckpt", "tables/grasps.csv"):
        (line,) = lines(workflow.plan(target, "--dry-run"))
        assert "no object of this run is in the validation split" in line and "needs (train 2, validation 0" in line
    split = yaml.safe_load(re.search(r"`(split: \{.*?\})` in the config", line)[1])
    assert workflow.changed(**split).planned("tables/grasps.csv") >= {"reconstruction", "evaluate", "table"}
    assert "vision" in workflow.planned("dataset")  # which needs no split


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"results": "/proc/nowhere"}, "/proc/nowhere/run: No such file or directory: set `results` in the config"),
        ({"vision": {"samples": 10**8}}, "  vision.samples: 100000000 is greater than the maximum of 65536"),
        ({"grasps": {"hand": {"mjcf": "no.xml", "sensors": "no.yaml"}}}, "no.xml: no such file"),
        ({"tuning": {"grid": "vast"}}, "vast"),
    ],
    ids=["results", "samples", "hand", "grid"],
)
def test_errors_of_the_config_come_without_snakemakes_frame(make_workflow, config, said):
    result = make_workflow(**config).plan("dataset")
    assert result.returncode != 0 and said in result.stderr
    for frame in ("WorkflowError", "configuration.smk", "Traceback", ", line "):
        assert frame not in result.stderr, result.stderr


def test_too_few_grasps_are_said_without_snakemakes_frame(make_workflow):
    workflow = make_workflow(grasps={"per_object": 2, "attempts": 2}, split={"train": 1, "validation": 1, "test": 1})
    (line,) = lines(workflow.plan("models/charts_touch_5/seed-0/best.ckpt", "--dry-run"))
    assert line.startswith("experiment charts_touch_5 takes 5 grasps")


def target(*arguments):
    result = plan(PROJECT, "--configfile", str(PROJECT / "config/smoke.yaml"), "--dry-run", *arguments)
    return result.returncode, lines(result)
