"""Checks of one object: every array of its rows, against the contract, the mesh and each other.

Each check is a number that must not exceed its limit: a distance, or a count of wrong values. `checks.csv`
says what each measures.
"""

import csv
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from palpate.camera import Camera
from palpate.hand import MAX_OUT_OF_RANGE, MAX_PENETRATION, Hand
from palpate.mesh import DIAGONAL, MAX_DEVIATION, OBJECT_POSITION, Geometry, load_collision, load_geometry, read_record
from palpate.sensor import DIGIT, Sensor
from palpate.store.contract import CONTRACT
from palpate.touch import local_points, shade, shade_pressed

if TYPE_CHECKING:
    from palpate.mesh.distance import Surface
    from palpate.surface.embree import RayMesh

# libigl would use every core for one batch, but batches are what is done in parallel. Read at its first use.
os.environ.setdefault("IGL_NUM_THREADS", "1")

ON_MESH = 1e-4  # metres
EXACT = 1e-6  # metres, or per unit of a rotation: float32 coordinates below 1 m are good to 6e-8
DEPTH_STEP = 2.0**-10  # relative: the step of a float16 between 1 and 2 m, twice that between 2 and 4 m
HAND_REACH = 0.5  # metres: no part of a hand that touches an object is further from it
OUTLINE = 0.01  # share of pixels: one whose centre lies on an outline may fall on either side of it
OUTLINE_PIXELS = 5  # so many may do so in any picture: of a small or thin object they are a larger share


class Check(NamedTuple):
    """What a check measures; it passes if that is at most `limit`."""

    limit: float
    measures: str


# What each check measures, in the order of the table in docs/dataset.md; a limit is a number, or one of these.
LIMITS = {"EXACT": EXACT, "ON_MESH": ON_MESH, "OUTLINE": OUTLINE, "MAX_DEVIATION": MAX_DEVIATION + EXACT}
LIMITS |= {"MAX_OUT_OF_RANGE": MAX_OUT_OF_RANGE, "MAX_PENETRATION": MAX_PENETRATION}
with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
    rows = list(csv.DictReader(file))
CHECKS = {row["check"]: Check(LIMITS.get(row["limit"]) or int(row["limit"]), row["measures"]) for row in rows}


# Checks that need a compiled engine of the extra `factory`, and the engine.
ENGINES = {"on mesh": "igl", "collision mesh": "igl", "picture of mesh": "embreex", "outside": "embreex"}


@cache
def can_check(check: str) -> bool:
    """Whether the engine that a check needs, if any, is installed."""
    try:
        import_module(ENGINES.get(check, "numpy"))
    except ImportError:
        return False
    return True


