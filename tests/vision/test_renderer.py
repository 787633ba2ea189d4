from dataclasses import replace

import bpy
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal
from PIL import Image as PillowImage
from scipy.ndimage import binary_erosion

from palpate.batch import UnusableObject
from palpate.mesh import OBJECT_POSITION
from palpate.scene import LIGHTS, Scene
from palpate.vision import Mesh, Renderer, looking_at, paper_camera, spheres
from palpate.vision.image import read_layers
from tests.vision.scenes import ball, grasp_poses, painted, scene_of

# Half a step of float16 between 1 and 2: what a stored depth is off by.
HALF_STEP = 2.0**-11
MARKERS = np.array([[0.0, 0, 0.2], [0.1, 0.02, -0.15], [-0.05, 0.17, 0.1], [0.03, -0.19, 0.03], [0.12, 0.1, 0]])


def centroid(weights, around, reach=8):
    """(x, y) of the weights' centroid within `reach` pixels of a point, in pixel coordinates."""
    row, column = np.mgrid[: weights.shape[0], : weights.shape[1]] + 0.5
    near = weights * (np.abs(column - around[0]) < reach) * (np.abs(row - around[1]) < reach)
    return np.array([(near * column).sum(), (near * row).sum()]) / near.sum()


def assert_markers_at(image, pixels):
    darkness = 255.0 - image.rgb.min(axis=-1)
    for pixel in pixels:
        assert np.abs(centroid(image.mask / 255, pixel) - pixel).max() < 0.25
        assert np.abs(centroid(darkness, pixel) - pixel).max() < 0.15


def test_known_points_of_an_object_land_on_their_pixels(write_glb):
    path = write_glb("markers", *(painted(ball(marker, 0.008), (0.02, 0.02, 0.02)) for marker in MARKERS))
    image, _ = Renderer(samples=32, device="cpu").render(scene_of(path))
    pixels, _ = paper_camera().project(MARKERS + OBJECT_POSITION)
    assert_markers_at(image, pixels)


def test_an_object_stands_where_its_scene_puts_it_and_its_camera_looks(write_glb):
    path = write_glb("markers", *(painted(ball(marker, 0.008), (0.02, 0.02, 0.02)) for marker in MARKERS))
    position = np.array([0.1, -0.2, 0.9])
    camera = looking_at(position, position + (-0.5, 0.9, 0.6), 333)
    image, _ = Renderer(samples=32, device="cpu").render(Scene(path.parent, object_position=position, camera=camera))
    assert image.rgb.shape == (333, 333, 3)
    assert_markers_at(image, camera.project(MARKERS + position)[0])


def test_the_lights_of_a_scene_shine_on_it_and_on_no_other(write_glb):
    path = write_glb("ball", painted(ball((0, 0, 0), 0.2), (0.8, 0.8, 0.8)))
    renderer, plain = Renderer(samples=4, device="cpu"), scene_of(path, size=64)
    expected, _ = renderer.render(plain)
    dark = replace(plain, lights=())
    below = replace(plain, lights=(replace(LIGHTS[0], position=(0.6, -0.55, -0.7)), LIGHTS[1]))
    shown = binary_erosion(expected.mask > 0, iterations=2)  # no pixel mixed with the background
    assert renderer.render(dark)[0].rgb[shown].max() < 3
    upper, lower = (renderer.render(scene)[0].rgb[shown].astype(int) for scene in (plain, below))
    rows = np.nonzero(shown)[0]
    top = rows < np.median(rows)
    assert upper[top].mean() > upper[~top].mean() + 20 and lower[~top].mean() > lower[top].mean() + 20
    assert_array_equal(renderer.render(plain)[0].rgb, expected.rgb)


@pytest.mark.parametrize("size", [200, 333])
def test_known_points_of_meshes_land_on_their_pixels_at_other_sizes_and_views(size):
    points = MARKERS + OBJECT_POSITION
    camera = looking_at(OBJECT_POSITION, (-0.4, 0.9, 1.1), size)
    image = Renderer(samples=32, device="cpu").render_meshes([spheres(points, 0.008, (0.1, 0.1, 0.1))], camera=camera)
    assert image.rgb.shape == (size, size, 3)
    assert_markers_at(image, camera.project(points)[0])


