"""Packs against the stores that they are made of."""

import csv

import h5py
import numpy as np
import pytest

from palpate import store
from palpate.training.pack import Pack, PackError, write

ATTRIBUTES = {"seed": 0, "config_digest": "0"}
BATCHES = {
    "batch-0000": [("a-0", "a", "train"), ("a-1", "a", "validation"), ("b-0", "b", "test")],
    "batch-0001": [("b-1", "b", "train")],
    "batch-0002": [("b-2", "b", "train")],
}
GRASPS = 2


def arrays_of(stage, names, seed):
    """Random arrays of the contract's shapes."""
    random = np.random.default_rng(seed)
    sizes = {"o": len(names), "og": GRASPS * len(names), "n": 7, "r": 3, "rr": 9, "p": 5, "v": 2, "q": 4}
    found = {}
    for name, spec in store.CONTRACT[stage].arrays.items():
        shape = [axis if isinstance(axis, int) else sizes[axis] for axis in spec.shape]
        values = random.integers(0, 2 if spec.dtype == "bool" else 200, shape)
        if spec.dtype.startswith("float"):
            values = values / 256  # exact in float32, and not far out of the world
        found[name] = values.astype("U8" if spec.dtype == "string" else spec.dtype)
    found["object"] = np.array(names, dtype=str)
    return found


