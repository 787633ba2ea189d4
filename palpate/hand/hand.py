"""A robot hand as plain data: a tree of links on hinges and slides, closed geoms, and touch sensors; no engine."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, get_origin

import numpy as np
from numpy.typing import ArrayLike

from palpate.configuration import read_yaml
from palpate.sensor import DIGIT

GEOM_KINDS = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "mesh")
MAX_PENETRATION = 0.001  # m that a grasp's hand may be in the object or in itself; `grasps.max_penetration`
# rad (of a slide m) that a grasp's joint may be out of its range: MuJoCo's limits are springs. Of 8,655 grasps one had
# more than 0.0006.
MAX_OUT_OF_RANGE = 0.001
DURATION = 0.4  # s that a hand takes to close
# Of `Hand`: types of arrays that are not float, by the second word of their names.
DTYPES = {"parent": int, "link": int, "driver": int, "slides": bool, "collides": bool, "thumb": bool}
Rows = Sequence[Sequence[Any]]
SMALLEST, LARGEST = 0.01, 1.0  # m, from end to end: hands of other sizes don't close in a stable way


@dataclass(frozen=True, eq=False)
class Hand:
    """A kinematic tree of L links with J joints, G geoms and s touch sensors. Metres, radians.

    Parents precede children; link 0 is the palm, its frame the palm frame. Joint `j` turns link `joint_link[j]` about
    an axis through the origin of the link's frame, or slides it along the axis; a link without a joint is fixed to its
    parent. Geom sizes follow MuJoCo: box (half extents), sphere (radius), capsule and cylinder (radius, half length
    along z), ellipsoid (half axes); a mesh is the convex hull of its vertices and has no size. Columns of rotations are
    the frame's axes in the frame it is given in.
    """

    name: str
    link_names: tuple[str, ...]  # L
    link_parent: np.ndarray  # (L,) int, -1 for the palm
    link_position: np.ndarray  # (L, 3) in the parent's frame, with all joints at 0
    link_rotation: np.ndarray  # (L, 3, 3) in the parent's frame, with all joints at 0
    joint_link: np.ndarray  # (J,) int
    joint_axis: np.ndarray  # (J, 3) unit vector in the link's frame
    joint_slides: np.ndarray  # (J,) bool: a slide, whose positions are metres; the others are hinges: radians
    joint_range: np.ndarray  # (J, 2)
    joint_names: tuple[str, ...]  # J
    joint_driver: np.ndarray  # (J,) int: the joint that it follows; itself if it has a servo
    joint_coupling: np.ndarray  # (J, 5): its position as factors of powers 0 to 4 of its driver's
    geom_link: np.ndarray  # (G,) int
    geom_kind: tuple[str, ...]  # G of GEOM_KINDS
    geom_size: np.ndarray  # (G, 3)
    geom_position: np.ndarray  # (G, 3) in the link's frame
    geom_rotation: np.ndarray  # (G, 3, 3) in the link's frame
    geom_rgba: np.ndarray  # (G, 4)
    geom_collides: np.ndarray  # (G,) bool; the others are drawn only
    geom_vertices: tuple[np.ndarray, ...]  # G of (V, 3) in the geom's frame, empty unless the geom is a mesh
    geom_faces: tuple[np.ndarray, ...]  # G of (F, 3) int
    sensor_names: tuple[str, ...]  # s
    sensor_thumb: np.ndarray  # (s,) bool: of the thumb, which closes in a share of the attempts only
    sensor_link: np.ndarray  # (s,) int
    sensor_position: np.ndarray  # (s, 3) in the link's frame
    sensor_rotation: np.ndarray  # (s, 3, 3) in the link's frame; x out of the gel, y columns, z rows
    open_joint_positions: np.ndarray  # (J,)
    palm_anchor: np.ndarray  # (4, 4) in the palm frame: on the palm's face, x its outward normal, z to the fingers
    colliding_pairs: np.ndarray  # (P, 2) int: geoms that collide with each other, the lower number first
    opposing_sensors: np.ndarray | None = None  # (s,) bool: those on one of two sides of an object; None: not said

    def __post_init__(self) -> None:
        problem, unknown = "", set(self.geom_kind) - set(GEOM_KINDS)
        if not len(self.sensor_link) or self.sensor_thumb.all():
            thumb = " but the thumb's" * bool(len(self.sensor_link))
            problem = f"has no touch sensor{thumb}: name one or more sensor frames of other fingers"
        elif not np.isfinite(self.joint_range).all() or (self.joint_range[:, 0] > self.joint_range[:, 1]).any():
            problem = "has a joint without a finite range (low, high) in radians or metres: give it one"
        elif unknown:
            problem = f"has geoms of kind {sorted(unknown)}: use {', '.join(GEOM_KINDS)}"
        elif not self.geom_collides.any():
            problem = "has no geom that collides: its fingers would pass through objects"
        elif not SMALLEST <= (length := self.length()) <= LARGEST:
            limits = f"{SMALLEST:g} to {LARGEST:g} m: give all lengths in metres"
            problem = f"is {length:.3g} m from end to end, not {limits}"
        if problem:
            raise ValueError(f"hand {self.name!r} {problem}")

    @classmethod
    def from_rows(cls, name: str, rows: Mapping[str, Rows], opened: ArrayLike, palm_anchor: np.ndarray) -> "Hand":
        """The hand of rows of each link, joint, geom and sensor, attributes in order, and its open joint positions.
        Geoms that collide do so with each other, but for `adjacent_links`."""
        values: dict[str, Any] = {}
        for group, own in rows.items():
            attributes = [field for field in fields(cls) if field.name.startswith(f"{group}_")]
            columns: Iterable[tuple] = zip(*own, strict=True) if own else [()] * len(attributes)
            for attribute, column in zip(attributes, columns, strict=True):
                dtype = DTYPES.get(attribute.name.split("_")[1], float)
                is_tuple = get_origin(attribute.type) is tuple
                values[attribute.name] = column if is_tuple else np.array(column, dtype=dtype)
        values["joint_range"] = values["joint_range"].reshape(-1, 2)
        values |= {"open_joint_positions": np.array(opened), "palm_anchor": palm_anchor}
        hand = cls(name, **values, colliding_pairs=np.zeros((0, 2), dtype=int))
        collides, link = hand.geom_collides, hand.geom_link
        meets = collides & collides[:, None] & ~hand.adjacent_links()[link, link[:, None]]
        return replace(hand, colliding_pairs=np.argwhere(np.triu(meets, k=1)))

    def length(self) -> float:
        """Metres of the open hand along an axis of the palm, by geoms' centres and sensors, or of its largest geom."""
        links = self.forward(np.eye(4), self.open_joint_positions)
        places = [self.geom_poses(links)[self.geom_collides, :3, 3], self.sensor_frames(links)[0]]
        own = np.array([np.ptp(shape, axis=0).max() if len(shape) else 0 for shape in self.geom_vertices])
        meshes = np.array(self.geom_kind) == "mesh"  # whose `geom_size` is not theirs
        geoms = np.where(meshes, own, 2 * self.geom_size.max(axis=1))[self.geom_collides]
        return float(max(np.ptp(np.concatenate(places), axis=0).max(), geoms.max()))

    def contact_distance(self) -> np.ndarray:
        """Metres (s,) from each sensor's origin to where its +x axis leaves its link's geoms; 0 if it misses them."""
        link_pose = self.forward(np.eye(4), self.open_joint_positions)
        position, rotation = self.sensor_frames(link_pose)
        along, distances = np.linspace(0, 0.05, 501), []
        for link, start, axes in zip(self.sensor_link, position, rotation, strict=True):
            inside = self.signed_distance(start + along[:, None] * axes[:, 0], link_pose, links=[link]) < 0
            distances.append(along[inside].max(initial=0.0))
        return np.array(distances)

    def forward(self, palm_pose: np.ndarray, joint_positions: np.ndarray) -> np.ndarray:
        """World poses (..., L, 4, 4) of links for palm_pose (..., 4, 4) and joint_positions (..., J), broadcast. Raises
        ValueError for another J."""
        palm_pose, joint_positions = np.asarray(palm_pose), np.asarray(joint_positions)
        if joint_positions.shape[-1:] != self.joint_link.shape:
            raise ValueError(f"expected {len(self.joint_link)} joint positions, got {joint_positions.shape}")
        leading = np.broadcast_shapes(palm_pose.shape[:-2], joint_positions.shape[:-1])
        pose = np.zeros((*leading, len(self.link_names), 4, 4))
        pose[..., 3, 3] = 1
        pose[..., 0, :, :] = palm_pose
        turn = rotation_about(self.joint_axis, np.where(self.joint_slides, 0, joint_positions))  # (..., J, 3, 3)
        for link in range(1, len(self.link_names)):
            parent = pose[..., self.link_parent[link], :, :]
            rotation = parent[..., :3, :3] @ self.link_rotation[link]
            joint = self.joint_of_link[link]
            if joint >= 0:
                rotation = rotation @ turn[..., joint, :, :]
            pose[..., link, :3, :3] = rotation
            pose[..., link, :3, 3] = parent[..., :3, :3] @ self.link_position[link] + parent[..., :3, 3]
            if joint >= 0 and self.joint_slides[joint]:
                pose[..., link, :3, 3] += joint_positions[..., joint, None] * (rotation @ self.joint_axis[joint])
        return pose

    @cached_property
    def joint_of_link(self) -> np.ndarray:
        """Numbers (L,) of the joints that move the links, -1 for a link that is fixed to its parent."""
        joints = np.full(len(self.link_names), -1)
        joints[self.joint_link] = np.arange(len(self.joint_link))
        return joints

    @cached_property
    def geom_planes(self) -> tuple[np.ndarray, ...]:
        """Half spaces (P, 4) of each geom that is a colliding mesh, as `half_spaces` gives them; empty for others."""
        meshes = zip(self.geom_collides & (np.array(self.geom_kind) == "mesh"), self.geom_vertices, strict=True)
        return tuple(half_spaces(vertices) if mesh else np.zeros((0, 4)) for mesh, vertices in meshes)

    @property
    def drivers(self) -> np.ndarray:
        """Numbers of the joints that have a servo; the others follow them."""
        return np.flatnonzero(self.joint_driver == np.arange(len(self.joint_link)))

    def follow(self, joint_positions: np.ndarray) -> np.ndarray:
        """Joint positions (..., J) with coupled joints where those that drive them put them."""
        if len(self.drivers) == len(self.joint_link):
            return joint_positions
        return (self.joint_coupling * joint_positions[..., self.joint_driver, None] ** np.arange(5)).sum(axis=-1)

    def follow_slopes(self, joint_positions: np.ndarray) -> np.ndarray:
        """Derivatives (..., J, J) of `follow`: of each joint by each."""
        powers = joint_positions[..., self.joint_driver, None] ** np.arange(4)
        slope = (self.joint_coupling[:, 1:] * np.arange(1, 5) * powers).sum(axis=-1)
        return slope[..., None] * (self.joint_driver[:, None] == np.arange(len(self.joint_link)))

    def sensor_frames(self, link_pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensor positions (..., s, 3) and rotations (..., s, 3, 3), of link poses (..., L, 4, 4)."""
        pose = np.asarray(link_pose)[..., self.sensor_link, :, :]
        rotation = pose[..., :3, :3] @ self.sensor_rotation
        position = (pose[..., :3, :3] @ self.sensor_position[:, :, None])[..., 0] + pose[..., :3, 3]
        return position, rotation

    def out_of_range(self, joint_positions: np.ndarray) -> np.ndarray:
        """Radians (of a slide metres) that the worst joint is out of its range (...); of joint positions (..., J)."""
        low, high = self.joint_range.T
        return np.maximum(low - joint_positions, joint_positions - high).max(axis=-1).clip(0)

    def geom_poses(self, link_pose: np.ndarray) -> np.ndarray:
        """Poses (..., G, 4, 4) of the geoms in the world, of link poses (..., L, 4, 4)."""
        local = np.zeros((len(self.geom_kind), 4, 4))
        local[:, :3, :3], local[:, :3, 3], local[:, 3, 3] = self.geom_rotation, self.geom_position, 1
        return np.asarray(link_pose)[..., self.geom_link, :, :] @ local

    def geom_distance(self, geom: int, points: np.ndarray, geom_pose: np.ndarray) -> np.ndarray:
        """Signed distance (N,) of points (N, 3) to one geom at `geom_pose` (4, 4), negative inside."""
        local = (points - geom_pose[:3, 3]) @ geom_pose[:3, :3]
        return signed_distance(self.geom_kind[geom], self.geom_size[geom], local, self.geom_planes[geom])

    def signed_distance(
        self, points: np.ndarray, link_pose: np.ndarray, links: Collection[int] | None = None
    ) -> np.ndarray:
        """Signed distance (N,) of points (N, 3) to colliding geoms (of these links), links at (L, 4, 4); < 0 inside."""
        poses = self.geom_poses(link_pose)
        nearest = np.full(len(points), np.inf)
        for geom in np.flatnonzero(self.geom_collides):
            if links is None or self.geom_link[geom] in links:
                np.minimum(nearest, self.geom_distance(geom, points, poses[geom]), out=nearest)
        return nearest

    def adjacent_links(self) -> np.ndarray:
        """Which links never collide with each other, (L, L) bool: rigidly joined, or one joint apart. Links without
        colliding geoms (the joints of a body with several hinges) don't count between others."""
        rigid = np.arange(len(self.link_names))  # the first link of the rigid body that a link belongs to
        for link in range(1, len(rigid)):
            if self.joint_of_link[link] < 0:
                rigid[link] = rigid[self.link_parent[link]]
        has_geoms = np.isin(np.arange(len(rigid)), rigid[self.geom_link[self.geom_collides]])
        adjacent = rigid[:, None] == rigid[None, :]
        for first in np.unique(rigid):
            before = self.link_parent[first]
            while before >= 0 and not has_geoms[rigid[before]]:
                before = self.link_parent[rigid[before]]
            if before >= 0:
                pair = (rigid == first)[:, None] & (rigid == rigid[before])[None, :]
                adjacent |= pair | pair.T
        return adjacent

    def to_arrays(self) -> dict[str, np.ndarray]:
        """The hand as named arrays (strings as bytes), such as HDF5 and Zarr store; see `from_arrays`."""
        arrays: dict[str, np.ndarray] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("geom_vertices", "geom_faces"):
                arrays[field.name] = np.concatenate([np.reshape(array, (-1, 3)) for array in value])
                arrays[f"{field.name}_count"] = np.array([len(array) for array in value])
            elif isinstance(value, np.ndarray):
                arrays[field.name] = value
            elif value is not None:
                arrays[field.name] = np.array([name.encode() for name in np.atleast_1d(value)])
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Any, prefix: str = "") -> "Hand":
        """The hand of `to_arrays`; arrays: by name (a mapping, a store, an HDF5 group); prefix: of the names in it."""
        values: dict[str, Any] = {}
        for field in fields(cls):
            name = f"{prefix}{field.name}"
            if field.name == "opposing_sensors" and name not in arrays:
                continue
            value = np.asarray(arrays[name][...])
            if field.name in ("geom_vertices", "geom_faces"):
                values[field.name] = tuple(np.split(value, np.cumsum(arrays[f"{name}_count"][...])[:-1]))
            elif value.dtype.kind in "SUO":
                names = tuple(text.decode() if isinstance(text, bytes) else str(text) for text in value.tolist())
                values[field.name] = names[0] if field.name == "name" else names
            else:
                values[field.name] = value
        return cls(**values)


