"""The authors' layout: a small tree written here by what their code expects, and a run there and back."""

import os
import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import palpate.store
from palpate.batch import UnusableObject, each_object
from palpate.camera import paper_camera
from palpate.catalogue import CatalogueError, Source, scan
from palpate.catalogue.sources import all_classes
from palpate.released import arrays as released
from palpate.released.layout import read_released
from palpate.touch import SENSOR_WIDTH
from tests.catalogue.whole import whole_catalogue
from tests.store.conftest import ATTRIBUTES

EMPTY = np.random.default_rng(9).integers(0, 256, (100, 100, 3), dtype=np.uint8)  # as they have it
SURFACE = "surfaces/0001/00012.npy"
QUARTER = SENSOR_WIDTH / 4


def rotation(angles):
    """About fixed x, then y, then z, written out."""
    (a, b, c), (d, e, f) = np.cos(angles), np.sin(angles)
    x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    return z @ y @ x


def grid(corner):
    """(100, 100, 2) y and z of their pixels, first axis y: at the pixels' corners, or in their middles."""
    line = (np.arange(100) / 100 - 0.5 + (0 if corner else 0.005)) * 0.01641
    return np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)


def scene(seed, corner=True):
    """A scene as theirs, and the depth (4, 100, 100) along each sensor's x by their pixels."""
    rng = np.random.default_rng(seed)
    position, angles = rng.uniform(-0.2, 0.2, (4, 3)) + [0, 0, 0.6], rng.uniform(-np.pi, np.pi, (4, 3))
    plane, success = grid(corner), np.array([True, True, False, True])
    depth = 0.02 + 40 * ((plane - rng.uniform(-0.005, 0.005, (4, 1, 1, 2))) ** 2).sum(axis=-1)
    felt = (depth < 0.0225) & success[:, None, None]
    points, gels = [], []
    for sensor in range(4):
        local = np.column_stack([depth[sensor][felt[sensor]], plane[felt[sensor]]])
        cloud = local @ rotation(angles[sensor]).T + position[sensor]
        points.append(rng.permutation(cloud).astype(np.float32))
        gels.append(np.where(felt[sensor][..., None], 255 - EMPTY // 2, EMPTY))
    return {
        "touch_success": success.tolist(),
        "cam_pos": position,
        "cam_rot": angles,
        "depth": [depth[sensor] for sensor in range(4)],
        "gel": gels,
        "points": points,
    }, np.where(felt, depth, np.inf)


def save(path, value):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, value)


def write_tree(root, corner=True):
    """Two classes; of the second's objects one has no surface and one no split."""
    rng = np.random.default_rng(0)
    for class_name, name in [("0001", "00012"), ("0001", "00013"), ("0002", "a.b"), ("0002", "x"), ("0002", "y")]:
        if name != "x":
            save(root / "surfaces" / class_name / f"{name}.npy", rng.uniform(-0.3, 0.3, (50, 3)))
        for grasp in range(2):
            save(root / "scene_info" / class_name / name / f"{grasp}.npy", scene(grasp, corner)[0])
        images = root / "images" / class_name / name
        images.mkdir(parents=True)
        for file in ("unoccluded", "0", "1"):
            pixels = rng.integers(0, 256, (40, 40, 3), dtype=np.uint8)
            Image.fromarray(pixels).save(images / f"{file}.png")
    save(root / "split.npy", {"train": ["000130001"], "valid": ["000120001"], "test": np.array(["a.b0002", "x0002"])})
    save(root / "empty_gel.npy", EMPTY)
    return root


@pytest.fixture
def tree(tmp_path):
    return write_tree(tmp_path / "data")


def test_what_is_whole_and_has_a_split_is_listed(tree, caplog):
    assert list(read_released(tree).items()) == [
        ("surfaces/0001/00012.npy", "validation"),
        ("surfaces/0001/00013.npy", "train"),
        ("surfaces/0002/a.b.npy", "test"),
    ]
    assert "2 objects without surface, scene info or split: 0002/x, 0002/y" in caplog.text


def test_the_catalogue_takes_their_splits(tree):
    source = Source("released", tree)
    assert all_classes(source) == {"0001": "all", "0002": "all"}
    table = whole_catalogue(source, {"0002": "all", "0001": 1}, batches=1)
    assert table["object"].tolist()[0] == "0002-a.b"
    assert table["source"].tolist()[0] == "surfaces/0002/a.b.npy"
    assert (
        dict(zip(table["object"], table["split"], strict=True)).items()
        <= {"0002-a.b": "test", "0001-00012": "validation", "0001-00013": "train"}.items()
    )
    assert table["batch"].tolist() == ["batch-0000", "batch-0001"]
    before = table["checksum"][0]
    save(tree / "scene_info/0002/a.b/1.npy", scene(7)[0])
    assert whole_catalogue(source, {"0002": "all"})["checksum"][0] != before
    with pytest.raises(CatalogueError, match="no object of class cup; there are 0001, 0002"):
        scan(source, {"cup": "all"})


def test_a_scan_of_several_classes_lists_a_dataset_once(tree, caplog):
    assert len(scan(Source("released", tree), {"0001": "all", "0002": "all"})) == 3
    assert len(caplog.records) == 1 and "2 objects without" in caplog.text


def test_a_surface_is_halved_and_lifted(tree):
    stored = np.load(tree / SURFACE)
    points = released.read_surface(tree / SURFACE, 50, np.random.default_rng(0))["points"]
    assert points.dtype == np.float32
    assert_allclose(points, stored / 2 + [0, 0, 0.6], atol=1e-7)
    fewer = released.read_surface(tree / SURFACE, 20, np.random.default_rng(0))["points"]
    places = [np.flatnonzero((points == point).all(axis=1))[0] for point in fewer]
    assert len(fewer) == 20 and (np.diff(places) > 0).all()
    with pytest.raises(UnusableObject, match=r"00012\.npy: 50 points: set surface.points"):
        released.read_surface(tree / SURFACE, 51, np.random.default_rng(0))


@pytest.mark.parametrize("corner", [True, False])
def test_touches_come_in_our_frame_and_order(tmp_path, corner):
    tree = write_tree(tmp_path, corner)
    felt = released.read_touch(tree / SURFACE, 2)
    stored = palpate.store.join("touch", {"a": felt}) | {"empty_reading": released.read_empty_reading(tree)}
    palpate.store.write(tmp_path / "touch/batch-0000.zarr", "touch", stored, ATTRIBUTES)  # the contract's
    for grasp in range(2):
        theirs, depth = scene(grasp, corner)
        assert felt["success"][grasp].tolist() == theirs["touch_success"]
        assert_array_equal(felt["position"][grasp], theirs["cam_pos"])
        for sensor in range(4):
            turn = rotation(theirs["cam_rot"][sensor])
            assert_allclose(felt["rotation"][grasp, sensor], turn, atol=1e-12)
            assert_allclose(felt["depth"][grasp, sensor], depth[sensor].T, atol=2e-7)
            count = felt["point_count"][grasp, sensor]
            assert count == np.isfinite(depth[sensor]).sum() == len(theirs["points"][sensor])
            assert not felt["points"][grasp, sensor, count:].any()
            if not theirs["touch_success"][sensor]:
                assert count == 0 and not felt["reading"][grasp, sensor].any()
                continue
            assert_array_equal(felt["reading"][grasp, sensor], theirs["gel"][sensor].transpose(1, 0, 2))
            cloud = felt["points"][grasp, sensor, :count]
            assert set(map(tuple, cloud)) == set(map(tuple, theirs["points"][sensor]))
            rows, columns = np.nonzero(np.isfinite(felt["depth"][grasp, sensor]))  # row-major
            plane = grid(corner)[columns, rows]
            expected = np.column_stack([felt["depth"][grasp, sensor][rows, columns], plane])
            assert_allclose((cloud - theirs["cam_pos"][sensor]) @ turn, expected, atol=3e-7)


def test_readings_that_are_turned_over_are_seen(tree):
    felt, empty = released.read_touch(tree / SURFACE, 2), released.read_empty_reading(tree)
    same, turned = released.orientation_agreement(felt, empty)
    assert same > 0.99 > turned
    exchanged = felt | {"reading": felt["reading"].swapaxes(2, 3)}
    assert released.orientation_agreement(exchanged, empty.swapaxes(0, 1))[1] > 0.99
    untouched = felt | {"success": np.zeros_like(felt["success"])}
    assert np.isnan(released.orientation_agreement(untouched, empty)).all()


def test_points_that_are_on_no_grid_are_kept(tree, caplog):
    theirs, _ = scene(0)
    rng = np.random.default_rng(3)
    local = np.column_stack([np.full(300, 0.02), rng.uniform(-0.012, 0.012, (300, 2))])
    theirs["points"][1] = local @ rotation(theirs["cam_rot"][1]).T + theirs["cam_pos"][1]
    save(tree / "scene_info/0001/00012/0.npy", theirs)
    felt = released.read_touch(tree / SURFACE, 1)
    assert "0.npy: the points of sensor 1 are not on a grid" in caplog.text
    assert felt["point_count"][0, 1] == 300
    finite = np.isfinite(felt["depth"][0, 1])
    assert 0 < finite.sum() < 300
    assert_allclose(felt["depth"][0, 1][finite], 0.02, atol=1e-7)


def test_images_are_resized_and_put_over_white(tree):
    images = released.read_vision(tree / SURFACE, 2, 40)
    assert set(images) == {"unoccluded", "occluded", "intrinsics", "extrinsics"}
    assert images["occluded"].shape == (2, 1, 40, 40, 3)
    assert_array_equal(images["intrinsics"][0] @ images["extrinsics"][0], paper_camera(40).matrix())
    assert_array_equal(images["occluded"][1, 0], np.asarray(Image.open(tree / "images/0001/00012/1.png")))
    assert released.read_vision(tree / SURFACE, 1, 32)["unoccluded"].shape == (1, 32, 32, 3)
    half = np.zeros((40, 40, 4), dtype=np.uint8)
    half[:20] = (10, 20, 30, 255)
    Image.fromarray(half).save(tree / "images/0001/00012/unoccluded.png")
    over = released.read_vision(tree / SURFACE, 1, 40)["unoccluded"][0]
    assert (over[:20] == [10, 20, 30]).all() and (over[20:] == 255).all()


class MakesAFolder:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def without(key):
    def damage(tree):
        theirs, _ = scene(0)
        del theirs[key]
        save(tree / "scene_info/0001/00012/0.npy", theirs)

    return damage


def with_value(key, value):
    def damage(tree):
        theirs, _ = scene(0)
        theirs[key] = value(theirs[key])
        save(tree / "scene_info/0001/00012/0.npy", theirs)

    return damage


def of_first(change):
    return lambda values: [change(values[0]), *values[1:]]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (without("gel"), r"0\.npy: no gel in it"),
        (with_value("cam_pos", lambda values: values[:3]), r"0\.npy: cam_pos: expected numbers of shape"),
        (with_value("cam_rot", lambda values: values * np.nan), r"0\.npy: cam_rot: not all finite"),
        (with_value("points", of_first(lambda cloud: cloud * np.inf)), r"points of sensor 0: not all finite"),
        (with_value("points", of_first(lambda cloud: cloud[:, :2])), r"points of sensor 0: expected"),
        (with_value("points", of_first(lambda cloud: np.zeros((10001, 3)))), "10001 points of sensor 0"),
        (with_value("points", lambda clouds: clouds[:3]), "points of 4 sensors"),
        (with_value("gel", of_first(lambda gel: gel + 300.0)), "gel of sensor 0: values from .*: expected 0"),
        (with_value("gel", of_first(lambda gel: None)), "gel of sensor 0: expected numbers"),
        (with_value("gel", of_first(lambda gel: "x")), "gel of sensor 0: expected numbers"),
        (lambda tree: (tree / "scene_info/0001/00012/1.npy").unlink(), r"1\.npy: no such file, but grasps"),
        (lambda tree: save(tree / "scene_info/0001/00012/0.npy", np.zeros(3)), "no touch_success, cam_pos"),
    ],
)
def test_a_scene_that_is_something_else_is_named(tree, damage, message):
    damage(tree)
    with pytest.raises(UnusableObject, match=message):
        released.read_touch(tree / SURFACE, 2)
    objects = [SURFACE, "surfaces/0001/00013.npy"]
    _, rejections = each_object(objects, lambda surface: released.read_touch(tree / surface, 2), "released")
    assert [rejection.object for rejection in rejections] == [SURFACE]


