"""A scene is data that engines read."""

import numpy as np
import pytest
import trimesh

from palpate import touch
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.scene import GRASP_ARRAYS, LIGHTS, Scene
from palpate.vision import looking_at, paper_camera
from tests.vision.scenes import grasp_poses

HAND = allegro()


def grasps():
    link_pose = grasp_poses(HAND)
    position, rotation = HAND.sensor_frames(link_pose)
    return dict(zip(GRASP_ARRAYS, (link_pose, position, rotation), strict=True))


def test_a_scene_of_grasps_has_their_arrays_and_the_defaults(tmp_path):
    arrays = grasps()
    scene = Scene.from_grasps(tmp_path / "bottle-0007", arrays, HAND)
    assert scene.name == "bottle-0007" and scene.visual_file == tmp_path / "bottle-0007/visual.glb"
    assert scene.sensor_position.shape == (2, 4, 3) and scene.sensor_rotation.shape == (2, 4, 3, 3)
    for name, array in arrays.items():
        assert getattr(scene, name) is array
    assert scene.object_position == OBJECT_POSITION and scene.lights == LIGHTS
    np.testing.assert_array_equal(scene.camera.matrix(), paper_camera().matrix())
    camera = looking_at((0, 0, 0.6), (1, 0, 1), 64)
    assert Scene.from_grasps(tmp_path, arrays, HAND, camera=camera).camera is camera


def test_an_object_alone_has_no_grasps_and_poses_need_a_hand(tmp_path):
    alone = Scene(str(tmp_path))
    assert alone.hand is None and alone.object_folder == tmp_path
    assert len(alone.link_pose) == len(alone.sensor_position) == len(alone.sensor_rotation) == 0
    with pytest.raises(ValueError, match="2 link poses without a hand"):
        Scene(tmp_path, None, grasps()["link_pose"])


def test_touch_reads_a_scene(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.12)
    (tmp_path / "visual.glb").write_bytes(trimesh.Scene([ball]).export(file_type="glb"))
    scene = Scene.from_grasps(tmp_path, grasps(), HAND)
    sensed = touch.sense_scene(scene, touch.scene_tracer(scene))
    assert sensed.depth.shape == (2, 4, 100, 100) and sensed.success.any()
    tracer = touch.RayCaster(load_visual(tmp_path), OBJECT_POSITION)
    flat = touch.sense(tracer, scene.sensor_position.reshape(-1, 3), scene.sensor_rotation.reshape(-1, 3, 3))
    np.testing.assert_array_equal(sensed.depth.reshape(flat.depth.shape), flat.depth)
    moved = Scene.from_grasps(tmp_path, grasps(), HAND, object_position=(5.0, 0, 0))
    assert not touch.sense_scene(moved).success.any()
