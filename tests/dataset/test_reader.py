import pickle
import pydoc
import shutil
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from operator import getitem

import h5py
import numpy as np
import pandas as pd
import pytest
import zarr

import palpate
import palpate.store
from palpate import seal
from palpate.batch import Rejection, write_rejections
from palpate.camera import looking_at, matrices, paper_camera
from palpate.catalogue import CatalogueError
from palpate.mesh import OBJECT_POSITION
from palpate.store import CONTRACT, StoreError
from palpate.touch import empty_reading
from tests.store.conftest import BATCHES

OBJECTS = ["ball-0000", "block-0000", "ball-0002"]
GRASPS = 2


def test_objects_are_those_of_the_catalogue_that_were_not_rejected(built):
    dataset = palpate.Dataset(built)
    assert dataset.objects == OBJECTS
    assert len(dataset) == 3
    assert [record.name for record in dataset] == OBJECTS
    assert dataset.classes == ["ball", "block"]
    assert dataset.stages == ["surface", "grasps", "touch", "vision"]
    assert "ball-0000" in dataset and "ball-0001" not in dataset
    with pytest.raises(KeyError, match="rejected.csv has the reason"):
        dataset["ball-0001"]
    with pytest.raises(KeyError, match="nothing-0000"):
        dataset["nothing-0000"]


def test_views_by_split_class_slice_and_name(built):
    dataset = palpate.Dataset(built)
    assert dataset.split("train").objects == ["ball-0000"]
    assert dataset.split("test").objects == ["block-0000"]
    assert dataset.of_class("ball").split("validation").objects == ["ball-0002"]
    assert dataset[1:].objects == OBJECTS[1:]
    assert dataset[-1].name == "ball-0002"
    assert dataset.select(["ball-0002", "ball-0000"]).objects == ["ball-0002", "ball-0000"]
    with pytest.raises(KeyError, match="train, validation, test"):
        dataset.split("valid")
    with pytest.raises(IndexError):
        dataset[3]


@pytest.mark.parametrize("name", OBJECTS)
def test_records_are_the_rows_of_the_stores(built, name):
    record = palpate.Dataset(built)[name]
    surface, grasps, touch, vision = (
        palpate.store.read(built / palpate.store.CONTRACT[stage].path(record.batch))
        for stage in ("surface", "grasps", "touch", "vision")
    )
    np.testing.assert_array_equal(record.points, surface["points"][surface["object"].tolist().index(name)])
    position = grasps["object"].tolist().index(name)
    assert record.attempts == 7
    np.testing.assert_array_equal(record.unoccluded, vision["unoccluded"][position, 0])
    assert len(record.grasps) == GRASPS
    for number, grasp in enumerate(record.grasps):
        row = position, number
        for array in ("palm_pose", "joint_positions", "penetration"):
            np.testing.assert_array_equal(getattr(grasp, array), grasps[array][row])
        for array in ("success", "position", "rotation", "depth"):
            np.testing.assert_array_equal(getattr(grasp, array), touch[array][row])
        np.testing.assert_array_equal(grasp.occluded, vision["occluded"][row][0])
        for sensor in range(4):
            count = touch["point_count"][row][sensor]
            np.testing.assert_array_equal(grasp.points[sensor], touch["points"][row][sensor, :count])
            expected = touch["reading"][row][sensor] if touch["success"][row][sensor] else empty_reading()
            np.testing.assert_array_equal(grasp.reading[sensor], expected)
    assert not all(grasp.success.all() for grasp in record.grasps)  # so that both cases were met