@dataclass
class CheckedObject:
    """One object of a batch: its rows of every store that has it, its mesh, the hand and its kind of sensor."""

    rows: dict[str, dict[str, np.ndarray]]  # stage -> array -> the object's row
    folder: Path
    hand: Hand | None = None  # without it grasps and frames are not checked
    sensor: Sensor = DIGIT

    @cached_property
    def mesh(self) -> Geometry:
        """The visual mesh in the world."""
        vertices, faces = load_geometry(self.folder)
        return Geometry(vertices + OBJECT_POSITION, faces)

    @cached_property
    def surface(self) -> "Surface":
        """What finds distances to the mesh."""
        from palpate.mesh.distance import Surface

        return Surface(*self.mesh)

    @cached_property
    def rays(self) -> "RayMesh":
        """What casts rays at the mesh, in the world."""
        from palpate.surface.embree import RayMesh

        return RayMesh(self.mesh)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (3,) of the box around the mesh's faces, in the world."""
        corners = self.mesh.vertices[self.mesh.faces.ravel()]
        return corners.min(axis=0), corners.max(axis=0)

    @cached_property
    def diagonal(self) -> float:
        """What the mesh's bounding box should measure from corner to corner, m: of an object that keeps its size, the
        source file's box at the scale that the object was given."""
        record = read_record(self.folder)
        if record.get("source", {}).get("scale", "diagonal") == "diagonal":
            return DIAGONAL
        low, high = np.array(record["source"]["bounding_box"])
        return record["scale"] * float(np.linalg.norm(high - low))

    @cached_property
    def see_through(self) -> bool:
        """Whether the mesh has transparent materials; False if its record does not state it."""
        return read_record(self.folder).get("visual.glb", {}).get("see_through", False)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Exact distance (n,) from points (n, 3) in the world to the mesh; NaN for one that is not finite."""
        finite, distance = np.isfinite(points).all(axis=1), np.full(len(points), np.nan)
        if finite.any():
            distance[finite] = self.surface.closest(np.asarray(points, dtype=np.float64)[finite])[0]
        return distance


# A check's name and what it measured: one number, or one a grasp, or one a grasp and sensor.
Measured = Iterator[tuple[str, np.ndarray | float]]


def check_mesh(item: CheckedObject) -> Measured:
    low, high = item.bounds
    off_centre = np.abs((low + high) / 2 - OBJECT_POSITION).max()
    yield "scale", max(off_centre, abs(np.linalg.norm(high - low) - item.diagonal))
    if can_check("collision mesh"):
        from palpate.mesh.distance import Surface, hausdorff

        collision = load_collision(item.folder)
        yield "collision mesh", hausdorff(item.surface, Surface(collision.vertices + OBJECT_POSITION, collision.faces))


def check_surface(item: CheckedObject) -> Measured:
    points = item.rows["surface"]["points"]
    low, high = item.bounds
    yield "inside box", np.maximum(low - points, points - high).max(initial=0)
    if can_check("on mesh"):
        yield "on mesh", item.distance(points).max(initial=0)


def check_grasps(item: CheckedObject) -> Measured:
    rows, hand = item.rows["grasps"], cast(Hand, item.hand)
    affine = np.abs(rows["palm_pose"][:, 3] - [0, 0, 0, 1]).max(axis=1)
    yield "rotation", np.maximum(rotation_error(rows["palm_pose"][:, :3, :3]), affine)
    joints = rows["joint_positions"]
    yield "joint limits", hand.out_of_range(joints)
    yield "kinematics", _pose_error(hand, hand.forward(rows["palm_pose"], joints), rows)
    yield "penetration", np.where(rows["penetration"] >= 0, rows["penetration"], np.inf)
    if "surface" in item.rows:
        points = item.rows["surface"]["points"]
        yield "in hand", np.array([_depth_in_hand(hand, pose, points) for pose in rows["link_pose"]])


def check_touch(item: CheckedObject) -> Measured:
    rows = item.rows["touch"]
    depth, success, count = rows["depth"], rows["success"], rows["point_count"]
    yield "touch depth", np.sum(_out_of_range(depth, item.sensor), axis=(2, 3))
    finite = np.isfinite(depth)
    yield "success", success != finite.any(axis=(2, 3))
    yield "one touch", ~success.any(axis=1)
    yield "point count", np.abs(count - finite.sum(axis=(2, 3)))
    points_error = np.zeros(success.shape)
    for index in np.ndindex(success.shape):
        try:
            cloud = local_points(*(rows[name][index] for name in ("depth", "position", "rotation")), item.sensor)
        except ValueError:  # no position at all, or one that no point can be stored at
            points_error[index] = np.inf
            continue
        points = rows["points"][index]
        points_error[index] = np.abs(points - np.pad(cloud, ((0, len(points) - len(cloud)), (0, 0)))).max()
    yield "points", points_error
    if "indentation" in rows:
        yield from _check_pressed(rows, item.sensor)
    else:
        yield "reading", _reading_error(depth, rows["reading"], item.sensor)
    if can_check("on mesh"):
        distance = np.zeros(count.shape)
        for index in zip(*np.nonzero(count > 0), strict=True):
            distance[index] = item.distance(rows["points"][index][: count[index]]).max()
        yield "on mesh", distance


def check_frames(item: CheckedObject) -> Measured:
    rows, hand = item.rows["frames"], cast(Hand, item.hand)
    grasps = len(rows["time"])
    yield "finite", _not_finite(rows, grasps)
    yield "rotation", rotation_error(rows["link_pose"][:, :, 0, :3, :3]).max(axis=1)
    links = hand.forward(rows["link_pose"][:, :, 0], rows["joint_positions"])
    yield "kinematics", _pose_error(hand, links, rows)
    yield "frame times", np.sum(~(np.diff(rows["time"], axis=1) > 0), axis=1) + (rows["time"][:, 0] < 0)
    for at_rest in (item.rows.get("grasps", {}), item.rows.get("touch", {})):
        for name in set(rows) & set(at_rest) - {"object"}:
            last, kept = rows[name][:, -1], at_rest[name]
            same = last.shape == kept.shape
            yield "last frame", (last != kept).reshape(grasps, -1).sum(axis=1) if same else np.inf
    if "contact_count" in rows:
        yield from _check_contacts(rows, hand)
    if "depth" in rows:
        depth = rows["depth"]
        yield "touch depth", np.sum(_out_of_range(depth, item.sensor), axis=(1, 2, 3, 4))
        yield "success", np.sum(rows["success"] != np.isfinite(depth).any(axis=(-2, -1)), axis=(1, 2))
        if can_check("on mesh"):  # each grasp's first touch, by its first sensor, on the way
            farthest = 0.0
            for grasp, touched in enumerate(rows["success"]):
                for index in np.argwhere(touched)[:1]:
                    pose = (rows[name][grasp, *index] for name in ("depth", "sensor_position", "sensor_rotation"))
                    farthest = np.maximum(farthest, item.distance(local_points(*pose, item.sensor)).max(initial=0))
            yield "on mesh", farthest


def _check_contacts(rows: dict[str, np.ndarray], hand: Hand) -> Measured:
    normal, force, count = rows["contact_normal"], rows["contact_force"], rows["contact_count"]
    taken = np.arange(force.shape[-1]) < count[..., None]
    length = np.linalg.norm(normal, axis=-1)
    wrong = np.where(taken, (force < 0) | (np.abs(length - 1) > EXACT), (force != 0) | (length != 0))
    yield "contacts", wrong.sum(axis=(1, 2))
    on_object = (rows["contact_other"] == -1)[..., None, :]
    mine = (rows["contact_link"][..., None, :] == hand.sensor_link[:, None]) & on_object
    pushes = (mine * force[..., None, :])[..., None] * normal[..., None, :, :]  # (g, f, s, a, 3), in the world
    arms = rows["contact_position"][..., None, :, :] - rows["sensor_position"][..., None, :]
    sums = [vectors.sum(axis=-2)[..., None, :] for vectors in (pushes, np.cross(arms, pushes))]
    expected = np.concatenate([total @ rows["sensor_rotation"] for total in sums], axis=-1)[..., 0, :]
    error = np.abs(rows["sensor_wrench"] - expected).max(axis=(-2, -1))
    yield "wrench", np.where(count <= force.shape[-1], error, 0).max(axis=1)


def check_hold(item: CheckedObject) -> Measured:
    rows = item.rows["hold"]
    along, moved = rows["held_along"], rows["moved"]
    wrong = np.isnan(moved) | ((moved == np.inf) != (along < 0))
    yield "finite", wrong.sum(axis=1) + ~np.isfinite(rows["mass"])
    label = np.where((along < 0).any(axis=1), -1, (along == 1).all(axis=1))
    farthest, nearest = moved[along == 1].max(initial=0), moved[along == 0].min(initial=np.inf)
    yield "held", (rows["held"] != label) + int(farthest > nearest)


def check_press(item: CheckedObject) -> Measured:
    rows, sensor = item.rows["press"], item.sensor
    yield "finite", _not_finite(rows, len(rows["force"]))
    yield "rotation", rotation_error(rows["rotation"])
    depth, axis, arm = rows["depth"], rows["rotation"][:, :, 0], rows["point"] - rows["position"]
    yield "touch depth", np.sum(_out_of_range(depth, sensor), axis=(1, 2))
    # The axis goes through the point, and nothing is in the undeformed gel.
    gel = sensor.gel_face - (depth + sensor.face_sag).min(axis=(1, 2))
    yield "press pose", np.maximum(np.linalg.norm(np.cross(arm, axis), axis=1), gel)
    yield from ((check, error.max(axis=1)) for check, error in _check_pressed(rows, sensor))
    if can_check("on mesh"):
        poses = zip(depth, rows["position"], rows["rotation"], strict=True)
        clouds = [item.distance(local_points(*pose, sensor)).max(initial=0) for pose in poses]
        yield "on mesh", np.maximum(item.distance(rows["point"]), clouds)
    if can_check("outside"):
        from palpate.touch.presses import ways_out

        yield "outside", ways_out(item.rays, rows["position"]) == 0


def _not_finite(rows: dict[str, np.ndarray], count: int) -> np.ndarray:
    """How many numbers, but for depths, are not finite in each of `count` grasps or presses."""
    numeric = [rows[name].reshape(count, -1) for name in rows if name not in ("object", "success", "depth")]
    return np.sum([np.sum(~np.isfinite(values), axis=1) for values in numeric], axis=0)


def _pose_error(hand: Hand, links: np.ndarray, rows: dict[str, np.ndarray]) -> np.ndarray:
    """Largest difference (g,) of stored poses from those of a hand's links (g, ..., L, 4, 4) and of its sensors."""
    position, rotation = hand.sensor_frames(links)
    pairs = ((links, rows["link_pose"]), (position, rows["sensor_position"]), (rotation, rows["sensor_rotation"]))
    return np.max([np.abs(a - b).reshape(len(links), -1).max(axis=1) for a, b in pairs], axis=0)


