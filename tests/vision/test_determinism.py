import bpy
import numpy as np
import trimesh
from numpy.testing import assert_array_equal

from palpate.vision import Renderer, renderer
from palpate.vision.camera import paper_camera
from tests.vision.scenes import ball, grasp_poses, painted


def objects(write_glb):
    torus = painted(trimesh.creation.torus(0.15, 0.05), (0.6, 0.1, 0.1), roughness=0.3)
    return write_glb("ball", painted(ball((0, 0, 0), 0.15), (0.1, 0.3, 0.6))), write_glb("torus", torus)


def assert_same(one, other):
    for image, twin in zip([one[0], *one[1]], [other[0], *other[1]], strict=True):
        for array, same in zip(image, twin, strict=True):
            assert_array_equal(array, same)


def test_images_do_not_depend_on_threads_order_or_what_came_before(write_glb, hand):
    first, second = objects(write_glb)
    poses = grasp_poses(hand)
    one = Renderer(size=96, samples=4, device="cpu", threads=1)
    a, b = one.render_object(first, hand, poses), one.render_object(second, hand, poses)
    two = Renderer(size=96, samples=4, device="cpu", threads=2)
    assert_same(two.render_object(second, hand, poses), b)
    assert_same(two.render_object(first, hand, poses), a)
    assert not np.array_equal(a[0].rgb, b[0].rgb)


def test_the_rectangle_holds_everything_drawn():
    camera = paper_camera(100)
    points = np.array([[0.1, 0.1, 0.7], [-0.1, 0.0, 0.5], [0.0, -0.1, 0.6]])
    render = bpy.context.scene.render
    assert renderer._crop(render, camera, points)
    pixels, _ = camera.project(points)
    assert (pixels[:, 0] > render.border_min_x * 100 + 1).all()
    assert (pixels[:, 0] < render.border_max_x * 100 - 1).all()
    assert (pixels[:, 1] > (1 - render.border_max_y) * 100 + 1).all()
    assert (pixels[:, 1] < (1 - render.border_min_y) * 100 - 1).all()


def test_nothing_stays_of_an_object(write_glb, hand):
    paths = objects(write_glb)
    poses = grasp_poses(hand)[:1]
    rendering = Renderer(size=32, samples=1, device="cpu")

    def census():
        kinds = [kind.identifier for kind in bpy.data.bl_rna.properties if kind.type == "COLLECTION"]
        return {kind: len(getattr(bpy.data, kind)) for kind in kinds}

    for path in paths:
        rendering.render_object(path, hand, poses)
    before = census()
    assert before["meshes"] > 0
    for path in paths * 3:
        rendering.render_object(path, hand, poses)
    assert census() == before
