import bpy
import numpy as np
import trimesh
from numpy.testing import assert_array_equal

from palpate.camera import paper_camera
from palpate.vision import Renderer, renderer
from tests.vision.scenes import ball, grasp_poses, painted, scene_of


def objects(write_glb):
    torus = painted(trimesh.creation.torus(0.15, 0.05), (0.6, 0.1, 0.1), roughness=0.3)
    return write_glb("ball", painted(ball((0, 0, 0), 0.15), (0.1, 0.3, 0.6))), write_glb("torus", torus)


def assert_same(one, other):
    for image, twin in zip([one[0], *one[1]], [other[0], *other[1]], strict=True):
        for array, same in zip(image, twin, strict=True):
            assert_array_equal(array, same)


def test_images_do_not_depend_on_threads_order_or_what_came_before(write_glb, hand):
    first, second = (scene_of(path, hand, grasp_poses(hand), 96) for path in objects(write_glb))
    one = Renderer(samples=4, device="cpu", threads=1)
    a, b = one.render(first), one.render(second)
    two = Renderer(samples=4, device="cpu", threads=2)
    assert_same(two.render(second), b)
    assert_same(two.render(first), a)
    assert not np.array_equal(a[0].rgb, b[0].rgb)


def test_the_rectangle_holds_everything_drawn():
    camera = paper_camera(100)
    points = np.array([[0.1, 0.1, 0.7], [-0.1, 0.0, 0.5], [0.0, -0.1, 0.6]])
    render = bpy.context.scene.render
    renderer._crop(render, 100, *Renderer.rectangle(camera, points))
    pixels, _ = camera.project(points)
    assert (pixels[:, 0] > render.border_min_x * 100 + 1).all()
    assert (pixels[:, 0] < render.border_max_x * 100 - 1).all()
    assert (pixels[:, 1] > (1 - render.border_max_y) * 100 + 1).all()
    assert (pixels[:, 1] < (1 - render.border_min_y) * 100 - 1).all()


def test_nothing_stays_of_an_object(write_glb, hand):
    scenes = [scene_of(path, hand, grasp_poses(hand)[:1], 32) for path in objects(write_glb)]
    rendering = Renderer(samples=1, device="cpu")

    def census():
        kinds = [kind.identifier for kind in bpy.data.bl_rna.properties if kind.type == "COLLECTION"]
        return {kind: len(getattr(bpy.data, kind)) for kind in kinds}

    for scene in scenes:
        rendering.render(scene)
    before = census()
    assert before["meshes"] > 0
    for scene in scenes * 3:
        rendering.render(scene)
    assert census() == before
