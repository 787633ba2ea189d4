"""Stores that were not made from one another are refused: by the reader, by validation, by the jobs that read them."""

import os
import pickle
import shutil

import numpy as np
import pytest
import yaml

import palpate.store
from palpate import Dataset, catalogue, seal
from palpate.command import main
from palpate.dataset.run import Run
from palpate.dataset.validation import check_again, validate_batch, write_findings
from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.stages import STAGES
from palpate.store import CONTRACT, StoreError
from tests.store.conftest import ATTRIBUTES, BATCHES, REJECTED

BATCH = "batch-0000"
OBJECT = BATCHES[BATCH][0]
CONFIG = {
    "seed": 0,
    "mesh": {"collision_faces": 4000},
    "surface": {"points": 500},
    "grasps": {"thumb_share": 0.15, "hand": None},
    "touch": {"sensor": {"range": 0.025}},
    "vision": {"size": 48, "device": "auto"},
}
INPUTS = {
    "surface": ("meshes",),
    "grasps": ("meshes", "surface"),
    "touch": ("meshes", "grasps"),
    "vision": ("meshes", "grasps"),
}


def make(run, stage, batch=BATCH, change=None, **settings):
    """Write a stage's store again as its job does: from the stores that are there, by the run's config."""
    section = CONFIG["mesh" if stage == "meshes" else stage] | settings
    if stage == "meshes":
        folder = run / "meshes" / batch
        entries = catalogue.read_catalogue(run / f"catalogue/{batch}.csv")
        return seal.write(folder, seal.combine({"mesh": section}, more=catalogue.sources_of(entries)))
    path = run / CONTRACT[stage].path(batch)
    paths = [run / STAGES[name].path(batch) for name in INPUTS[stage]]
    made_from = seal.combine({"seed": 0, stage: section}, *map(seal.read, paths))
    arrays = palpate.store.read(path)
    if change:
        arrays[change] = np.nextafter(arrays[change], 10)
    palpate.store.write(path, stage, arrays, ATTRIBUTES | {"made_from": made_from})


def say(run, **sections):
    """Write the run's config, with changes."""
    config = {key: value | sections.get(key, {}) if key in sections else value for key, value in CONFIG.items()}
    (run / "config.yaml").write_text(yaml.safe_dump(config))


@pytest.fixture(scope="module")
def stating(built, tmp_path_factory):
    """A run whose stores state what they were made from, to be read only."""
    run = shutil.copytree(built, tmp_path_factory.mktemp("stating") / "small")
    for batch in BATCHES:
        for stage in ("meshes", *INPUTS):
            make(run, stage, batch)
    say(run)
    return run


@pytest.fixture
def whole(stating, tmp_path):
    """A copy of it, to be changed."""
    return shutil.copytree(stating, tmp_path / "small")


def refused(run, *named):
    """Whatever is read first, the store is named, and how to build it again."""
    for order in (["touch", "vision"], ["vision", "touch"]):
        with pytest.raises(StoreError) as error:
            dataset = Dataset(run, order)
            for stage in order:
                dataset.load(stage, {"touch": "depth", "vision": "occluded"}[stage])
        for text in (*named, "remove it and build it again with: snakemake "):
            assert text in str(error.value), str(error.value)
    with pytest.raises(StoreError, match="remove it and build it again"):
        list(Dataset(run).grasps())


def mixed(run, batch=BATCH):
    return {finding.store for finding in validate_batch(run, batch) if finding.check == "made from" and not finding.ok}


def test_a_run_that_was_made_from_one_config_is_read(whole):
    dataset = Dataset(whole)
    for stage, name in (("vision", "occluded"), ("touch", "depth"), ("surface", "points"), ("grasps", "palm_pose")):
        dataset.load(stage, name)
    assert dataset[0].mesh.is_dir()
    assert not any(mixed(whole, batch) for batch in BATCHES)


def test_touch_of_other_grasps_than_the_images(whole, capsys):
    """thumb_share was changed, and only touch was built again."""
    say(whole, grasps={"thumb_share": 0.5})
    for batch in BATCHES:
        make(whole, "grasps", batch, thumb_share=0.5, change="palm_pose")
        make(whole, "touch", batch)
    vision = f"vision/{BATCH}.zarr"
    refused(whole, vision, "grasps.thumb_share = 0.15, but the run has 0.5", f"; from other grasps/{BATCH}.h5")
    assert mixed(whole) == {"vision"}
    assert main(["export", str(whole), str(whole / "shared")]) == 1
    assert vision in capsys.readouterr().err and not (whole / "shared").exists()


def test_the_same_without_a_config(whole):
    """What stores state of each other is enough."""
    make(whole, "grasps", change="palm_pose")
    make(whole, "touch")
    (whole / "config.yaml").unlink()
    refused(whole, f"vision/{BATCH}.zarr was made from other grasps/{BATCH}.h5 than the run has")


def test_training_refuses_them(whole):
    make(whole, "vision", size=24)
    experiment = Experiment("occluded", "charts", "occluded", False, 1)
    with pytest.raises(StoreError, match=f"vision/{BATCH}.zarr was made with vision.size = 24, but the run has 48"):
        ExperimentData.load(whole, experiment)


