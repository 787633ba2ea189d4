"""Stability of touch: grazing rays, rays through edges and vertices, surfaces at the limits, far coordinates.

Depth maps are compared with a closed form or with `exact_depth`, which tests every face in double precision and
shares no code with the tracers. A ray closer to an edge than single precision resolves (`BAND`) may be on either
side of it.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from palpate.mesh import load_visual
from palpate.sensor import DIGIT
from palpate.touch import PIXEL_CENTRES, RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH, RayCaster, sense, shade
from studies.exact_depth import PIXELS, Y, Z, exact_depth
from studies.stability.cases import Cases, Finding, at_least, at_most, equal, rejects

CASES = Cases()

# Metres from an edge within which a ray may hit or miss: rounding of an object of 0.5 m in single precision is 3e-8 m
# a coordinate.
BAND = 2e-7
# Millimetres: depths are stored in single precision, which rounds 25 mm by up to 0.93e-6 mm.
ROUNDED = 2e-6
# Sensor poses: None is along the axes, the others are random.
SEEDS = (None, 1, 2)


class Pose(NamedTuple):
    """A sensor: position (3,), and rotation (3, 3) with the frame's axes as columns."""

    position: np.ndarray
    rotation: np.ndarray

    def frame(self, points: np.ndarray) -> np.ndarray:
        """Transform points (..., 3) from the sensor's frame to the frame of the pose."""
        return points @ self.rotation.T + self.position


SHIFTS = BAND * np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)


class Disagreement(NamedTuple):
    """Number of pixels that are wrongly in range or out of range, and the largest error of the depth, mm."""

    flipped: int
    millimetres: float


def disagreement(depth: np.ndarray, triangles: np.ndarray, pose: Pose) -> Disagreement:
    """Compare a depth map (100, 100) with the exact depths of all rays within `BAND` of each pixel's ray."""
    depth = depth.ravel().astype(np.float64)
    doubtful = np.flatnonzero(~np.isclose(depth, exact_depth(triangles, *pose), rtol=1e-7, atol=0))
    if not len(doubtful):
        return Disagreement(0, _largest_difference(depth, exact_depth(triangles, *pose)))
    right = [
        exact_depth(triangles, *pose, PIXELS[doubtful] + shift, low, high)
        for low, high in ((-BAND, SENSOR_RANGE + BAND), (BAND, SENSOR_RANGE - BAND))
        for shift in (*SHIFTS, np.zeros(2))
    ]
    nearest, furthest, traced = np.min(right, axis=0), np.max(right, axis=0), depth[doubtful]
    flipped = np.where(np.isfinite(traced), np.isinf(nearest), np.isfinite(furthest))
    return Disagreement(
        int(flipped.sum()),
        max(_largest_difference(nearest, traced, above=True), _largest_difference(traced, furthest, above=True)),
    )


def _largest_difference(one: np.ndarray, other: np.ndarray, above: bool = False) -> float:
    """Largest absolute difference (above: largest excess of one over other) in mm, where both are finite."""
    both = np.isfinite(one) & np.isfinite(other)
    difference = one[both] - other[both]
    return 1e3 * float((difference if above else np.abs(difference)).max(initial=0))


def random_pose(seed: int | None) -> Pose:
    """A random pose with coordinates within 0.2 m; for seed None the identity."""
    if seed is None:
        return Pose(np.zeros(3), np.eye(3))
    rng = np.random.default_rng(seed)
    return Pose(rng.uniform(-0.2, 0.2, 3), Rotation.random(random_state=seed).as_matrix())


def in_pose(mesh: trimesh.Trimesh, pose: Pose) -> trimesh.Trimesh:
    """Transform a mesh from the sensor's frame to the frame of the pose."""
    return trimesh.Trimesh(pose.frame(mesh.vertices), mesh.faces, process=False, validate=False)


def height_field(y: np.ndarray, z: np.ndarray, x: np.ndarray) -> trimesh.Trimesh:
    """A height field: a sheet with vertices (n, n) at y, z on the sensor plane and at distance x from it."""
    n = len(y)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]])
    return trimesh.Trimesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, process=False)