def test_projection_is_that_of_blenders_camera():
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    points = MARKERS + OBJECT_POSITION
    Renderer(samples=1, device="cpu").render_meshes([spheres(points, 0.01)])
    scene = bpy.context.scene
    there = np.array([world_to_camera_view(scene, scene.camera, Vector(point)) for point in points])
    pixels, depth = paper_camera().project(points)
    assert np.abs(pixels - np.column_stack([there[:, 0], 1 - there[:, 1]]) * 256).max() < 1e-3
    assert np.allclose(depth, there[:, 2], atol=1e-6)


def test_nodes_of_a_file_keep_their_places(write_glb, tmp_path):
    scene = trimesh.Scene()
    for marker in MARKERS:
        turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
        turn[:3, 3] = marker
        scene.add_geometry(painted(ball((0, 0, 0), 0.008), (0.02, 0.02, 0.02)), transform=turn)
    path = tmp_path / "visual.glb"
    path.write_bytes(scene.export(file_type="glb"))
    image, _ = Renderer(samples=32, device="cpu").render(scene_of(path))
    assert_markers_at(image, paper_camera().project(MARKERS + OBJECT_POSITION)[0])


def test_depth_of_a_plane_is_the_closed_form():
    camera = paper_camera(128)
    normal = np.array([0.8, 0.3, 0.5])
    across = np.cross(normal, [0, 0, 1])
    sides = 0.6 * np.stack([across, np.cross(normal, across)])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ sides + OBJECT_POSITION
    image = Renderer(samples=1, device="cpu").render_meshes(
        [Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))], camera=camera
    )
    rays = camera.rays()
    expected = (np.array(OBJECT_POSITION) - camera.position) @ normal / (rays @ normal)
    shown = image.mask > 0
    assert shown.mean() > 0.3
    assert np.abs(image.depth - expected)[shown].max() < HALF_STEP + 1e-4
    assert np.isposinf(image.depth[~shown]).all()


def test_depth_and_mask_of_a_sphere_are_the_closed_form():
    camera, radius = paper_camera(128), 0.2
    mesh = ball(OBJECT_POSITION, radius, subdivisions=5)
    image = Renderer(samples=1, device="cpu").render_meshes([Mesh(mesh.vertices, mesh.faces)], camera=camera)
    rays = camera.rays()
    out = camera.position - OBJECT_POSITION
    a, b, c = (rays**2).sum(-1), rays @ out, out @ out - radius**2
    discriminant = b**2 - a * c
    hit = discriminant > 0
    assert (hit != (image.mask > 0)).mean() < 0.002
    well_inside = discriminant > 0.02 * discriminant.max()
    expected = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
    assert np.abs(image.depth - expected)[well_inside].max() < HALF_STEP + 5e-4


def test_mask_and_depth_are_those_of_rays_through_pixel_centres(write_glb):
    mesh = trimesh.creation.torus(0.15, 0.05)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.9, [1, 0.3, 0]))
    size = 160
    image, _ = Renderer(samples=1, device="cpu").render(scene_of(write_glb("torus", mesh), size=size))
    camera = paper_camera(size)
    rays = camera.rays().reshape(-1, 3)
    mesh.apply_translation(OBJECT_POSITION)
    where, ray, _ = mesh.ray.intersects_location(np.tile(camera.position, (len(rays), 1)), rays, multiple_hits=False)
    depth = np.full(len(rays), np.inf)
    depth[ray] = camera.project(where)[1]
    hit = np.isfinite(depth).reshape(size, size)
    assert hit.sum() > 1000
    assert (hit != (image.mask > 0)).sum() <= 4  # rays that graze the silhouette
    both = hit & (image.mask > 0)
    close = np.abs(image.depth[both] - depth.reshape(size, size)[both]) < HALF_STEP + 1e-4
    assert close.mean() > 0.998  # grazing rays again


