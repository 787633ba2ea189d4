import pickle
import shutil
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import palpate
import palpate.store
from palpate.atomic import atomic_write
from palpate.batch import Rejection, write_rejections
from palpate.catalogue import CatalogueError
from palpate.store import StoreError
from palpate.touch import empty_reading

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
    with pytest.raises(KeyError, match="test, train, validation"):
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
    np.testing.assert_array_equal(record.unoccluded, vision["unoccluded"][position])
    assert len(record.grasps) == GRASPS
    for number, grasp in enumerate(record.grasps):
        row = position, number
        for array in ("palm_pose", "joint_positions", "penetration"):
            np.testing.assert_array_equal(getattr(grasp, array), grasps[array][row])
        for array in ("success", "position", "rotation", "depth"):
            np.testing.assert_array_equal(getattr(grasp, array), touch[array][row])
        np.testing.assert_array_equal(grasp.occluded, vision["occluded"][row])
        for sensor in range(4):
            count = touch["point_count"][row][sensor]
            np.testing.assert_array_equal(grasp.points[sensor], touch["points"][row][sensor, :count])
            expected = touch["reading"][row][sensor] if touch["success"][row][sensor] else empty_reading()
            np.testing.assert_array_equal(grasp.reading[sensor], expected)
    assert not all(grasp.success.all() for grasp in record.grasps)  # so that both cases were met


def test_arrays_are_joined_over_batches_in_the_order_of_the_view(built):
    dataset = palpate.Dataset(built)
    depth = dataset.array("touch", "depth")
    assert depth.shape == (3, GRASPS, 4, 100, 100) and depth.dtype == np.float32 and depth.ndim == 5
    expected = np.stack([[grasp.depth for grasp in record.grasps] for record in dataset])
    np.testing.assert_array_equal(np.asarray(depth), expected)
    mask = np.array([True, False, True])
    indices = [slice(None), -1, [2, 0, 1], slice(0, 3, 2), mask, mask.tolist(), (1, 1), (2, -1, 3), (slice(0, 2), 1)]
    indices += [(slice(1, 3), slice(None), 0), (mask, slice(1, None), 2, slice(10, 20, 3)), (mask, 0, -1), ...]
    indices += [(..., 5), (0, ..., slice(3)), (slice(3, 3), 1), ([], 0), (np.int64(1), np.int64(0)), ()]
    for index in indices:
        np.testing.assert_array_equal(depth[index], expected[index], err_msg=str(index))
        assert depth[index].shape == expected[index].shape and depth[index].dtype == expected.dtype
    wrong = [3, -4, (0, GRASPS), (0, 0, 0, 0, 0, 0), (0, slice(None, None, -1)), (0, [0, 1]), (0, mask), (0, None)]
    for index in wrong:
        with pytest.raises(IndexError):
            depth[index]
    turned = dataset.select(["ball-0002", "ball-0000"]).array("surface", "points")
    np.testing.assert_array_equal(turned, [dataset["ball-0002"].points, dataset["ball-0000"].points])
    with pytest.raises(KeyError, match="no rows"):
        dataset.array("touch", "empty_reading")


def damaged(run, stage, change, batch="batch-0000"):
    """The store of a batch, written again after `change` altered its arrays in place."""
    path = run / palpate.store.CONTRACT[stage].path(batch)
    arrays, attributes = palpate.store.read(path), palpate.store.open(path).attributes
    change(arrays)
    palpate.store.write(path, stage, arrays, attributes)


def test_arrays_are_loaded_into_memory_in_the_type_asked_for(built):
    dataset = palpate.Dataset(built)
    assert dataset.grasps_per_object == GRASPS
    for stage, name in (("surface", "points"), ("touch", "depth"), ("grasps", "palm_pose"), ("vision", "occluded")):
        np.testing.assert_array_equal(dataset.load(stage, name), dataset.array(stage, name)[:])
    position = dataset.load("touch", "position", np.float32)
    assert position.dtype == np.float32 and position.shape == (3, GRASPS, 4, 3)
    np.testing.assert_array_equal(dataset.empty_reading, empty_reading())
    expected = [[grasp.reading for grasp in record.grasps] for record in dataset]
    np.testing.assert_array_equal(dataset.readings(), expected)
    stored = dataset.array("touch", "reading")[:]
    assert not stored[~dataset.load("touch", "success")].any() and not np.array_equal(stored, expected)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 600.0])
@pytest.mark.parametrize(
    ("stage", "name", "limit"),
    [
        ("surface", "points", "NaN, infinite or above 10"),
        ("touch", "position", "NaN, infinite or above 10"),
        ("touch", "rotation", "NaN, infinite or above 1.001"),
        ("touch", "points", "NaN, infinite or above 10"),
    ],
)
def test_wrong_values_are_errors_that_name_file_object_and_remedy(run, stage, name, limit, value):
    def change(arrays):
        arrays[name][(1, *[0] * (arrays[name].ndim - 1))] = value
        if stage == "touch":
            arrays["point_count"][1] = 1

    damaged(run, stage, change)
    message = rf"{stage}/batch-0000.* {name} of block-0000 is {limit}; remove .* snakemake {stage}/batch-0000"
    with pytest.raises(StoreError, match=message):
        palpate.Dataset(run).load(stage, name)
    assert palpate.Dataset(run).select(["ball-0000"]).load(stage, name).any()


