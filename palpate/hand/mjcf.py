"""A user's hand, read from a MuJoCo model file (MJCF or URDF) into plain data."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from palpate.configuration import ConfigError, check, read_yaml
from palpate.hand.couplings import Couplings
from palpate.hand.hand import Hand, rotation_about
from palpate.hand.model import LEAST_INERTIA, LEAST_MASS, MUJOCO_GEOM
from palpate.sensor import DIGIT, Sensor

log = logging.getLogger(__name__)
SCHEMA = Path(__file__).with_name("schema.yaml")
# Of plausible hinges: at most two turns to a side; the widest of a hand more than some degrees.
FURTHEST_TURN, NARROWEST_TURNS = 4 * np.pi, 0.1
DEGREES = 'does `<compiler angle="..."/>` say degree or radian rightly?'
OPEN_TOLERANCE = 1e-3  # rad, of a slide m: an `open` that was rounded
CLOSED = 0.005  # m between the middles of two gels that face each other, which no open hand has

GROUPS = ("thumb", "opposes")  # of sensors

GEOM_KIND = {geom: kind for kind, geom in MUJOCO_GEOM.items()}


def from_mjcf(path: Path | str, sensors: Mapping | Path | str, gel_face: float = DIGIT.gel_face) -> Hand:
    """A hand of hinges and slides from a model file; ConfigError, naming the file, for what can't be used. sensors: a
    mapping or YAML file with the keys of `schema.yaml`. gel_face: m from the sensors' frames to the gel's face. The
    palm's frame is its body's, whose joints are omitted with a warning; others get a servo, or follow one that has, in
    their range."""
    path, named = Path(path), f"the sensors of {path}" if isinstance(sensors, Mapping) else str(sensors)
    description = sensors if isinstance(sensors, Mapping) else read_yaml(sensors)
    check(description, SCHEMA, named)
    try:
        return _Reader(_compile(path), path, named).hand(description, gel_face)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None


def check_files(model: Path | str, sensors: Path | str, sensor: Sensor) -> list[str]:
    """A sentence for each sensor whose gel's face is off its link, and for gels that touch in the open hand."""
    hand, messages = from_mjcf(model, sensors, sensor.gel_face), []
    for name, distance in zip(hand.sensor_names, hand.contact_distance(), strict=True):
        off = distance - sensor.gel_face
        where = f"{1e3 * abs(off):.0f} mm {'beyond' if off > 0 else 'behind'} its gel's face"
        where = where if distance else "not on its x"
        where += f", out of the range of {sensor.name}" * bool(distance > sensor.range)
        message = f"{sensors}: sensor {name!r}: the surface of its link is {where}; a site is in that face, x out of it"
        messages += [message] * bool(abs(off) > 0.002)
    position, rotation = hand.sensor_frames(hand.forward(np.eye(4), hand.open_joint_positions))
    gels = zip(hand.sensor_names, position + sensor.gel_face * rotation[:, :, 0], rotation[:, :, 0], strict=True)
    for (one, face, out), (other, other_face, other_out) in combinations(gels, 2):
        apart = np.linalg.norm(other_face - face)
        if apart < CLOSED and out @ other_out < 0:
            touch = f"gels {one!r} and {other!r} touch ({1e3 * apart:.0f} mm)"
            messages.append(f"{sensors}: the open hand is closed: {touch}: give `open`")
    return messages


def model_files(path: Path | str) -> list[Path]:
    """Existing files that a model file reads, sorted: meshes, textures, included models; none if it can't be read."""
    path = Path(path)
    try:
        files = {Path(name) for name in mujoco.mju_getXMLDependencies(str(path))}
        root = ElementTree.parse(path).getroot()
        if root.tag == "robot":
            files |= {Path(mesh.file) for mesh in _urdf(root, path).meshes}
    except (mujoco.FatalError, ElementTree.ParseError, OSError, ValueError):
        return []
    return sorted(file for file in files if file.is_file() and file != path)


def _compile(path: Path) -> mujoco.MjModel:
    """The model of a file. Raises ConfigError for a file that is no model."""
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError) as error:
        raise ConfigError(f"{path}: can't be read as XML: {error}") from None
    if root.tag == "mujocoinclude":
        raise ConfigError(f"{path}: has no body of its own, but is a part of a model: give the file that includes it")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise ConfigError(f"{path}: is a template: expand it, `xacro {path.name} > hand.urdf`")
    spec = _urdf(root, path) if root.tag == "robot" else mujoco.MjSpec.from_file(str(path))
    # Masses play no part: what is wrong with them is no error.
    spec.compiler.balanceinertia, spec.compiler.boundmass, spec.compiler.boundinertia = True, LEAST_MASS, LEAST_INERTIA
    try:
        return spec.compile()
    except ValueError:
        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # a flat one has no volume
        return spec.compile()


