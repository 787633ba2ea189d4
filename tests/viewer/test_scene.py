"""The scene of an object, read back from the bytes of its GLB file."""

import io
import json
import shutil
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

import palpate
from palpate.camera import paper_camera
from palpate.mesh import OBJECT_POSITION
from palpate.viewer import page, record_scene
from palpate.vision.geom import link_mesh
from tests.store.conftest import shape


@pytest.fixture(scope="module")
def record(built):
    return palpate.Dataset(built)["ball-0002"]


@pytest.fixture(scope="module")
def glb(record):
    prediction = trimesh.creation.box((0.1, 0.2, 0.3)).apply_translation((0, 0, 0.6))
    prediction.visual.vertex_colors = [200, 100, 50, 255]
    return record_scene(record, record.grasps, {1: prediction}).export(file_type="glb")


@pytest.fixture(scope="module")
def scene(glb):
    return trimesh.load_scene(io.BytesIO(glb), file_type="glb", process=False)


def in_world(scene, node):
    """Vertices of a node in the world frame of the dataset: glTF's (x, y, z) is the world's (x, -z, y)."""
    pose, name = scene.graph.get(node)
    points = trimesh.transform_points(np.asarray(scene.geometry[name].vertices), pose)
    return points @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


def nodes(scene, start):
    return sorted(node for node in scene.graph.nodes_geometry if node.startswith(start))


def test_the_object_stands_upright_where_the_dataset_has_it(scene, record):
    (node,) = nodes(scene, "object object")
    expected = np.asarray(shape(record.name).vertices) + OBJECT_POSITION
    found = in_world(scene, node)
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(expected, axis=0), atol=1e-6)
    pose, name = scene.graph.get(node)
    middle = trimesh.transform_points(np.asarray(scene.geometry[name].vertices), pose).mean(axis=0)
    np.testing.assert_allclose(middle, (0, 0.6, 0), atol=1e-3)  # y is up


def test_clouds_and_gels_are_where_the_sensors_are(scene, record):
    for grasp in record.grasps:
        clouds = nodes(scene, f"grasp-{grasp.number} cloud")
        touching = [name for name, success in zip(grasp.sensors, grasp.success, strict=True) if success]
        assert clouds == sorted(f"grasp-{grasp.number} cloud {name}" for name in touching)
        for number, name in enumerate(grasp.sensors):
            if grasp.success[number]:
                found = in_world(scene, f"grasp-{grasp.number} cloud {name}")
                np.testing.assert_allclose(found, grasp.points[number], atol=2e-7)
            corners = in_world(scene, f"grasp-{grasp.number} gel {name}")
            local = (corners - grasp.position[number]) @ grasp.rotation[number]
            np.testing.assert_allclose(np.abs(local), np.tile([0, 1, 1], (4, 1)) * grasp.sensor.width / 2, atol=1e-7)


def test_the_pixels_of_a_reading_are_at_their_points_of_the_plane(glb, record):
    """By the file's bytes: glTF's texture coordinates start at the upper left corner of the picture."""
    length = struct.unpack_from("<I", glb, 12)[0]
    tree, data = json.loads(glb[20 : 20 + length]), glb[28 + length :]

    def view(number):
        entry = tree["bufferViews"][number]
        return data[entry.get("byteOffset", 0) :][: entry["byteLength"]]

    def values(number):
        entry = tree["accessors"][number]
        columns = {"VEC2": 2, "VEC3": 3}[entry["type"]]
        start = entry.get("byteOffset", 0)
        return np.frombuffer(view(entry["bufferView"])[start:], np.float32, entry["count"] * columns).reshape(
            -1, columns
        )

    grasp = record.grasps[0]
    for number, name in enumerate(grasp.sensors):
        node = next(each for each in tree["nodes"] if each.get("name") == f"grasp-0 gel {name}")
        primitive = tree["meshes"][node["mesh"]]["primitives"][0]
        texture = tree["materials"][primitive["material"]]["pbrMetallicRoughness"]["baseColorTexture"]["index"]
        image = tree["images"][tree["textures"][texture]["source"]]
        with Image.open(io.BytesIO(view(image["bufferView"]))) as picture:
            np.testing.assert_array_equal(np.asarray(picture.convert("RGB")), grasp.reading[number])
        position, uv = (values(primitive["attributes"][key]) for key in ("POSITION", "TEXCOORD_0"))
        # Columns run along y and rows along z (docs/dataset.md).
        np.testing.assert_allclose(uv, position[:, 1:] / grasp.sensor.width + 0.5, atol=1e-6)


def test_the_hand_is_where_its_links_are(scene, record):
    """Every vertex of a link is on or in the closed forms of the link's geoms; some are on them."""
    hand = record.hand
    for grasp in record.grasps:
        for link in np.unique(hand.geom_link):
            vertices = in_world(scene, f"grasp-{grasp.number} hand {hand.link_names[link]}")
            poses = hand.geom_poses(grasp.link_pose)
            mine = np.flatnonzero(hand.geom_link == link)
            distance = np.min([hand.geom_distance(geom, vertices, poses[geom]) for geom in mine], axis=0)
            assert distance.max() < 1e-5 and distance.max() > -1e-5


def test_predictions_and_cameras_are_in_their_groups(scene):
    np.testing.assert_allclose(np.ptp(in_world(scene, "grasp-1 prediction"), axis=0), (0.1, 0.2, 0.3), atol=1e-7)
    assert not nodes(scene, "grasp-0 prediction")
    frustum = in_world(scene, "object camera")
    camera = paper_camera(64)
    assert np.linalg.norm(frustum - camera.position, axis=1).min() < 1e-6
    pixels, depth = camera.project(frustum)
    corners = {(0, 0), (64, 0), (64, 64), (0, 64)}
    assert {tuple(np.round(pixel).astype(int)) for pixel in pixels[depth > 0.01]} == corners


def test_what_a_run_does_not_have_is_left_out(run):
    for stage in ("meshes", "grasps", "vision"):
        shutil.rmtree(run / stage)
    record = palpate.Dataset(run)["ball-0000"]
    scene = record_scene(record, record.grasps)
    kinds = {node.split(" ")[1] for node in scene.graph.nodes_geometry}
    assert kinds == {"object", "gel", "cloud"}
    (geometry,) = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry if "object" in node]
    np.testing.assert_array_equal(geometry.vertices, record.points)


def test_the_meshes_of_the_hand_are_built_once(record, monkeypatch):
    built = []
    monkeypatch.setattr(page, "link_mesh", lambda hand, link: built.append(link) or link_mesh(hand, link))
    assert len(record.grasps) > 1
    record_scene(record, record.grasps)
    assert built == np.unique(record.hand.geom_link).tolist()
