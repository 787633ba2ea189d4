"""The study of chart fits: its true surface against closed forms, its error against known offsets."""

from functools import partial

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from palpate.charts import chamfer_distance, fit_direct, sample_faces, touch_chart
from palpate.protocol import CHAMFER_SCALE
from palpate.touch import SENSOR_RANGE, SENSOR_WIDTH, RayCaster, local_points
from studies.error_vs_runtime.touch_charts import TouchCharts, Touches, _adam, distances, fit_adam, visible_surface

ROTATION = Rotation.random(random_state=3).as_matrix()
POSITION = np.array([0.1, -0.2, 0.6])
RADIUS = 0.02


def slope(depth: float, tilt: float = 0.3, half: float = SENSOR_WIDTH) -> np.ndarray:
    """Two triangles (2, 3, 3), in the sensor's frame: a square at a depth, tilted along y."""
    corners = np.array([[depth + tilt * y, y, z] for y in (-half, half) for z in (-half, half)])
    return corners[[[0, 1, 2], [3, 2, 1]]]


def in_world(local: np.ndarray) -> np.ndarray:
    return local @ ROTATION.T + POSITION


def in_sensor(points: np.ndarray) -> np.ndarray:
    return (points - POSITION) @ ROTATION


def touched_ball() -> tuple[trimesh.Trimesh, np.ndarray]:
    """A ball in front of the sensor, and the triangles (f, 3, 3) of the half that is nearer to it."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    ball.vertices += in_world(np.array([0.01 + RADIUS, 0.003, 0.0]))
    return ball, ball.triangles[in_sensor(ball.triangles_center)[:, 0] < 0.011 + RADIUS]


@pytest.fixture(scope="module")
def touches() -> Touches:
    """Two touches of a ball, its depth by Embree."""
    ball, near = touched_ball()
    position, rotation = np.stack([POSITION, POSITION + 0.002]), np.stack([ROTATION] * 2)
    depth = RayCaster(ball).trace(position, rotation)
    clouds = [torch.from_numpy(local_points(*each)) for each in zip(depth, position, rotation, strict=True)]
    truth = [
        (points, cKDTree(points))
        for points in (visible_surface(near, *pose, 4) for pose in zip(position, rotation, strict=True))
    ]
    fields = (torch.from_numpy(array).float() for array in (depth, position, rotation))
    depth, position, rotation = fields
    return Touches(depth, torch.isfinite(depth), position, rotation, clouds, truth)


def test_the_true_surface_is_the_nearest_in_range():
    hidden, small = slope(0.02), slope(0.01, tilt=0.1, half=SENSOR_WIDTH / 4)
    behind, far = slope(-0.01), slope(SENSOR_RANGE + 0.02)
    triangles = in_world(np.concatenate([hidden, small, behind, far]))
    found = in_sensor(visible_surface(triangles, POSITION, ROTATION, 2))
    assert len(found) == 200**2
    front = (np.abs(found[:, 1:]) < SENSOR_WIDTH / 4).all(axis=1)
    expected = np.where(front, 0.01 + 0.1 * found[:, 1], 0.02 + 0.3 * found[:, 1])
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-12)


def test_the_true_surface_of_a_ball_and_the_depth_maps_pixels(touches):
    for points, cloud in zip((p for p, _ in touches.truth), touches.clouds, strict=True):
        centre = in_world(np.array([0.01 + RADIUS, 0.003, 0.0]))
        # The facets of 20,480 triangles lie at most 0.03 % of the radius inside the ball.
        np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), RADIUS, rtol=4e-4)
        far = cKDTree(points).query(cloud.numpy())[0]
        assert far.max() < 2e-4 and np.median(far) < 3e-5


def test_an_offset_is_the_error():
    truth = visible_surface(in_world(slope(0.015)), POSITION, ROTATION, 4)
    tree = cKDTree(truth)
    line = np.linspace(-SENSOR_WIDTH / 2, SENSOR_WIDTH / 2, 9)
    z, y = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    chart = np.stack([0.015 + 0.3 * y, y, z], axis=1)
    there, back = distances(in_world(chart), truth, tree)
    assert there.max() < 1e-12 and back.max() < 5e-5
    normal = np.array([1, -0.3, 0]) / np.hypot(1, 0.3)
    there, back = distances(in_world(chart + 1e-3 * normal), truth, tree)
    np.testing.assert_allclose(np.median(there), 1e-3, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt((back**2).mean()), 1e-3, rtol=2e-2)
    # A chart without area: its only place.
    there, back = distances(np.repeat(in_world(chart)[:1], 81, axis=0), truth, tree)
    assert there.max() == pytest.approx(np.hypot(1, 1) * SENSOR_WIDTH, rel=0.05) and back.max() < 5e-5


def test_errors_of_fits(touches):
    study = TouchCharts()
    methods = {str(method): method for method in study.methods()}

    def error(charts):
        return study.errors(touches, charts)["Chamfer distance, root mean square"]

    direct = error(methods["direct, rows over the contact"].run(touches))
    # Chords of a ball of 20 mm over 2 mm leave 25 micrometres; the rest is at the contact's edge.
    assert 0.005 < direct < 0.2
    assert error(methods["direct, rows to the nearest contact"].run(touches)) < 0.3
    options = {"samples": 300}
    early, late = (error(_adam(options | {"steps": steps}, touches)) for steps in (5, 20))
    assert direct < late < early


def test_the_reference_is_converged(touches):
    """Four times as many rays change the error by less than a hundredth of a millimetre."""
    charts = fit_direct(*touches[:4]).double().numpy()
    finer = visible_surface(touched_ball()[1], POSITION, ROTATION, 8)
    one, other = (
        [np.sqrt((d**2).mean()) for d in distances(charts[0], points, tree)]
        for points, tree in (touches.truth[0], (finer, cKDTree(finer)))
    )
    np.testing.assert_allclose(one, other, atol=1e-5)


def test_the_papers_fit_lowers_the_loss_and_stops_below_its_bound(touches):
    position, rotation = touches.position, touches.rotation
    fitted = partial(fit_adam, touches.clouds, position, rotation, samples=300)

    def loss(charts):
        points = sample_faces(charts, touch_chart().faces, 4000, torch.Generator().manual_seed(0))
        return chamfer_distance(points, touches.clouds) * CHAMFER_SCALE

    plane = fitted(steps=1)
    sheet = torch.cat([torch.zeros(81, 1), touch_chart().grid], dim=1)
    torch.testing.assert_close(plane, sheet @ rotation.mT + position[:, None])
    stop = 0.02 / CHAMFER_SCALE
    done = fitted(steps=60, stop=stop, generator=torch.Generator().manual_seed(0))
    assert (loss(plane) > 1).all() and (loss(done) < 0.03).all()
    # A lower bound makes it go on, and come closer.
    further = fitted(steps=60, stop=0.0, generator=torch.Generator().manual_seed(0))
    assert (loss(further) < loss(done)).all()