def _urdf(root: ElementTree.Element, path: Path) -> mujoco.MjSpec:
    """The specification of a URDF, its root a body, which MuJoCo alone makes part of the world, and its meshes found:
    relative to it, or below a folder above it (`package://`, with or without the package's name), or by their last part
    in the compiler's folder. Raises ConfigError for a mesh that is not there."""
    settings = root.find("mujoco/compiler")
    if settings is None:
        settings = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    shown = settings.get("discardvisual") == "false"  # by default visual meshes aren't read
    for mesh in root.iter("mesh") if shown else root.iterfind(".//collision/geometry/mesh"):
        name, folders = mesh.get("filename", ""), [path.parent, *path.absolute().parents]
        tail, own = Path(name.partition("://")[2] or name), path.parent / settings.get("meshdir", "")
        places = [folder / part for part in (tail, Path(*tail.parts[1:])) for folder in folders if part.parts]
        file = next((place for place in (*places, own / tail, own / tail.name) if place.is_file()), None)
        if file is None:
            raise ConfigError(f"{path}: no mesh {name!r} here, in a folder above, or in the `meshdir`")
        mesh.set("filename", str(file.resolve()))
    settings.attrib |= {"strippath": "false", "meshdir": "", "fusestatic": "false"}
    return mujoco.MjSpec.from_string(ElementTree.tostring(root, "unicode"))