def sheet(distance: float, slope: float = 0.0, half: float = 0.05, width: float = 0.05) -> trimesh.Trimesh:
    """A rectangle of two faces at a distance (m) and slope; its level lines run along (0.6, -0.8) in y and z.

    Whatever its slope, every fifth ray along a level line, 3 columns and 4 rows apart, meets it at the distance.
    half: half its extent along the level lines, width: half its extent across them, metres.
    """
    along, across = np.meshgrid([-half, half], [-width, width])
    middle = PIXEL_CENTRES[RESOLUTION // 2]
    return height_field(
        middle + 0.6 * along + 0.8 * across, middle - 0.8 * along + 0.6 * across, distance + slope * across
    )


def trace_depth(tracer, pose: Pose) -> np.ndarray:
    """One sensor's depth map (100, 100)."""
    return tracer.trace(pose.position[None], pose.rotation[None])[0]


def depths_of(mesh, seeds) -> np.ndarray:
    """Depth maps (k, 100, 100) of a mesh in the sensor's frame, in each pose."""
    poses = map(random_pose, seeds)
    return np.array([trace_depth(RayCaster(in_pose(mesh, pose)), pose) for pose in poses])


def agrees_with_exact(meshes, seeds=SEEDS, what: str = "") -> Iterator[Finding]:
    """Findings: depth maps of a `RayCaster` agree with `exact_depth`, for meshes (sensor's frame) in all poses."""
    errors, depths = [], []
    for mesh, seed in product(meshes, seeds):
        pose = random_pose(seed)
        placed = in_pose(mesh, pose)
        depths.append(trace_depth(RayCaster(placed), pose))
        errors.append(disagreement(depths[-1], placed.triangles, pose))
    yield equal(f"flipped pixels{what}", sum(error.flipped for error in errors), 0)
    yield at_most(f"depth off{what}", max(error.millimetres for error in errors), ROUNDED, "mm")
    # So that there is something to compare, and nothing behind the sensor plane is felt.
    yield at_least(f"pixels felt{what}", min(int(np.isfinite(depth).sum()) for depth in depths), 1)
    yield at_least(f"nearest depth{what}", min(float(depth.min()) for depth in depths), 0.0, "m")


@CASES.case("grazing sensor", "touch")
def grazing(subject):
    """Sheets at up to 89.9994 degrees to the sensor plane, whose depths span 20 mm and 20 m."""
    for slope in (10, 1e3, 1e5):
        sheets = [sheet(0.0125, slope, width=deep / slope) for deep in (0.01, 10.0)]
        yield from agrees_with_exact(sheets, what=f" at {np.degrees(np.arctan(slope)):.6g} degrees")


@CASES.case("rays through vertices and along edges", "touch")
def vertices_and_edges(subject):
    """A vertex at every pixel: each ray meets the corner of six faces, rows and columns run along edges."""
    y, z = np.meshgrid(np.r_[-0.01, PIXEL_CENTRES, 0.01], np.r_[-0.01, PIXEL_CENTRES, 0.01])
    stripes = np.arange(RESOLUTION + 2) // 2 % 2
    noise = np.random.default_rng(0).random(y.shape)
    # A ray that misses its corner by rounding is on a face: at most 10 mm / 0.16 mm steep, the wavy one hardly at all.
    steep = 1e3 * BAND * 0.01 / (SENSOR_WIDTH / RESOLUTION)
    shapes = {
        "wavy": (0.02 + 0.3 * y + 0.1 * np.sin(300 * z) * y, 1e-3),
        "steps of 10 mm": (0.01 + 0.01 * stripes + 0 * y, steep),
        "noise of 10 mm": (0.01 + 0.01 * noise, steep),
    }
    for name, (x, bound) in shapes.items():
        depths = depths_of(height_field(y, z, x), (1, 2, 3))
        off = max(_largest_difference(depth, x[1:-1, 1:-1]) for depth in depths)
        yield equal(f"holes, {name}", int(np.isinf(depths).sum()), 0)
        yield at_most(f"depth off, {name}", off, bound, "mm")


@CASES.case("faces seen exactly edge-on", "touch")
def edge_on(subject):
    """A wall with sides parallel to the rays and a blade edge-on to them, both turned by very small angles."""
    y = PIXEL_CENTRES[10]
    blade = trimesh.Trimesh([[0.012, y, -0.01], [0.02, y, 0.01], [0.024, y, 0.0]], [[0, 1, 2]], process=False)
    front = trimesh.creation.box((0.01, 2 * abs(PIXEL_CENTRES[30]), 0.008)).apply_translation((0.02, 0, 0))
    wall = trimesh.util.concatenate([front, blade])
    for angle in (0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3, 0.1):
        leaning = wall.copy()
        leaning.vertices = wall.vertices @ Rotation.from_euler("yz", [angle, angle]).as_matrix().T
        yield from agrees_with_exact([leaning], what=f", turned by {angle:g}")


@CASES.case("sensor plane inside the mesh", "touch")
def inside(subject):
    """The sensor sees the wall in front of it, whatever is behind the sensor plane or crosses it."""
    off = float(1e3 * np.abs(depths_of(trimesh.creation.box((0.03, 0.05, 0.05)), SEEDS) - 0.015).max())
    yield at_most("depth off in a box", off, ROUNDED, "mm")
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.012)
    yield from agrees_with_exact([ball], what=", a ball through the plane")
    # Its sides are parallel to the rays, from 5 mm behind the sensor plane to 5 mm before it: rays meet its front.
    wall = trimesh.creation.box((0.01, 2 * abs(PIXEL_CENTRES[30]), 0.008))
    yield from agrees_with_exact([wall], what=", a wall edge-on through the plane")


