"""Outputs that were put back from another time, whole and with their own seals, among outputs that are of today."""

import shutil

import pandas as pd
import pytest
import yaml

import palpate
from palpate import seal
from palpate.atomic import atomic_write, write_if_changed
from palpate.batch import Rejection, write_rejections
from palpate.catalogue import read_catalogue, sources_of, write_catalogue
from palpate.command import main
from palpate.dataset.run import Run
from palpate.dataset.validation import combine_validation, outputs
from palpate.results.tables import write_table
from palpate.store import CONTRACT, StoreError
from tests.store.conftest import ATTRIBUTES, BATCHES, REJECTED

SPLIT = {"train": 0.6, "validation": 0.2, "test": 0.2, "held_out": "objects"}
STORES = ("surface", "grasps", "touch", "vision")
MODEL, TABLE, FIGURE = "models/charts/seed-0/best.ckpt", "tables/grasp_success.csv", "figures/data_point.png"
PART = "rejected/grasps/batch-0000.csv"


def write_config(run, split):
    write_if_changed(run / "config.yaml", yaml.safe_dump({"split": split, "seed": 0}), {})


def write_splits(run, split, splits=None):
    """The run's catalogue as its job writes it; splits: of some objects."""
    entries = [each._replace(split=(splits or {}).get(each.object, each.split)) for each in entries_of(run)]
    made_from = seal.made_of(sorted(run.glob("catalogue/*.csv")), seal.by_path({"split": split, "seed": 0}))
    write_catalogue(run / "catalogue.csv", entries, made_from)


def entries_of(run):
    return [each for path in sorted(run.glob("catalogue/*.csv")) for each in read_catalogue(path)]


def write_part(run, stage, batch, names):
    path = run / f"rejected/{stage}/{batch}.csv"
    write_rejections(path, [Rejection(name, stage, "too few grasps") for name in names], {})
    return path


def write_stores(run, batch):
    """The stores that are there, made from the rejections that are there."""
    for stage in STORES:
        path = run / CONTRACT[stage].path(batch)
        rejected = f"rejected/grasps/{batch}.csv"
        made_from = seal.with_output({}, run / rejected) if stage != "surface" else {}
        palpate.store.write(path, stage, palpate.store.read(path), ATTRIBUTES | {"made_from": made_from})


def write_whole(run):
    parts = sorted(run.glob("rejected/*/*.csv"))
    write_rejections(run / "rejected.csv", palpate.batch.read_rejections(parts), seal.made_of(parts))


def write_products(run):
    """A model, a table and a figure, made from what the run has."""
    catalogue = run / "catalogue.csv"
    with atomic_write(run / MODEL, seal.made_of([catalogue, *run.glob("touch/*.zarr")])) as partial:
        import torch

        torch.save({"weights": {}}, partial)
    made_from = seal.made_of([catalogue, *sorted(run.glob("rejected/grasps/*.csv"))], {"vision.samples": 16})
    write_table(pd.DataFrame({"class": ["ball"], "objects": [3]}), run / TABLE, made_from)
    with atomic_write(run / FIGURE, seal.made_of([catalogue])) as partial:
        partial.write_bytes(b"a picture")


@pytest.fixture(scope="module")
def started(built, tmp_path_factory):
    """A run as the workflow leaves it: every output has its seal. To be read only."""
    run = shutil.copytree(built, tmp_path_factory.mktemp("sealed") / "small")
    for path in sorted(run.glob("catalogue/*.csv")):
        entries = read_catalogue(path)
        write_catalogue(path, entries, {"inputs": sources_of(entries)})
    write_if_changed(run / "batches.json", "{}\n", {})
    write_config(run, SPLIT)
    write_splits(run, SPLIT)
    for batch, names in BATCHES.items():
        write_part(run, "grasps", batch, [REJECTED] if REJECTED in names else [])
        write_stores(run, batch)
    write_whole(run)
    write_products(run)
    return run


@pytest.fixture
def whole(started, tmp_path):
    """A copy of it, to be changed."""
    return shutil.copytree(started, tmp_path / "small")


def failures(run):
    """What `palpate validate` says of the run's own files: check and words."""
    table = combine_validation([], run, files=outputs(run))
    return {row["check"]: row["where"] for row in table.to_dict("records") if not row["passed"]}


def put_back(path, backup):
    """A file with its seal."""
    for each in (path, seal.beside(path)):
        if (backup / each.name).exists():
            shutil.copy(backup / each.name, each)


