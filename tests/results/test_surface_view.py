import numpy as np
import pytest
import trimesh

from palpate.results import surface_view
from palpate.results.surface_view import SITE_COLOURS, TOUCHED_WITHIN, SurfaceView

RADIUS, CAP = 0.2, 0.04  # m, of a ball, and of a round site on it
NOTHING = np.zeros((0, 3))
SHAPE = (180, 240)


def ball():
    return trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)


def cap(direction):
    """Points on the ball within CAP of the line in a direction, as dense as a sensor's."""
    rng = np.random.default_rng(0)
    radius, angle = CAP * np.sqrt(rng.uniform(size=40_000)), rng.uniform(0, 2 * np.pi, size=40_000)
    height = np.sqrt(RADIUS**2 - radius**2)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return trimesh.transform_points(points, trimesh.geometry.align_vectors([0, 0, 1], direction))


def test_rays_come_from_the_pixels_they_project_to():
    view = SurfaceView(trimesh.creation.box((0.1, 0.2, 0.3)), []).view(30, 20, SHAPE)
    origins, direction = view.rays(1, 1.0)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    np.testing.assert_allclose(view.project(origins + 0.7 * direction), pixels)


@pytest.mark.parametrize("azimuth, elevation", [(0, 0), (75, 40), (200, -35)])
def test_the_view_is_upright_and_from_its_direction(azimuth, elevation):
    view = SurfaceView(ball(), []).view(azimuth, elevation, SHAPE)
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view.axes) == pytest.approx(1)
    (_, low), (_, high) = view.project(np.array([[0, 0, 0], [0, 0, 0.1]]))
    assert high < low  # row 0 is at the top
    turn, tilt = np.radians([azimuth, elevation])
    towards = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    np.testing.assert_allclose(view.axes[2], -towards)


def test_a_balls_silhouette_is_a_disc_that_fills_the_picture():
    surface = SurfaceView(ball(), [NOTHING])
    view = surface.view(0, 0, SHAPE)
    picture = surface.draw(view)
    assert picture.image.shape == (*SHAPE, 4)
    assert picture.silhouette == pytest.approx(np.pi * RADIUS**2, rel=0.01)
    alpha = picture.image[..., 3]
    assert alpha.sum() * view.scale**2 == pytest.approx(np.pi * RADIUS**2, rel=0.01)
    shown = np.flatnonzero(alpha.any(axis=1))
    assert len(shown) == pytest.approx(SHAPE[0] * (1 - 2 * surface_view.MARGIN), abs=2)
    assert shown.mean() == pytest.approx((SHAPE[0] - 1) / 2, abs=1)


def test_a_sites_area_colour_and_middle():
    surface = SurfaceView(ball(), [NOTHING, cap([1, 0, 0]), NOTHING, NOTHING])
    picture = surface.draw(surface.view(0, 0, SHAPE))
    assert np.pi * CAP**2 * 0.98 < picture.area[1] < np.pi * (CAP + TOUCHED_WITHIN) ** 2 * 1.02
    assert (picture.area[[0, 2, 3]] == 0).all() and not picture.hidden.any()
    np.testing.assert_allclose(picture.centres[1], [SHAPE[1] / 2, SHAPE[0] / 2], atol=1)
    assert np.isnan(picture.centres[[0, 2, 3]]).all()
    middle = picture.image[SHAPE[0] // 2, SHAPE[1] // 2, :3]
    np.testing.assert_allclose(middle / middle.max(), np.array(SITE_COLOURS[1]) / max(SITE_COLOURS[1]), atol=1e-6)
    colourful = np.ptp(picture.image[..., :3], axis=-1) > 0.1
    assert colourful.mean() * picture.image[..., 0].size == pytest.approx(
        picture.area[1] / surface.view(0, 0, SHAPE).scale ** 2, rel=0.1
    )


def test_a_site_behind_the_object_is_hidden():
    surface = SurfaceView(ball(), [cap([-1, 0, 0])])
    picture = surface.draw(surface.view(0, 0, SHAPE))
    assert picture.area[0] == 0 and picture.hidden[0]
    assert np.isfinite(picture.centres[0]).all()


@pytest.mark.parametrize("direction", [(0, -1, 0.3), (-1, 0.2, -0.2)])
def test_the_best_view_looks_at_the_site(direction):
    surface = SurfaceView(ball(), [cap(direction)])
    view = surface.best_view(SHAPE)
    assert -view.axes[2] @ direction / np.linalg.norm(direction) > 0.85


def test_the_best_view_of_a_long_object_is_not_end_on():
    rod = trimesh.creation.box((0.5, 0.02, 0.02))
    view = SurfaceView(rod, [NOTHING]).best_view(SHAPE)
    assert abs(view.axes[2][0]) < 0.4


def test_faces_are_drawn_from_either_side():
    mesh, flipped = ball(), ball()
    flipped.invert()
    images = [SurfaceView(m, []).draw(SurfaceView(m, []).view(10, 20, SHAPE)).image for m in (mesh, flipped)]
    np.testing.assert_allclose(*images, atol=0.02)


def test_a_wall_takes_half_of_the_sky(monkeypatch):
    """Right beside a high wall, half of the cosine-weighted directions above the floor are blocked."""
    monkeypatch.setattr(surface_view, "AMBIENT", 1.0)
    floor = trimesh.creation.box((0.6, 0.6, 0.01))
    wall = trimesh.creation.box((0.01, 0.6, 0.4))
    wall.apply_translation((0.295, 0, 0.205))
    surface = SurfaceView(trimesh.util.concatenate([floor, wall]), [])
    view = surface.view(180, 60, SHAPE)
    light = surface.draw(view).image[..., 0] / surface_view.CLAY[0]

    def at(x):
        column, row = view.project(np.array([[x, 0, 0.005]]))[0].astype(int)
        return light[row - 1 : row + 2, column - 10 : column + 11].mean()

    assert at(-0.1) == pytest.approx(1, abs=0.01)
    assert at(0.287) == pytest.approx(0.5, abs=0.06)