@pytest.fixture
def run(tmp_path):
    """A run of three batches whose stages have lost different objects, and its stores' arrays."""
    lost = {"vision": {"a-1", "b-2"}, "touch": {"b-1"}}
    held = {}
    for stage in ("surface", "touch", "charts", "vision", "views"):
        for seed, (batch, rows) in enumerate(BATCHES.items()):
            names = [name for name, _, _ in rows if name not in lost.get("touch" if stage == "charts" else stage, ())]
            held[stage, batch] = arrays_of(stage, names, seed)
            store.write(tmp_path / store.CONTRACT[stage].path(batch), stage, held[stage, batch], ATTRIBUTES)
    with (tmp_path / "catalogue.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["object", "class", "split", "batch"])
        writer.writerows([*row, batch] for batch, rows in BATCHES.items() for row in rows)
    return tmp_path, held


def make(run, family, *stages):
    folder = run[0]
    paths = {stage: [folder / store.CONTRACT[stage].path(batch) for batch in BATCHES] for stage in stages}
    write(folder / f"packs/{family}.h5", family, folder / "catalogue.csv", paths)
    return folder / f"packs/{family}.h5"


def row(run, stage, name, array, grasp=None):
    """What a store holds of an object, looked up by hand."""
    for (found, _), arrays in run[1].items():
        if found == stage and name in arrays["object"]:
            place = list(arrays["object"]).index(name)
            return arrays[array][place if grasp is None else place * GRASPS + grasp]
    raise KeyError(name)


def test_objects_that_all_its_stores_have(run):
    found = Pack.read(make(run, "occluded-charts", "surface", "vision", "touch", "charts"))
    assert found.objects == ["a-0", "b-0"] and found.classes == ["a", "b"] and found.splits == ["train", "test"]
    assert Pack.read(make(run, "unoccluded-none", "surface", "vision")).objects == ["a-0", "b-0", "b-1"]
    assert Pack.read(make(run, "none-charts", "surface", "touch", "charts")).objects == [
        "a-0",
        "a-1",
        "b-0",
        "b-2",
    ]


def test_rows_are_those_of_the_stores(run):
    found = Pack.read(make(run, "occluded-charts", "surface", "vision", "touch", "charts"))
    assert found.grasps == GRASPS
    for number, name in enumerate(found.objects):
        np.testing.assert_array_equal(found["points"][number], row(run, "surface", name, "points"))
        for grasp in range(GRASPS):
            for ours, stage, theirs in [
                ("occluded", "vision", "occluded"),
                ("charts", "charts", "vertices"),
                ("success", "touch", "success"),
                ("position", "touch", "position"),
                ("rotation", "touch", "rotation"),
            ]:
                np.testing.assert_array_equal(found[ours][number, grasp], row(run, stage, name, theirs, grasp))
    assert "reading" not in found and "unoccluded" not in found


def test_views(run):
    found = Pack.read(make(run, "views-none", "surface", "views"))
    assert (found.views, found.grasps, len(found)) == (2, 0, 5)
    np.testing.assert_array_equal(found["views"][3], row(run, "views", "b-1", "image"))
    np.testing.assert_array_equal(found["camera"][3], row(run, "views", "b-1", "camera").astype(np.float32))


def test_an_untouched_sensor_reads_the_empty_gel(run):
    found = Pack.read(make(run, "none-readings", "surface", "touch"))
    empty = run[1]["touch", "batch-0000"]["empty_reading"]
    seen = set()
    for number, name in enumerate(found.objects):
        for grasp in range(GRASPS):
            for sensor, success in enumerate(found["success"][number, grasp]):
                stored = row(run, "touch", name, "reading", grasp)[sensor]
                np.testing.assert_array_equal(found["reading"][number, grasp, sensor], stored if success else empty)
                seen.add(bool(success))
    assert seen == {True, False}


def test_some_splits(run):
    path = make(run, "none-charts", "surface", "touch", "charts")
    whole, part = Pack.read(path), Pack.read(path, ["validation", "test"])
    assert part.objects == ["a-1", "b-0"] and part.of_split("test") == [1]
    np.testing.assert_array_equal(part["charts"], whole["charts"][[1, 2]])
    assert part.digest == whole.digest


def test_the_same_stores_give_the_same_bytes_and_others_another_digest(run):
    path = make(run, "none-charts", "surface", "touch", "charts")
    first, digest = path.read_bytes(), Pack.read(path).digest
    assert make(run, "none-charts", "surface", "touch", "charts").read_bytes() == first
    changed = run[1]["charts", "batch-0001"] | run[1]["charts", "batch-0000"]
    changed["vertices"] = changed["vertices"].copy()
    changed["vertices"][0, 0, 0, 0] += 1
    store.write(run[0] / "charts/batch-0000.zarr", "charts", changed, ATTRIBUTES)
    assert Pack.read(make(run, "none-charts", "surface", "touch", "charts")).digest != digest


def test_a_value_that_is_not_finite_names_its_object(run):
    arrays = run[1]["charts", "batch-0000"]
    arrays["vertices"][GRASPS * 2, 1, 5, 2] = np.nan
    store.write(run[0] / "charts/batch-0000.zarr", "charts", arrays, ATTRIBUTES)
    with pytest.raises(PackError, match="charts vertices of b-0 has NaN"):
        make(run, "none-charts", "surface", "touch", "charts")
    assert not list((run[0] / "packs").glob("*"))


def test_no_object_left(run):
    (run[0] / "catalogue.csv").write_text("object,class,split,batch\n")
    with pytest.raises(PackError, match="no object is in all of surface, vision"):
        make(run, "unoccluded-none", "surface", "vision")


def test_a_changed_bit_is_noticed(run):
    path = make(run, "none-charts", "surface", "touch", "charts")
    whole, held = path.read_bytes(), Pack.read(path)
    for name in ("points", "charts", "success"):
        # A row is one piece of the file.
        place = whole.index(held[name][0].tobytes())
        changed = bytearray(whole)
        changed[place + 3] ^= 1
        path.write_bytes(changed)
        with pytest.raises(PackError, match="none-charts.h5 can't be read"):
            Pack.read(path)
    path.write_bytes(whole[:-200])
    with pytest.raises(PackError, match="none-charts.h5 can't be read"):
        Pack.read(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [("points", np.nan), ("charts", np.inf), ("position", 600.0), ("rotation", 1.5), ("charts", -600.0)],
)
def test_values_that_cannot_be_are_noticed_and_named(run, name, value):
    path = make(run, "none-charts", "surface", "touch", "charts")
    with h5py.File(path, "a") as file:
        file[name][(2, *[0] * (file[name].ndim - 1))] = value
    with pytest.raises(PackError, match=rf"none-charts.h5: {name} of b-0 is NaN, infinite or above .*remove"):
        Pack.read(path)
    assert len(Pack.read(path, ["validation"])) == 1  # what is not read is not looked at


def test_arrays_of_different_lengths_are_noticed(run):
    path = make(run, "none-charts", "surface", "touch", "charts")
    with h5py.File(path, "a") as file:
        values = file["points"][:]
        del file["points"]
        file["points"] = np.concatenate([values, values])
    with pytest.raises(PackError, match="different numbers of objects .*'points': 8"):
        Pack.read(path)


def test_files_that_cannot_be_read(run):
    missing = run[0] / "packs/none-charts.h5"
    with pytest.raises(PackError, match="does not exist; build it with: snakemake packs/none-charts.h5"):
        Pack.read(missing)
    path = make(run, "none-charts", "surface", "touch", "charts")
    with h5py.File(path, "a") as file:
        file.attrs["schema_version"] = 99
    with pytest.raises(PackError, match="schema version 99"):
        Pack.read(path)
    path.write_bytes(b"no pack")
    with pytest.raises(PackError, match="can't be read"):
        Pack.read(path)
    with pytest.raises(PackError, match="of family none-charts has no occluded"):
        Pack.read(make(run, "none-charts", "surface", "touch", "charts"))["occluded"]