def backup_of(path, folder):
    folder.mkdir()
    for each in (path, seal.beside(path)):
        if each.exists():
            shutil.copy(each, folder / each.name)
    return folder


def read_everything(run):
    return [{name: grasp[name] for name in ("reading", "occluded")} for grasp in palpate.Dataset(run).grasps()]


def test_a_run_of_one_time_has_no_failure(whole, tmp_path):
    assert failures(whole) == {}
    assert len(read_everything(whole)) == 6
    assert main(["export", str(whole), str(tmp_path / "shared")]) == 0
    assert seal.verify(tmp_path / "shared").inputs


def test_a_catalogue_with_other_splits_is_an_error(whole, tmp_path):
    """It was put back from the time before the config's splits were changed."""
    backup = backup_of(whole / "catalogue.csv", tmp_path / "backup")
    others = SPLIT | {"train": 0.2, "validation": 0.6}
    write_config(whole, others)
    write_splits(whole, others, {"ball-0000": "validation", "ball-0002": "train"})
    list(palpate.Dataset(whole))
    put_back(whole / "catalogue.csv", backup)
    message = "catalogue.csv was made with split.train = 0.6, but the run has 0.2; .*; remove it and build it again"
    with pytest.raises(StoreError, match=message):
        list(palpate.Dataset(whole))
    assert "catalogue.csv was made with split.train = 0.6" in failures(whole)["made from"]
    assert main(["export", str(whole), str(tmp_path / "shared")]) == 1


def test_a_table_of_rejections_that_lacks_one_is_an_error(whole, tmp_path):
    """It was put back from the time before an object was rejected."""
    batch = next(batch for batch, names in BATCHES.items() if REJECTED in names)
    part = whole / f"rejected/grasps/{batch}.csv"
    backups = {path: backup_of(path, tmp_path / path.stem) for path in (part, whole / "rejected.csv")}
    write_part(whole, "grasps", batch, BATCHES[batch])
    write_stores(whole, batch)
    write_whole(whole)
    write_products(whole)
    assert failures(whole) == {}
    put_back(whole / "rejected.csv", backups[whole / "rejected.csv"])
    assert "rejected.csv was made from other rejected/grasps/batch-" in failures(whole)["made from"]
    put_back(part, backups[part])
    for stage in ("grasps", "touch", "vision"):
        with pytest.raises(StoreError, match=f"{stage}/{batch}.* was made from other rejected/grasps/{batch}.csv than"):
            Run(whole).store(stage, batch)
    with pytest.raises(StoreError, match="rejected"):
        read_everything(whole)
    assert f"{TABLE} was made from other rejected/grasps/" in failures(whole)["made from"]


def test_a_model_table_and_figure_of_other_splits(whole, tmp_path):
    """The catalogue was made again, and nothing else."""
    write_splits(whole, SPLIT, {"ball-0000": "test"})
    said = failures(whole)["made from"]
    for name in (MODEL, TABLE, FIGURE, "tables/grasp_success.md"):
        assert f"{name} was made from other catalogue.csv than the run has; remove it and build it again" in said
    assert len(read_everything(whole)) == 6  # the dataset is of one time
    with pytest.raises(StoreError, match=f"{FIGURE} was made from other catalogue.csv"):
        palpate.Dataset(whole).require_current(whole / FIGURE)
    assert main(["export", str(whole), str(tmp_path / "shared")]) == 1
    write_products(whole)
    assert failures(whole) == {}


@pytest.mark.parametrize(
    "name", [MODEL, TABLE, FIGURE, "catalogue.csv", "config.yaml", "rejected/grasps/batch-0000.csv"]
)
def test_an_altered_or_unsealed_output_fails_validation(whole, name):
    content = (whole / name).read_bytes()
    (whole / name).write_bytes(content[:20] + bytes([content[20] ^ 1]) + content[21:] if len(content) > 20 else b"x")
    try:
        assert name in failures(whole)["tables"]
    except (ValueError, OSError) as error:  # of what validation itself reads
        assert name in str(error)
    (whole / name).write_bytes(content)
    if name == MODEL:
        return
    seal.beside(whole / name).unlink()
    try:
        assert f"{name} is damaged: it has no seal" in failures(whole)["tables"]
    except (ValueError, OSError) as error:
        assert "it has no seal" in str(error) and name in str(error)


def test_what_remains_of_batches_of_an_earlier_config_is_no_failure(whole):
    write_part(whole, "grasps", "batch-0007", [])
    write_rejections(whole / "rejected/grasps/batch-0007.csv", [], {"config": {"seed": 7}})
    assert failures(whole) == {}
