"""What is said at the start, before anything runs: splits, targets, seeds, folders, and configs, each in one line."""

import os
import re
import shutil
import subprocess
import sys
import threading

import pytest
import yaml

from palpate import Dataset
from tests.workflow.conftest import PROJECT, run_snakemake

PROCEDURAL = {"kind": "procedural", "path": None}
FEW = [{"class": "bottle", "objects": 3}]


def lines(result) -> list[str]:
    """What a dry run prints from the building of the graph of jobs on."""
    return result.stdout.rpartition("Building DAG of jobs...")[2].strip().splitlines()


def test_splits_of_few_objects_are_filled(make_workflow):
    """By their names none would be in the validation split."""
    workflow = make_workflow(source=PROCEDURAL, classes=FEW)
    assert workflow.planned("tables/grasps.csv") >= {"reconstruction", "evaluate", "table"}


def test_a_split_without_objects_is_said_at_the_start_with_the_way_to_set_it(make_workflow):
    workflow = make_workflow(source=PROCEDURAL, classes=FEW, split={"train": 1, "validation": 0, "test": 0})
    for target in ("models/charts_occluded/seed-0/best.ckpt", "models/touch_depth/best.ckpt", "tables/grasps.csv"):
        (line,) = lines(workflow(target, "--dry-run"))
        assert "no object of this run is in the" in line and "needs (train 3, validation 0, test 0)" in line
    split = yaml.safe_load(re.search(r"`(split: \{.*?\})` in the config", line)[1])
    assert workflow.changed(**split).planned("tables/grasps.csv") >= {"reconstruction", "evaluate", "table"}
    assert "vision" in workflow.planned("dataset")  # which needs no split


def test_without_figures_the_tables_are_made_alone_and_a_figure_by_its_file(make_workflow):
    workflow = make_workflow(figures=False)
    for target in ("dataset", "all"):
        made = workflow.outputs(target)
        assert "tables/dataset_statistics.csv" in made and not any(path.startswith("figures/") for path in made)
    assert "figures/examples_can.png" in workflow.outputs("figures/examples_can.png")
    made = {path for path in workflow.changed(figures=True).outputs("dataset") if path.startswith("figures/")}
    assert made == {f"figures/{name}.png" for name in ("data_point", "grasp_steps", "examples_can", "examples_brick")}


def test_the_meshes_of_an_older_version_are_made_again():
    """The rule has the version of what it writes in its params, which Snakemake compares."""
    text = (PROJECT / "workflow/rules/meshes.smk").read_text()
    assert "from palpate.mesh import VERSION as MESH_VERSION" in text and "version=MESH_VERSION" in text


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"results": "/proc/nowhere"}, "/proc/nowhere/run: No such file or directory: set `results` in the config"),
        ({"vision": {"samples": 10**8}}, "  vision.samples: 100000000 is greater than the maximum of 65536"),
        ({"grasps": {"hand": {"mjcf": "no.xml", "sensors": "no.yaml"}}}, "no.xml: no such file"),
        (
            {"vision": {"cameras": [{"position": [1, 0, 1], "target": [2, 0, 1]}]}},
            "vision.cameras.0: the object's",
        ),
        ({"vision": {"lights": [{"kind": "sun", "energy": 1}]}}, "vision.lights.0: light of kind sun needs a position"),
        ({"tuning": {"grid": "vast"}}, "vast"),
    ],
    ids=["results", "samples", "hand", "cameras", "lights", "grid"],
)
def test_errors_of_the_config_come_without_snakemakes_frame(make_workflow, config, said):
    result = make_workflow(**config)("dataset")
    assert result.returncode != 0 and said in result.stderr
    for frame in ("WorkflowError", "configuration.smk", "Traceback", ", line "):
        assert frame not in result.stderr, result.stderr


def test_numbers_in_braces_of_the_command_line_are_numbers(make_workflow):
    workflow = make_workflow()
    assert "vision" in workflow.planned("dataset", "--config", "vision={size: 128}", "touch={sensor: dome360}")
    result = workflow("dataset", "--config", "vision={size: many}")
    assert "vision.size: 'many' is not of type 'integer'" in result.stderr