def test_depth_may_be_infinite_but_not_nan(run):
    assert np.isinf(palpate.Dataset(run).load("touch", "depth")).any()
    for value in (np.nan, -np.inf):
        damaged(run, "touch", lambda arrays, value=value: arrays["depth"].__setitem__((0, 1, 2, 3, 4), value))
        with pytest.raises(StoreError, match="depth of ball-0000 is NaN, infinite"):
            palpate.Dataset(run).load("touch", "depth")


def test_local_clouds_past_their_count_are_not_looked_at(run):
    expected = palpate.Dataset(run).load("touch", "points")

    def change(arrays):
        for index in np.ndindex(arrays["point_count"].shape):
            arrays["points"][index][arrays["point_count"][index] :] = np.nan

    damaged(run, "touch", change)
    np.testing.assert_array_equal(palpate.Dataset(run).load("touch", "points"), expected)


def test_batches_that_differ_in_shape_are_named(run):
    damaged(run, "surface", lambda arrays: arrays.update(points=arrays["points"][:, 1:]), "batch-0001")
    message = r"batch-0001.zarr: points of an object is \(499, 3\), but \(500, 3\) in .*batch-0000.*from one config"
    with pytest.raises(StoreError, match=message):
        palpate.Dataset(run).load("surface", "points")


def test_a_dataset_without_objects_has_nothing_to_load(built):
    nothing = palpate.Dataset(built)[:0]
    for load in (lambda: nothing.load("surface", "points"), lambda: nothing.grasps_per_object, nothing.readings):
        with pytest.raises(StoreError, match="no object .*rejected.csv says why"):
            load()


def test_names_of_objects_are_text_in_every_stage(built):
    dataset = palpate.Dataset(built)
    for stage in dataset.stages:
        names = dataset.array(stage, "object")
        assert names[:].tolist() == OBJECTS and names[:].dtype.kind == "U" and names[1] == OBJECTS[1]


def test_opening_reads_no_array_but_the_names_of_objects(built, monkeypatch):
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
    assert {name for _, name, _ in read} == {"object"}
    read.clear()
    depth[1, 0, 2]
    assert read == [("touch", "depth", (1, 0, 2))]  # one record, not the batch


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
    assert palpate.Dataset(run).objects == OBJECTS[1:]
    dataset = palpate.Dataset(run, stages=["grasps", "touch"])
    assert dataset.objects == OBJECTS
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
    assert palpate.Dataset(run).objects == ["ball-0000", "ball-0002"]


def reject(run, stage, batch, name):
    """A stage's tables of all batches, of which one rejected an object."""
    path = run / f"rejected/{stage}/{batch}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    for other in ("batch-0000", "batch-0001"):
        if not (path.parent / f"{other}.csv").exists():
            (path.parent / f"{other}.csv").write_text("object,stage,reason\n")
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
    with pytest.raises(ValueError, match="no stage renders: expected some of released, meshes, surface, grasps"):
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
    (run / "rejected.csv").unlink()
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


def total(array, row):
    return float(np.sum(array[row], dtype=float))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_dataset_in_use_travels_to_other_processes(built, method):
    dataset = palpate.Dataset(built)
    points = dataset.array("touch", "points")
    expected = [total(points, row) for row in range(len(points))]  # the stores are open now
    with ProcessPoolExecutor(2, mp_context=get_context(method)) as pool:
        assert list(pool.map(total, [points] * len(points), range(len(points)))) == expected


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
        with atomic_write(table, checksum=True) as partial:
            write_rejections(partial, [Rejection("ball-0001", "touch", "no touch")])
    dataset = palpate.Dataset(run)
    assert len(dataset.rejections()) == 2
    table = tables["batch-0001"]
    content = table.read_text()
    for change in (lambda: table.write_text(content.replace("0001", "0002")), table.unlink):
        change()
        with pytest.raises(StoreError, match=f"{table} .*; remove it and .*: snakemake rejected/touch/batch-0001.csv"):
            palpate.Dataset(run)
    shutil.rmtree(run / "touch/batch-0001.zarr")  # not made yet
    assert len(palpate.Dataset(run).rejections()) == 1


def test_whether_an_object_has_the_one_size_of_all(run):
    """By the catalogue; one of an older version has no such column, and one size."""
    assert all(record.normalised for record in palpate.Dataset(run))
    rows = [row.split(",") for row in (run / "catalogue.csv").read_text().splitlines()]
    scales = ["scale", "diagonal", "keep", "0.001", *["diagonal"] * (len(rows) - 4)]
    (run / "catalogue.csv").write_text("".join(f"{','.join(row)},{s}\n" for row, s in zip(rows, scales, strict=True)))
    sizes = {record.name: record.normalised for record in palpate.Dataset(run, [])}
    assert sizes == {row[0]: scale == "diagonal" for row, scale in zip(rows[1:], scales[1:], strict=True)}
    assert palpate.Dataset(run)[0].scale == 0.001  # of its file's unit, in metres