def test_nothing_in_a_dataset_is_run(tree):
    target = tree / "made"
    for path in ("scene_info/0001/00012/0.npy", "split.npy", SURFACE, "empty_gel.npy"):
        copy = shutil.copytree(tree, tree.with_name(path.replace("/", "-")))
        save(copy / path, {"touch_success": MakesAFolder(target), "train": [MakesAFolder(target)]})
        for read in (
            lambda: read_released(copy),  # noqa: B023
            lambda: released.read_touch(copy / SURFACE, 2),  # noqa: B023
            lambda: released.read_surface(copy / SURFACE, 50, None),  # noqa: B023
            lambda: released.read_empty_reading(copy),  # noqa: B023
        ):
            try:
                read()
            except UnusableObject as error:
                assert path.rpartition("/")[2] in str(error) and "posix.mkdir, which is refused" in str(error)
                break
        else:
            raise AssertionError(f"{path} was read")
        assert not target.exists()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda tree: shutil.rmtree(tree / "images"), "images: no such folder: set source.path"),
        (lambda tree: (tree / "split.npy").unlink(), r"split\.npy: no such file"),
        (lambda tree: save(tree / "split.npy", {"bottle": []}), r"split\.npy: expected a dictionary with train"),
        (lambda tree: save(tree / "split.npy", np.zeros(3)), r"split\.npy: expected a dictionary"),
        (lambda tree: save(tree / "split.npy", {"train": ["b"]}), "data: no object has surface, images, .* a split"),
        (lambda tree: save(tree / "split.npy", {"train": ["a"], "test": ["a"]}), "a is in train and in test"),
    ],
)
def test_a_dataset_that_is_something_else_is_named(tree, damage, message):
    damage(tree)
    with pytest.raises(CatalogueError, match=message):
        scan(Source("released", tree), {"0001": "all"})


def test_an_empty_reading_is_needed(tree):
    (tree / "empty_gel.npy").unlink()
    with pytest.raises(UnusableObject, match=r"empty_gel\.npy: no such file: copy it"):
        released.read_empty_reading(tree)