def test_arrays_are_joined_over_batches_in_the_order_of_the_view(built):
    dataset = palpate.Dataset(built)
    depth = dataset.array("touch", "depth")
    assert depth.shape == (3, GRASPS, 4, 100, 100) and depth.dtype == np.float32
    expected = np.stack([[grasp.depth for grasp in record.grasps] for record in dataset])
    np.testing.assert_array_equal(np.asarray(depth), expected)
    mask = np.array([True, False, True])
    indices = [slice(None), -1, [2, 0, 1], slice(0, 3, 2), mask, mask.tolist(), (1, 1), (2, -1, 3), (slice(0, 2), 1)]
    indices += [(slice(1, 3), slice(None), 0), (mask, slice(1, None), 2, slice(10, 20, 3)), (mask, 0, -1)]
    indices += [(slice(3, 3), 1), ([], 0), (np.int64(1), np.int64(0)), (), (0, slice(None, None, -1))]
    indices += [(slice(None, None, -1), 1, 2), ([1, 1], 0, 1, 2, slice(None, None, -7))]
    for index in indices:
        np.testing.assert_array_equal(depth[index], expected[index], err_msg=str(index))
        assert depth[index].shape == expected[index].shape and depth[index].dtype == expected.dtype
    wrong = [
        3,
        -4,
        (0, GRASPS),
        (0, 0, 0, 0, 0, 0),
        (0, mask),
        (0, None),
        "a",
        [-4, 0],
        mask[1:],
        (0, [0, 1]),
        ["a"],
        0.5,
    ]
    for index in wrong:
        with pytest.raises(IndexError):
            depth[index]
    assert depth.attrs["unit"] == "m" and depth.attrs["axes"] == "(o, g, s, r, c)" and depth.attrs["seed"] == 0
    turned = dataset.select(["ball-0002", "ball-0000"]).array("surface", "points")
    np.testing.assert_array_equal(turned, [dataset["ball-0002"].points, dataset["ball-0000"].points])
    with pytest.raises(KeyError, match="no rows"):
        dataset.array("touch", "empty_reading")


def test_an_untouched_sensor_reads_the_empty_gel_in_every_way_of_reading(built):
    dataset = palpate.Dataset(built)
    success, reading = dataset.load("touch", "success"), dataset.array("touch", "reading")
    stored = {
        name: palpate.store.read(built / f"touch/{batch}.zarr", "reading")["reading"][row]
        for batch, kept in {"batch-0000": OBJECTS[:2], "batch-0001": OBJECTS[2:]}.items()
        for row, name in enumerate(kept)
    }
    expected = np.stack([stored[name] for name in OBJECTS])
    assert not expected[~success].any() and not success.all()
    expected[~success] = empty_reading()
    for index in (1, (2, 1), (slice(None), 0, 3), (0, 1, slice(1, 3), slice(7), 3), (1, 0, 2, 4, 9, 1), [2, 0]):
        np.testing.assert_array_equal(reading[index], expected[index], err_msg=str(index))
    np.testing.assert_array_equal(dataset.load("touch", "reading"), expected)
    np.testing.assert_array_equal([[grasp.reading for grasp in record.grasps] for record in dataset], expected)
    items = [item["reading"] for item in dataset.grasps(arrays=["reading"])]
    np.testing.assert_array_equal(items, expected.reshape(-1, *expected.shape[2:]))


def test_grasps_are_the_records_as_dictionaries(built):
    dataset = palpate.Dataset(built)
    grasps = dataset.grasps()
    records = [grasp for record in dataset for grasp in record.grasps]
    assert len(grasps) == len(records) == 3 * GRASPS
    assert {"palm_pose", "reading", "points", "occluded_depth", "unoccluded", "surface_points"} < set(grasps.arrays)
    for item, grasp in zip(grasps, records, strict=True):
        record = grasp.object
        assert (item["object"], item["class"], item["split"]) == (record.name, record.class_name, record.split)
        assert item["grasp"] == grasp.number
        for name in set(grasps.arrays) - {"points", "surface_points"}:
            found = getattr(grasp, name) if name in dir(grasp) else getattr(record, name)
            np.testing.assert_array_equal(item[name], found, err_msg=name)
        np.testing.assert_array_equal(item["surface_points"], record.points)
        for cloud, count, points in zip(item["points"], item["point_count"], grasp.points, strict=True):
            np.testing.assert_array_equal(cloud[:count], points)
            assert not cloud[count:].any()
    assert [item["object"] for item in dataset.grasps("test", [])] == ["block-0000"] * GRASPS
    assert list(grasps[-1]) == list(grasps[5]) and grasps[-1]["grasp"] == GRASPS - 1
    for wrong in (3 * GRASPS, -3 * GRASPS - 1):
        with pytest.raises(IndexError, match=f"grasp {wrong} of {3 * GRASPS}"):
            grasps[wrong]
    with pytest.raises(KeyError, match="array of grasps: 'gel' is not one of joint_positions, .*surface_points"):
        dataset.grasps(arrays=["gel"])
    with pytest.raises(KeyError, match="train, validation, test"):
        dataset.grasps("tests")
    with pytest.raises(palpate.StoreError, match="no object to take grasps of: rejected.csv, or the config's `split`"):
        dataset.of_class("block").grasps("train")


