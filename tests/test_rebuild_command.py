"""The commands in messages: they make what the message is about, of the run that it is about."""

import os
import shlex

import pytest

from palpate.rebuild_command import rebuild_advice, rebuild_command, run_folder


def words(text):
    """The targets of a command, and its config."""
    split = shlex.split(text)
    assert split[0] == "snakemake" and split[-2] == "--configfile" and split[-4:-2] == ["--cores", "2"]
    return split[1:-4], split[-1]


@pytest.fixture(params=["mine", "a run"])
def run(tmp_path, request):
    folder = tmp_path / "results" / request.param
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text("run: mine\n")
    return folder


@pytest.mark.parametrize("path", ["catalogue.csv", "touch/batch-0003.zarr", "models/a/seed-0/best.ckpt"])
def test_a_file_is_made_by_its_path_in_the_run_with_the_runs_config(run, path, monkeypatch):
    expected = ([path], str(run / "config.yaml"))
    assert words(rebuild_command(run / path)) == expected
    monkeypatch.chdir(run.parent)
    assert words(rebuild_command(f"{run.name}/{path}")) == expected
    monkeypatch.chdir(run)  # as jobs are
    assert words(rebuild_command(path)) == expected and run_folder(".") == run


@pytest.mark.parametrize("path", ["rejected/meshes/batch-0000.csv", "rejected/touch/batch-0003.csv"])
def test_a_table_of_rejections_is_of_the_run_that_it_is_in(run, path, tmp_path):
    """Though `rejected` has a folder `meshes`, as a run has."""
    for folder in (run, tmp_path / "old"):
        (folder / "rejected/meshes").mkdir(parents=True)
    assert words(rebuild_command(run / path)) == ([path], str(run / "config.yaml"))
    assert f"snakemake {path} --cores 2 --configfile <the config of the run in {tmp_path / 'old'}>" == (
        rebuild_command(tmp_path / "old" / path)
    )
    named = tmp_path / "results/rejected"
    (named / "meshes").mkdir(parents=True)
    (named / "config.yaml").touch()
    assert run_folder(named / "meshes/batch-0000") == run_folder(named / "reports/validation.csv") == named


def test_other_targets_may_be_named_and_braces_are_the_shells(run):
    assert words(rebuild_command(run / "touch/x.zarr", "dataset", "views/batch-{0000..0012}.zarr")) == (
        ["dataset", "views/batch-{0000..0012}.zarr"],
        str(run / "config.yaml"),
    )
    assert "batch-{0000..0012}.zarr --cores" in rebuild_command(run, "views/batch-{0000..0012}.zarr")


@pytest.mark.parametrize("path", ["catalogue.csv", "touch/batch-0003.zarr"])
def test_of_a_run_without_its_config_the_config_is_to_be_put_in(tmp_path, path):
    text = rebuild_command(tmp_path / "old" / path)
    assert f"snakemake {path} --cores 2 --configfile <the config of the run in {tmp_path / 'old'}>" == text
    os.makedirs(tmp_path / "older/models")
    assert f"snakemake models/a/b.ckpt --cores 2 --configfile <the config of the run in {tmp_path / 'older'}>" == (
        rebuild_command(tmp_path / "older/models/a/b.ckpt")
    )


def test_a_damaged_file_is_to_be_removed_first_and_a_missing_one_only_built(run):
    assert rebuild_advice(run / "rejected.csv").startswith("build it with: snakemake rejected.csv ")
    (run / "rejected.csv").touch()
    assert rebuild_advice(run / "rejected.csv").startswith("remove it and build it again with: snakemake rejected.csv ")
    os.symlink(run / "nowhere", run / "index.html")  # a link to nothing is in the way, too
    assert rebuild_advice(run / "index.html", "the link").startswith("remove the link and build it again with: ")
    assert rebuild_advice(run / "batches.json") == "start the run again, which writes it"
