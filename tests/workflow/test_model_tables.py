"""What the tables' rules ask for, by dry runs of the real Snakefile with experiments of another kind."""

import re
import shutil

import pytest
import yaml

from palpate.results.published import effects
from tests.learning.synthetic import DECLARED, EXPERIMENTS
from tests.workflow.conftest import PROJECT, run_snakemake

GRASPS = DECLARED.tables["grasps"].by_name


@pytest.fixture
def project(tmp_path):
    """A copy of the workflow, whose config may be changed."""
    for name in ("Snakefile", "workflow", "config", "envs"):
        source = PROJECT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    for name in ("palpate", "studies"):
        (tmp_path / name).symlink_to(PROJECT / name)
    return tmp_path


def declared(project, change) -> None:
    """Apply a function to what config/experiments.yaml says."""
    path = project / "config/experiments.yaml"
    held = yaml.safe_load(path.read_text())
    change(held)
    path.write_text(yaml.safe_dump(held, sort_keys=False))


def trained(names) -> set[str]:
    """The models that experiments are evaluated with."""
    return {EXPERIMENTS[name].trained for name in names}


def models(names) -> set[str]:
    """Those of them that are models: not retrieval, which is measured only."""
    return {name for name in trained(names) if EXPERIMENTS[name].is_trained}


def counts(project, *targets) -> dict[str, int]:
    """How many jobs of each rule a dry run would run."""
    result = run_snakemake(project, "--dry-run", *targets)
    assert result.returncode == 0, result.stdout + result.stderr
    stats = re.search(r"^job +count\n-.*?\n(.*?)^total", result.stdout, re.MULTILINE | re.DOTALL)
    return {line.split()[0]: int(line.split()[1]) for line in stats[1].splitlines()}


def test_a_table_trains_and_measures_just_its_experiments(project):
    table = counts(project, "tables/model_selection.csv")
    names = DECLARED.tables["model_selection"].by_name
    assert (table["reconstruction"], table["evaluate"], table["table"]) == (len(models(names)), len(trained(names)), 1)
    assert not {"views", "rings", "evaluate_touch"} & set(table)
    local = counts(project, "tables/local_touch_charts.csv")
    assert not {"vision", "views", "reconstruction"} & set(local) and local["evaluate_touch"] == 1
    single = counts(project, "tables/single_image.csv")
    assert not {"grasps", "touch", "vision"} & set(single) and single["reconstruction"] == 4
    assert set(counts(project, "tables/architectures/occluded.csv")) == {"table"}
    tuning = counts(project, "tables/tuning.csv")
    assert "reconstruction" not in tuning and tuning["tuning_point"] == 2**3 and "vision" in tuning


def test_effects_take_the_experiments_that_are_compared(project):
    found = counts(project, "tables/touch_effect.csv")
    compared = {row[key] for row in effects(EXPERIMENTS) for key in ("experiment", "compared_with")}
    assert found["evaluate"] == len(trained(compared)) > 12 and "evaluate_rings" not in found
    quality = counts(project, "tables/surface_quality.csv")
    assert quality["evaluate"] == len(trained(DECLARED.tables["input_modalities"].by_name))
    assert quality["table"] == 1


def test_every_seed_is_trained_and_measured(project):
    more = project / "more.yaml"
    more.write_text("training: {seeds: [0, 3]}\n")
    table = counts(project, "tables/extrapolation.csv", "--configfile", str(more))
    names = trained(DECLARED.tables["extrapolation"].by_name)
    assert table["evaluate_rings"] == table["reconstruction"] == 2 * len(names)
    table, names = counts(project, "tables/grasps.csv", "--configfile", str(more)), GRASPS
    assert table["reconstruction"] == 2 * len(models(names))
    assert table["evaluate"] == 2 * len(models(names)) + len(trained(names) - models(names))


def test_a_table_that_is_not_declared_is_not_built(project):
    def grasps_only(held):
        held["tables"] = {"grasps": held["tables"]["grasps"]}
        names = {*GRASPS} | trained(GRASPS)
        held["experiments"] = [
            {"method": each.method.name, "name": name}
            | {key: getattr(each, key) for key in ("vision", "touch", "grasps", "fewer_grasps")}
            | ({"weights": each.weights} if each.weights else {})
            for name, each in EXPERIMENTS.items()
            if name in names
        ]

    declared(project, grasps_only)
    # Of `all`, figures of models that are not declared are not the tables' matter: ask for the tables.
    found = counts(project, "tables/grasps.csv", "figures/multi_grasp.png")
    assert found["reconstruction"] == len(models(GRASPS))
    for target, message in (
        ("tables/claims.csv", "is needed, but config/experiments.yaml does not define it"),
        ("tables/input_modalities.csv", "defines no table input_modalities"),
    ):
        result = run_snakemake(project, "--dry-run", target)
        assert result.returncode and message in result.stdout + result.stderr


def test_an_experiment_of_ones_own_is_trained_and_stands_in_a_table(project):
    def with_mine(held):
        mine = {"name": "wider", "method": "charts", "vision": "occluded", "touch": True}
        held["experiments"] += [mine | {"architecture": {"gcn": {"width": 96}}}]
        held["experiments"] += [{"method": "template", "vision": "occluded", "touch": True, "grasps": [2, 3]}]
        held["tables"]["input_modalities"]["experiments"] += ["wider"]

    declared(project, with_mine)
    assert counts(project, "models/wider/seed-0/best.ckpt")["reconstruction"] == 1
    assert counts(project, "models/template_occluded_touch_3/seed-0/best.ckpt")["reconstruction"] == 1
    names = DECLARED.tables["input_modalities"].by_name
    assert counts(project, "tables/input_modalities.csv")["reconstruction"] == len(models(names)) + 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda held: held["tables"].update(grasp=held["tables"].pop("grasps")), "no table is called grasp;"),
        (
            lambda held: held["tables"]["grasps"]["experiments"].append("charts_smell"),
            "table grasps has an experiment with name: charts_smell, and none is defined",
        ),
        (
            lambda held: held["tables"]["grasps"]["experiments"][0]["method"].append("telepathy"),
            "table grasps has an experiment with method: telepathy, and none is defined",
        ),
        (lambda held: held["tables"]["grasps"].update(split="train"), "tested on validation or test"),
    ],
)
def test_a_declaration_that_makes_no_sense_is_an_error_before_anything_runs(project, change, message):
    declared(project, change)
    result = run_snakemake(project, "--dry-run", "tables/model_selection.csv")
    assert result.returncode and message in result.stdout + result.stderr