def test_grasps_are_what_zarr_and_hdf5_read_themselves(built):
    grasps = palpate.Dataset(built).grasps()
    for item in grasps:
        batch = next(name for name, objects in BATCHES.items() if item["object"] in objects)
        for name, (stage, spec) in grasps.sources.items():
            path = built / CONTRACT[stage].path(batch)
            opened = h5py.File(path) if path.suffix == ".h5" else zarr.open_group(path)
            objects = [each.decode() if isinstance(each, bytes) else each for each in opened["object"][:]]
            values = opened[spec.name][...][objects.index(item["object"])]
            values = values if spec.row == "object" else values[item["grasp"]]
            values = values[0] if spec.of_cameras else values
            if name == "reading":  # 0 is stored for a sensor that touched nothing
                values = values[item["success"]]
                np.testing.assert_array_equal(item[name][item["success"]], values)
                assert (item[name][~item["success"]] == empty_reading()).all()
                continue
            np.testing.assert_array_equal(item[name], values, err_msg=name)
            assert item[name].dtype == values.dtype


def test_a_loader_of_torch_takes_the_grasps_as_they_are(built):
    from torch.utils.data import DataLoader

    dataset = palpate.Dataset(built)
    dataset[0].grasps[0].depth  # noqa: B018  (the stores are open when the workers start)
    grasps = pickle.loads(pickle.dumps(dataset.grasps()))  # as workers that are spawned get it
    loader = DataLoader(grasps, batch_size=4, num_workers=2)
    batches = list(loader)
    assert [len(batch["object"]) for batch in batches] == [4, 2]
    depth = np.concatenate([batch["depth"].numpy() for batch in batches])
    np.testing.assert_array_equal(depth, dataset.array("touch", "depth")[:].reshape(depth.shape))
    assert batches[1]["grasp"].tolist() == [0, 1] and batches[0]["attempts"].tolist() == [7] * 4


def test_the_table_has_a_row_a_grasp(run):
    table = palpate.Dataset(run).table()
    assert list(table) == ["object", "class", "split", "batch", "grasp", "touches", "row"]
    success = palpate.Dataset(run).load("touch", "success")
    assert len(table) == 3 * GRASPS
    for line in table.itertuples():
        assert line.object == OBJECTS[line.row] and line.touches == success[line.row, line.grasp].sum()
    assert table.groupby("object", sort=False)["split"].first().tolist() == ["train", "test", "validation"]
    shutil.rmtree(run / "touch")
    pd.testing.assert_frame_equal(palpate.Dataset(run).table(), table)  # by the touches of the grasps
    shutil.rmtree(run / "grasps")
    assert list(palpate.Dataset(run).table()) == ["object", "class", "split", "batch", "row"]


def test_wrong_names_list_the_right_ones(built):
    dataset = palpate.Dataset(built)
    with pytest.raises(
        KeyError, match="stage with arrays: 'tuch' is not one of surface, grasps, .*; did you mean 'touch'"
    ):
        dataset.array("tuch", "depth")
    with pytest.raises(KeyError, match="'tain' is not one of train, validation, test; did you mean 'train'"):
        dataset.split("tain")
    with pytest.raises(KeyError, match="'bal' is not one of ball, block; did you mean 'ball'"):
        dataset.of_class("bal")
    with pytest.raises(KeyError, match="objects .*; the first are ball-0000, block-0000, ball-0002"):
        dataset["x"]
    with pytest.raises(KeyError, match="array of touch: .*; did you mean 'depth'"):
        dataset.array("touch", "dept")
    with pytest.raises(KeyError, match="array of grasps: 'dept' .*; did you mean 'depth'"):
        dataset.grasps(arrays=["dept"])
    with pytest.raises(ValueError, match="stage 'viison' is not one of .*; did you mean 'vision'"):
        palpate.Dataset(built, stages=["viison"])
    with pytest.raises(KeyError, match="array of touch: 'color' is not one of object, success, position"):
        dataset.load("touch", "color")
    with pytest.raises(KeyError, match="did you mean 'ball-0000'"):
        dataset["bal-0000"]
    with pytest.raises(AttributeError, match="has no 'readings'; did you mean 'reading'"):
        dataset[0].grasps[0].readings  # noqa: B018
    with pytest.raises(AttributeError, match="no attribute 'datasets'; there are Dataset, .*reconstruct, .*store"):
        palpate.datasets  # noqa: B018


