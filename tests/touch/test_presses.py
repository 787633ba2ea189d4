"""Presses of a sensor onto an object, against closed forms, symmetry and the gel itself."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from palpate.batch import UnusableObject
from palpate.configuration import ConfigError
from palpate.sensor import load
from palpate.touch import RayCaster, face_sensor, press_object
from palpate.touch.gel import Layer, press

DIGIT, MINI = load("digit"), load("gelsight_mini")
RADIUS = 0.03
FORCES = (0.2, 1.0)


def ball() -> tuple[trimesh.Trimesh, np.ndarray]:
    """A ball whose facets are 3 um off it at most, and points on it."""
    mesh = trimesh.creation.icosphere(subdivisions=6, radius=RADIUS)
    return mesh, trimesh.sample.sample_surface(mesh, 500, seed=1)[0]


def pressed(mesh, points, sensor=DIGIT, seed=0, count=3, forces=FORCES, **settings):
    return press_object(mesh, points, sensor, np.random.default_rng(seed), count, forces, **settings)[0]


@pytest.fixture(scope="module")
def straight():
    return pressed(*ball())


def test_pressures_carry_the_force(straight):
    area = np.prod(DIGIT.pixel)
    assert (straight["pressure"] >= 0).all() and (straight["inside"] == 1).all()
    assert_allclose(straight["pressure"].sum(axis=(2, 3), dtype=float) * area, np.tile(FORCES, (3, 1)), rtol=1e-6)
    assert_array_equal(straight["force"], np.tile(FORCES, (3, 1)))
    assert_allclose(straight["strain"], straight["approach"] / DIGIT.material["thickness"])


def test_a_ball_is_touched_from_its_outside_at_one_point(straight):
    """Its normals lead from the centre; a gel that touches it is a radius and the gel's distance away."""
    axis = straight["rotation"][:, :, 0]
    assert_allclose(straight["normal"], straight["point"] / RADIUS, atol=0.02)
    assert_allclose(axis, -straight["normal"], atol=1e-12)
    assert_allclose(np.linalg.norm(straight["position"], axis=1), RADIUS + DIGIT.gel_face, atol=1e-5)
    assert_allclose(straight["depth"].min(axis=(1, 2)), DIGIT.gel_face, atol=1e-5)
    assert_allclose(np.linalg.det(straight["rotation"]), 1)


def test_what_a_symmetric_ball_does_is_symmetric():
    """One whose facet, which it is pressed at, is square to the axis: all images are their mirror images."""
    mesh = trimesh.creation.icosphere(subdivisions=7, radius=RADIUS)  # its facets are 0.4 mm wide
    arrays = pressed(mesh, mesh.triangles_center[[1000]], forces=(1.0,), count=1)
    dent, motion = arrays["indentation"][0, 0], arrays["displacement"][0, 0]
    assert dent.max() > 1e-4
    small = 0.03 * dent.max()
    for mirrored in (dent[::-1], dent[:, ::-1], dent.T):
        assert_allclose(dent, mirrored, atol=small)
    small = 0.03 * np.abs(motion).max()
    assert_allclose(motion[..., 0], -motion[:, ::-1, 0], atol=small)
    assert_allclose(motion[..., 1], -motion[::-1, :, 1], atol=small)
    assert_allclose(motion[..., 0], motion[..., 1].T, atol=small)


