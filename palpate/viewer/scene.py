"""One object and its grasps as a scene of named nodes, for GLB: object, hand, sensors, clouds, predictions, cameras.

A node is named `<group> <kind> <name>`. Its group is `object`, `grasp-<number>` or `press-<number>`; its kind is
`object`, `hand`, `gel`, `force`, `cloud`, `prediction` or `camera`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from palpate.camera import Camera
from palpate.dataset import GraspRecord, ObjectRecord
from palpate.dataset.reader import FramesRecord, PressRecord
from palpate.mesh import OBJECT_POSITION, mesh_file
from palpate.sensor import Size
from palpate.vision.image import linear
from palpate.vision.meshes import link_mesh

# glTF has y up, the dataset's world z: the scene's root turns one into the other.
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
ROOT = "world"
# sRGB of the sensors, in their order: Okabe and Ito's colours (2008, Color Universal Design).
SENSOR_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
POINT_COLOUR = "#9a9a9a"  # of a surface without a mesh
CAMERA_LENGTH = 0.12  # m from a camera to the frame that is drawn for it
FORCE_LENGTH, FORCE_WIDTH = 0.05, 0.01  # m: length of an arrow for each newton, width of its head


def sensor_colour(sensor: int) -> str:
    return SENSOR_COLOURS[sensor % len(SENSOR_COLOURS)]


def record_scene(
    record: ObjectRecord,
    grasps: Sequence[GraspRecord] = (),
    predictions: Mapping[int, trimesh.Trimesh] | None = None,
    presses: Sequence[PressRecord] = (),
) -> trimesh.Scene:
    """The scene of an object and some of its grasps and presses; `.export(file_type="glb")` gives the bytes of a file.
    Nodes are in the world frame, metres, below a root that turns z up into glTF's y up. What the run does not have
    (meshes, hand, touches) is left out; without meshes the object is its surface points. predictions: meshes in the
    world frame by the number of the grasp."""
    scene = trimesh.Scene(base_frame="root")
    scene.graph.update(frame_to=ROOT, frame_from="root", matrix=Y_UP)
    _add_object(scene, record)
    for camera in cameras(record):
        _add(scene, "object camera", _frustum(camera))
    for press in presses:  # with its last force
        pose = _pose(press.rotation, press.position + press.approach[-1] * press.rotation[:, 0])
        _add(scene, f"press-{press.number} gel sensor", _gel(press.reading[-1], press.sensor.size), pose)
    for grasp in grasps:
        group = f"grasp-{grasp.number}"
        if "grasps" in grasp.stages:
            for link in np.unique(record.hand.geom_link):
                drawn = link_mesh(record.hand, int(link))
                shape = trimesh.Trimesh(drawn.vertices, drawn.faces, vertex_normals=drawn.normals, process=False)
                name = f"{group} hand {record.hand.link_names[link]}"
                _add(scene, name, _with_colours(shape, drawn.colours), grasp.link_pose[link], geometry=f"link {link}")
        if "touch" in grasp.stages:
            for number, name in enumerate(grasp.sensors):
                pose = _pose(grasp.rotation[number], grasp.position[number])
                _add(scene, f"{group} gel {name}", _gel(grasp.reading[number], grasp.sensor.size), pose)
                if len(grasp.points[number]):
                    _add(scene, f"{group} cloud {name}", _cloud(grasp.points[number], sensor_colour(number)))
        if "frames" in grasp.stages and grasp.frames.has_contacts:
            for slot, pose in enumerate(force_arrows(grasp.frames)[-1]):
                _add(scene, f"{group} force {slot}", _arrow(), pose, geometry="force")
        if predictions and grasp.number in predictions:
            mesh = predictions[grasp.number].copy()
            colours = np.asarray(cast(Any, mesh.visual).vertex_colors)[:, :3] / 255
            _add(scene, f"{group} prediction", _with_colours(mesh, colours))
    return scene


def _pose(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    return np.block([[rotation, position[:, None]], [np.zeros(3), 1.0]])


def force_arrows(frames: FramesRecord) -> np.ndarray:
    """Poses (f, n, 4, 4), scaled to size, of arrows along +z from 0 to 1: the forces of the hand on the object. An
    arrow ends at its contact. n: the most contacts of a frame. Where there is none, or one of the hand with itself, the
    arrow is too small to be seen."""
    count = frames.contact_count
    slots = np.s_[:, : count.max()]
    shown = (np.arange(count.max()) < count[:, None]) & (frames.contact_other[slots] < 0)
    push = np.where(shown[..., None], -frames.contact_normal[slots], [0.0, 0.0, 1.0])
    length = np.maximum(FORCE_LENGTH * shown * frames.contact_force[slots], 1e-4)
    width = np.where(shown, FORCE_WIDTH, 1e-4)
    sizes = np.stack([width, width, length], axis=-1)
    tip = np.where(shown[..., None], frames.contact_position[slots], OBJECT_POSITION)
    poses = np.tile(np.eye(4), (*shown.shape, 1, 1))
    for slot in np.ndindex(shown.shape):
        poses[slot][:3, :3] = trimesh.geometry.align_vectors([0, 0, 1], push[slot])[:3, :3] * sizes[slot]
    poses[..., :3, 3] = tip - length[..., None] * push
    return poses


def cameras(record: ObjectRecord) -> list[Camera]:
    """The cameras that took the images; none without images."""
    numbers = range(record.cameras if "vision" in record.stages else 0)
    return [record.seen_by(number).vision_camera for number in numbers]


def _add(
    scene: trimesh.Scene, name: str, shape: trimesh.parent.Geometry, pose: np.ndarray | None = None, geometry: str = ""
) -> None:
    """Add a node with a shape; one geometry may have several nodes."""
    scene.geometry.setdefault(geometry or name, shape)
    matrix = np.eye(4) if pose is None else pose
    scene.graph.update(frame_to=name, frame_from=ROOT, matrix=matrix, geometry=geometry or name)


def _add_object(scene: trimesh.Scene, record: ObjectRecord) -> None:
    """Add the object's mesh with its materials, or its surface points if the run has no meshes."""
    if not (record.mesh / "visual.glb").exists():
        _add(scene, "object object points", _cloud(record.points, POINT_COLOUR))
        return
    loaded = trimesh.load_scene(mesh_file(record.mesh, "visual.glb"), process=False)
    place = trimesh.transformations.translation_matrix(OBJECT_POSITION)
    for number, node in enumerate(loaded.graph.nodes_geometry):
        pose, geometry = loaded.graph[node]
        _add(scene, f"object object {number}", loaded.geometry[geometry], place @ pose, f"object {geometry}")