def test_names_are_complete_and_help_has_units_and_shapes(built):
    for name in dir(palpate):
        getattr(palpate, name)
    assert {"Dataset", "Reconstructor", "StoreError", "reconstruct", "store", "dataset", "vision"} <= set(dir(palpate))
    assert palpate.store.CONTRACT and set(palpate.__all__) <= set(dir(palpate))
    grasp = pydoc.render_doc(palpate.dataset.GraspRecord, renderer=pydoc.plaintext)
    record = pydoc.render_doc(palpate.dataset.ObjectRecord, renderer=pydoc.plaintext)
    frames = pydoc.render_doc(palpate.dataset.reader.FramesRecord, renderer=pydoc.plaintext)
    press = pydoc.render_doc(palpate.dataset.reader.PressRecord, renderer=pydoc.plaintext)
    for stage, name, spec in [(each, *pair) for each in CONTRACT for pair in CONTRACT[each].arrays.items()]:
        of_grasp = frames if "frame" in stage else grasp
        of_object = record if spec.of_objects and name != "object" else ""
        text = {"": "", "object": of_object, "press": press}.get(spec.row, of_grasp)
        if text and name not in ("points", "reading"):
            axes = spec.shape[1 if spec.row == "object" else 2 :]
            shape = ", ".join(str(axis) for axis in axes if axis != "k")  # a record has one camera
            said = text.split(f"\n |  {name}\n")[1].split("\n |  \n")[0]
            assert f"({shape}" in said and f"{spec.dtype}, {spec.unit}".rstrip(", ") in said, name
    assert "(s, r, c, 3) uint8, RGB" in grasp and "(count, 3) float32, m" in grasp


def test_opening_a_run_with_tables_of_rejections_opens_no_store(run, monkeypatch):
    """However many stores there are; and those that were read are forgotten."""
    opened = []
    monkeypatch.setattr(palpate.dataset.run, "Store", lambda path: opened.append(path) or palpate.store.Store(path))
    monkeypatch.setattr(palpate.dataset.run, "REMEMBERED_STORES", 2)
    dataset = palpate.Dataset(run)
    assert dataset.objects == OBJECTS and not opened
    assert palpate.Dataset(run, ["surface", "vision"]).objects == OBJECTS  # vision needs grasps
    assert palpate.Dataset(run, ["surface"]).objects == [*OBJECTS[:2], "ball-0001", OBJECTS[2]]
    assert not opened
    for _ in range(2):
        for item in dataset.grasps(arrays=["depth", "occluded", "surface_points"]):
            assert item["depth"].any()
    assert len(dataset._run._stores) == 2


def damaged(run, stage, change, batch="batch-0000"):
    """The store of a batch, written again after `change` altered its arrays in place."""
    path = run / palpate.store.CONTRACT[stage].path(batch)
    arrays, attributes = palpate.store.read(path), palpate.store.open(path).attributes
    change(arrays)
    palpate.store.write(path, stage, arrays, attributes)


def test_arrays_are_loaded_into_memory_in_the_type_asked_for(built):
    dataset = palpate.Dataset(built)
    for stage, name in (("surface", "points"), ("touch", "depth"), ("grasps", "palm_pose"), ("vision", "occluded")):
        np.testing.assert_array_equal(dataset.load(stage, name), dataset.array(stage, name)[:])
    position = dataset.load("touch", "position", np.float32)
    assert position.dtype == np.float32 and position.shape == (3, GRASPS, 4, 3)
    np.testing.assert_array_equal(dataset.empty_reading, empty_reading())
    expected = [[grasp.reading for grasp in record.grasps] for record in dataset]
    np.testing.assert_array_equal(dataset.load("touch", "reading"), expected)