@CASES.case("surface on the sensor plane", "touch")
def on_the_sensor_plane(subject):
    """A surface on the plane, or in front by however little, is in range at every pixel; one behind at none."""
    for ahead in (0.0, 1e-12, 1e-9, 1e-8, 1e-7, -1e-9, -1e-7):
        depths, in_front = depths_of(sheet(ahead), (*SEEDS, 3)), ahead >= 0
        flipped = int((np.isfinite(depths) != in_front).sum())
        off = float(1e3 * np.abs(depths - ahead).max()) if in_front else 0.0
        yield equal(f"flipped pixels, surface {ahead:g} m ahead", flipped, 0)
        yield at_most(f"depth off, surface {ahead:g} m ahead", off, 1e-9 if abs(ahead) < 1e-8 else ROUNDED, "mm")
    both = trimesh.util.concatenate([sheet(-1e-9), sheet(0.01)])
    off = float(1e3 * np.abs(depths_of(both, (1, 2)) - 0.01).max())
    yield at_most("depth off, a surface 1 nm behind and one before it", off, 1e-6, "mm")


@CASES.case("surface exactly at the range limit", "touch")
def at_the_range_limit(subject):
    """Just before the limit every pixel is in range, just beyond it none."""
    for beyond in (-1e-9, 1e-9):
        depths = depths_of(sheet(SENSOR_RANGE + beyond), SEEDS)
        flipped = int((np.isfinite(depths) != (beyond < 0)).sum())
        yield equal(f"flipped pixels, surface {beyond:g} m beyond", flipped, 0)


def shade_in_double(depth: np.ndarray) -> np.ndarray:
    """Grey levels (100, 100, 3), not rounded, by the equations of docs/touch.md in double precision."""
    height = np.where(np.isfinite(depth), np.maximum(SENSOR_RANGE - depth.astype(np.float64), 0), 0)
    slope_z, slope_y = np.gradient(height, PIXEL_CENTRES[1] - PIXEL_CENTRES[0])
    normal = np.stack([-slope_y, -slope_z, np.ones_like(height)], axis=-1)
    lights = np.stack([place for place, *_ in DIGIT.lamps])  # P_r, P_g, P_b: y, z, height above the undeformed surface
    to_light = lights - np.stack([Y, Z, height], axis=-1)[:, :, None]
    cosine = np.einsum("rcx,rclx->rcl", normal, to_light)
    cosine /= np.linalg.norm(normal, axis=-1)[..., None] * np.linalg.norm(to_light, axis=-1)
    return DIGIT.diffuse * np.maximum(cosine, 0)


@CASES.case("steep steps in the impression", "shading")
def steep_steps(subject):
    """Full impression next to none: the shading is correct, within range and never wraps around."""
    row, column = np.indices((RESOLUTION, RESOLUTION))
    rng = np.random.default_rng(0)
    shapes = {
        "one step": np.where(column < 50, 0.0, np.inf),
        "chessboard": np.where((row + column) % 2 == 0, 0.0, np.inf),
        "noise": rng.uniform(0, SENSOR_RANGE, row.shape),
        "one pixel": np.where((row == 50) & (column == 50), 0.0, np.inf),
        "all on the sensor plane": np.zeros(row.shape),
    }
    for name, depth in shapes.items():
        off = np.abs(shade(depth) - shade_in_double(depth)).max()
        yield at_most(f"reading off, {name}", float(off), 0.51, "grey levels", "0.5 is its own rounding")
    broken = np.full((RESOLUTION, RESOLUTION), 0.02)
    for value in (np.nan, -np.inf):
        broken[3, 4] = value
        yield rejects(f"a depth of {value}", lambda: shade(broken), ValueError, "NaN or -inf")