def test_materials_and_texture_appear_and_row_0_is_at_the_top(write_glb):
    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[:, 0], pixels[:, 1] = (200, 30, 30), (30, 30, 200)
    texture = trimesh.visual.material.PBRMaterial(
        baseColorTexture=PillowImage.fromarray(pixels), metallicFactor=0.0, roughnessFactor=1.0
    )
    # Upper half: a square that faces the camera's side (+x), red where y < 0 and blue where y > 0.
    square = trimesh.Trimesh(
        [[0, -0.1, 0.05], [0, 0.1, 0.05], [0, 0.1, 0.2], [0, -0.1, 0.2]], [[0, 1, 2], [0, 2, 3]], process=False
    )
    square.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=texture)
    below = painted(ball((0, 0, -0.12), 0.06), (0.05, 0.6, 0.05))
    image, _ = Renderer(samples=8, device="cpu").render(scene_of(write_glb("flag", square, below)))
    points = np.array([[0, -0.08, 0.12], [0, 0.08, 0.12], [0.05, 0, -0.1]]) + OBJECT_POSITION
    column, row = np.floor(paper_camera().project(points)[0]).astype(int).T
    assert_array_equal(image.rgb[row, column].argmax(axis=-1), [0, 2, 1])
    assert (image.rgb[row, column].max(axis=-1) > image.rgb[row, column].min(axis=-1) + 60).all()
    green = (image.mask > 0) & (image.rgb.argmax(axis=-1) == 1)
    red = (image.mask > 0) & (image.rgb.argmax(axis=-1) == 0)
    assert np.nonzero(green)[0].min() > np.nonzero(red)[0].max()


@pytest.mark.parametrize(("opacity", "seen"), [(0.2, True), (0.0, False)])
def test_transparent_parts_count_and_invisible_ones_do_not(write_glb, opacity, seen):
    glass = painted(ball((0, 0, 0.1), 0.05), (0.1, 0.1, 0.1))
    glass.visual.material.alphaMode = "BLEND"
    glass.visual.material.baseColorFactor = [0.1, 0.1, 0.1, opacity]
    opaque = painted(ball((0, 0, -0.1), 0.05), (0.1, 0.1, 0.1))
    image, _ = Renderer(samples=4, device="cpu").render(scene_of(write_glb("glass", glass, opaque), size=64))
    points = np.array([[0, 0, 0.1], [0, 0, -0.1]]) + OBJECT_POSITION
    column, row = np.floor(paper_camera(64).project(points)[0]).astype(int).T
    assert_array_equal(image.mask[row, column] > 0, [seen, True])
    assert_array_equal(np.isfinite(image.depth[row, column]), [seen, True])
    assert (image.rgb[row[0], column[0]] > image.rgb[row[1], column[1]] + 60).all()


def test_white_paint_under_the_lamp_is_bright_and_not_clipped(write_glb):
    path = write_glb("ball", painted(ball((0, 0, 0), 0.2), (0.8, 0.8, 0.8)))
    image, _ = Renderer(samples=32, device="cpu").render(scene_of(path, size=96))
    inside = image.rgb[image.mask > 0].astype(int)
    assert 235 < np.percentile(inside, 99) < 252
    assert (image.rgb[~(image.mask > 0) & np.isinf(image.depth)] >= 250).mean() > 0.9
    # In the lamp's shadow the ambient light is left.
    assert 120 < np.percentile(inside, 1) < 190


def test_the_hand_hides_what_is_behind_it_and_nothing_else(write_glb, hand):
    poses = grasp_poses(hand)
    path = write_glb("box", trimesh.creation.box((0.06, 0.2, 0.4)))
    renderer = Renderer(samples=1, device="cpu")
    alone, held = renderer.render(scene_of(path, hand, poses, 128))
    assert len(held) == 2
    for pose, image in zip(poses, held, strict=True):
        bare = renderer.render_meshes(hand=hand, link_pose=pose, camera=paper_camera(128))
        assert not bare.mask.any()
        in_front = bare.depth < alone.depth
        tie = bare.depth == alone.depth
        assert_array_equal(image.mask[~tie] > 0, ((alone.mask > 0) & ~in_front)[~tie])
        assert_array_equal(image.depth, np.minimum(bare.depth, alone.depth))
        hidden = (alone.mask > 0) & (image.mask == 0)
        assert 200 < hidden.sum() < (alone.mask > 0).sum()
    again, none = renderer.render(scene_of(path, size=128))
    assert none == []
    assert_array_equal(again.rgb, alone.rgb)


def test_the_hand_is_drawn_where_its_closed_forms_are(hand):
    pose = grasp_poses(hand)[1]
    camera = paper_camera(160)
    image = Renderer(samples=1, device="cpu").render_meshes(hand=hand, link_pose=pose, camera=camera)
    seen = np.isfinite(image.depth)
    assert seen.sum() > 800
    points = camera.position + image.depth[seen, None].astype(float) * camera.rays()[seen]
    distance = hand.signed_distance(points, pose)
    # Rounded edges are inside by up to 0.75 of the bevel (3 mm); the rest is float16.
    assert distance.max() < 2 * HALF_STEP
    assert distance.min() > -0.003
    assert np.median(np.abs(distance)) < HALF_STEP


