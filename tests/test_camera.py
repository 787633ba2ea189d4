import numpy as np
import pytest

from palpate.camera import Camera, matrices
from palpate.vision import looking_at, paper_camera

OBJECT = np.array([0.0, 0.0, 0.6])


def test_paper_camera_sees_the_object_in_the_middle_of_its_image():
    camera = paper_camera()
    corners = OBJECT + 0.25 / np.sqrt(3) * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, 8).T
    pixels, depth = camera.project(corners)
    assert ((pixels > 20) & (pixels < 236)).all()
    assert ((depth > 0.8) & (depth < 1.5)).all()
    centre, depth = camera.project(OBJECT)
    assert np.abs(centre - 128).max() < 15
    assert depth == pytest.approx(np.linalg.norm(camera.position - OBJECT), rel=0.01)


def test_field_of_view_is_that_of_the_published_focal_length():
    for size in (64, 256, 500):
        camera = paper_camera(size)
        assert np.degrees(2 * np.arctan(size / 2 / camera.focal_length)) == pytest.approx(34.95, abs=0.005)


def test_rotation_is_blenders_euler_xyz():
    from mathutils import Euler

    euler = Euler(np.radians([70.458, 4.940, 113.540]), "XYZ")
    assert np.allclose(paper_camera().rotation, np.array(euler.to_matrix()), atol=1e-6)


@pytest.mark.parametrize("size", [16, 256, 599])
def test_points_anywhere_are_projected_as_by_the_matrix_and_those_behind_have_no_pixel(size):
    camera, random = paper_camera(size), np.random.default_rng(0)
    points = random.uniform(-50, 50, (10_000, 3))
    pixels, depth = camera.project(points)
    ahead = (camera.position - points) @ camera.rotation[:, 2]
    assert not np.isfinite(pixels[ahead <= 0]).any() and np.isfinite(pixels[ahead > 0]).all()
    assert np.abs(depth - ahead).max() <= 1e-10
    homogeneous, far = np.column_stack([points, np.ones(len(points))]) @ camera.extrinsics().T, ahead > 0.01
    homogeneous = homogeneous @ camera.intrinsics().T
    assert np.abs(homogeneous[far, :2] / homogeneous[far, 2:] - pixels[far]).max() <= 1e-6
    assert np.allclose(camera.matrix(), camera.intrinsics() @ camera.extrinsics())
    assert np.isnan(camera.project(camera.position)[0]).all()


def test_a_normalised_object_of_any_shape_is_within_the_image():
    """It is in the ball around the middle of its box."""
    directions = np.random.default_rng(0).normal(size=(10_000, 3))
    pixels, _ = paper_camera().project(OBJECT + 0.25 * directions / np.linalg.norm(directions, axis=1, keepdims=True))
    assert pixels.min() >= 0 and pixels.max() <= paper_camera().size


def test_rays_go_through_pixel_centres():
    camera = paper_camera(32)
    depth = np.random.default_rng(0).uniform(0.5, 2, (32, 32))
    pixels, seen = camera.project(camera.position + depth[..., None] * camera.rays())
    row, column = np.mgrid[:32, :32]
    assert np.allclose(pixels, np.stack([column, row], axis=-1) + 0.5)
    assert np.allclose(seen, depth)


def test_a_camera_comes_back_from_its_matrices():
    for camera in (paper_camera(100), looking_at((0.1, 0.2, 0.3), (1.0, -1.0, 0.8), 64, 70)):
        stored = matrices([camera])
        back = Camera.from_matrices(stored["intrinsics"][0], stored["extrinsics"][0], camera.size)
        np.testing.assert_allclose(back.position, camera.position, atol=1e-12)
        np.testing.assert_allclose(back.rotation, camera.rotation, atol=1e-12)
        np.testing.assert_allclose(back.matrix(), camera.matrix(), atol=1e-9)
        np.testing.assert_allclose(np.linalg.inv(back.pose())[:3] * [[1], [-1], [-1]], camera.extrinsics(), atol=1e-9)


@pytest.mark.parametrize("place, value", [((0, 0), 99.0), ((1, 1), 99.0), ((0, 2), 51.0), ((0, 1), 1.0), ((2, 2), 2.0)])
def test_matrices_that_are_not_of_such_a_camera_are_refused(place, value):
    intrinsics = paper_camera(100).intrinsics()
    intrinsics[place] = value
    with pytest.raises(ValueError, match="expected square pixels and the principal point at the image's centre"):
        Camera.from_matrices(intrinsics, paper_camera(100).extrinsics(), 100)
    with pytest.raises(ValueError, match="of an image of 101 pixels"):
        Camera.from_matrices(paper_camera(100).intrinsics(), paper_camera(100).extrinsics(), 101)


def test_looking_at_puts_the_target_in_the_middle_and_up_upwards():
    camera = looking_at((0.1, 0.2, 0.3), (1.0, -1.0, 0.8), size=100)
    pixels, _ = camera.project(np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.35]]))
    assert np.allclose(pixels[0], 50)
    assert pixels[1, 0] == pytest.approx(50) and pixels[1, 1] < 50
    assert np.linalg.det(camera.rotation) == pytest.approx(1)
    with pytest.raises(ValueError, match="choose another `up`"):
        looking_at((0, 0, 0), (0, 0, 1))