class _Reader:
    """Rebases every body's frame so that its origin is on its joint's axis, as `Hand` has it."""

    def __init__(self, model: mujoco.MjModel, path: Path, source: str):
        self.model, self.path, self.source = model, path, source  # of the description of the sensors, for messages
        if model.nbody == 1:
            raise ValueError("the model has no body: give the file that includes it, if it is a part of one")
        self.collides = (model.geom_contype | model.geom_conaffinity) != 0  # or drawn only
        self.collides[[*model.pair_geom1, *model.pair_geom2]] = True
        self.links: list[tuple] = []
        self.joints: list[list] = []
        self.numbers: list[int] = []  # of the joints in the model
        self.link_of_body: dict[int, int] = {}
        self.origin_of_body: dict[int, np.ndarray] = {}  # the body frame's origin in its link's frame

    def hand(self, description: Mapping, gel_face: float) -> Hand:
        """The hand of a checked description of its sensors; `gel_face` and errors as of `from_mjcf`."""
        model = self.model
        palm = self._find("body", description["palm"]) if description.get("palm") else 1
        if palm == 0 and not model.body_geomnum[0] and (model.body_parentid[1:] == 0).sum() == 1:
            palm = 1  # a URDF's root link, which MuJoCo alone would make part of the world
        for joint in np.flatnonzero(model.jnt_bodyid == palm):
            kind = mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()
            log.warning("%s: the palm's %s joint is omitted: a grasp places the palm", self.path, kind)
        self._add_link((palm and model.body(palm).name) or "palm", -1, np.zeros(3), np.eye(3))
        self.link_of_body[palm], self.origin_of_body[palm] = 0, np.zeros(3)
        for body in range(palm + 1, model.nbody):
            if model.body_parentid[body] in self.link_of_body:
                self._add_body(body)
        geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in self.link_of_body]
        # Planes and fields of the world, and those that are drawn only, are no part of a hand.
        solid = [mujoco.mjtGeom(kind) in GEOM_KIND for kind in model.geom_type]
        geoms = [geom for geom in geoms if solid[geom] or (self.collides[geom] and model.geom_bodyid[geom])]
        turns = [(name, *limits) for _, _, slides, limits, name in self.joints if not slides and limits.any()]
        for name, low, high in turns:
            if max(-low, high) > FURTHEST_TURN:
                raise ValueError(f"the hinge of {name!r} turns from {low:g} to {high:g} rad: {DEGREES}")
        if turns and len(turns) == len(self.joints) and max(high - low for _, low, high in turns) < NARROWEST_TURNS:
            raise ValueError(f"no hinge turns by more than {np.degrees(NARROWEST_TURNS):.0f} degrees: {DEGREES}")
        coupled = Couplings(model, self.numbers)
        for number, joint in enumerate(self.joints):
            joint[3], joint[5:] = coupled.range[number], [coupled.driver[number], coupled.coefficients[number]]
            if np.isnan(joint[3]).any():
                raise ValueError(f"joint {joint[4]!r} has no range: give it one")
        given = description["sensors"]
        if twice := [sensor for number, sensor in enumerate(given) if sensor in given[:number]]:
            raise ConfigError(f"{self.source}: sensors: {twice[0]} is named twice")
        sensors = [self._sensor(sensor) for sensor in given]
        names, thumb, opposes = ([sensor[0] for sensor in sensors], *(description.get(k) or [] for k in GROUPS))
        for key, group in zip(GROUPS, (thumb, opposes), strict=True):
            if unknown := sorted(set(group) - set(names)):
                raise ConfigError(
                    f"{self.source}: `{key}` names {', '.join(unknown)}, which no sensor is called: {', '.join(names)}"
                )
        if opposes and set(opposes) == set(names):
            raise ConfigError(f"{self.source}: `opposes` names all sensors: name those of one side of an object")
        if not self.joints:
            raise ConfigError(f"{self.source}: no joint is below the palm, {self.links[0][0]!r}: name another `palm`")
        faces = [(name, name in thumb, link, at - gel_face * turn[:, 0], turn) for name, link, at, turn in sensors]
        rows: dict[str, Any] = {"link": self.links, "joint": self.joints, "sensor": faces}
        rows["geom"] = [self._geom(geom) for geom in geoms]
        reference = np.clip(model.qpos0[model.jnt_qposadr[self.numbers]], *coupled.range.T)
        read = Hand.from_rows(self.path.stem, rows, reference, self._anchor(description, geoms))
        opened = self._open(description.get("open"), read)
        opposing = np.isin(names, opposes) if opposes else None
        colliding = self._colliding(read, geoms)
        return replace(read, open_joint_positions=opened, colliding_pairs=colliding, opposing_sensors=opposing)

    def _find(self, kind: str, name: str) -> int:
        """The number of a body or a site that the description of the sensors names."""
        try:
            return getattr(self.model, kind)(name).id
        except KeyError:
            known = (getattr(self.model, kind)(number).name for number in range(getattr(self.model, f"n{kind}")))
            names = ", ".join(filter(None, known))
            raise ConfigError(f"{self.source}: {self.path} has no {kind} {name!r}, but {names or 'none'}") from None

    def _open(self, given: Sequence[float] | Mapping[str, float] | None, hand: Hand) -> np.ndarray:
        """Joint positions (J,) of the open hand; those that are not given are at the reference, or follow."""
        names, start = list(hand.joint_names), hand.open_joint_positions.copy()
        if isinstance(given, Sequence) and len(given) != len(names):
            counts = f"{len(given)} joint positions, the hand has {len(names)} joints"
            raise ConfigError(f"{self.source}: `open` has {counts}: {', '.join(names)}")
        given = dict(zip(names, given, strict=True)) if isinstance(given, Sequence) else given or {}
        if unknown := [name for name in given if name not in names]:
            raise ConfigError(f"{self.source}: `open`: no joint {unknown[0]!r}, but {', '.join(names)}")
        joints = [names.index(name) for name in given]
        start[joints] = [*given.values()]
        start = hand.follow(start)
        for joint, position in zip(joints, given.values(), strict=True):
            low, high = hand.joint_range[joint]
            if not low - OPEN_TOLERANCE <= position <= high + OPEN_TOLERANCE:
                limits = f"{names[joint]!r}, {low:g} to {high:g}: give radians, of slides metres"
                raise ConfigError(f"{self.source}: `open`: {position:g} is out of the range of {limits}")
            if abs(start[joint] - position) > OPEN_TOLERANCE:
                driver = names[hand.joint_driver[joint]]
                followed = f"{names[joint]!r} follows {driver!r} to {start[joint]:.4g}, not {position:g}"
                raise ConfigError(f"{self.source}: `open`: {followed}: give {driver!r} alone")
        return hand.follow(np.clip(start, *hand.joint_range.T))

    def _colliding(self, hand: Hand, geoms: list[int]) -> np.ndarray:
        """Those of the `colliding_pairs` (P, 2) whose contype and conaffinity let them collide and no `exclude`
        forbids, and each `pair`, as MuJoCo has it. geoms: the model's numbers of the hand's."""
        model, body = self.model, self.model.geom_bodyid[geoms]
        meets = (model.geom_contype[geoms, None] & model.geom_conaffinity[geoms]) != 0
        excluded = np.isin((body[:, None] << 16) + body, model.exclude_signature)
        meets = (meets | meets.T) & ~(excluded | excluded.T)
        pairs = [pair for pair in hand.colliding_pairs.tolist() if meets[*pair]]
        named = np.stack([model.pair_geom1, model.pair_geom2], axis=-1).tolist()
        pairs += [sorted(geoms.index(geom) for geom in pair) for pair in named if set(pair) <= set(geoms)]
        return np.unique(np.array(pairs, dtype=int).reshape(-1, 2), axis=0)

    def _add_link(self, name: str, parent: int, position: np.ndarray, rotation: np.ndarray) -> int:
        """Add a link, whose name is made unlike all others; returns its number."""
        while name == "world" or any(name == link[0] for link in self.links):  # names of bodies of the simulation
            name += "_"
        self.links.append((name, parent, position, rotation))
        return len(self.links) - 1

    def _add_body(self, body: int) -> None:
        """A body as one link for each of its joints (one if it has none), each link's origin on its joint."""
        model, parent_body = self.model, self.model.body_parentid[body]
        name, parent = model.body(body).name or f"body_{body}", self.link_of_body[parent_body]
        position = self.origin_of_body[parent_body] + model.body_pos[body]
        rotation, anchor = _rotation(model.body_quat[body]), np.zeros(3)
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        if count == 0:
            parent = self._add_link(name, parent, position, rotation)
        for number, joint in enumerate(range(first, first + count)):
            kind = mujoco.mjtJoint(model.jnt_type[joint])
            if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                raise ValueError(f"joint {model.joint(joint).name!r} is neither hinge nor slide: others can't be read")
            slides = kind == mujoco.mjtJoint.mjJNT_SLIDE
            anchor_now, axis = model.jnt_pos[joint].copy(), model.jnt_axis[joint].copy()
            reference = model.qpos0[model.jnt_qposadr[joint]]
            position = position + rotation @ (anchor_now - anchor)
            if slides:
                position = position - reference * rotation @ axis
            else:
                rotation = rotation @ rotation_about(axis, -reference)
            link_name = name if number == count - 1 else f"{name}_{number}"
            parent = self._add_link(link_name, parent, position, rotation)
            limits, joint_name = model.jnt_range[joint].copy(), model.joint(joint).name or link_name
            self.joints.append([parent, axis, slides, limits, joint_name])
            self.numbers.append(joint)
            position, rotation, anchor = np.zeros(3), np.eye(3), anchor_now
        self.link_of_body[body], self.origin_of_body[body] = parent, -anchor

    def _sensor(self, sensor: Mapping[str, Any]) -> tuple[str, int, np.ndarray, np.ndarray]:
        """Name, link, position and rotation of a sensor given by a site, or by a body and a pose in it."""
        model = self.model
        if "site" in sensor:
            site = self._find("site", sensor["site"])
            name, body = sensor["site"], model.site_bodyid[site]
            position, rotation = model.site_pos[site], _rotation(model.site_quat[site])
        else:
            name, body = sensor["body"], self._find("body", sensor["body"])
            position = np.asarray(sensor.get("position", (0, 0, 0)), dtype=float)
            rotation = Rotation.from_euler("xyz", sensor.get("rotation", (0, 0, 0))).as_matrix()
        if body not in self.link_of_body:
            raise ConfigError(f"{self.source}: {name!r} is not on the hand: its body is not below the palm")
        return name, self.link_of_body[body], self.origin_of_body[body] + position, rotation

    def _anchor(self, description: Mapping, geoms: list[int]) -> np.ndarray:
        """The pose (4, 4) that is described, or on the face of the palm's geoms that is farthest along its x."""
        anchor = np.eye(4)
        if given := description.get("anchor"):
            given = {"site": given} if isinstance(given, str) else given
            name, link, anchor[:3, 3], anchor[:3, :3] = self._sensor(given)
            if link != 0:
                raise ConfigError(f"{self.source}: anchor {name!r} is not on the palm's body")
            return anchor
        model = self.model
        faces: list[float] = []  # the largest x of each geom's bounding box in the palm's frame
        for geom in geoms:
            if self.link_of_body[model.geom_bodyid[geom]] == 0:
                turn, centre, half = _rotation(model.geom_quat[geom])[0], *np.split(model.geom_aabb[geom], 2)
                faces.append(model.geom_pos[geom, 0] + turn @ centre + np.abs(turn) @ half)
        anchor[0, 3] = max(faces, default=0.0)
        return anchor

    def _geom(self, geom: int) -> tuple:
        """The row of a geom for `Hand.from_rows`."""
        model, body = self.model, self.model.geom_bodyid[geom]
        kind = GEOM_KIND.get(mujoco.mjtGeom(model.geom_type[geom]))
        if kind is None:
            raise ValueError(f"geom {geom} ({model.geom(geom).name!r}) is a plane or a field: no part of a hand")
        vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
        if kind == "mesh":
            mesh = model.mesh(model.geom_dataid[geom])
            start, first = mesh.vertadr[0], mesh.faceadr[0]
            vertices = model.mesh_vert[start : start + mesh.vertnum[0]].astype(float)
            faces = model.mesh_face[first : first + mesh.facenum[0]].astype(int)
        position, rotation = self.origin_of_body[body] + model.geom_pos[geom], _rotation(model.geom_quat[geom])
        material = model.geom_matid[geom]
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        size, link = model.geom_size[geom], self.link_of_body[body]
        return link, kind, size, position, rotation, colour, self.collides[geom], vertices, faces


def _rotation(quaternions: np.ndarray) -> np.ndarray:
    """The rotation matrices (..., 3, 3) of quaternions (..., 4) as the engine has them, w first."""
    return Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