def test_a_store_that_was_put_back(whole, tmp_path):
    """Whatever the time that its files have."""
    backup = shutil.copytree(whole / f"vision/{BATCH}.zarr", tmp_path / "backup.zarr")
    make(whole, "grasps", change="palm_pose")
    make(whole, "touch")
    make(whole, "vision")
    assert not mixed(whole)
    shutil.rmtree(whole / f"vision/{BATCH}.zarr")
    shutil.copytree(backup, whole / f"vision/{BATCH}.zarr")
    os.utime(whole / f"vision/{BATCH}.zarr")
    refused(whole, f"vision/{BATCH}.zarr was made from other grasps")
    assert mixed(whole) == {"vision"}


def test_a_store_of_another_size_of_image(whole):
    make(whole, "vision", size=24)
    refused(whole, f"vision/{BATCH}.zarr was made with vision.size = 24, but the run has 48")
    assert mixed(whole) == {"vision"}
    (whole / "config.yaml").unlink()  # then the first batch that is read counts
    refused(whole, "vision.size = ")


def test_meshes_of_other_files_than_the_catalogue_lists(whole):
    for table in (whole / "catalogue.csv", whole / f"catalogue/{BATCH}.csv"):
        rows = [line.split(",") for line in table.read_text().splitlines()]
        rows = [[*row[:5], "ab" * 32 if row[0] == OBJECT else row[5]] for row in rows]
        table.write_text("\n".join(",".join(row) for row in rows) + "\n")
    refused(whole, f"meshes/{BATCH} was made from other sources of {BATCH} than the run has")
    assert mixed(whole) == {"meshes", *INPUTS}


def test_meshes_that_were_made_again(whole):
    make(whole, "meshes", collision_faces=2000)
    with pytest.raises(StoreError, match=f"meshes/{BATCH} was made with mesh.collision_faces = 2000"):
        Dataset(whole)[OBJECT].mesh  # noqa: B018
    say(whole, mesh={"collision_faces": 2000})
    with pytest.raises(StoreError, match=f"surface/{BATCH}.zarr was made with mesh.collision_faces = 4000"):
        Dataset(whole)[OBJECT].points  # noqa: B018


def test_equal_bytes_are_the_same_store(whole, tmp_path):
    """Built again, moved, or read on another machine."""
    for stage in ("meshes", "surface", "grasps"):
        make(whole, stage)
    say(whole, vision={"device": "gpu"})
    moved = whole.rename(tmp_path / "elsewhere")
    assert not mixed(moved)
    Dataset(moved).load("vision", "occluded")


def test_a_store_that_changes_while_the_run_is_read(whole):
    dataset = pickle.loads(pickle.dumps(Dataset(whole, ["touch"])))
    dataset.load("touch", "depth")
    make(whole, "grasps", change="palm_pose")
    with pytest.raises(StoreError, match=f"touch/{BATCH}.zarr was made from other grasps"):
        dataset.load("grasps", "palm_pose")


def test_a_job_does_not_mix_its_inputs(whole):
    make(whole, "meshes", collision_faces=2000)
    with pytest.raises(seal.MixedInputs, match=f"grasps/{BATCH}.h5 was made with .* from other meshes/{BATCH}"):
        make(whole, "touch")


def test_validation_looks_at_the_config_again(whole):
    """A report of values does not say what the config is now."""
    tables = []
    for batch in BATCHES:
        tables.append(whole / f"reports/validation/{batch}.csv")
        write_findings(tables[-1], validate_batch(whole, batch))
    say(whole, vision={"size": 64})
    findings, anew = check_again(whole, tables)
    assert anew == 0
    assert {finding.store for finding in findings if not finding.ok} == {"vision"}


def test_no_other_store_is_opened_for_it(whole, monkeypatch):
    opened = []
    monkeypatch.setattr(Run, "_require_fitting", lambda run, batch, sealed: opened.append(sealed.path))
    for stage in ("touch", "grasps"):
        (whole / "rejected" / stage).mkdir(parents=True)
        for batch in BATCHES:
            rows = [f"{REJECTED},grasps,too few\n"] if stage == "grasps" and REJECTED in BATCHES[batch] else []
            (whole / f"rejected/{stage}/{batch}.csv").write_text("".join(["object,stage,reason\n", *rows]))
    Dataset(whole, ["touch"]).load("touch", "depth")
    assert opened == [whole / CONTRACT["touch"].path(batch) for batch in BATCHES]


@pytest.mark.parametrize("field", ["object", "checksum", "up", "scale", "turn"])
def test_the_digest_of_sources_has_all_that_an_objects_meshes_depend_on(field):
    """And nothing else: not its class or split."""
    entry = catalogue.CatalogueEntry("mug-1", "mug", "train", BATCH, "mug/1.obj", "ab" * 32, "z", "keep", turn="90")
    assert catalogue.sources_of([entry]) != catalogue.sources_of([entry._replace(**{field: "y"})])
    assert catalogue.sources_of([entry]) == catalogue.sources_of([entry._replace(split="test", class_name="cup")])
    other = entry._replace(object="mug-2")
    assert catalogue.sources_of([entry, other]) != catalogue.sources_of([other, entry])