@pytest.mark.parametrize(
    ("stage", "name"),
    [("surface", "points"), ("touch", "position"), ("touch", "rotation"), ("touch", "points"), ("grasps", "palm_pose")],
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_errors_that_name_file_object_and_remedy(run, stage, name, value):
    damaged(run, stage, lambda arrays: arrays[name].__setitem__((1, *[0] * (arrays[name].ndim - 1)), value))
    message = rf"{stage}/batch-0000.* {name} of block-0000 is NaN or infinite; remove .* snakemake {stage}/batch-0000"
    with pytest.raises(StoreError, match=message):
        palpate.Dataset(run).load(stage, name)
    assert palpate.Dataset(run).select(["ball-0000"]).load(stage, name).any()


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_depth_may_be_infinite_but_not_nan(run, value):
    assert np.isinf(palpate.Dataset(run).load("touch", "depth")).any()
    damaged(run, "touch", lambda arrays: arrays["depth"].__setitem__((0, 1, 2, 3, 4), value))
    with pytest.raises(StoreError, match="depth of ball-0000 is NaN or infinite"):
        palpate.Dataset(run).load("touch", "depth")


def test_batches_that_differ_in_shape_are_named(run):
    damaged(run, "surface", lambda arrays: arrays.update(points=arrays["points"][:, 1:]), "batch-0001")
    message = r"batch-0001.zarr: points of an object is \(499, 3\), but \(500, 3\) in .*batch-0000.*from one config"
    with pytest.raises(StoreError, match=message):
        palpate.Dataset(run).load("surface", "points")


def test_a_dataset_without_objects_has_nothing_to_load(built):
    nothing = palpate.Dataset(built)[:0]
    for load in (lambda: nothing.load("surface", "points"), lambda: nothing.sensor, nothing.grasps):
        with pytest.raises(StoreError, match="no object .*rejected.csv"):
            load()


def test_names_of_objects_are_text_in_every_stage(built):
    dataset = palpate.Dataset(built)
    for stage in dataset.stages:
        names = dataset.array(stage, "object")
        assert names[:].tolist() == OBJECTS and names[:].dtype.kind == "U" and names[1] == OBJECTS[1]


def test_opening_reads_no_array(built, monkeypatch):
    read = []
    get = palpate.store.Store.get

    def spy(store, name, index=...):
        read.append((store.path.parent.name, name, index))
        return get(store, name, index)

    monkeypatch.setattr(palpate.store.Store, "get", spy)
    dataset = palpate.Dataset(built)
    repr(dataset)
    depth = dataset.array("touch", "depth")
    assert depth.shape and repr(depth)
    assert not read
    depth[1, 0, 2]
    assert read == [("touch", "object", ...), ("touch", "depth", (1, 0, 2))]  # one record, not the batch


@pytest.mark.parametrize("stage, array", [("touch", "reading"), ("vision", "occluded"), ("grasps", "palm_pose")])
def test_a_stage_that_was_not_built_is_named_with_the_command_that_builds_it(run, stage, array):
    shutil.rmtree(run / stage)
    dataset = palpate.Dataset(run)
    assert stage not in dataset.stages
    assert dataset["ball-0000"].points.shape == (500, 3)
    with pytest.raises(StoreError, match=f"has no {stage}; build it with: snakemake {stage}/batch-0000"):
        getattr(dataset["ball-0000"].grasps[0], array)
    with pytest.raises(StoreError, match=f"has no {stage}; build it with"):
        dataset.array(stage, array)[0]


def test_a_missing_batch_is_named_with_the_command_that_builds_it(run):
    shutil.rmtree(run / "touch/batch-0001.zarr")
    dataset = palpate.Dataset(run)
    assert dataset["ball-0000"].grasps[0].reading.any()
    with pytest.raises(StoreError, match=r"does not exist; build it with: snakemake touch/batch-0001.zarr"):
        dataset["ball-0002"].grasps[0].reading.any()


def test_an_object_that_a_store_lacks_is_an_error_not_another_object(run):
    path = run / "surface/batch-0000.zarr"
    arrays = palpate.store.read(path)
    attributes = palpate.store.open(path).attributes
    kept = {"object": arrays["object"][1:], "points": arrays["points"][1:]}
    palpate.store.write(path, "surface", kept, attributes)
    dataset = palpate.Dataset(run)
    assert dataset["block-0000"].points.any()
    with pytest.raises(StoreError, match=r"surface/batch-0000.zarr does not hold ball-0000.*remove it and"):
        dataset["ball-0000"].points.any()


def test_a_folder_that_is_no_run_is_said_to_be_none(tmp_path):
    with pytest.raises(CatalogueError, match="catalogue.csv does not exist"):
        palpate.Dataset(tmp_path)
    (tmp_path / "catalogue.csv").write_text("object,class\na,b\n")
    with pytest.raises(CatalogueError, match="catalogue.csv has no column 'split'"):
        palpate.Dataset(tmp_path)


def test_a_catalogue_alone_opens(run):
    for stage in ("surface", "grasps", "touch", "vision"):
        shutil.rmtree(run / stage)
    dataset = palpate.Dataset(run)
    assert dataset.objects == OBJECTS and dataset.stages == []


def test_objects_rejected_before_the_whole_list_is_made_are_left_out(run):
    (run / "rejected.csv").unlink()
    reject(run, "surface", "batch-0000", "block-0000")
    assert palpate.Dataset(run).objects == ["ball-0000", "ball-0001", "ball-0002"]


def reject(run, stage, batch, name=None):
    """A stage's tables of all batches, of which one rejected an object."""
    path = run / f"rejected/{stage}/{batch}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    for other in ("batch-0000", "batch-0001"):
        if not (path.parent / f"{other}.csv").exists():
            (path.parent / f"{other}.csv").write_text("object,stage,reason\n")
    if name:
        path.write_text(f"object,stage,reason\n{name},{stage},too thin\n")


def test_batches_that_the_catalogue_does_not_name_are_not_read(run):
    reject(run, "grasps", "batch-0001", "ball-0001")
    reject(run, "meshes", "batch-0002", "ball-0000")  # left by a config with smaller batches
    (run / "vision").rename(run / "kept")
    (run / "vision").mkdir()
    (run / "kept/batch-0000.zarr").rename(run / "vision/batch-0007.zarr")
    dataset = palpate.Dataset(run)
    assert dataset.objects == OBJECTS
    assert [row["object"] for row in dataset.rejections()] == ["ball-0001"]
    assert dataset.stages == ["surface", "grasps", "touch"]


@pytest.mark.parametrize("written", ["by stage", "whole"])
def test_what_a_stage_rejected_does_not_matter_to_those_who_do_not_ask_for_it(run, written):
    """Nor whether its store is there yet."""
    path = run / "vision/batch-0000.zarr"
    arrays = palpate.store.read(path)
    kept = {key: array[1:] for key, array in arrays.items()}
    palpate.store.write(path, "vision", kept, palpate.store.open(path).attributes)
    if written == "by stage":
        reject(run, "vision", "batch-0000", "ball-0000")
        reject(run, "grasps", "batch-0001", "ball-0001")
    else:
        with open(run / "rejected.csv", "a") as file:
            file.write("ball-0000,vision,too thin\n")
    whole, touch = palpate.Dataset(run), palpate.Dataset(run, stages=["meshes", "grasps", "touch"])
    assert whole.objects == OBJECTS[1:] and touch.objects == OBJECTS
    assert {row["stage"] for row in whole.rejections()} == {"grasps", "vision"}
    assert {row["stage"] for row in touch.rejections()} == {"grasps"}
    assert touch.split("train").rejections() == touch.rejections()
    with pytest.raises(StoreError, match="ball-0000, which was rejected at vision: too thin; open"):
        touch["ball-0000"].unoccluded.any()
    shutil.rmtree(run / "vision")
    assert palpate.Dataset(run, stages=["grasps", "touch"]).objects == OBJECTS
    with pytest.raises(ValueError, match="stage 'renders' is not one of released, meshes, surface, grasps"):
        palpate.Dataset(run, stages=["touch", "renders"])


def test_what_is_made_from_the_dataset_does_not_change_it(run):
    """Such as views: their rejections matter to those who ask for them."""
    reject(run, "grasps", "batch-0001", "ball-0001")
    reject(run, "views", "batch-0000", "ball-0000")
    assert palpate.Dataset(run).objects == OBJECTS
    assert [row["stage"] for row in palpate.Dataset(run).rejections()] == ["grasps"]
    assert palpate.Dataset(run, stages=["grasps", "views"]).objects == OBJECTS[1:]


def test_a_run_that_has_no_grasps_store_is_read_from_what_it_has(run):
    """As when touch and images were not made here."""
    expected = [[grasp.depth for grasp in record.grasps] for record in palpate.Dataset(run)]
    shutil.rmtree(run / "grasps")
    shutil.rmtree(run / "meshes")
    dataset = palpate.Dataset(run)
    assert dataset.objects == OBJECTS and dataset.stages == ["surface", "touch", "vision"]
    assert palpate.Dataset(run, stages=["surface"]).objects == [*OBJECTS[:2], "ball-0001", OBJECTS[2]]
    np.testing.assert_array_equal([[grasp.depth for grasp in record.grasps] for record in dataset], expected)
    assert dataset[0].grasps[1].occluded.shape == (64, 64, 3)
    shutil.rmtree(run / "touch")
    assert len(palpate.Dataset(run)[0].grasps) == GRASPS


def test_unknown_names_are_attribute_errors_that_list_the_arrays(built):
    record = palpate.Dataset(built)[0]
    with pytest.raises(AttributeError, match="unoccluded_mask"):
        record.depth  # noqa: B018
    with pytest.raises(AttributeError, match="occluded_depth"):
        record.grasps[0].color  # noqa: B018
    assert "palm_pose" in dir(record.grasps[0]) and "unoccluded" in dir(record)


def test_representations_say_what_there_is(built):
    dataset = palpate.Dataset(built)
    assert "3 objects (ball 2, block 1); surface, grasps, touch, vision" in repr(dataset)
    assert "block-0000" in repr(dataset["block-0000"]) and "test" in repr(dataset["block-0000"])
    assert repr(dataset[0].grasps[1]) == "GraspRecord('ball-0000', 1)"


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_dataset_in_use_travels_to_other_processes(built, method):
    dataset = palpate.Dataset(built)
    points = dataset.array("touch", "points")
    expected = list(points)  # the stores are open now
    with ProcessPoolExecutor(1, mp_context=get_context(method)) as pool:
        found = list(pool.map(getitem, [points] * len(points), range(len(points))))
    np.testing.assert_array_equal(found, expected)


def test_records_survive_pickling(built):
    record = palpate.Dataset(built)["ball-0002"]
    record.grasps[0].depth  # noqa: B018
    copy = pickle.loads(pickle.dumps(record))
    np.testing.assert_array_equal(copy.grasps[1].depth, record.grasps[1].depth)


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"", "is empty"), (b"\xff\xfe\x00\x01\n", "is not text"), (b"object,class,split,batch\n", "lists no object")],
)
def test_a_catalogue_that_is_empty_or_no_text_is_named_with_the_remedy(run, content, said):
    (run / "catalogue.csv").write_bytes(content)
    with pytest.raises(CatalogueError, match=f"{run}/catalogue.csv {said}; remove it and .* snakemake catalogue.csv"):
        palpate.Dataset(run)