@CASES.case("float32 far from the origin", "touch")
def far_from_the_origin(subject):
    """Mesh and sensor moved together: depths equal those at the origin within the rounding of coordinates."""
    pose = random_pose(3)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    ball.apply_translation((0.055, 0, 0.02))
    here = in_pose(ball, pose)
    expected = trace_depth(RayCaster(here), pose)
    shift = 1e6 * np.array([1.0, -0.7, 0.3])
    moved_pose = Pose(pose.position + shift, pose.rotation)
    moved = trimesh.Trimesh(here.vertices + shift, here.faces, process=False)
    # Both are given in doubles, that far out 1.2e-10 m apart; the ball's faces lean by up to 75 degrees.
    bound = 1e3 * 8 * np.spacing(1e6) + ROUNDED
    for name, tracer in (("mesh", RayCaster(moved)), ("object_position", RayCaster(here, shift))):
        result = trace_depth(tracer, moved_pose)
        flipped = int((np.isfinite(result) != np.isfinite(expected)).sum())
        yield equal(f"flipped pixels, {name} at 1e6 m", flipped, 0)
        yield at_most(f"depth changes, {name} at 1e6 m", _largest_difference(result, expected), bound, "mm")
    sensed = partial(sense, RayCaster(here, shift), moved_pose.position[None], moved_pose.rotation[None])
    reason = "too far from the origin for points in single precision"
    yield rejects("local points at 1e6 m", sensed, ValueError, reason)
    shift = np.array([15.0, 0, 0])
    near = sense(RayCaster(here), pose.position[None], pose.rotation[None]).points.astype(np.float64)
    moved = sense(RayCaster(here, shift), (pose.position + shift)[None], pose.rotation[None]).points
    yield at_most("local points off at 15 m", 1e3 * float(np.abs(moved - near - shift).max()), 1e-3, "mm")


@CASES.case("object much larger than the sensor", "touch")
def larger_than_single_precision(subject):
    """A distant face makes Embree's coordinates coarse: a ball with a stray face, and a plane of 20 km."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.012)
    ball.apply_translation((0.02, 0, 0))
    for far in (100.0, 1e5):
        corners = np.array([[far, 0, 0], [far, 1e-3, 0], [far, 0, 1e-3]])
        stray = trimesh.Trimesh(corners, [[0, 1, 2]], process=False)
        bound = f", with a face {far:g} m off"
        yield from agrees_with_exact([trimesh.util.concatenate([ball, stray])], (1, 2), bound)
    yield from agrees_with_exact([sheet(0.02, 0.3, half=1e4, width=1e4)], (1, 2), ", on a plain of 20 km")


@CASES.case("an object of the run", "touch")
def on_the_object(subject, count: int = 4) -> Iterator[Finding]:
    """Sensors at random places of the run's object, also inside it, compared with `exact_depth`."""
    mesh = load_visual(subject.folder)
    points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
    rng = np.random.default_rng(0)
    off, seen, flipped = 0.0, 0, 0
    for point, number in zip(points, face, strict=True):
        towards = -mesh.face_normals[number] + 0.5 * rng.standard_normal(3)
        axes = np.linalg.qr(np.column_stack([towards, rng.standard_normal((3, 2))]))[0]
        axes[:, 0] *= np.sign(axes[:, 0] @ towards)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        pose = Pose(point - axes[:, 0] * rng.uniform(-0.01, 0.03), axes)
        cast = disagreement(trace_depth(RayCaster(mesh), pose), mesh.triangles, pose)
        right = np.isfinite(exact_depth(mesh.triangles, *pose))
        flipped, off, seen = flipped + cast.flipped, max(off, cast.millimetres), seen + int(right.sum())
    yield equal("flipped pixels", flipped, 0, "", f"of {seen} felt by {count} sensors")
    yield at_most("depth off", off, ROUNDED, "mm")
