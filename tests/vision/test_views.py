import json

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from palpate.batch import UnusableObject, generator
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.vision import Renderer, looking_at, views
from tests.vision.scenes import painted, scene_of


def blocks():
    """An object without symmetry, of the dataset's size: three boxes."""
    parts = [
        trimesh.creation.box(extents).apply_translation(centre)
        for extents, centre in [
            ((0.3, 0.1, 0.1), (0, 0, 0)),
            ((0.06, 0.06, 0.16), (0.12, 0, 0.13)),
            ((0.05, 0.14, 0.05), (-0.1, 0.1, 0)),
        ]
    ]
    mesh = trimesh.util.concatenate(parts)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return mesh.apply_scale(DIAGONAL / np.linalg.norm(mesh.extents))


def silhouette(mesh, matrix, size):
    """(size, size) whether the ray through each pixel's centre meets the mesh, by a (3, 4) matrix."""
    position = -np.linalg.solve(matrix[:, :3], matrix[:, 3])
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    pixels = np.stack([column, row, np.ones_like(row)], axis=-1).reshape(-1, 3)
    rays = np.linalg.solve(matrix[:, :3], pixels.T).T
    return mesh.ray.intersects_any(np.broadcast_to(position, rays.shape), rays).reshape(size, size)


def test_masks_are_what_rays_by_the_stored_cameras_meet(write_glb):
    mesh = blocks()
    path = write_glb("blocks", painted(mesh.copy(), (0.5, 0.2, 0.1)))
    at = views.viewpoints(generator(0, "blocks", "views"), 4)
    made = views.render(Renderer(samples=1, device="cpu"), scene_of(path), at, 137)
    assert made.image.shape == (4, 137, 137, 3) and made.image.dtype == np.uint8
    assert made.camera.shape == (4, 3, 4) and made.camera.dtype == np.float64
    there = mesh.copy().apply_translation(OBJECT_POSITION)
    for image, mask, matrix in zip(*made, strict=True):
        seen = silhouette(there, matrix, 137)
        assert seen.sum() > 500
        assert ((mask > 0) != seen).sum() <= 4  # rays that graze an edge
        assert set(np.unique(mask)) == {0, 255}
        shifts = [(down - 2, over - 2) for down, over in np.ndindex(5, 5)]
        beside = ~np.any([np.roll(seen, shift, (0, 1)) for shift in shifts], axis=0)
        assert (image[beside] == 255).all()


def test_views_of_a_small_object_are_those_of_a_large_one(write_glb):
    """An object that keeps its size is looked at from a distance in proportion to it."""
    at = views.viewpoints(generator(0, "blocks", "views"), 3)
    renderer = Renderer(samples=1, device="cpu")
    large = views.render(renderer, scene_of(write_glb("large", painted(blocks(), (0.5, 0.2, 0.1)))), at, 64)
    path = write_glb("small", painted(blocks().apply_scale(0.1), (0.5, 0.2, 0.1)))
    (path.parent / "mesh.json").write_text(json.dumps({"diagonal": 0.1 * DIAGONAL}))
    small = views.render(renderer, scene_of(path), at, 64)
    assert ((small.mask > 0) != (large.mask > 0)).sum() <= 4 and (large.mask > 0).sum() > 500
    there = [
        -np.linalg.solve(matrix[:, :3], matrix[:, 3]) - OBJECT_POSITION for matrix in (*small.camera, *large.camera)
    ]
    assert_allclose(there[:3], 0.1 * np.array(there[3:]))


def test_no_view_looks_at_the_dark_side(write_glb):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=DIAGONAL / np.sqrt(12))
    path = write_glb("ball", painted(ball, (0.8, 0.8, 0.8)))
    at = [(azimuth, 27.0, 0.8) for azimuth in (0, 90, 180, 270)]
    renderer = Renderer(samples=4, device="cpu")
    made = views.render(renderer, scene_of(path), at, 64)
    brightness = [image[mask > 0].mean() for image, mask in zip(made.image, made.mask, strict=True)]
    assert np.ptp(brightness) < 3
    before = renderer.render(scene_of(path))[0].rgb
    assert_array_equal(Renderer(samples=4, device="cpu").render(scene_of(path))[0].rgb, before)


def test_the_first_views_do_not_depend_on_their_number_nor_on_what_came_before(write_glb):
    path = write_glb("blocks", painted(blocks(), (0.5, 0.2, 0.1)))
    other = write_glb("box", painted(trimesh.creation.box((0.1, 0.2, 0.3)), (0.1, 0.9, 0.1)))
    at = views.viewpoints(generator(3, "blocks", "views"), 5)
    assert_array_equal(at[:2], views.viewpoints(generator(3, "blocks", "views"), 2))
    renderer = Renderer(samples=2, device="cpu")
    whole = views.render(renderer, scene_of(path), at, 60)
    views.render(renderer, scene_of(other), at, 60)
    again = views.render(renderer, scene_of(path), at[1:2], 60)
    for one, two in zip(whole, again, strict=True):
        assert_array_equal(one[1], two[0])


def test_viewpoints_are_drawn_from_the_published_ranges():
    drawn = views.viewpoints(np.random.default_rng(0), 4000)
    for column, (low, high) in zip((0, 1, 2), ((0, 360), (25, 30), (0.65, 0.95)), strict=True):
        assert low <= drawn[:, column].min() < drawn[:, column].max() < high
        assert_allclose(drawn[:, column].mean(), (low + high) / 2, rtol=0.02)


@pytest.mark.parametrize("azimuth", [0.0, 40.0, 170.0, 359.0])
def test_the_camera_stands_where_the_formula_says_and_looks_at_the_object(azimuth):
    viewpoint = (azimuth, 27.0, 0.8)
    a, e = np.radians([azimuth, 27.0])
    towards = np.array([np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])
    position = OBJECT_POSITION + 0.5 * 1.75 * 0.8 * towards
    # 2.1875 is the first entry of Blender's projection matrix, that of a lens of 35 mm on 32 mm.
    expected = looking_at(OBJECT_POSITION, position, 137, 2 * np.degrees(np.arctan(1 / 2.1875)))
    assert_allclose(views.camera(viewpoint).matrix(), expected.matrix(), atol=1e-9)
    centre, depth = views.camera(viewpoint).project(np.array(OBJECT_POSITION))
    assert_allclose(centre, [68.5, 68.5], atol=1e-9)
    assert_allclose(depth, 0.7)


def test_an_object_that_no_view_shows_is_unusable(write_glb):
    glass = painted(blocks(), (1, 1, 1))
    glass.visual.material.alphaMode = "BLEND"
    glass.visual.material.baseColorFactor = [255, 255, 255, 0]
    scene = scene_of(write_glb("glass", glass))
    with pytest.raises(UnusableObject, match="no view shows"):
        views.render(Renderer(samples=1, device="cpu"), scene, [(0, 25, 0.7)], 40)
