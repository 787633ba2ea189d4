import shutil
from dataclasses import replace
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
import trimesh
from matplotlib.colors import to_rgb
from PIL import Image

from palpate import Dataset, store, vision
from palpate.camera import paper_camera
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.results import dataset_figures as figures
from palpate.results.dataset_figures import camera_holding, clear_view, data_point, example_grasp, examples, grasp_steps
from palpate.scene import Scene
from palpate.vision import Renderer
from palpate.vision.image import vision_record
from tests.results.conftest import build_run

QUICK = {"samples": 1}


def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are drawn, instead of their files."""
    found = []
    monkeypatch.setattr(figures, "save", lambda figure, path: found.append(figure))
    return found


def shown(axes) -> np.ndarray:
    (image,) = axes.images
    return np.asarray(image.get_array())


def traced(meshes, hand, grasp) -> dict[str, np.ndarray]:
    """Images of an object over a transparent background: its silhouette and depths by trimesh's rays."""
    camera, count = paper_camera(128), len(grasp["palm_pose"])
    rays = camera.rays().reshape(-1, 3)
    start = np.broadcast_to(camera.position - OBJECT_POSITION, rays.shape)
    where, ray, _ = load_visual(meshes).ray.intersects_location(start, rays, multiple_hits=False)
    depth = np.full(len(rays), np.inf, np.float16)
    depth[ray] = camera.project(where + OBJECT_POSITION)[1]
    depth = depth.reshape(camera.size, camera.size)
    mask = np.where(np.isfinite(depth), 255, 0).astype(np.uint8)
    alone = vision.Image(np.dstack([mask // 2] * 3 + [mask]), mask, depth)
    return vision_record([(alone, [alone] * count)], [camera])


def test_a_data_point_shows_images_readings_and_touched_points_of_its_grasp(drawn, tmp_path):
    build_run(tmp_path / "run", ["bottle-0000"], vision=traced)
    path = tmp_path / "run/touch/batch-0000.zarr"
    arrays, attributes = store.read(path), store.open(path).attributes
    (points,) = store.read(tmp_path / "run/surface/batch-0000.zarr")["points"]
    downwards = points[np.argsort(-points[:, 2])]  # a quarter of the surface for each sensor, from the top down
    arrays["points"][0, :, :, :2500] = downwards.reshape(4, 2500, 3)
    arrays["point_count"][:] = 2500
    store.write(path, "touch", arrays, attributes)
    dataset = Dataset(tmp_path / "run")
    data_point(dataset, tmp_path / "a.png")
    grasp = example_grasp(dataset)
    alone, held, *readings, touched = drawn[0].axes
    np.testing.assert_array_equal(shown(alone), grasp.object.unoccluded)
    np.testing.assert_array_equal(shown(held), grasp.occluded)
    for sensor, panel in enumerate(readings):
        np.testing.assert_array_equal(shown(panel), grasp.reading[sensor])
        assert panel.get_title() == grasp.sensors[sensor]
        assert (panel.images[0].get_alpha() == 1) == panel.spines["left"].get_visible() == grasp.success[sensor]
    # The object in grey, as large as the panel, what is transparent stays so; on it a sensor's points in its colour.
    seen, mask = shown(touched), grasp.object.unoccluded_mask
    assert (seen[mask > 0] == (127, 127, 127, 255)).all() and not seen[mask == 0, 3].any()
    (low, high), (bottom, top), (row, column) = touched.get_xlim(), touched.get_ylim(), np.nonzero(mask)
    assert low < column.min() < column.max() < high and top < row.min() < row.max() < bottom
    assert (high - low) / max(np.ptp(row), np.ptp(column)) == pytest.approx(figures.MARGIN)
    assert len(touched.collections) == grasp.success.sum()
    mesh, camera, right = load_visual(grasp.object.mesh), grasp.object.vision_camera, []
    for sensor, sites in zip(np.flatnonzero(grasp.success), touched.collections, strict=True):
        cloud = grasp.points[sensor][:: figures.SITE_STRIDE]
        np.testing.assert_allclose(sites.get_offsets(), camera.project(cloud)[0] - 0.5)
        full = np.array(to_rgb(figures.SENSOR_COLOURS[sensor]))
        faint = (np.abs(sites.get_facecolor()[:, :3] - full) > 1e-6).any(axis=1)
        np.testing.assert_allclose(sites.get_facecolor()[faint, :3], [1 - figures.HIDDEN * (1 - full)] * faint.sum())
        away = camera.position - cloud
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        hidden = mesh.ray.intersects_any(cloud - OBJECT_POSITION + 0.01 * away, away)
        right.append(faint == hidden)
        assert 0 < faint.mean() < 1  # of a bottle half is behind
    assert np.concatenate(right).mean() > 0.95  # by trimesh's rays from the points; some graze


def test_sensors_have_the_names_of_the_runs_own_hand(run, drawn, tmp_path):
    names = ["left", "right", "high", "low"]
    copy = shutil.copytree(run, tmp_path / "run")
    path = copy / "grasps" / "batch-0000.h5"
    arrays, attributes = store.read(path), store.open(path).attributes
    store.write(path, "grasps", arrays | {"hand/sensor_names": np.array(names)}, attributes)
    examples(Dataset(copy), "bottle", tmp_path / "sheet.png")
    assert [axes.get_title() for axes in drawn[0].axes[2:6]] == names


def test_a_sheet_has_a_row_an_object_each_with_another_grasp(dataset, drawn, tmp_path):
    examples(dataset, "bottle", tmp_path / "two.png")
    panels = drawn[0].axes
    assert len(panels) == 2 * 7
    assert [panels[row * 7].get_ylabel() for row in range(2)] == ["bottle-0000, grasp 0", "bottle-0001, grasp 1"]
    np.testing.assert_array_equal(shown(panels[8]), dataset["bottle-0001"].grasps[1].occluded)


def test_a_figure_has_the_same_bytes_every_time_whatever_the_users_style(dataset, tmp_path):
    data_point(dataset, tmp_path / "a.png")
    with matplotlib.rc_context({"figure.facecolor": "black", "font.size": 30, "savefig.bbox": "tight"}):
        data_point(dataset, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert Image.open(tmp_path / "a.png").text == {}


@pytest.mark.parametrize("count, most", [(1, 6), (6, 6), (7, 6), (100, 6), (100, 1)])
def test_evenly(count, most):
    numbers = figures._evenly(count, most)
    assert len(set(numbers)) == len(numbers) == min(count, most)
    assert numbers[0] == 0 and (most == 1 or numbers[-1] == count - 1)
    assert np.ptp(np.diff(numbers)) <= 1 if len(numbers) > 1 else True


def test_the_example_has_most_touches(dataset):
    counts = [int(grasp.success.sum()) for record in dataset for grasp in record.grasps]
    assert example_grasp(dataset).success.sum() == max(counts)


@pytest.mark.parametrize("class_name", ["sock", "teapot"])
def test_a_class_without_objects_is_said_to_have_none(dataset, tmp_path, class_name):
    """All socks were rejected; teapots never were in the catalogue."""
    examples(dataset, class_name, tmp_path / "none.png")
    height, width, _ = pixels(tmp_path / "none.png").shape
    assert height < 100 and width > 300


def test_a_run_without_usable_objects_has_its_figures(run, tmp_path):
    shutil.copy(run / "catalogue.csv", tmp_path)
    names = [line.split(",")[0] for line in (run / "catalogue.csv").read_text().splitlines()[1:]]
    (tmp_path / "rejected.csv").write_text("object,stage,reason\n" + "".join(f"{n},meshes,x\n" for n in names))
    for draw in (data_point, grasp_steps):
        draw(Dataset(tmp_path), tmp_path / "a.png")
        picture = pixels(tmp_path / "a.png")
        assert picture.shape[0] < 100 and picture.min() < 100  # there is a sentence


def test_the_stored_hand_is_the_hand_that_was_stored(dataset):
    stored, made = dataset["knife-0000"].hand.to_arrays(), allegro().to_arrays()
    assert stored.keys() == made.keys()
    for name in made:
        np.testing.assert_array_equal(stored[name], made[name])


def test_a_sheet_takes_objects_from_all_over_the_class(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "EXAMPLES", 1)
    examples(dataset, "bottle", tmp_path / "one.png")
    monkeypatch.setattr(figures, "EXAMPLES", 6)
    examples(dataset.select(["bottle-0000"]), "bottle", tmp_path / "first.png")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "first.png").read_bytes()


def test_the_example_does_not_depend_on_batches_or_order_of_reading(dataset):
    first, second = example_grasp(dataset), example_grasp(Dataset(dataset["knife-0000"].mesh.parents[2]))
    assert (first.object.name, first.number) == (second.object.name, second.number)


def test_the_hand_comes_is_placed_and_closes(dataset, drawn, monkeypatch, tmp_path):
    monkeypatch.setattr(figures, "STEP_PIXELS", 60)
    grasp_steps(dataset, tmp_path / "a.png", **QUICK)
    pictures = [np.asarray(axes.images[0].get_array()).astype(int) for axes in drawn[0].axes]
    alone, *with_hand = [(picture.max(axis=-1) < 60).sum() for picture in pictures]  # the hand is black
    assert len(with_hand) == 3 and min(with_hand) > alone + 20
    _, loaded, placed, closed = pictures
    assert all((one != other).any() for one, other in ((loaded, placed), (placed, closed)))


def test_the_closing_shows_frames_evenly_and_rests_at_the_last(dataset, monkeypatch, tmp_path):
    monkeypatch.setattr(figures, "PIXELS", 60)
    monkeypatch.setattr(figures, "FRAMES", 2)
    grasp = example_grasp(dataset)
    opened = grasp.object.hand.forward(grasp.palm_pose, grasp.object.hand.open_joint_positions)
    success = np.array([np.zeros_like(grasp.success)] * 2 + [grasp.success])
    frames = SimpleNamespace(link_pose=np.array([opened] * 2 + [grasp.link_pose]), time=[0.0, 0.7, 1.5])
    frames.reading, frames.success, frames.has_touch = np.array([grasp.reading] * 3), success, True
    framed = SimpleNamespace(object=grasp.object, sensors=grasp.sensors, frames=frames)
    monkeypatch.setattr(figures, "example_grasp", lambda dataset: framed)
    figures.closing(dataset, tmp_path / "a.gif", **QUICK)
    with Image.open(tmp_path / "a.gif") as animation:
        assert animation.n_frames == 2 and animation.info["duration"] == figures.PAUSE
        first = np.asarray(animation.convert("RGB"))
        animation.seek(1)
        assert animation.info["duration"] == figures.REST
        assert (np.asarray(animation.convert("RGB")) != first).any()


def test_poses_are_rendered_in_one_session_and_each_as_if_it_were_alone(dataset, monkeypatch):
    """The object's file is read once; of each pose the same bytes come from a new Blender scene of its own."""
    scenes, files, read = [], [], Renderer.read_file
    monkeypatch.setattr(Renderer, "read_file", lambda self, path: (files.append(path), read(self, path)))
    monkeypatch.setattr(figures, "Scene", lambda *given, **others: scenes.append(Scene(*given, **others)) or scenes[-1])
    grasp = example_grasp(dataset)
    opened = grasp.object.hand.forward(grasp.palm_pose, grasp.object.hand.open_joint_positions)
    poses = np.array([opened, grasp.link_pose, opened])
    alone, *held = figures.rendered(grasp, poses, 60, samples=2, threads=1)
    assert len(files) == 1 and len(held) == 3
    for pose, picture in zip(poses, held, strict=True):
        bare, (image,) = Renderer(samples=2).render(replace(scenes[0], link_pose=pose[None]))
        np.testing.assert_array_equal(image.rgb, picture)
        np.testing.assert_array_equal(bare.rgb, alone)


def test_drawn_points_are_on_the_hand(dataset):
    hand, grasp = allegro(), example_grasp(dataset)
    points = figures.hand_points(hand, grasp.link_pose)
    assert hand.signed_distance(points, grasp.link_pose).max() < 1e-9


def towards(azimuth, elevation):
    turn, tilt = np.radians([azimuth, elevation])
    return np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])


def test_the_camera_holds_everything_and_no_more():
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = OBJECT_POSITION + rng.normal(size=(50, 3)) * rng.uniform(0.05, 0.2, size=3)
        camera = camera_holding(points, towards(rng.uniform(0, 360), rng.uniform(-60, 60)), 240)
        seen, depth = camera.project(points)
        assert (depth > 0).all() and seen.min() > 0 and seen.max() < camera.size
        assert np.abs(seen / camera.size - 0.5).max() == pytest.approx(0.5 / figures.HOLDING)


@pytest.mark.parametrize("azimuth", [0, 90, 210])
def test_points_on_a_ball_are_looked_at_from_their_side(monkeypatch, azimuth):
    monkeypatch.setattr(figures, "load_geometry", lambda mesh: trimesh.creation.icosphere(4, 0.2))
    rng = np.random.default_rng(0)
    cap = towards(azimuth, 0) + 0.2 * rng.normal(size=(200, 3))
    cap = OBJECT_POSITION + 0.2 * cap / np.linalg.norm(cap, axis=1, keepdims=True)
    view = clear_view(SimpleNamespace(mesh=None), cap)
    np.testing.assert_allclose(view, towards(azimuth, figures.ELEVATION), atol=1e-12)
    assert np.linalg.norm(clear_view(SimpleNamespace(mesh=None), np.zeros((0, 3)))) == pytest.approx(1)


def test_the_object_hides_the_hand_least_from_the_clear_view(dataset):
    """By trimesh's rays, of all directions that are looked at."""
    grasp = example_grasp(dataset)
    mesh = load_visual(grasp.object.mesh)
    points = figures.hand_points(allegro(), grasp.link_pose)[::25]

    def hidden(direction):
        start = points - OBJECT_POSITION + figures.LIFT * direction
        return mesh.ray.intersects_any(start, np.tile(direction, (len(points), 1))).mean()

    every = [hidden(towards(azimuth, figures.ELEVATION)) for azimuth in figures.AZIMUTHS]
    assert hidden(clear_view(grasp.object, points)) <= min(every) + 0.01