def test_too_few_grasps_are_said_without_snakemakes_frame(make_workflow):
    workflow = make_workflow(grasps={"per_object": 2, "attempts": 2}, split={"train": 1, "validation": 1, "test": 1})
    (line,) = lines(workflow("tables/grasps.csv", "--dry-run"))
    assert line.startswith("experiment charts_unoccluded_touch_3 takes 3 grasps")


@pytest.fixture(scope="module")
def smoke(make_workflow):
    config = yaml.safe_load((PROJECT / "config/smoke.yaml").read_text())
    return make_workflow(**config | {"source": PROCEDURAL, "run": "run"})


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("tables/graps.csv", "did you mean 'tables/grasps.csv'"),
        ("datset", "did you mean 'dataset'"),
        ("models/template_tuch_any/seed-0/best.ckpt", "did you mean 'models/template_touch_any/seed-0/best.ckpt'"),
        ("models/template_touch_any/seed-7/best.ckpt", "the config has no seed 7: add it to training.seeds"),
        ("evaluations/template_touch_any/seed-7.csv", "the config has no seed 7: add it to training.seeds"),
        ("figures/example_knife.png", "did you mean 'figures/examples_knife.png'"),
    ],
)
def test_an_unknown_target_is_named_with_the_nearest_and_with_those_there_are(smoke, target, said):
    result = smoke(target, "--dry-run")
    found = lines(result)
    assert result.returncode != 0 and found[0].startswith(f"no target {target}")
    assert any(said in line for line in found)
    listed = "\n".join(found[1:])
    some = ("all, catalogue, dataset", "dataset_statistics", "examples_knife", "template_touch_any", "batch-0000")
    assert not [known for known in some if known not in listed]
    assert "Exception" not in result.stdout


def test_a_batch_that_there_is_not_is_one_line(smoke):
    assert lines(smoke("meshes/batch-0099", "--dry-run")) == [
        "the run has no batch-0099; its batches are batch-0000 to batch-0000"
    ]


@pytest.mark.parametrize("place", [str, os.path.relpath], ids=["absolute", "relative"])
def test_a_path_from_the_root_is_the_runs(smoke, place, monkeypatch):
    target = place(smoke.run / "surface/batch-0000.zarr")
    monkeypatch.chdir(PROJECT)
    monkeypatch.setattr("sys.argv", ["snakemake", target])
    assert smoke.planned(target) == {"shapes", "catalogue_batch", "catalogue", "meshes", "surface"}
    wrong = place(smoke.run / "tables/graps.csv")
    monkeypatch.setattr("sys.argv", ["snakemake", wrong])
    found = lines(smoke(wrong, "--dry-run"))
    assert found[0].startswith("no target tables/graps.csv; did you mean 'tables/grasps.csv'")


def test_jobs_that_ended_leave_no_timers_that_look_for_jobs_every_second(make_workflow, monkeypatch):
    """Snakemake 9's limit of jobs a second does, one for each: hundreds take a core of the run."""
    delays, begin = [], threading.Timer.__init__

    def count(timer, interval, *arguments):
        delays.append(interval)
        begin(timer, interval, *arguments)

    monkeypatch.setattr(threading.Timer, "__init__", count)
    workflow = make_workflow()
    run = workflow("catalogue.csv")
    assert run.returncode == 0 and (workflow.run / "catalogue.csv").exists(), run.stdout + run.stderr
    assert set(delays) <= {60}
    # Those that the end of the run has cancelled; Python would wait for the others before it ends.
    assert all(each.finished.is_set() for each in threading.enumerate() if isinstance(each, threading.Timer))
    asked = make_workflow()("catalogue/batch-0000.csv", "--max-jobs-per-timespan", "50/1s")
    assert asked.returncode == 0 and 1 in delays, asked.stdout + asked.stderr


def test_without_the_logger_a_run_has_snakemakes_own_output_and_the_end_of_ours(make_workflow):
    """As in an environment into which `make env` has not installed this checkout."""
    workflow = make_workflow()
    run = workflow("catalogue.csv", "--workflow-profile", "none", "--nolock")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "rule catalogue:" in run.stderr and f"{workflow.run}: index.html" in run.stderr


