"""A user's hand, read from a MuJoCo model file (MJCF or URDF) into plain data."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from palpate.hand.hand import Hand, rotation_about
from palpate.sensor import DIGIT

GEOM_KIND = {
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}


def from_mjcf(path: Path | str, sensors: Mapping | Path | str, gel_face: float = DIGIT.gel_face) -> Hand:
    """Read a hand of hinges and slides from a model file, with the frames of its sensors.

    sensors: a mapping, or a YAML file that holds one, with the keys

    - `sensors`: one or more of `{site: name}` or `{body: name, position: [x, y, z], rotation: [roll, pitch, yaw]}`
      (metres, radians, fixed axes); x points out of the gel, y along the columns and z along the rows of a
      reading.
    - `palm` (optional): the palm's body; default: the first one. The hand is everything from it on.
    - `anchor` (optional): a site on the palm's face, x its outward normal and z along the fingers, which is
      aimed at the object; default: the face of the palm's collision geoms in +x, at y = z = 0 of the palm's
      body.
    - `open` (optional): joint positions of the open hand in radians or metres; default: those of the file.
    - `thumb` (optional): names of the sensors (sites or bodies) of the thumb, which closes in a share of the attempts
      only (`grasps.thumb_share`); default: none, all fingers close in each.

    The palm's frame is that of its body. Every joint is driven by a servo of its own; its range is the
    file's.

    Raises ValueError, naming the file, for what a `Hand` can't be: joints other than hinges and slides, coupled
    joints, unlimited joints, no sensor.
    """
    path = Path(path)
    description = sensors
    if not isinstance(sensors, Mapping):
        description = yaml.safe_load(Path(sensors).read_text())
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
        return _Reader(model, path.stem).hand(description, gel_face)
    except KeyError as error:
        raise ValueError(f"{path}: nothing of this name, or key missing: {error.args[0]}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def model_files(path: Path | str) -> list[Path]:
    """The other files that a model file names and that exist, sorted: meshes, textures, included models.

    Of a URDF its meshes, which MuJoCo looks up by name in the folder that its compiler element says (the
    model's by default). None, if the file can't be read.
    """
    path = Path(path)
    try:
        files = {Path(name) for name in mujoco.mju_getXMLDependencies(str(path))}
        root = ElementTree.parse(path).getroot()
    except (mujoco.FatalError, ElementTree.ParseError, OSError):
        return []
    if root.tag == "robot":
        folders = [element.get("meshdir", "") for element in root.iterfind("mujoco/compiler")] or [""]
        names = [element.get("filename", "") for element in root.iter("mesh")]
        for folder in folders:
            files |= {path.parent / folder / tail for name in names for tail in (name, Path(name).name)}
    return sorted(file for file in files if file.is_file() and file != path)


class _Reader:
    """Rebases every body's frame so that its origin is on its joint's axis, as `Hand` has it."""

    def __init__(self, model: mujoco.MjModel, name: str):
        self.model, self.name = model, name
        if (model.eq_type == mujoco.mjtEq.mjEQ_JOINT).any():
            raise ValueError("joints coupled by an equality can't be read: each joint needs a servo of its own")
        self.links, self.joints, self.reference = [], [], []
        self.link_of_body: dict[int, int] = {}
        self.origin_of_body: dict[int, np.ndarray] = {}  # the body frame's origin in its link's frame

    def hand(self, description: Mapping, gel_face: float) -> Hand:
        model = self.model
        palm = model.body(description["palm"]).id if description.get("palm") else 1
        self._add_link(model.body(palm).name or "palm", -1, np.zeros(3), np.eye(3))
        self.link_of_body[palm], self.origin_of_body[palm] = 0, np.zeros(3)
        for body in range(palm + 1, model.nbody):
            if model.body_parentid[body] in self.link_of_body:
                self._add_body(body)
        geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in self.link_of_body]
        sensors = [self._sensor(sensor) for sensor in description["sensors"]]
        names, thumb = [sensor[0] for sensor in sensors], description.get("thumb") or []
        if unknown := sorted(set(thumb) - set(names)):
            raise ValueError(f"`thumb` names {', '.join(unknown)}, which no sensor is called: {', '.join(names)}")
        joint_range = np.array([joint[2] for joint in self.joints], dtype=float).reshape(-1, 2)
        start = np.asarray(description.get("open", self.reference), dtype=float)
        if start.shape != (len(self.joints),):
            raise ValueError(f"`open` has {start.size} joint positions, the hand has {len(self.joints)} joints")
        kinds, vertices, faces = zip(*(self._geom_shape(geom) for geom in geoms), strict=True)
        hand = Hand(
            name=self.name,
            link_names=tuple(link[0] for link in self.links),
            link_parent=np.array([link[1] for link in self.links]),
            link_position=np.array([link[2] for link in self.links]),
            link_rotation=np.array([link[3] for link in self.links]),
            joint_link=np.array([joint[0] for joint in self.joints]),
            joint_axis=np.array([joint[1] for joint in self.joints]),
            joint_slides=np.array([joint[3] for joint in self.joints], dtype=bool),
            joint_range=joint_range,
            geom_link=np.array([self.link_of_body[model.geom_bodyid[geom]] for geom in geoms]),
            geom_kind=kinds,
            geom_size=np.array([model.geom_size[geom] for geom in geoms]),
            geom_position=np.array(
                [self.origin_of_body[model.geom_bodyid[geom]] + model.geom_pos[geom] for geom in geoms]
            ),
            geom_rotation=_rotation(model.geom_quat[geoms]),
            geom_rgba=np.array([self._colour(geom) for geom in geoms], dtype=float),
            geom_collides=np.array([self._collides(geom) for geom in geoms]),
            geom_vertices=vertices,
            geom_faces=faces,
            sensor_names=tuple(names),
            sensor_thumb=np.isin(names, thumb),
            sensor_link=np.array([sensor[1] for sensor in sensors]),
            sensor_position=np.array([sensor[2] - gel_face * sensor[3][:, 0] for sensor in sensors]),
            sensor_rotation=np.array([sensor[3] for sensor in sensors]),
            open_joint_positions=np.clip(start, *joint_range.T),
            palm_anchor=self._anchor(description, geoms),
        )
        return hand

    def _add_link(self, name: str, parent: int, position: np.ndarray, rotation: np.ndarray) -> int:
        self.links.append((name, parent, position, rotation))
        return len(self.links) - 1

    def _add_body(self, body: int) -> None:
        """A body as one link for each of its joints (one if it has none), each link's origin on its joint."""
        model = self.model
        name = model.body(body).name or f"body_{body}"
        parent_body = model.body_parentid[body]
        parent = self.link_of_body[parent_body]
        position = self.origin_of_body[parent_body] + model.body_pos[body]
        rotation = _rotation(model.body_quat[body])
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        anchor = np.zeros(3)
        if count == 0:
            parent = self._add_link(name, parent, position, rotation)
        for number, joint in enumerate(range(first, first + count)):
            kind = mujoco.mjtJoint(model.jnt_type[joint])
            if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                raise ValueError(f"joint {model.joint(joint).name!r} is neither hinge nor slide: others can't be read")
            slides = kind == mujoco.mjtJoint.mjJNT_SLIDE
            if not model.jnt_limited[joint]:
                raise ValueError(f"joint {model.joint(joint).name!r} has no range: give it one")
            anchor_now, axis = model.jnt_pos[joint].copy(), model.jnt_axis[joint].copy()
            reference = model.qpos0[model.jnt_qposadr[joint]]
            position = position + rotation @ (anchor_now - anchor)
            if slides:
                position = position - reference * rotation @ axis
            else:
                rotation = rotation @ rotation_about(axis, -reference)
            last = number == count - 1
            parent = self._add_link(name if last else f"{name}_{number}", parent, position, rotation)
            self.joints.append((parent, axis, model.jnt_range[joint].copy(), slides))
            self.reference.append(reference)
            position, rotation, anchor = np.zeros(3), np.eye(3), anchor_now
        self.link_of_body[body], self.origin_of_body[body] = parent, -anchor

    def _sensor(self, sensor: Mapping) -> tuple[str, int, np.ndarray, np.ndarray]:
        """Name, link, position and rotation of a sensor given by a site, or by a body and a pose in it."""
        model = self.model
        if "site" in sensor:
            site = model.site(sensor["site"]).id
            name, body = sensor["site"], model.site_bodyid[site]
            position, rotation = model.site_pos[site], _rotation(model.site_quat[site])
        else:
            name, body = sensor["body"], model.body(sensor["body"]).id
            position = np.asarray(sensor.get("position", (0, 0, 0)), dtype=float)
            rotation = Rotation.from_euler("xyz", sensor.get("rotation", (0, 0, 0))).as_matrix()
        if body not in self.link_of_body:
            raise ValueError(f"sensor {name!r} is not on the hand: its body is not below the palm")
        return name, self.link_of_body[body], self.origin_of_body[body] + position, rotation

    def _anchor(self, description: Mapping, geoms: list[int]) -> np.ndarray:
        anchor = np.eye(4)
        if description.get("anchor"):
            _, link, anchor[:3, 3], anchor[:3, :3] = self._sensor({"site": description["anchor"]})
            if link != 0:
                raise ValueError(f"anchor {description['anchor']!r} is not a site of the palm's body")
            return anchor
        faces = [self._front(geom) for geom in geoms if self.link_of_body[self.model.geom_bodyid[geom]] == 0]
        anchor[0, 3] = max(faces, default=0.0)
        return anchor

    def _front(self, geom: int) -> float:
        """The largest x of a geom's bounding box in its body's frame."""
        centre, half = self.model.geom_aabb[geom, :3], self.model.geom_aabb[geom, 3:]
        rotation = _rotation(self.model.geom_quat[geom])
        return float(self.model.geom_pos[geom, 0] + rotation[0] @ centre + np.abs(rotation[0]) @ half)

    def _geom_shape(self, geom: int) -> tuple[str, np.ndarray, np.ndarray]:
        model = self.model
        kind = GEOM_KIND.get(mujoco.mjtGeom(model.geom_type[geom]))
        if kind is None:
            raise ValueError(f"geom {geom} ({model.geom(geom).name!r}) is a plane or a field: no part of a hand")
        if kind != "mesh":
            return kind, np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return (
            kind,
            model.mesh_vert[start : start + count].astype(float),
            model.mesh_face[first : first + faces].astype(int),
        )

    def _colour(self, geom: int) -> np.ndarray:
        material = self.model.geom_matid[geom]
        return self.model.mat_rgba[material] if material >= 0 else self.model.geom_rgba[geom]

    def _collides(self, geom: int) -> bool:
        return bool(self.model.geom_contype[geom] or self.model.geom_conaffinity[geom])


def _rotation(quaternions: np.ndarray) -> np.ndarray:
    """The rotation matrices (..., 3, 3) of quaternions (..., 4) as the engine has them, w first."""
    return Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