@pytest.mark.parametrize("sensor", [DIGIT, MINI], ids=["digit", "mini"])
def test_images_are_those_of_the_gel_pressed_directly(sensor):
    mesh, points = ball()
    arrays = pressed(mesh, points, sensor, count=1, forces=(1.0,), tilt=0.1)
    face = face_sensor(sensor)
    depth = RayCaster(mesh, sensor=face).trace(arrays["position"], arrays["rotation"])[0]
    direct = press(depth + face.face_sag, sensor.pixel, Layer(**sensor.material), 1.0)
    window = tuple(slice((m - n) // 2, (m + n) // 2) for m, n in zip(face.resolution, sensor.resolution, strict=True))
    assert_allclose(arrays["indentation"][0, 0], direct.indentation[window], atol=1e-8)
    assert_allclose(arrays["approach"][0, 0], direct.approach, rtol=1e-4)
    inside = direct.pressure[window].sum() / direct.pressure.sum()
    assert_allclose(arrays["inside"][0, 0], inside, atol=1e-6)
    assert_allclose(arrays["depth"][0], RayCaster(mesh, sensor=sensor).trace(*poses(arrays))[0], atol=1e-8)


def poses(arrays):
    return arrays["position"], arrays["rotation"]


def test_presses_depend_on_the_generator_only_and_fewer_are_the_first():
    mesh, points = ball()
    few, more = pressed(mesh, points, count=1, tilt=0.2), pressed(mesh, points, count=2, tilt=0.2)
    for name, array in few.items():
        assert_array_equal(array, more[name][:1], err_msg=name)
    assert not np.array_equal(pressed(mesh, points, seed=5, count=1)["point"], few["point"])


def test_tilts_are_spread_evenly_within_their_limit():
    """The cosine of a direction that is uniform on a cap is uniform."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=RADIUS)
    arrays = pressed(mesh, mesh.triangles_center, count=100, forces=(0.1,), tilt=0.3)
    cosine = -np.einsum("ti,ti->t", arrays["rotation"][:, :, 0], arrays["normal"])
    assert cosine.min() >= np.cos(0.3) and cosine.min() < np.cos(0.27)
    assert_allclose(cosine.mean(), (1 + np.cos(0.3)) / 2, atol=0.005)
    # The sensor's axis goes through its point.
    arm = arrays["point"] - arrays["position"]
    assert_allclose(np.cross(arm, arrays["rotation"][:, :, 0]), 0, atol=1e-12)


def test_a_mesh_that_is_inside_out_is_pressed_from_outside(straight):
    mesh, points = ball()
    mesh.invert()
    assert_allclose(pressed(mesh, points)["position"], straight["position"], atol=1e-12)


def test_a_slide_takes_the_gel_along_as_far_as_friction_goes():
    mesh, points = ball()
    one = {"count": 1, "forces": (1.0,)}
    still, loose, held = (
        pressed(mesh, points, **one, slide=length, friction=friction)
        for length, friction in ((0, 0.5), (2e-4, 0), (2e-4, 5.0))
    )
    assert "slide" not in still
    assert_allclose(np.linalg.norm(held["slide"]), 2e-4)
    assert_allclose(loose["displacement"], still["displacement"], atol=1e-12)
    moved = (held["displacement"] - still["displacement"])[0, 0]
    middle = np.unravel_index(held["pressure"][0, 0].argmax(), moved.shape[:2])
    assert_allclose(moved[middle], held["slide"][0], rtol=0.01)  # that much friction holds it there
    assert_array_equal(held["indentation"], still["indentation"])


def test_an_object_without_a_way_to_its_points_is_unusable():
    """Inner faces of two plates, 10 mm apart: no sensor fits between them. And a point under a roof."""
    plates = trimesh.util.concatenate(
        [trimesh.creation.box((0.2, 0.2, 0.004)).apply_translation((0, 0, height)) for height in (0.007, -0.007)]
    )
    inner = np.array([[0.01, 0.02, 0.005], [-0.03, 0, -0.005]])
    with pytest.raises(UnusableObject, match=r"0 of 2 presses found at 20 surface points \(no free way out .*: 20\)"):
        pressed(plates, inner, count=2)
    post = trimesh.creation.box((0.01, 0.01, 0.06)).apply_translation((0.006, 0, 0.03))
    floor = trimesh.creation.box((0.2, 0.2, 0.01)).apply_translation((0, 0, -0.005))
    with pytest.raises(UnusableObject, match=r"something else meets the gel first: 10"):
        pressed(trimesh.util.concatenate([post, floor]), np.array([[0.0, 0.0, 0.0]]), count=1)
    needle = trimesh.creation.cone(0.0005, 0.05)
    with pytest.raises(UnusableObject, match=r"through the gel: 10"):
        pressed(needle, np.array([[0.0, 0.0, 0.05]]), count=1, forces=(20.0,))
    with pytest.raises(ConfigError, match="can't be pressed"):
        pressed(*ball(), load("dome360"))