def test_a_hand_that_no_object_can_be_grasped_with_ends_the_run_before_it_starts(make_workflow, tmp_path):
    """Not an object a row of rejected.csv: open, its links are in each other, and the file does not exclude them."""
    case = PROJECT / "tests/cases/hand-exclude"
    text = (case / "hand.xml").read_text()
    (tmp_path / "hand.xml").write_text(text.replace('<exclude body1="palm" body2="b_tip"/>', ""))
    hand = {"mjcf": str(tmp_path / "hand.xml"), "sensors": str(case / "sensors.yaml")}
    result = make_workflow(grasps={"hand": hand})("dataset")
    assert result.returncode != 0
    assert "hand 'hand': open, its links 'palm' and 'b_tip' are 10.0 mm deep in each other" in result.stderr
    for frame in ("WorkflowError", "configuration.smk", "Traceback", ", line "):
        assert frame not in result.stderr, result.stderr


def test_with_quiet_a_wrong_config_is_said_on_standard_error(make_workflow):
    result = make_workflow(sed=1)("dataset", "--quiet", "all")
    assert result.returncode == 1 and "sed: unknown key; did you mean 'seed'?" in result.stderr and not result.stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("classes: &a [*a]\n", "line 1: this value contains itself: remove the alias in it"),
        ("split: &a {train: *a}\n", "a file of --configfile contains itself, or is nested too deep: `palpate check"),
    ],
    ids=["list", "mapping"],
)
def test_a_config_that_contains_itself_is_one_line(tmp_path, text, said):
    """Snakemake merges mappings before it reads the workflow."""
    (tmp_path / "config.yaml").write_text(text)
    result = run_snakemake(PROJECT, "--configfile", str(tmp_path / "config.yaml"))
    assert result.returncode == 1 and said in result.stderr.splitlines()[-1] and "Traceback" not in result.stderr


def test_as_a_module_of_another_workflow_it_says_in_a_line_that_it_is_none(tmp_path):
    shutil.copy(PROJECT / "tests/cases/snakemake-module/Snakefile", tmp_path)
    (tmp_path / "overlay.yaml").write_text("run: mine\n")
    (tmp_path / "palpate").symlink_to(PROJECT)
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--dry-run", "mine"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    (line,) = result.stderr.strip().splitlines()[-1:]
    assert result.returncode == 1 and line.startswith("Palpate is no module of another Snakemake workflow: run ")
    assert "Traceback" not in result.stderr and "Error" not in result.stderr


def test_a_checkout_with_braces_in_its_path_is_said_and_results_may_have_some(tmp_path, make_workflow):
    """Snakemake formats the paths of scripts with a job's wildcards."""
    checkout = tmp_path / "palpate {x}"
    checkout.mkdir()
    shutil.copy(PROJECT / "Snakefile", checkout)
    result = subprocess.run([*make_workflow().command()[:3], "-n"], cwd=checkout, capture_output=True, text=True)
    assert result.returncode == 1 and "Traceback" not in result.stderr
    assert result.stderr.strip() == f"{checkout}: Snakemake takes braces in a workflow's path for placeholders: " + (
        "rename the folder"
    )
    workflow = make_workflow(results=str(tmp_path / "results {"))
    assert workflow("catalogue.csv").returncode == 0 and (tmp_path / "results {/run/catalogue.csv").exists()


def test_a_stage_that_is_asked_for_brings_the_catalogue_and_another_catalogue_makes_no_store_again(make_workflow):
    workflow, target = make_workflow(), "surface/batch-0000.zarr"
    assert workflow(target).returncode == 0
    dataset = Dataset(workflow.run)
    assert dataset.objects and len(dataset[0].points) and (workflow.run / "config.yaml").exists()
    other = workflow.changed(split={"train": 1, "validation": 0, "test": 0})
    assert other.planned(target) == {"catalogue"} and other.planned("-f", target) == {"surface"}