def test_a_table_of_rejections_that_is_lost_or_damaged_is_an_error(run):
    tables = {batch: run / f"rejected/touch/{batch}.csv" for batch in ("batch-0000", "batch-0001")}
    for table in tables.values():
        table.parent.mkdir(parents=True, exist_ok=True)
        write_rejections(table, [Rejection("ball-0001", "touch", "no touch")], seal.NOTHING)
    dataset = palpate.Dataset(run)
    assert len(dataset.rejections()) == 2
    table = tables["batch-0001"]
    content = table.read_text()
    command = "with: snakemake rejected/touch/batch-0001.csv"
    table.write_text(content.replace("0001", "0002"))
    with pytest.raises(StoreError, match=f"{table} has changed .*; remove it and build it again {command}"):
        palpate.Dataset(run)
    table.unlink()
    with pytest.raises(StoreError, match=f"{table} does not exist; build it {command}"):
        palpate.Dataset(run)
    shutil.rmtree(run / "touch/batch-0001.zarr")  # not made yet
    assert len(palpate.Dataset(run).rejections()) == 1


def test_a_record_shows_one_camera_and_the_others_are_asked_for(run):
    cameras = [paper_camera(64), looking_at(OBJECT_POSITION, (-0.5, 1.0, 0.8), 64)]
    for batch in ("batch-0000", "batch-0001"):
        path = run / palpate.store.CONTRACT["vision"].path(batch)
        arrays, attributes = palpate.store.read(path), palpate.store.open(path).attributes
        for name in set(arrays) - {"object"}:
            axis = 2 if name.startswith("occluded") else 1
            arrays[name] = np.concatenate([arrays[name], np.flip(arrays[name], axis + 1)], axis=axis)
        arrays |= {name: np.tile(each, (len(arrays["object"]), 1, 1, 1)) for name, each in matrices(cameras).items()}
        palpate.store.write(path, "vision", arrays, attributes)
    dataset = palpate.Dataset(run)
    record = dataset["block-0000"]
    grasp, row = record.grasps[1], 1
    arrays = palpate.store.read(run / palpate.store.CONTRACT["vision"].path("batch-0000"))
    for number, camera in enumerate(cameras):
        for seen, of_grasp in ((record.seen_by(number), False), (grasp.seen_by(number), True)):
            assert seen.cameras == 2
            np.testing.assert_array_equal(seen.intrinsics, camera.intrinsics())
            np.testing.assert_array_equal(seen.extrinsics, camera.extrinsics())
            np.testing.assert_allclose(seen.vision_camera.pose(), camera.pose(), atol=1e-9)
            points = np.random.default_rng(0).normal(size=(5, 3))
            np.testing.assert_allclose(seen.vision_camera.project(points)[1], camera.project(points)[1], atol=1e-9)
            alone = seen.object if of_grasp else seen
            np.testing.assert_array_equal(alone.unoccluded_depth, arrays["unoccluded_depth"][row, number])
            held = seen if of_grasp else seen.grasps[1]
            np.testing.assert_array_equal(held.occluded, arrays["occluded"][row, 1, number])
    np.testing.assert_array_equal(grasp.occluded_mask, arrays["occluded_mask"][row, 1, 0])
    np.testing.assert_array_equal(grasp.success, grasp.seen_by(1).success)
    expected = [[camera.matrix() for camera in cameras]] * len(dataset)
    np.testing.assert_allclose(dataset.cameras(), expected, atol=1e-12)
    for item in (record, grasp):
        with pytest.raises(IndexError, match="has no camera 2: it has 2, numbered from 0"):
            item.seen_by(2)
        with pytest.raises(IndexError):
            item.seen_by(-1)