def _out_of_range(depth: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Whether depths (..., r, c) are neither in the sensor's range nor +inf: bool, of the same shape."""
    return ~((depth > 0) & (depth <= sensor.reach.astype(depth.dtype))) & (depth != np.inf)


def check_frame_images(item: CheckedObject) -> Measured:
    images, numbers = item.rows["frame_images"]["occluded"], item.rows["frame_images"]["image_frame"]
    yield "seen", int((images == images[:, :, :, :1, :1]).all(axis=(3, 4, 5)).sum())
    last = item.rows["frames"]["time"].shape[1] - 1 if "frames" in item.rows else numbers[:, -1]
    out_of_order = np.sum(np.diff(numbers, axis=1) <= 0, axis=1)
    yield "image frames", out_of_order + (numbers[:, 0] < 0) + (numbers[:, -1] != last)


def check_vision(item: CheckedObject) -> Measured:
    rows = item.rows["vision"]
    masks = np.concatenate([rows["unoccluded_mask"][None], rows["occluded_mask"]])
    yield "mask values", np.sum((masks != 0) & (masks != 255))
    images = np.concatenate([rows["unoccluded"][None], rows["occluded"]])
    one_colour = (images == images[:, :, :1, :1]).all(axis=(2, 3, 4))
    yield "seen", int(one_colour.sum()) + int((rows["unoccluded_mask"] != 255).all(axis=(1, 2)).sum())
    finite = np.isfinite(rows["extrinsics"]).all()
    error = rotation_error(rows["extrinsics"][..., :3]).max() if finite else np.inf
    try:
        seen = [_Pictures.of_camera(rows, number) for number in range(len(rows["intrinsics"]))]
    except ValueError:
        error = np.inf
    yield "camera", error
    if error <= EXACT:  # else nothing is where it says
        yield "image depth", sum(_depth_error(pictures, item.diagonal) for pictures in seen)
        if can_check("picture of mesh"):
            yield "picture of mesh", max(_picture_error(item, pictures) for pictures in seen)
        yield "occlusion", np.max([_occlusion_error(pictures) for pictures in seen], axis=0)


class _Pictures(NamedTuple):
    """What one camera saw: object masks (p, p) and (g, p, p) bool, depths of the same shapes, m."""

    camera: Camera
    mask: np.ndarray
    depth: np.ndarray
    occluded_mask: np.ndarray
    occluded_depth: np.ndarray

    @classmethod
    def of_camera(cls, rows: dict[str, np.ndarray], number: int) -> "_Pictures":
        """Of the rows of one object; ValueError if the camera's matrices are none."""
        mask, depth = rows["unoccluded_mask"][number], rows["unoccluded_depth"][number]
        camera = Camera.from_matrices(rows["intrinsics"][number], rows["extrinsics"][number], len(mask))
        of_grasps = rows["occluded_mask"][:, number] == 255, rows["occluded_depth"][:, number].astype(np.float32)
        return cls(camera, mask == 255, depth.astype(np.float32), *of_grasps)


def _depth_error(pictures: _Pictures, diagonal: float) -> int:
    """Number of depths that are wrong on their own: NaN, out of the scene, or not finite just where the object is."""
    depths = np.concatenate([pictures.depth[None], pictures.occluded_depth])
    centre = pictures.camera.project(np.array(OBJECT_POSITION))[1]
    outside = np.abs(depths - centre) > diagonal / 2 + HAND_REACH
    wrong = np.isnan(depths) | (outside & (depths != np.inf))
    return int(np.sum(wrong) + np.sum(pictures.mask != np.isfinite(pictures.depth)))


def _step(depth: np.ndarray) -> np.ndarray:
    """By how much stored depths may be off, m: the step of a float16 at depths (...), but no less than 1 m."""
    return DEPTH_STEP * 2.0 ** np.floor(np.log2(np.where(np.isfinite(depth), np.maximum(depth, 1), 1)))


def check_together(item: CheckedObject) -> Measured:
    """Poses and successes of touch against those of the grasps. Raises ValueError if their numbers differ."""
    grasps, touch = item.rows["grasps"], item.rows["touch"]
    if grasps["touches"].shape != touch["success"].shape:
        shapes = f"{touch['success'].shape}, in grasps {grasps['touches'].shape}"
        raise ValueError(f"grasps and sensors of an object are {shapes}")
    position = np.abs(grasps["sensor_position"] - touch["position"]).max(axis=2)
    rotation = np.abs(grasps["sensor_rotation"] - touch["rotation"]).max(axis=(2, 3))
    yield "sensor poses", np.maximum(position, rotation)
    yield "touches", grasps["touches"] != touch["success"]


def rotation_error(rotations: np.ndarray) -> np.ndarray:
    """Largest element of |R'R - 1|, or |det R - 1| if that is larger, of rotations (..., 3, 3)."""
    product = np.swapaxes(rotations, -1, -2) @ rotations
    orthonormal = np.abs(product - np.eye(3)).max(axis=(-1, -2))
    return np.maximum(orthonormal, np.abs(np.linalg.det(rotations) - 1))


def check_values(stage: str, item: CheckedObject) -> Measured:
    """The values of one object in a store without checks of its own."""
    specs = CONTRACT[stage].arrays
    numbers = {name: values for name, values in item.rows[stage].items() if values.dtype.kind == "f"}
    wrong = (np.sum(~np.isfinite(values) & (values != specs[name].fill)) for name, values in numbers.items())
    yield "finite", int(sum(wrong))


# The checks of one object's rows of a store, by its stage; those of another stage are `check_values`.
OF_STAGE: dict[str, Callable[[CheckedObject], Measured]] = {
    "surface": check_surface,
    "grasps": check_grasps,
    "touch": check_touch,
    "frames": check_frames,
    "hold": check_hold,
    "press": check_press,
    "vision": check_vision,
    "frame_images": check_frame_images,
}


def _reading_error(depth: np.ndarray, reading: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Largest difference (g, s) of stored readings from the shading of the depth maps, grey levels; inf of a map that
    can't be shaded."""
    touched, valid = np.isfinite(depth).any(axis=(2, 3)), (depth > -np.inf).all(axis=(2, 3))
    expected = np.zeros(reading.shape, int)  # of a sensor that touched nothing, none is stored
    expected[touched & valid] = shade(depth[touched & valid], sensor)
    return np.where(touched & ~valid, np.inf, np.abs(expected - reading).max(axis=(2, 3, 4)))


def _check_pressed(rows: dict[str, np.ndarray], sensor: Sensor) -> Iterator[tuple[str, np.ndarray]]:
    """Checks of pressed readings (g, s), of presses (t, e). The force is 0 of a gel that nothing presses."""
    force, carried = rows["force"], rows["pressure"].sum(axis=(-2, -1), dtype=float) * np.prod(sensor.pixel)
    off, touched = np.zeros(force.shape), rows.get("success", np.full(force.shape, True))
    for index in np.ndindex(off.shape):
        shaded = shade_pressed(rows["indentation"][index], sensor, rows["displacement"][index])
        off[index] = np.abs(rows["reading"][index].astype(int) - shaded * touched[index]).max()
    yield "reading", off
    error = np.abs(carried - rows["inside"] * force) / np.where(force > 0, force, 1)
    yield "pressed", np.where(rows["pressure"].min(axis=(-2, -1)) < 0, np.inf, error)


def _depth_in_hand(hand: Hand, link_pose: np.ndarray, points: np.ndarray) -> float:
    """Largest depth of points (n, 3) in the hand's colliding geoms; 0 if none is inside."""
    centres = hand.geom_poses(link_pose)[:, :3, 3]
    vertices = [np.linalg.norm(corners, axis=1).max(initial=0) for corners in hand.geom_vertices]
    reach = np.maximum(hand.geom_size.sum(axis=1), vertices)[:, None]  # no less than the geom's radius
    near = (points > (centres - reach).min(axis=0)) & (points < (centres + reach).max(axis=0))
    points = np.asarray(points[near.all(axis=1)], dtype=np.float64)
    return max(-hand.signed_distance(points, link_pose).min(initial=0), 0)


def _picture_error(item: CheckedObject, pictures: _Pictures) -> float:
    """Share of pixels where mask or depth differ from rays cast at the mesh through the pixels' centres. Where the mesh
    is transparent, they may show what lies behind it, or nothing."""
    camera, mesh = pictures.camera, item.rays
    rays = camera.rays().reshape(-1, 3)
    face = mesh.first_face(np.broadcast_to(camera.position, rays.shape), rays)
    hit = face >= 0
    normal, corner = mesh.normals[face[hit]], mesh.triangles[face[hit], 0]
    ahead = np.einsum("ni,ni->n", normal, rays[hit])
    first = np.full(len(rays), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):  # faces seen edge-on
        first[hit] = np.einsum("ni,ni->n", normal, corner - camera.position) / ahead
    seen, depth = pictures.mask.ravel(), pictures.depth.ravel()
    with np.errstate(invalid="ignore"):  # inf - inf
        differs = (hit != seen) | (hit & ~(np.abs(first - depth) <= _step(first)))
    if item.see_through:
        differs &= ~(hit & (depth > first))
    return float(_share(differs.sum(), hit.sum()))


def _occlusion_error(pictures: _Pictures) -> np.ndarray:
    """Share of the object's pixels that don't fit the image without the hand, for each grasp: (g,)."""
    _, mask, depth, seen, nearest = pictures
    with np.errstate(invalid="ignore"):  # inf - inf
        same = np.abs(nearest - depth) <= _step(depth)
    wrong = (seen & ~(mask & same)) | (mask & ~seen & ~(nearest < depth))
    return _share(wrong.sum(axis=(1, 2)), mask.sum())


def _share(wrong: np.ndarray, pixels: int) -> np.ndarray:
    """Share of an object's pixels that are wrong; that of `OUTLINE_PIXELS` never exceeds `OUTLINE`."""
    return wrong / max(pixels, OUTLINE_PIXELS / OUTLINE)
