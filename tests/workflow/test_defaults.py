"""Every default that points to a row of the published report has one there, which holds it as chosen."""

import re

import pandas as pd
import pytest
import yaml

from tests.workflow.conftest import PROJECT, run_snakemake

REPORT = PROJECT / "docs/results/default/reports/error_vs_runtime.csv"
# What the report calls a value: in other units, or by another name.
AS_WRITTEN = {("grasps", "time step, ms"): 1e3}


def pointers() -> list[tuple[str, str, str]]:
    """(stage, knob, what is written before it) of every pointer in the config and the recipes."""
    found = []
    for name in ("config.yaml", "recipes.yaml"):
        for line in (PROJECT / "config" / name).read_text().splitlines():
            value, _, comment = line.partition("#")
            if value.strip():
                found += [(*pointer, value) for pointer in re.findall(r"\[([^:\]]+): ([^\]]+)\]", comment)]
    return found


def numbers(written: str) -> list[float]:
    """The numbers in a line of YAML, nested ones too."""
    values = list(yaml.safe_load(written).values())
    for value in values:
        values += list(value.values()) if isinstance(value, dict) else []
    return [value for value in values if isinstance(value, int | float)]


@pytest.fixture(scope="module")
def report():
    return pd.read_csv(REPORT, dtype={"value": str})


def test_there_are_pointers_for_every_stage_with_a_key():
    stages = {"decimation", "grasps", "renders", "chamfer distance", "reconstruction"}
    assert {stage for stage, _, _ in pointers()} == stages


@pytest.mark.parametrize(("stage", "knob", "written"), pointers())
def test_a_default_is_what_the_report_has_as_chosen(report, stage, knob, written):
    rows = report[(report["stage"] == stage) & (report["knob"] == knob)]
    assert rows["value"].nunique() > 1, "nothing to choose from"
    chosen = pd.to_numeric(rows.loc[rows["chosen"], "value"], errors="coerce")
    assert len(chosen)
    expected = [number * AS_WRITTEN.get((stage, knob), 1) for number in numbers(written)]
    assert not expected or any(chosen.eq(number).any() for number in expected)


def test_the_readme_says_how_many_models_the_default_run_trains(tmp_path):
    """Trainings of a dry run; with more seeds each but the U-Net is trained again."""
    found = []
    for seeds in ("[0]", "[0,1]"):
        config = [f"results={tmp_path}", f"training={{seeds: {seeds}}}"]
        planned = run_snakemake(PROJECT, "all", "--dry-run", "--config", *config)
        stats = re.findall(r"^(?:reconstruction|touch_depth) +(\d+)$", planned.stdout, re.MULTILINE)
        assert len(stats) >= 2, planned.stdout + planned.stderr
        found.append(sum(map(int, stats[:2])))
    assert found[1] == 2 * found[0] - 1
    assert set(re.findall(r"trains (\d+) models", (PROJECT / "README.md").read_text())) == {str(found[0])}