def _with_colours(mesh: trimesh.Trimesh, colours: ArrayLike) -> trimesh.Trimesh:
    """A mesh with sRGB colours (n, 3) of its vertices: glTF has them linear. Without a material it would be metal."""
    rgb = np.rint(255 * linear(colours))
    rgba = np.column_stack([rgb, np.full(len(rgb), 255)]).astype(np.uint8)
    mesh.visual = TextureVisuals(material=PBRMaterial(metallicFactor=0.0, roughnessFactor=0.6, doubleSided=True))
    mesh.visual.vertex_attributes["color"] = rgba
    return mesh


def _gel(reading: np.ndarray, size: Size) -> trimesh.Trimesh:
    """The sensor plane, in the sensor's frame, with the reading on it: columns along y, rows along z."""
    y, z = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]) * np.array(size)[::-1, None] / 2
    # trimesh has (0, 0) at the picture's lower left corner.
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=float)
    material = PBRMaterial(
        baseColorTexture=Image.fromarray(reading), doubleSided=True, metallicFactor=0.0, roughnessFactor=1.0
    )
    vertices, visual = np.column_stack([np.zeros(4), y, z]), TextureVisuals(uv, material=material)
    # From outside, along -x, its front is seen.
    return trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def _arrow() -> trimesh.Trimesh:
    """An arrow along +z from 0 to 1, with a head 1 wide."""
    shaft = trimesh.creation.cylinder(0.15, segment=np.array([[0, 0, 0], [0, 0, 0.75]]), sections=12)
    head = trimesh.creation.cone(0.5, 0.25, sections=16).apply_translation((0, 0, 0.75))
    arrow = shaft + head
    return _with_colours(arrow, np.tile([0.8, 0.0, 0.0], (len(arrow.vertices), 1)))


def _cloud(points: np.ndarray, colour: str) -> trimesh.PointCloud:
    colours = np.tile(_linear_bytes(colour), (len(points), 1))
    return trimesh.PointCloud(np.asarray(points, dtype=np.float32), colors=colours)


def _frustum(camera: Camera) -> trimesh.path.Path3D:
    """The camera's centre joined to the frame of its picture, 12 cm before it."""
    half = camera.size / 2 / camera.focal_length
    corners = CAMERA_LENGTH * np.array([(-half, half, -1), (half, half, -1), (half, -half, -1), (-half, -half, -1)])
    centre, frame = camera.position, camera.position + corners @ camera.rotation.T
    edges = [*([centre, corner] for corner in frame), *zip(frame, np.roll(frame, 1, 0), strict=True)]
    path = trimesh.load_path(np.array(edges))
    path.colors = np.tile(_linear_bytes("#555555"), (len(path.entities), 1))
    return path


def _linear_bytes(colour: str) -> np.ndarray:
    """Linear RGBA (4,) uint8 of an HTML colour."""
    encoded = np.array([int(colour[start : start + 2], 16) for start in (1, 3, 5)]) / 255
    return np.append(np.rint(255 * linear(encoded)), 255).astype(np.uint8)