def test_masters_are_the_arrays(write_glb, hand, tmp_path):
    path = write_glb("bottle-0007", painted(ball((0, 0, 0), 0.1), (0.5, 0.2, 0.1)))
    renderer = Renderer(samples=2, device="cpu", exr=tmp_path / "exr")
    alone, held = renderer.render(scene_of(path, hand, grasp_poses(hand), 64))
    files = ["bottle-0007-unoccluded.exr", "bottle-0007-grasp-0.exr", "bottle-0007-grasp-1.exr"]
    assert sorted(file.name for file in (tmp_path / "exr").iterdir()) == sorted(files)
    for file, image in zip(files, [alone, *held], strict=True):
        for back, there in zip(read_layers(tmp_path / "exr" / file).image((1, 1, 1)), image, strict=True):
            assert_array_equal(back, there)


def test_colours_of_figures_by_mesh_vertex_and_face():
    corners = np.array([[0, -0.2, 0.5], [0, 0.2, 0.5], [0, 0.2, 0.8], [0, -0.2, 0.8]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    camera = looking_at((0, 0, 0.65), (1, 0, 0.65), size=64)
    renderer = Renderer(samples=4, device="cpu")

    def at(colours, y, z):
        image = renderer.render_meshes([Mesh(corners, faces, colours)], camera=camera, background=None)
        column, row = np.floor(camera.project(np.array([0, y, z]))[0]).astype(int)
        assert image.rgb.shape == (64, 64, 4) and image.rgb[0, 0, 3] == 0 and image.rgb[row, column, 3] == 255
        return image.rgb[row, column, :3].argmax()

    assert at((0.1, 0.9, 0.1), 0.15, 0.55) == 1
    assert [at([(0.9, 0, 0), (0, 0, 0.9)], y, z) for y, z in ((0.15, 0.55), (-0.15, 0.75))] == [0, 2]
    ends = [(0.9, 0, 0), (0.9, 0, 0), (0, 0, 0.9), (0, 0, 0.9)]
    assert [at(ends, 0.0, z) for z in (0.52, 0.78)] == [0, 2]


def test_meshes_outside_the_image_are_background():
    image = Renderer(samples=1, device="cpu").render_meshes([spheres([[0, 0, 50.0]], 0.1)], camera=paper_camera(32))
    assert (image.rgb == 255).all() and not image.mask.any()


def test_what_is_broken_is_unusable_and_the_next_object_renders(write_glb, tmp_path):
    renderer = Renderer(samples=1, device="cpu")
    good = write_glb("good", ball((0, 0, 0), 0.1))
    expected, _ = renderer.render(scene_of(good, size=48))
    whole = good.read_bytes()
    broken = {"text": b"this is no glTF", "empty": b"", "cut": whole[: len(whole) // 2], "header": whole[:20]}
    for name, content in broken.items():
        path = tmp_path / name / "visual.glb"
        path.parent.mkdir()
        path.write_bytes(content)
        with pytest.raises(UnusableObject, match=f"{name}/visual.glb"):
            renderer.render(scene_of(path, size=48))
        image, _ = renderer.render(scene_of(good, size=48))
        assert_array_equal(image.rgb, expected.rgb)
    points = write_glb("points", trimesh.PointCloud(MARKERS))
    with pytest.raises(UnusableObject, match="triangles"):
        renderer.render(scene_of(points))
    with pytest.raises(FileNotFoundError, match="visual.glb"):
        renderer.render(scene_of(tmp_path / "nowhere" / "visual.glb"))


def test_a_full_disk_is_no_fault_of_the_object(write_glb):
    renderer = Renderer(samples=1, device="cpu")
    (renderer._folder / "picture.exr").symlink_to("/dev/full")
    with pytest.raises(OSError, match="space left"):
        renderer.render(scene_of(write_glb("ball", ball((0, 0, 0), 0.1))))


def test_an_older_renderer_and_an_unknown_device_are_refused(write_glb):
    path = write_glb("ball", ball((0, 0, 0), 0.1))
    old = Renderer(samples=1, device="cpu")
    Renderer(samples=1, device="cpu")
    with pytest.raises(RuntimeError, match="newer Renderer"):
        old.render(scene_of(path))
    with pytest.raises(ValueError, match="expected auto, cpu or gpu"):
        Renderer(device="toaster")
