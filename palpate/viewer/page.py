"""The page of an object, one HTML file that works offline, and its scene of named nodes, for GLB.

A node is named `<group> <kind> <name>`. Its group is `object`, `grasp-<number>` or `press-<number>`; its kind is
`object`, `hand`, `gel`, `force`, `cloud`, `prediction` or `camera`.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh
from markupsafe import Markup
from numpy.typing import ArrayLike
from PIL import Image, ImageColor
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from palpate.atomic import atomic_write
from palpate.camera import Camera
from palpate.dataset import GraspRecord, ObjectRecord
from palpate.dataset.reader import FramesRecord, PressRecord
from palpate.hand import Hand
from palpate.mesh import OBJECT_POSITION, mesh_file
from palpate.results.page import SENSOR_COLOURS
from palpate.sensor import Size
from palpate.touch import empty_reading
from palpate.viewer.html import data_uri, render, resource
from palpate.vision.geom import link_mesh
from palpate.vision.image import linear

# glTF has y up, the dataset's world z: the scene's root turns one into the other.
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
ROOT, IDENTITY = "world", np.eye(4)
POINT_COLOUR = "#9a9a9a"  # of a surface without a mesh
CAMERA_LENGTH = 0.12  # m from a camera to the frame that is drawn for it
FORCE_LENGTH, FORCE_WIDTH = 0.05, 0.01  # m: length of an arrow for each newton, width of its head
READING = 100  # pixels of a reading of a frame or a press, at most
PRESSES = 20  # of an object, at most
LABELS = {"object": "object", "hand": "hand", "gel": "readings on the sensors", "cloud": "touch clouds"}
LABELS |= {"force": f"contact forces on the object (1 N is {1e3 * FORCE_LENGTH:g} mm)"}
LABELS |= {"prediction": "prediction", "camera": "cameras"}


def record_scene(
    record: ObjectRecord,
    grasps: Sequence[GraspRecord] = (),
    predictions: Mapping[int, trimesh.Trimesh] | None = None,
    presses: Sequence[PressRecord] = (),
) -> trimesh.Scene:
    """The scene of an object and some of its grasps and presses; `.export(file_type="glb")` gives the bytes of a file.
    Nodes are in the world frame, metres, below a root that turns z up into glTF's y up. What the run does not have is
    left out; without meshes the object is its surface points. predictions: world frame, by the grasp's number."""
    scene = trimesh.Scene(base_frame="root")
    scene.graph.update(frame_to=ROOT, frame_from="root", matrix=Y_UP)
    if not (record.mesh / "visual.glb").exists():
        _add(scene, "object object points", _cloud(record.points, POINT_COLOUR))
    else:
        loaded = trimesh.load_scene(mesh_file(record.mesh, "visual.glb"), process=False)
        for number, node in enumerate(loaded.graph.nodes_geometry):
            pose, geometry = loaded.graph[node]
            pose = _pose(np.eye(3), np.array(OBJECT_POSITION)) @ pose
            _add(scene, f"object object {number}", loaded.geometry[geometry], pose, f"object {geometry}")
    for camera in cameras(record):
        _add(scene, "object camera", _frustum(camera))
    for press in presses:  # with its last force
        pose = _pose(press.rotation, press.position + press.approach[-1] * press.rotation[:, 0])
        _add(scene, f"press-{press.number} gel sensor", _gel(press.reading[-1], press.sensor.size), pose)
    links = {}
    if grasps and "grasps" in record.stages:
        links = {link: _link(record.hand, link) for link in np.unique(record.hand.geom_link).tolist()}
    for grasp in grasps:
        group = f"grasp-{grasp.number}"
        for link, shape in links.items():
            name = f"{group} hand {record.hand.link_names[link]}"
            _add(scene, name, shape, grasp.link_pose[link], geometry=f"link {link}")
        if "touch" in grasp.stages:
            for number, name in enumerate(grasp.sensors):
                pose = _pose(grasp.rotation[number], grasp.position[number])
                _add(scene, f"{group} gel {name}", _gel(grasp.reading[number], grasp.sensor.size), pose)
                if len(grasp.points[number]):
                    colour = SENSOR_COLOURS[number % len(SENSOR_COLOURS)]
                    _add(scene, f"{group} cloud {name}", _cloud(grasp.points[number], colour))
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
    """Poses (f, n, 4, 4), scaled to size, of arrows along +z from 0 to 1, which end at the contacts: the forces of the
    hand on the object. n: the most contacts of a frame. Others (none, hand with itself) are too small to be seen."""
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
    return [seen.vision_camera for seen in _seen(record)]


def _seen(record: ObjectRecord | GraspRecord) -> list[ObjectRecord | GraspRecord]:
    """An object or a grasp as each camera sees it; none without images."""
    return [record.seen_by(number) for number in range(record.cameras if "vision" in record.stages else 0)]