def test_whether_an_object_has_the_one_size_of_all(run):
    """By the catalogue; an object without a scale has the one size."""
    assert all(record.normalised for record in palpate.Dataset(run))
    rows = [row.split(",") for row in (run / "catalogue.csv").read_text().splitlines()]
    scales = ["scale", "diagonal", "keep", "0.001", *["diagonal"] * (len(rows) - 4)]
    (run / "catalogue.csv").write_text("".join(f"{','.join(row)},{s}\n" for row, s in zip(rows, scales, strict=True)))
    sizes = {record.name: record.normalised for record in palpate.Dataset(run, [])}
    assert sizes == {row[0]: scale == "diagonal" for row, scale in zip(rows[1:], scales[1:], strict=True)}
    assert palpate.Dataset(run)[0].scale == 0.001  # of its file's unit, in metres


def test_what_was_drawn_for_an_object_is_read_back(run):
    assert palpate.Dataset(run)["ball-0000"].drawn == {}
    path, drawn = run / CONTRACT["vision"].path("batch-0000"), {"ball-0000": {"background": [0.5, 1, 1]}}
    attributes = palpate.store.open(path).attributes | {"drawn": drawn}
    palpate.store.write(path, "vision", palpate.store.read(path), attributes)
    dataset = palpate.Dataset(run)
    assert dataset["ball-0000"].drawn == drawn["ball-0000"] and dataset["block-0000"].drawn == {}
