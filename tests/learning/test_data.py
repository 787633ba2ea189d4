"""The data in memory against the stores that they are loaded from."""

import csv
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate import Dataset, store
from palpate.experiments import Experiment
from palpate.learning import checkpoints
from palpate.learning.data import ExperimentData, ExperimentDataError
from palpate.learning.inputs import INPUTS, stages
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.samples import windows
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import DIGIT
from palpate.store import StoreError
from tests.learning.conftest import OCCLUDED_TOUCH, SETTINGS, made_up

ATTRIBUTES = {"seed": 0, "made_from": {}, "sensor": DIGIT.description()}
BATCHES = {
    "batch-0000": [("a-0", "a", "train"), ("a-1", "a", "validation"), ("b-0", "b", "test")],
    "batch-0001": [("b-1", "b", "train")],
    "batch-0002": [("b-2", "b", "train")],
}
GRASPS = 2
UNOCCLUDED = Experiment("unoccluded", "charts", "unoccluded", False, 1)
TOUCH = Experiment("touch", "charts", "none", True, 1)
READINGS = replace(TOUCH, strategy="sphere")
VIEWS = replace(UNOCCLUDED, vision="views")


def arrays_of(stage, names, seed):
    """Random arrays of the contract's shapes."""
    random = np.random.default_rng(seed)
    sizes = {
        "o": len(names),
        "g": GRASPS,
        "n": 7,
        "s": 4,
        "r": 3,
        "c": 4,
        "rc": 12,
        "k": 2,
        "p": 5,
        "b": 3,
        "v": 2,
        "q": 4,
        "i": 2,
        "u": 2,
    }
    found = {}
    for name, spec in store.CONTRACT[stage].arrays.items():
        shape = [axis if isinstance(axis, int) else sizes[axis] for axis in spec.shape]
        values = random.integers(0, 2 if spec.dtype == "bool" else 200, shape)
        if spec.dtype.startswith("float"):
            values = values / 256  # exact in float32, and not far out of the world
        found[name] = values.astype("U8" if spec.dtype == "string" else spec.dtype)
    found["object"] = np.array(names, dtype=str)
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run of three batches whose stages have lost different objects, and its stores' arrays."""
    folder = tmp_path_factory.mktemp("data") / "run"
    lost = {"vision": {"a-1", "b-2"}, "touch": {"b-1"}}
    held = {}
    for stage in ("surface", "touch", "charts", "vision", "views"):
        for seed, (batch, rows) in enumerate(BATCHES.items()):
            names = [name for name, _, _ in rows if name not in lost.get("touch" if stage == "charts" else stage, ())]
            held[stage, batch] = arrays_of(stage, names, seed)
            store.write(folder / store.CONTRACT[stage].path(batch), stage, held[stage, batch], ATTRIBUTES)
    with (folder / "catalogue.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["object", "class", "split", "batch"])
        writer.writerows([*row, batch] for batch, rows in BATCHES.items() for row in rows)
    rows = [f"{name},{stage},lost\n" for stage, names in lost.items() for name in sorted(names)]
    (folder / "rejected.csv").write_text("".join(["object,stage,reason\n", *rows]))
    return folder, held


@pytest.fixture
def run(made, tmp_path):
    """A copy that a test may change, and the arrays of its stores."""
    shutil.copytree(made[0], tmp_path / "run")
    return tmp_path / "run", made[1]


def change(run, stage, name, index, value):
    """Write the first batch's store of a stage again, with another value."""
    arrays = dict(run[1][stage, "batch-0000"])
    arrays[name] = arrays[name].copy()
    arrays[name][index] = value
    store.write(run[0] / store.CONTRACT[stage].path("batch-0000"), stage, arrays, ATTRIBUTES)


def row(run, stage, name, array):
    """The row of an object in a store, looked up by hand."""
    for (found, _), arrays in run[1].items():
        if found == stage and name in arrays["object"]:
            return arrays[array][list(arrays["object"]).index(name)]
    raise KeyError(name)


def test_objects_that_all_stores_have(made):
    found = ExperimentData.load(made[0], OCCLUDED_TOUCH)
    assert found.objects == ["a-0", "b-0"] and found.classes == ["a", "b"] and found.splits == ["train", "test"]
    assert ExperimentData.load(made[0], UNOCCLUDED).objects == ["a-0", "b-0", "b-1"]
    assert ExperimentData.load(made[0], TOUCH).objects == ["a-0", "a-1", "b-0", "b-2"]


def test_rows_are_those_of_the_stores(made):
    found = ExperimentData.load(made[0], replace(OCCLUDED_TOUCH, strategy="template"))
    assert found.grasps == GRASPS and set(found.arrays) == {
        *("points", "occluded", "image_camera", "success", "position", "rotation", "charts"),
        *("unoccluded_silhouette", "occluded_silhouette", "hand_silhouette"),
    }
    for number, name in enumerate(found.objects):
        for ours, stage, theirs in [
            ("points", "surface", "points"),
            ("occluded", "vision", "occluded"),
            ("charts", "charts", "vertices"),
            ("success", "touch", "success"),
            ("position", "touch", "position"),
            ("rotation", "touch", "rotation"),
        ]:
            np.testing.assert_array_equal(found[ours][number], row(made, stage, name, theirs))
        matrices = (row(made, "vision", name, array) for array in ("intrinsics", "extrinsics"))
        expected = [k @ e for k, e in zip(*matrices, strict=True)]
        np.testing.assert_allclose(found["image_camera"][number], expected, rtol=1e-6)
    with pytest.raises(ExperimentDataError, match="the experiment takes no unoccluded"):
        found["unoccluded"]


def test_views(made):
    found = ExperimentData.load(made[0], VIEWS)
    assert (found.images(VIEWS), found.grasps, len(found)) == (2, 0, 5)
    np.testing.assert_array_equal(found["views"][3], row(made, "views", "b-1", "image"))
    np.testing.assert_array_equal(found["camera"][3], row(made, "views", "b-1", "camera").astype(np.float32))


def test_an_untouched_sensor_reads_the_empty_gel(made):
    found = ExperimentData.load(made[0], READINGS)
    stores = [arrays for (stage, _), arrays in made[1].items() if stage == "touch"]
    for number, name in enumerate(found.objects):
        (empty,) = (arrays["empty_reading"] for arrays in stores if name in arrays["object"])
        stored = row(made, "touch", name, "reading")
        for index in np.ndindex(GRASPS, 4):
            expected = stored[index] if found["success"][number][index] else empty
            np.testing.assert_array_equal(found["reading"][number][index], expected)
    assert set(found["success"].ravel()) == {True, False}


def test_some_splits(made):
    whole, part = ExperimentData.load(made[0], TOUCH), ExperimentData.load(made[0], TOUCH, ["validation", "test"])
    assert part.objects == ["a-1", "b-0"] and part.of_split("test") == [1]
    np.testing.assert_array_equal(part["charts"], whole["charts"][[1, 2]])


def test_the_same_data_have_the_same_digest_and_others_another(run):
    digest = ExperimentData.load(run[0], TOUCH).digest
    assert ExperimentData.load(run[0], TOUCH).digest == digest
    assert ExperimentData.load(run[0], TOUCH, ["train"]).digest != digest
    assert ExperimentData.load(run[0], READINGS).digest != digest
    change(run, "vision", "occluded", (0, 0, 0, 0, 0), 7)  # which this experiment does not take
    assert ExperimentData.load(run[0], TOUCH).digest == digest
    change(run, "charts", "vertices", (0, 0, 0, 0), 1.5)
    assert ExperimentData.load(run[0], TOUCH).digest != digest


def test_names_are_part_of_the_digest():
    data, renamed = made_up(), made_up()
    assert data.digest == renamed.digest
    renamed.splits[0] = "test"
    del renamed.digest
    assert data.digest != renamed.digest


@pytest.mark.parametrize(("stage", "name", "value"), [("surface", "points", np.nan), ("charts", "vertices", np.inf)])
def test_values_that_cannot_be_are_noticed_and_named(run, stage, name, value):
    arrays = run[1][stage, "batch-0000"]
    change(run, stage, name, (list(arrays["object"]).index("b-0"), *[0] * (arrays[name].ndim - 1)), value)
    with pytest.raises(StoreError, match=f"{stage}/batch-0000.*of b-0 is NaN or infinite; remove it"):
        ExperimentData.load(run[0], TOUCH)
    assert len(ExperimentData.load(run[0], TOUCH, ["validation"])) == 1  # what is not loaded is not checked


def test_nan_in_memory_names_its_object():
    arrays = {"object": ["a", "b"], "class": ["c"] * 2, "split": ["train"] * 2, "points": np.zeros((2, 5, 3))}
    arrays["points"][1, 2, 0] = np.nan
    with pytest.raises(ExperimentDataError, match="the data in memory: points of b is NaN or infinite"):
        ExperimentData(arrays)


def test_a_changed_bit_is_noticed(run):
    for stage, name in (("surface", "points"), ("charts", "vertices"), ("touch", "success")):
        path = next((run[0] / stage / "batch-0000.zarr" / name / "c").rglob("0"))
        path = path if path.is_file() else next(each for each in path.rglob("*") if each.is_file())
        whole = path.read_bytes()
        path.write_bytes(bytes([whole[0] ^ 1]) + whole[1:])
        with pytest.raises(StoreError, match="batch-0000.zarr can't be read"):
            ExperimentData.load(run[0], TOUCH)
        path.write_bytes(whole)
    assert len(ExperimentData.load(run[0], TOUCH))


def test_splits_may_be_an_iterator(run):
    expected = ExperimentData.load(run[0], TOUCH, ["train", "validation"])
    assert ExperimentData.load(run[0], TOUCH, iter(["train", "validation"])).objects == expected.objects


def test_no_object_left(run):
    with pytest.raises(ExperimentDataError, match="no object of nonsense is in all of .*: more objects are needed"):
        ExperimentData.load(run[0], TOUCH, ["nonsense"])
    (run[0] / "catalogue.csv").write_text("object,class,split,batch\nc-0,c,train,batch-0000\n")
    (run[0] / "rejected.csv").write_text("object,stage,reason\nc-0,surface,lost\n")
    with pytest.raises(ExperimentDataError, match="is in all of surface, vision: .*; rejected.csv says why"):
        ExperimentData.load(run[0], UNOCCLUDED)


def test_a_store_that_is_missing(run):
    shutil.rmtree(run[0] / "charts")
    with pytest.raises(StoreError, match="has no charts; build it with"):
        ExperimentData.load(run[0], TOUCH)
    assert len(ExperimentData.load(run[0], READINGS))


def test_more_arrays_change_no_sample(made):
    every = [each for each in INPUTS.values() if each.name != "template"]
    data = ExperimentData.read(Dataset(made[0], stages(OCCLUDED_TOUCH)), every)
    assert windows(data, OCCLUDED_TOUCH, "train") == windows(
        ExperimentData.load(made[0], OCCLUDED_TOUCH), OCCLUDED_TOUCH, "train"
    )


def test_one_camera_of_all_images_is_common(tmp_path):
    one, several, touch = made_up("occluded"), made_up("unoccluded", cameras=2), made_up("none")
    np.testing.assert_array_equal(one.common_camera(OCCLUDED_TOUCH), one["image_camera"][3, 0])
    assert several.common_camera(UNOCCLUDED) is None and touch.common_camera(TOUCH) is None
    assert one.image_size(OCCLUDED_TOUCH) == several.image_size(UNOCCLUDED) == 24 and touch.image_size(TOUCH) is None
    assert (one.images(OCCLUDED_TOUCH), several.images(UNOCCLUDED), one.images(TOUCH)) == (1, 2, 0)
    learner = ReconstructionLearner(one, OCCLUDED_TOUCH, SETTINGS, seed=0)
    checkpoints.save(tmp_path / "a.ckpt", "reconstruction", learner.model, learner.described())
    held = checkpoints.read(tmp_path / "a.ckpt", "reconstruction")
    np.testing.assert_array_equal(np.float32(held["camera"]), one["image_camera"][0, 0])
    assert held["image_size"] == 24


def test_models_start_around_the_largest_object_that_they_are_trained_on():
    """Of objects that keep their size; the test split's are not looked at. The model is built again as it was."""
    made = made_up()
    points = made["points"].copy()
    points[6] = OBJECT_POSITION + 5 * (points[6] - OBJECT_POSITION)  # of the test split
    names = {"object": made.objects, "class": made.classes, "split": made.splits}
    data = ExperimentData(made.arrays | names | {"points": points}, one_size=False)
    box = points[:4].max(axis=1) - points[:4].min(axis=1)
    assert data.largest == pytest.approx(np.sqrt((box**2).sum(axis=1)).max(), rel=1e-6)
    learner = ReconstructionLearner(data, OCCLUDED_TOUCH, SETTINGS, 0)
    radius = learner.described()["architecture"]["radius"]
    assert 0.52 * data.largest <= radius < 0.52 * data.largest + 0.001 and learner.model.scale == radius
    distance = (learner.model.start.double() - torch.tensor(OBJECT_POSITION)).norm(dim=1)
    assert (distance - radius).abs().max() < 1e-6
    assert "radius" not in ReconstructionLearner(made_up(), OCCLUDED_TOUCH, SETTINGS, 0).described()["architecture"]