def rotation_about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) by `angle` (...) about unit vectors `axis` (..., 3): Rodrigues' formula."""
    axis, angle = np.asarray(axis, dtype=float), np.asarray(angle, dtype=float)
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*axis.shape[:-1], 3, 3)
    sine, versine = np.sin(angle)[..., None, None], (1 - np.cos(angle))[..., None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


def signed_distance(kind: str, size: np.ndarray, points: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Signed distance (N,) of points (N, 3) to a geom in its own frame. size: (3,) as in `Hand`; planes: (P, 4) of a
    mesh, see `half_spaces`. Exact, but outside a mesh, where it is never farther than the true one."""
    if kind == "mesh":
        return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    if kind == "sphere":
        return np.linalg.norm(points, axis=1) - size[0]
    if kind == "box":
        excess = np.abs(points) - size
        return np.linalg.norm(np.maximum(excess, 0), axis=1) + np.minimum(excess.max(axis=1), 0)
    if kind == "ellipsoid":
        # The nearest point of the surface has coordinates a^2 p / (a^2 + t) for half axes a and the greatest t for
        # which they are on it, found by bisection from the least it can be (Eberly 2013, "Distance from a Point to an
        # Ellipse, an Ellipsoid, or a Hyperellipsoid").
        points = np.maximum(np.abs(points), 1e-15)  # in a plane of symmetry the nearest point need not be in it
        scaled, squares = size * points, np.square(size)
        beyond = squares - squares.min()  # t + a^2, less that of the shortest axis
        low, high = scaled[:, np.argmin(size)], np.linalg.norm(scaled, axis=1)
        for _ in range(50):  # to rounding
            middle = np.sqrt(low * high)
            outside = np.square(scaled / (middle[:, None] + beyond)).sum(axis=1) > 1
            low, high = np.where(outside, middle, low), np.where(outside, high, middle)
        nearest = size * scaled / (high[:, None] + beyond)
        sign = np.where(np.square(points / size).sum(axis=1) < 1, -1, 1)
        return sign * np.linalg.norm(points - nearest, axis=1)
    radius, half_length, _ = size
    if kind == "capsule":
        along = np.clip(points[:, 2], -half_length, half_length)
        return np.linalg.norm(points - along[:, None] * np.array([0.0, 0.0, 1.0]), axis=1) - radius
    radial, axial = np.linalg.norm(points[:, :2], axis=1) - radius, np.abs(points[:, 2]) - half_length
    outside = np.hypot(np.maximum(radial, 0), np.maximum(axial, 0))
    return outside + np.minimum(np.maximum(radial, axial), 0)


def half_spaces(vertices: np.ndarray) -> np.ndarray:
    """The convex hull of vertices (V, 3) as half spaces (P, 4): normal n and offset, n . x + offset < 0 inside."""
    from scipy.spatial import ConvexHull

    return np.unique(np.round(ConvexHull(vertices).equations, 9), axis=0)


def allegro(gel_face: float = DIGIT.gel_face) -> Hand:
    """The Allegro hand with four DIGITs as fingertips: 16 joints, four each of index, middle, ring finger and thumb.
    Palm frame: +x the palm's normal (towards the object), +z along the fingers; the thumb is at -y. gel_face: m from
    the sensor frame to the gel's face, of another sensor in the DIGIT's place."""
    given = read_yaml(Path(__file__).with_name("allegro.yaml"))
    rows: dict[str, list[tuple]] = {"link": [("palm", -1, (0, 0, 0), np.eye(3))], "joint": [], "geom": [], "sensor": []}
    links, joints, geoms, sensors = rows.values()

    def add_box(link: int, centre: ArrayLike, half_extents: ArrayLike, colour: str) -> None:
        no_mesh = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
        geoms.append((link, "box", half_extents, centre, np.eye(3), given["colours"][colour], True, *no_mesh))

    def add_between(link: int, bounds: Sequence[Sequence[float]], colour: str) -> None:
        low, high = np.transpose(bounds)
        add_box(link, (low + high) / 2, (high - low) / 2, colour)

    palm = given["palm"]
    for box in palm["boxes"]:
        add_between(0, [palm["x"], *box], "link")
    sensor_position = given["sensor"] + np.array([DIGIT.gel_face - gel_face, 0, 0])
    for name, finger in given["fingers"].items():
        link = 0
        for number, phalanx in enumerate(finger["links"]):
            # Roll, pitch and yaw about fixed axes, as in a URDF. scipy's rounds otherwise: stored hands would change.
            x, y, z = rotation_about(np.eye(3), np.array(phalanx["turn"]))
            links.append((f"{name}_{number}", link, phalanx["position"], z @ y @ x))
            link = len(links) - 1
            joint = len(joints)
            joints.append((link, phalanx["axis"], False, phalanx["range"], links[link][0], joint, (0, 1, 0, 0, 0)))
            add_box(link, phalanx["centre"], phalanx["half_extents"], "link")
        links.append((f"{name}_tip", link, (0, 0, finger["tip"]), np.eye(3)))
        tip = len(links) - 1
        add_between(tip, given["digit"], "digit")
        add_between(tip, given["gel"], "gel")
        sensors.append((name, name == "thumb", tip, sensor_position, np.eye(3)))

    anchor = np.eye(4)
    anchor[:3, 3] = (palm["x"][1], 0, palm["anchor_height"])
    return Hand.from_rows("allegro", rows, given["open"], anchor)
