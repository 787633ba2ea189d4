"""The page of an object: one HTML file with styles, scripts, pictures and the scene in it, so that it works offline."""

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from markupsafe import Markup

from palpate.atomic import atomic_write
from palpate.camera import Camera
from palpate.dataset import GraspRecord, ObjectRecord
from palpate.dataset.reader import PressRecord
from palpate.mesh import OBJECT_POSITION
from palpate.touch import empty_reading
from palpate.viewer.html import data_uri, render, resource
from palpate.viewer.scene import FORCE_LENGTH, Y_UP, cameras, force_arrows, record_scene, sensor_colour

READING = 100  # pixels of a reading of a frame or a press, at most
PRESSES = 20  # of an object, at most
LABELS = {"object": "object", "hand": "hand", "gel": "readings on the sensors", "cloud": "touch clouds"}
LABELS |= {"force": f"contact forces on the object (1 N is {1e3 * FORCE_LENGTH:g} mm)"}
LABELS |= {"prediction": "prediction", "camera": "cameras"}


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
    missing = {"prediction": not predictions, "force": not with_forces}
    labels = {kind: label for kind, label in LABELS.items() if not missing.get(kind)}
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
        picture = {"reading": data_uri(grasp.reading[number]), "colour": sensor_colour(number)}
        sensors.append({"name": name, **picture, **touch})
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
    """A press as the page takes it: at each force the sensor's pose, as a row of a 3 x 4 matrix, its reading, and a
    line about it."""
    position = press.position + press.approach[:, None] * press.rotation[:, 0]
    poses = [np.column_stack([press.rotation, place]).ravel().round(6).tolist() for place in position]
    lines = [
        f"{force:g} N, {1e3 * depth:.2f} mm deep, {100 * inside:.0f} % of the force within the image"
        for force, depth, inside in zip(press.force, press.approach, press.inside, strict=True)
    ]
    return {"poses": poses, "readings": [data_uri(reading, READING) for reading in press.reading], "lines": lines}


def _images(record: ObjectRecord | GraspRecord, name: str) -> list[str]:
    """The images of an object or of a grasp, one a camera."""
    cameras = record.cameras if "vision" in record.stages else 0
    return [data_uri(getattr(record.seen_by(number), name)) for number in range(cameras)]


def _viewpoint(camera: Camera) -> dict[str, object]:
    """A camera as the page takes it, y up: where it is and looks at, and its vertical field of view in degrees."""
    _, up, back = camera.rotation.T
    target = camera.position - max(0.1, np.linalg.norm(camera.position - OBJECT_POSITION)) * back
    places = {"position": camera.position, "target": target, "up": up}
    field = 2 * np.degrees(np.arctan(camera.size / 2 / camera.focal_length))
    return {name: (Y_UP[:3, :3] @ place).tolist() for name, place in places.items()} | {"field": float(field)}