def _add(scene: trimesh.Scene, name: str, shape: Any, pose: np.ndarray = IDENTITY, geometry: str = "") -> None:
    """Add a node with a shape; one geometry may have several nodes."""
    scene.geometry.setdefault(geometry or name, shape)
    scene.graph.update(frame_to=name, frame_from=ROOT, matrix=pose, geometry=geometry or name)


def _link(hand: Hand, link: int) -> trimesh.Trimesh:
    drawn = link_mesh(hand, link)
    shape = trimesh.Trimesh(drawn.vertices, drawn.faces, vertex_normals=drawn.normals, process=False)
    return _with_colours(shape, drawn.colours)


def _with_colours(mesh: trimesh.Trimesh, colours: ArrayLike) -> trimesh.Trimesh:
    """A mesh with sRGB colours (n, 3) of its vertices: glTF has them linear. Without a material it would be metal."""
    mesh.visual = TextureVisuals(material=PBRMaterial(metallicFactor=0.0, roughnessFactor=0.6, doubleSided=True))
    mesh.visual.vertex_attributes["color"] = _linear_rgba(colours)
    return mesh


def _gel(reading: np.ndarray, size: Size) -> trimesh.Trimesh:
    """The sensor plane, in the sensor's frame, with the reading on it: columns along y, rows along z."""
    y, z = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]) * np.array(size)[::-1, None] / 2
    # trimesh has (0, 0) at the picture's lower left corner.
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=float)
    look = {"doubleSided": True, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    material = PBRMaterial(baseColorTexture=Image.fromarray(reading), **look)
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
    rgba = _linear_rgba(np.divide([ImageColor.getrgb(colour)], 255))
    return trimesh.PointCloud(np.asarray(points, dtype=np.float32), colors=np.tile(rgba, (len(points), 1)))


def _frustum(camera: Camera) -> trimesh.path.Path3D:
    """The camera's centre joined to the frame of its picture, 12 cm before it."""
    half = camera.size / 2 / camera.focal_length
    corners = CAMERA_LENGTH * np.array([(-half, half, -1), (half, half, -1), (half, -half, -1), (-half, -half, -1)])
    centre, frame = camera.position, camera.position + corners @ camera.rotation.T
    edges = [*([centre, corner] for corner in frame), *zip(frame, np.roll(frame, 1, 0), strict=True)]
    path = trimesh.load_path(np.array(edges))
    path.colors = np.tile(_linear_rgba(np.divide([ImageColor.getrgb("#555555")], 255)), (len(path.entities), 1))
    return path


def _linear_rgba(colours: ArrayLike) -> np.ndarray:
    """Linear RGBA (n, 4) uint8 of sRGB colours (n, 3) in 0..1."""
    return np.insert(np.rint(255 * linear(colours)), 3, 255, axis=1).astype(np.uint8)


def object_page(
    path: Path | str,
    record: ObjectRecord,
    grasps: Sequence[int] | None = None,
    predictions: Mapping[int, trimesh.Trimesh] | None = None,
    model: str = "",
) -> Path:
    """Write the page of one object, and the scene beside it as a `.glb`; both atomically.
    path: of the page, `.html`. grasps: numbers of those that are shown; all by default. predictions: meshes in the
    world frame by the number of the grasp, of the model that `model` names. Returns the path of the GLB file. Raises
    IndexError for a grasp that the object does not have."""
    path = Path(path)
    all_grasps = record.grasps if {"grasps", "touch", "vision"} & {*record.stages} else []
    if wrong := [number for number in grasps or () if not 0 <= number < len(all_grasps)]:
        raise IndexError(f"{record.name} has no grasp {wrong[0]}: it has {len(all_grasps)}, numbered from 0")
    shown = all_grasps if grasps is None else [all_grasps[number] for number in grasps]
    pressed = record.presses[:PRESSES] if "press" in record.stages else []
    glb = record_scene(record, shown, predictions, pressed).export(file_type="glb")
    scene_file = path.with_suffix(".glb")
    frames = {grasp.number: _frames(grasp) for grasp in shown if "frames" in grasp.stages}
    viewpoints = [_viewpoint(camera) for camera in cameras(record)]
    data = {"glb": base64.b64encode(glb).decode(), "cameras": viewpoints, "frames": frames}
    data["presses"] = {press.number: _press(press) for press in pressed}
    with_forces = any(name.startswith("force ") for closing in frames.values() for name in closing["poses"])
    there = {"prediction": predictions, "force": with_forces}
    labels = {kind: label for kind, label in LABELS.items() if there.get(kind, True)}
    if predictions and model:
        labels["prediction"] += f" of {model}"
    with atomic_write(scene_file) as partial:
        partial.write_bytes(glb)
    render(
        path,
        "object.html.jinja",
        record=record,
        labels=labels,
        cameras=len(viewpoints),
        grasps=[_grasp(grasp) for grasp in shown],
        frames=max((len(closing["time"]) for closing in frames.values()), default=0),
        presses=[press.number for press in pressed],
        forces=max((len(press.force) for press in pressed), default=0),
        images=_images(record, "unoccluded"),
        data=Markup(json.dumps(data).replace("<", "\\u003c")),
        style=resource("viewer.css"),
        three=resource("three.min.js"),
        script=resource("viewer.js"),
    )
    return scene_file


def _grasp(grasp: GraspRecord) -> dict[str, object]:
    """The images and readings of a grasp, which the page shows beside the scene, and with what each sensor's link
    presses the object at rest, if the grasp has a grip."""
    sensors = []
    for number, name in enumerate(grasp.sensors if "touch" in grasp.stages else ()):
        touch = {"touches": grasp.success[number], "points": grasp.point_count[number]}
        touch |= {"reading": data_uri(grasp.reading[number]), "colour": SENSOR_COLOURS[number % len(SENSOR_COLOURS)]}
        sensors.append({"name": name, **touch})
    shown = {"number": grasp.number, "images": _images(grasp, "occluded"), "sensors": sensors}
    pressed = zip(grasp.sensors, grasp.sensor_force, strict=True) if grasp.has_forces else ()
    return shown | {"forces": ", ".join(f"{name} {force:.1f} N" for name, force in pressed), "label": _label(grasp)}


def _label(grasp: GraspRecord) -> str:
    """Whether the grasp holds the object, and how well; empty if that was not tested."""
    if "hold" not in grasp.stages:
        return ""
    along = f"{(grasp.held_along == 1).sum()} of {len(grasp.held_along)} directions of gravity"
    quality = f"resists any disturbance up to {grasp.wrench_radius:.2f} N"
    friction = f"{100 * grasp.cone_margin:.0f} % of friction left"
    return f"{'holds' if grasp.held == 1 else 'does not hold'}: {along}; {quality}; {friction}"


def _frames(grasp: GraspRecord) -> dict[str, Any]:
    """A grasp's closing as the page takes it: times, poses of the scene's nodes by kind and name as rows of 3 x 4
    matrices, and readings; None for a sensor that touches nothing, which reads `empty`."""
    frames, hand = grasp.frames, grasp.object.hand
    gels = np.concatenate([frames.sensor_rotation, frames.sensor_position[..., None]], axis=-1)
    poses = {f"gel {name}": gels[:, number] for number, name in enumerate(grasp.sensors)}
    poses |= {f"hand {hand.link_names[link]}": frames.link_pose[:, link, :3] for link in np.unique(hand.geom_link)}
    if frames.has_contacts:
        poses |= {f"force {slot}": arrows for slot, arrows in enumerate(force_arrows(frames)[:, :, :3].swapaxes(0, 1))}
    rows = {name: np.round(pose.reshape(-1, 12), 5).tolist() for name, pose in poses.items()}
    closing = {"time": frames.time.tolist(), "poses": rows}
    if frames.has_touch:
        readings = np.full(frames.success.shape, None)
        for place in np.argwhere(frames.success):
            readings[*place] = data_uri(frames.reading[*place], READING)
        closing |= {"readings": readings.tolist(), "empty": data_uri(empty_reading(frames.sensor), READING)}
    return closing


def _press(press: PressRecord) -> dict[str, Any]:
    """A press as the page takes it: at each force the sensor's pose, as rows of 3 x 4, its reading, and a line."""
    position = press.position + press.approach[:, None] * press.rotation[:, 0]
    poses = [np.column_stack([press.rotation, place]).ravel().round(6).tolist() for place in position]
    lines = [
        f"{force:g} N, {1e3 * depth:.2f} mm deep, {100 * inside:.0f} % of the force within the image"
        for force, depth, inside in zip(press.force, press.approach, press.inside, strict=True)
    ]
    return {"poses": poses, "readings": [data_uri(reading, READING) for reading in press.reading], "lines": lines}


def _images(record: ObjectRecord | GraspRecord, name: str) -> list[str]:
    return [data_uri(getattr(seen, name)) for seen in _seen(record)]


def _viewpoint(camera: Camera) -> dict[str, object]:
    """A camera as the page takes it, y up: where it is and looks at, and its vertical field of view in degrees."""
    _, up, back = camera.rotation.T
    target = camera.position - max(0.1, np.linalg.norm(camera.position - OBJECT_POSITION)) * back
    places = {"position": camera.position, "target": target, "up": up}
    field = 2 * np.degrees(np.arctan(camera.size / 2 / camera.focal_length))
    return {name: (Y_UP[:3, :3] @ place).tolist() for name, place in places.items()} | {"field": float(field)}
