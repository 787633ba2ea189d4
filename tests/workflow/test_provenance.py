"""A run that is moved or has another seed, numbers that are written otherwise, and sources that change meanwhile."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from palpate import Dataset, shapes
from palpate.catalogue import checksum, read_catalogue, require_unchanged, write_catalogue
from palpate.seal import DamagedFile
from palpate.store import StoreError, read
from tests.workflow.conftest import PROJECT, VIEWS, run_snakemake, two_classes


def test_a_moved_run_goes_on(finished, tmp_path):
    """All params are relative to its folder."""
    moved = shutil.copytree(finished.run, tmp_path / "elsewhere/renamed", symlinks=True)
    config = ["--configfile", str(finished.config), "--config", f"results={moved.parent}", "run=renamed"]
    result = run_snakemake(PROJECT, "dataset", "--dry-run", *config)
    assert result.returncode == 0 and "Nothing to be done" in result.stdout + result.stderr, result.stderr


def test_objects_made_in_the_run_move_with_it(make_workflow, tmp_path):
    workflow = make_workflow(
        source={"kind": "procedural", "path": None}, classes=[{"class": "bottle", "objects": 1}], batch_size=1
    )
    assert workflow("meshes/batch-0000").returncode == 0
    moved = workflow.run.rename(tmp_path / "renamed")
    config = ["--configfile", str(workflow.config), "--config", f"results={tmp_path}", "run=renamed"]
    result = run_snakemake(PROJECT, "meshes/batch-0000", "--dry-run", *config)
    assert "Nothing to be done" in result.stdout + result.stderr, result.stdout[-3000:]
    assert moved.is_dir()


def test_a_seed_written_as_1_0_is_1(finished):
    assert not finished.changed(seed=0.0, grasps={"per_object": 5.0}).jobs("dataset")


def test_a_source_that_changes_after_its_table_was_made(make_workflow, tmp_path):
    """Its checksum is looked at, though by the clock it is not newer."""
    meshes = two_classes(tmp_path)
    workflow = make_workflow(source={"kind": "folder", "path": str(meshes)})
    targets = "catalogue.csv", "meshes/batch-0000"
    assert workflow(*targets).returncode == 0
    source = meshes / "brick/millimetres.obj"
    times = source.stat()
    source.write_text(source.read_text() + "# changed\n")
    os.utime(source, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert workflow.planned(*targets) == {"catalogue_batch", "catalogue", "meshes"}
    # The table alone, made again: what the meshes were made from is known.
    assert workflow("catalogue/batch-0000.csv").returncode == 0
    write_catalogue(workflow.run / "catalogue.csv", read_catalogue(workflow.run / "catalogue/batch-0000.csv"))
    message = "meshes/batch-0000 was made from other sources of batch-0000 than the run has; remove it"
    with pytest.raises(StoreError, match=message):
        Dataset(workflow.run)[0].mesh  # noqa: B018


def test_another_checkout_of_the_same_commit_makes_nothing_again(finished, tmp_path):
    """Its files are new, and so are their times."""
    copy = tmp_path / "checkout"
    for name in ("config", "envs", "palpate", "profiles", "studies", "workflow", "snakemake_logger_plugin_palpate"):
        shutil.copytree(PROJECT / name, copy / name, symlinks=True, copy_function=shutil.copyfile)
    shutil.copyfile(PROJECT / "Snakefile", copy / "Snakefile")
    result = run_snakemake(copy, "dataset", "--dry-run", "--configfile", str(finished.config))
    assert "Nothing to be done" in result.stdout + result.stderr, result.stdout[-3000:]


def test_a_job_compares_the_file_that_it_has_read(tmp_path):
    source = tmp_path / "a.obj"
    source.write_text("v 0 0 0\n")
    before = checksum(source)
    require_unchanged(source, before)
    for change in (lambda: source.write_text("v 0 0 1\n"), source.unlink):
        change()
        with pytest.raises(DamagedFile, match=f"{source} has changed while it was read .*: start again once"):
            require_unchanged(source, before)


def test_another_seed_gives_another_dataset(extended, make_workflow):
    """In each stage that draws."""
    other = make_workflow(seed=1, views=VIEWS)
    result = other("views/batch-0000.zarr", "grasps/batch-0000.h5")
    assert result.returncode == 0, result.stderr
    drawn = {"surface.zarr": "points", "grasps.h5": "palm_pose", "views.zarr": "camera"}
    for store, array in drawn.items():
        path = Path(store).stem + "/batch-0000" + Path(store).suffix
        first, second = read(extended.run / path)[array], read(other.run / path)[array]
        assert first.shape == second.shape and not np.array_equal(first, second), store
    # Nothing is drawn for meshes.
    of_meshes = "meshes/batch-0000/seal.json"
    assert (extended.run / of_meshes).read_bytes() == (other.run / of_meshes).read_bytes()


def test_another_seed_gives_other_procedural_objects(make_workflow, tmp_path):
    """The library writes those of either seed; the workflow those of its config's."""
    source = {"source": {"kind": "procedural", "path": None}, "classes": [{"class": "bottle", "objects": 1}]}
    workflow = make_workflow(seed=1, **source)
    assert workflow("catalogue/batch-0000.csv").returncode == 0
    (made,) = read_catalogue(workflow.run / "catalogue/batch-0000.csv")
    written = []
    for seed in (0, 1):
        (tmp_path / str(seed)).mkdir()
        shapes.write("bottle", 0, tmp_path / f"{seed}/bottle-0000", seed)
        written.append(checksum(tmp_path / f"{seed}" / Path(made.source).name))
    assert written[0] != made.checksum == written[1]
