"""Stability of touch: grazing rays, rays through edges and vertices, surfaces on the limits, far coordinates.

Depth maps are held against every face of the mesh in double precision (`exact_depth`, which shares no code
with the tracers) or against a closed form. Where a ray passes an edge closer than the tracers' single
precision resolves (`BAND`), both sides of the edge are right.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from palpate.mesh import load_visual
from palpate.touch import (
    DIFFUSE,
    LIGHTS,
    PIXEL_CENTRES,
    RESOLUTION,
    SENSOR_RANGE,
    RayCaster,
    SphereTracer,
    empty_reading,
    normals,
    sense,
    shade,
)
from palpate.touch.sphere_tracing import TOLERANCE
from studies.stability.cases import Cases, Finding, at_least, at_most, equal, rejects

CASES = Cases()

# Metres that a ray may pass an edge by and still hit, or within it and still miss: rounding of an object of
# 0.5 m in single precision is 3e-8 m a coordinate.
BAND = 2e-7
# Millimetres: depths are stored in single precision, which rounds 25 mm by up to 0.93e-6 mm.
ROUNDED = 2e-6
# Sensors as different from the axes as can be, and one along them.
SEEDS = (None, 1, 2)


class Pose(NamedTuple):
    """A sensor: position (3,), and rotation (3, 3) with the frame's axes as columns."""

    position: np.ndarray
    rotation: np.ndarray

    def frame(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the sensor's frame in the frame of the pose."""
        return points @ self.rotation.T + self.position


Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
PIXELS = np.stack([Y.ravel(), Z.ravel()], axis=1)
SHIFTS = BAND * np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)


def exact_depth(triangles, pose: Pose, pixels=PIXELS, low=0.0, high=SENSOR_RANGE) -> np.ndarray:
    """(n,) depth between low and high of the first face of triangles (f, 3, 3) at each of pixels (n, 2).

    Barycentric coordinates in the sensor plane, of every face that is not exactly edge-on, in double
    precision; edges are 1e-12 m wide.
    """
    corner = (np.asarray(triangles, dtype=np.float64) - pose.position) @ pose.rotation
    a, ab, ac = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    twice = ab[:, 1] * ac[:, 2] - ab[:, 2] * ac[:, 1]
    left, right = corner[:, :, 1].min(axis=1) - 1e-9, corner[:, :, 1].max(axis=1) + 1e-9
    depth = np.full(len(pixels), np.inf)
    for y in np.unique(pixels[:, 0]):
        column = np.flatnonzero(pixels[:, 0] == y)
        f = np.flatnonzero((left <= y) & (y <= right) & (twice != 0))
        away = pixels[column, None] - a[f, 1:]
        u = (away[..., 0] * ac[f, 2] - away[..., 1] * ac[f, 1]) / twice[f]
        v = (ab[f, 1] * away[..., 1] - ab[f, 2] * away[..., 0]) / twice[f]
        covered = np.ones(u.shape, dtype=bool)
        for share, edge in ((u, ac[f]), (v, ab[f]), (1 - u - v, (ac - ab)[f])):
            covered &= share >= -1e-12 * np.linalg.norm(edge[:, 1:], axis=1) / np.abs(twice[f])
        found = a[f, 0] + np.clip(u, 0, 1) * ab[f, 0] + np.clip(v, 0, 1) * ac[f, 0]
        covered &= (found >= low) & (found <= high)
        depth[column] = np.where(covered, found, np.inf).min(axis=1, initial=np.inf)
    return depth


class Disagreement(NamedTuple):
    """Pixels felt that should not be, or the other way round, and how far depths are off, in mm."""

    flipped: int
    millimetres: float


def disagreement(depth: np.ndarray, triangles: np.ndarray, pose: Pose) -> Disagreement:
    """Of a depth map (100, 100), from what any ray within `BAND` of the pixel's meets, exactly."""
    depth = depth.ravel().astype(np.float64)
    doubtful = np.flatnonzero(~np.isclose(depth, exact_depth(triangles, pose), rtol=1e-7, atol=0))
    if not len(doubtful):
        return Disagreement(0, _off(depth, exact_depth(triangles, pose)))
    right = [
        exact_depth(triangles, pose, PIXELS[doubtful] + shift, low, high)
        for low, high in ((-BAND, SENSOR_RANGE + BAND), (BAND, SENSOR_RANGE - BAND))
        for shift in (*SHIFTS, np.zeros(2))
    ]
    nearest, furthest, mine = np.min(right, axis=0), np.max(right, axis=0), depth[doubtful]
    flipped = np.where(np.isfinite(mine), np.isinf(nearest), np.isfinite(furthest))
    return Disagreement(int(flipped.sum()), max(_off(nearest, mine, above=True), _off(mine, furthest, above=True)))


def _off(one: np.ndarray, other: np.ndarray, above: bool = False) -> float:
    """Largest difference in mm, or excess of the one over the other, where both are finite."""
    both = np.isfinite(one) & np.isfinite(other)
    difference = one[both] - other[both]
    return 1e3 * float((difference if above else np.abs(difference)).max(initial=0))


def turned(seed: int | None, reach: float = 0.2) -> Pose:
    """A sensor at the origin along the axes (None), or any other way and within `reach` of the origin."""
    if seed is None:
        return Pose(np.zeros(3), np.eye(3))
    rng = np.random.default_rng(seed)
    return Pose(rng.uniform(-reach, reach, 3), Rotation.random(random_state=seed).as_matrix())


def seen_from(mesh: trimesh.Trimesh, pose: Pose) -> trimesh.Trimesh:
    """The mesh, given in the sensor's frame, in the frame of the pose."""
    return trimesh.Trimesh(pose.frame(mesh.vertices), mesh.faces, process=False, validate=False)


def heights(y: np.ndarray, z: np.ndarray, x: np.ndarray) -> trimesh.Trimesh:
    """A sheet with a vertex at each of (n, n) places of the sensor plane, x in front of it."""
    n = len(y)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]])
    return trimesh.Trimesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, process=False)


def sheet(distance: float, slope: float = 0.0, half: float = 0.05, width: float = 0.05) -> trimesh.Trimesh:
    """A rectangle of two faces around the ray of a pixel: its level lines run along (0.6, -0.8) of y and z.

    However steep, it is met at the distance by every fifth ray along a level line, 3 columns and 4 rows on.
    half: of its level lines, width: half of its extent across them, metres.
    """
    along, across = np.meshgrid([-half, half], [-width, width])
    middle = PIXEL_CENTRES[RESOLUTION // 2]
    return heights(middle + 0.6 * along + 0.8 * across, middle - 0.8 * along + 0.6 * across, distance + slope * across)


def box(extents, centre=(0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents)
    mesh.apply_translation(centre)
    return mesh


def felt(tracer, pose: Pose) -> np.ndarray:
    """One sensor's depth map (100, 100)."""
    return tracer.trace(pose.position[None], pose.rotation[None])[0]


def compared(method, meshes, seeds=SEEDS) -> Iterator[tuple[np.ndarray, Disagreement]]:
    """Depth and disagreement of each mesh, given in the sensor's frame, by a tracer in several poses."""
    for mesh in meshes:
        for seed in seeds:
            pose = turned(seed)
            there = seen_from(mesh, pose)
            depth = felt(method(there), pose)
            yield depth, disagreement(depth, there.triangles, pose)


def exactly(meshes, seeds=SEEDS, what: str = "") -> Iterator[Finding]:
    """What a `RayCaster` sees of the meshes is what every face in double precision says."""
    found = list(compared(RayCaster, meshes, seeds))
    yield equal(f"flipped pixels{what}", sum(each.flipped for _, each in found), 0)
    yield at_most(f"depth off{what}", max(each.millimetres for _, each in found), ROUNDED, "mm")
    least = min(int(np.isfinite(depth).sum()) for depth, _ in found)
    yield at_least(f"pixels felt{what}", least, 1, "", "so that there is something to compare")
    nearest = min(float(depth.min()) for depth, _ in found)
    yield at_least(f"nearest depth{what}", nearest, 0.0, "m", "nothing behind the sensor plane is felt")


@CASES.case("grazing sensor, Embree", "touch")
def grazing(subject):
    """Sheets at up to 89.9994 degrees to the sensor plane, 20 mm and 20 m deep."""
    for slope in (10, 100, 1e3, 1e4, 1e5):
        sheets = [sheet(0.0125, slope, width=deep / slope) for deep in (0.01, 10.0)]
        yield from exactly(sheets, what=f" at {np.degrees(np.arctan(slope)):.6g} degrees")


@CASES.case("grazing sensor, sphere tracing", "touch")
def grazing_by_sphere_tracing(subject):
    """A ray stops a tolerance away from the surface: that is tolerance / cos(incidence) early."""
    for slope in (1, 10, 30, 100):
        pose = turned(1)
        there = seen_from(sheet(0.0125, slope, width=0.01 / slope), pose)
        depth = felt(SphereTracer(there), pose).ravel()
        right = exact_depth(there.triangles, pose)
        angle = f" at {np.degrees(np.arctan(slope)):.6g} degrees"
        missed = int((np.isfinite(right) & np.isinf(depth)).sum())
        yield equal(f"pixels given up{angle}", missed, 0, "", f"of {np.isfinite(right).sum()}")
        early = 1e3 * TOLERANCE * np.hypot(1, slope)
        yield at_most(f"stops short{angle}", _off(right, depth, above=True), 1.001 * early + ROUNDED, "mm")
        yield at_most(f"goes through{angle}", _off(depth, right, above=True), ROUNDED, "mm")


@CASES.case("rays through vertices and along edges", "touch")
def vertices_and_edges(subject):
    """A vertex at every pixel: each ray meets a corner of six faces, each row and column runs along edges."""
    y, z = np.meshgrid(np.r_[-0.01, PIXEL_CENTRES, 0.01], np.r_[-0.01, PIXEL_CENTRES, 0.01])
    stripes = np.arange(RESOLUTION + 2) // 2 % 2
    noise = np.random.default_rng(0).random(y.shape)
    # A ray that misses its corner by rounding is on a face: at most 10 mm / 0.16 mm steep, the wavy one hardly at all.
    steep = 1e3 * BAND * 0.01 / (0.01641 / RESOLUTION)
    shapes = {
        "wavy": (0.02 + 0.3 * y + 0.1 * np.sin(300 * z) * y, 1e-3),
        "steps of 10 mm": (0.01 + 0.01 * stripes + 0 * y, steep),
        "noise of 10 mm": (0.01 + 0.01 * noise, steep),
    }
    for name, (x, bound) in shapes.items():
        holes, off = 0, 0.0
        for seed in (1, 2, 3):
            pose = turned(seed)
            depth = felt(RayCaster(seen_from(heights(y, z, x), pose)), pose)
            holes += int(np.isinf(depth).sum())
            off = max(off, _off(depth, x[1:-1, 1:-1]))
        yield equal(f"holes, {name}", holes, 0)
        yield at_most(f"depth off, {name}", off, bound, "mm")


@CASES.case("faces seen exactly edge-on", "touch")
def edge_on(subject):
    """A wall whose sides run along the rays, a blade in the plane of rays, and both turned by next to nothing."""
    y = PIXEL_CENTRES[10]
    blade = trimesh.Trimesh([[0.012, y, -0.01], [0.02, y, 0.01], [0.024, y, 0.0]], [[0, 1, 2]], process=False)
    wall = trimesh.util.concatenate([box((0.01, 2 * abs(PIXEL_CENTRES[30]), 0.008), (0.02, 0, 0)), blade])
    for angle in (0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3, 0.1):
        leaning = wall.copy()
        leaning.vertices = wall.vertices @ Rotation.from_euler("yz", [angle, angle]).as_matrix().T
        yield from exactly([leaning], what=f", turned by {angle:g}")


@CASES.case("thousands of slivers and needles", "touch")
def slivers_and_needles(subject):
    """A fan of 2000 faces around one point, and loose needles of 1 nm to 10 mm width."""
    turn = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    rim = np.stack([np.full(2000, 0.02), 0.012 * np.cos(turn), 0.012 * np.sin(turn)], axis=1)
    around = np.arange(2000)
    faces = np.stack([0 * around, around + 1, (around + 1) % 2000 + 1], axis=1)
    fan = trimesh.Trimesh(np.concatenate([[[0.012, 0, 0]], rim]), faces, process=False)
    yield from exactly([fan], (1,), ", fan")
    needles = loose_needles()
    yield from exactly([needles], (1,), ", needles")
    pose = turned(1)
    there = seen_from(needles, pose)
    depth = felt(SphereTracer(there), pose)
    points = pose.frame(np.column_stack([depth.ravel(), PIXELS])[np.isfinite(depth.ravel())][::10])
    away = 1e3 * float(distance_to(there, points).max())
    # What it passes within the tolerance it feels; a flat face it takes for its longest edge.
    bound = 1e3 * (TOLERANCE + 1e-4 * there.edges_unique_length.max())
    yield at_most("sphere tracing, points off needles", away, bound, "mm")
    missed = np.isfinite(exact_depth(there.triangles, pose)) & np.isinf(depth.ravel())
    yield equal("sphere tracing, needles missed", int(missed.sum()), 0)


def loose_needles(count: int = 300) -> trimesh.Trimesh:
    rng = np.random.default_rng(0)
    first = rng.uniform([0, -0.01, -0.01], [0.03, 0.01, 0.01], (count, 3))
    second = first + 0.01 * rng.normal(size=(count, 3))
    third = first + rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-9, -2, (count, 1))
    return trimesh.Trimesh(
        np.stack([first, second, third], axis=1).reshape(-1, 3),
        np.arange(3 * count).reshape(-1, 3),
        process=False,
    )


def distance_to(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Distance (n,) in metres of points (n, 3) to the nearest edge or, above its inside, face.

    Written out, for libigl's distance to a needle is wrong.
    """
    nearest = np.full(len(points), np.inf)
    for corners in np.asarray(mesh.triangles, dtype=np.float64):
        sides = np.roll(corners, -1, axis=0) - corners
        away = points[:, None] - corners
        along = np.clip((away * sides).sum(axis=2) / np.maximum((sides**2).sum(axis=1), 1e-300), 0, 1)
        to_sides = np.linalg.norm(away - along[..., None] * sides, axis=2).min(axis=1)
        normal = np.cross(sides[0], -sides[2])
        normal /= max(np.linalg.norm(normal), 1e-300)
        above = (np.cross(sides, away) @ normal >= 0).all(axis=1)
        nearest = np.minimum(nearest, np.where(above, np.abs(away[:, 0] @ normal), to_sides))
    return nearest


@CASES.case("sensor plane inside the mesh", "touch")
def inside(subject):
    """The sensor sees the wall in front of it, whatever it has behind it or cuts through."""
    for method, bound in ((RayCaster, ROUNDED), (SphereTracer, 1e3 * TOLERANCE + ROUNDED)):
        off = 0.0
        for seed in SEEDS:
            pose = turned(seed)
            depth = felt(method(seen_from(box((0.03, 0.05, 0.05)), pose)), pose)
            off = max(off, float(1e3 * np.abs(depth - 0.015).max()))
        yield at_most(f"depth off in a box, {method.__name__}", off, bound, "mm")
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.012)
    yield from exactly([ball, loose_needles()], what=", surfaces through the plane")
    # Its sides run along rays, from 5 mm behind the sensor plane to 5 mm before it: felt is its front.
    wall = box((0.01, 2 * abs(PIXEL_CENTRES[30]), 0.008))
    yield from exactly([wall], what=", a wall edge-on through the plane")


@CASES.case("surface on the sensor plane", "touch")
def on_the_sensor_plane(subject):
    """Felt everywhere if it is on the plane or before it, by however little; nowhere if it is behind it."""
    for ahead in (0.0, 1e-12, 1e-9, 1e-8, 1e-7, -1e-9, -1e-7):
        holes, off = 0, 0.0
        for seed in (*SEEDS, 3):
            pose = turned(seed)
            depth = felt(RayCaster(seen_from(sheet(ahead), pose)), pose)
            holes += int((np.isinf(depth) if ahead >= 0 else np.isfinite(depth)).sum())
            off = max(off, float(1e3 * np.abs(depth - ahead).max()) if ahead >= 0 else 0.0)
        yield equal(f"flipped pixels, surface {ahead:g} m ahead", holes, 0)
        yield at_most(f"depth off, surface {ahead:g} m ahead", off, 1e-9 if abs(ahead) < 1e-8 else ROUNDED, "mm")
    both = trimesh.util.concatenate([sheet(-1e-9), sheet(0.01)])
    depths = [felt(RayCaster(seen_from(both, pose)), pose) for pose in (turned(1), turned(2))]
    off = float(1e3 * np.abs(np.array(depths) - 0.01).max())
    yield at_most("depth off, a surface 1 nm behind and one before it", off, 1e-6, "mm")


@CASES.case("surface exactly at the range limit", "touch")
def at_the_range_limit(subject):
    """Either side of it is felt, or not, throughout; on it rounding decides, and the reading is the same."""
    for beyond in (-1e-9, 1e-9):
        holes = 0
        for seed in SEEDS:
            pose = turned(seed)
            depth = felt(RayCaster(seen_from(sheet(SENSOR_RANGE + beyond), pose)), pose)
            holes += int((np.isinf(depth) if beyond < 0 else np.isfinite(depth)).sum())
        yield equal(f"flipped pixels, surface {beyond:g} m beyond", holes, 0)
    levels, furthest = 0, 0.0
    for seed in range(6):
        pose = turned(seed or None)
        there = RayCaster(seen_from(sheet(SENSOR_RANGE), pose))
        found = sense(there, pose.position[None], pose.rotation[None])
        reading = shade(found.depth[0]).astype(int)
        levels = max(levels, int(np.abs(reading - empty_reading()).max()))
        furthest = max(furthest, float(np.where(np.isfinite(found.depth), found.depth, 0).max()))
    yield equal("reading differs from that of nothing", levels, 0, "grey levels")
    yield at_most("furthest depth felt", furthest, float(np.float32(SENSOR_RANGE)), "m", "in single precision")


def shade_in_double(depth: np.ndarray) -> np.ndarray:
    """(100, 100, 3) grey levels, not rounded: the equations of docs/touch.md in double precision."""
    height = np.where(np.isfinite(depth), np.maximum(SENSOR_RANGE - depth.astype(np.float64), 0), 0)
    pixel = PIXEL_CENTRES[1] - PIXEL_CENTRES[0]
    padded = np.pad(height, 1, mode="reflect", reflect_type="odd")  # so that one-sided ones come of it
    slope_y = (padded[1:-1, 2:] - padded[1:-1, :-2]) / (2 * pixel)
    slope_z = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / (2 * pixel)
    normal = np.stack([-slope_y, -slope_z, np.ones_like(height)], axis=-1)
    to_light = LIGHTS - np.stack([Y, Z, height], axis=-1)[:, :, None]
    cosine = np.einsum("rcx,rclx->rcl", normal, to_light)
    cosine /= np.linalg.norm(normal, axis=-1)[..., None] * np.linalg.norm(to_light, axis=-1)
    return DIFFUSE * np.maximum(cosine, 0)


@CASES.case("steep steps in the impression", "shading")
def steep_steps(subject):
    """Full depth to nothing from pixel to pixel: the shading stays in range, wraps nowhere, and is right."""
    row, column = np.indices((RESOLUTION, RESOLUTION))
    rng = np.random.default_rng(0)
    shapes = {
        "one step": np.where(column < 50, 0.0, np.inf),
        "chessboard": np.where((row + column) % 2 == 0, 0.0, np.inf),
        "stripes": np.where(row // 2 % 2 == 0, 0.0, SENSOR_RANGE),
        "noise": rng.uniform(0, SENSOR_RANGE, row.shape),
        "one pixel": np.where((row == 50) & (column == 50), 0.0, np.inf),
        "all on the sensor plane": np.zeros(row.shape),
        "a surface at the light": np.where((row == 0) & (column == 50), 0.0, 1e-9),
    }
    for name, depth in shapes.items():
        normal = normals(np.maximum(SENSOR_RANGE - np.float32(depth), 0))
        length = np.abs(np.linalg.norm(normal.astype(np.float64), axis=-1) - 1).max()
        yield at_most(f"length of normals off 1, {name}", float(length), 4 * np.finfo(np.float32).eps)
        off = np.abs(shade(depth) - shade_in_double(depth)).max()
        yield at_most(f"reading off, {name}", float(off), 0.51, "grey levels", "0.5 is its own rounding")
    broken = np.full((RESOLUTION, RESOLUTION), 0.02)
    for value in (np.nan, -np.inf):
        broken[3, 4] = value
        yield rejects(f"a depth of {value}", lambda: shade(broken), ValueError, "NaN or -inf")


@CASES.case("float32 far from the origin", "touch")
def far_from_the_origin(subject):
    """Mesh and sensor moved together: depths are those at the origin, to the rounding of the coordinates."""
    pose = turned(3)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    ball.apply_translation((0.055, 0, 0.02))
    here = seen_from(ball, pose)
    expected = {method: felt(method(here), pose) for method in (RayCaster, SphereTracer)}
    for far in (1e3, 1e6):
        shift = far * np.array([1.0, -0.7, 0.3])
        there = Pose(pose.position + shift, pose.rotation)
        moved = trimesh.Trimesh(here.vertices + shift, here.faces, process=False)
        # Both are given in doubles, that far out 1.2e-10 m apart; the ball's faces lean by up to 75 degrees.
        bound = 1e3 * 8 * np.spacing(far) + ROUNDED
        for method, depth in expected.items():
            for name, tracer in (("mesh", method(moved)), ("object_position", method(here, shift))):
                result = felt(tracer, there)
                what = f"{method.__name__}, {name} at {far:g} m"
                flipped = int((np.isfinite(result) != np.isfinite(depth)).sum())
                yield equal(f"flipped pixels, {what}", flipped, 0)
                yield at_most(f"depth changes, {what}", _off(result, depth), bound, "mm")
        caster = RayCaster(here, shift)
        yield rejects(
            f"local points at {far:g} m",
            lambda there=there, caster=caster: sense(caster, there.position[None], there.rotation[None]),
            ValueError,
            "too far from the origin for points in single precision",
        )
    shift = np.array([15.0, 0, 0])
    near = sense(RayCaster(here), pose.position[None], pose.rotation[None]).points.astype(np.float64)
    moved = sense(RayCaster(here, shift), (pose.position + shift)[None], pose.rotation[None]).points
    yield at_most("local points off at 15 m", 1e3 * float(np.abs(moved - near - shift).max()), 1e-3, "mm")


@CASES.case("object much larger than the sensor", "touch")
def larger_than_single_precision(subject):
    """A face far off makes Embree's coordinates coarse, of a ball, of its edges, and of a plain."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.012)
    ball.apply_translation((0.02, 0, 0))
    for far in (100.0, 1e5):
        corners = np.array([[far, 0, 0], [far, 1e-3, 0], [far, 0, 1e-3]])
        stray = trimesh.Trimesh(corners, [[0, 1, 2]], process=False)
        bound = f", with a face {far:g} m off"
        yield from exactly([trimesh.util.concatenate([ball, stray])], (1, 2), bound)
    yield from exactly([sheet(0.02, 0.3, half=1e4, width=1e4)], (1, 2), ", on a plain of 20 km")


@CASES.case("poses that are none", "touch")
def poses_that_are_none(subject):
    """NaN, infinite, stretched and mirrored poses are refused, not read as touching nothing."""
    mesh, pose = sheet(0.01), turned(None)
    mirrored, stretched, broken = np.diag([1.0, 1, -1]), 1.01 * np.eye(3), np.eye(3)
    broken[1, 1] = np.nan
    poses = {
        "NaN position": (Pose(np.array([0, np.nan, 0]), pose.rotation), "position of sensor 0 is not finite"),
        "infinite position": (Pose(np.array([np.inf, 0, 0]), pose.rotation), "position of sensor 0 is not"),
        "NaN rotation": (Pose(pose.position, broken), "axes of sensor 0 are not"),
        "mirrored rotation": (Pose(pose.position, mirrored), "axes of sensor 0 are not"),
        "stretched rotation": (Pose(pose.position, stretched), "axes of sensor 0 are not"),
    }
    for method in (RayCaster, SphereTracer):
        tracer = method(mesh)
        for name, (wrong, reason) in poses.items():
            for call in (tracer.trace, tracer.succeeds):
                yield rejects(
                    f"{name}, {method.__name__}.{call.__name__}",
                    lambda wrong=wrong, call=call: call(wrong.position[None], wrong.rotation[None]),
                    ValueError,
                    reason,
                )


def on_the_object(subject, count: int) -> Iterator[Finding]:
    """Sensors at random places of the run's object, some inside it, against every face of it."""
    mesh = load_visual(subject.folder)
    points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
    rng = np.random.default_rng(0)
    flips = {"RayCaster": 0, "SphereTracer": 0}
    off, seen, missed = 0.0, 0, 0
    for point, number in zip(points, face, strict=True):
        towards = -mesh.face_normals[number] + 0.5 * rng.standard_normal(3)
        axes = np.linalg.qr(np.column_stack([towards, rng.standard_normal((3, 2))]))[0]
        axes[:, 0] *= np.sign(axes[:, 0] @ towards)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        pose = Pose(point - axes[:, 0] * rng.uniform(-0.01, 0.03), axes)
        cast = disagreement(felt(RayCaster(mesh), pose), mesh.triangles, pose)
        right = exact_depth(mesh.triangles, pose)
        traced = felt(SphereTracer(mesh), pose).ravel()
        flips["RayCaster"] += cast.flipped
        flips["SphereTracer"] += int((np.isinf(right) & np.isfinite(traced)).sum())
        missed += int((np.isfinite(right) & np.isinf(traced)).sum())
        off, seen = max(off, cast.millimetres), seen + int(np.isfinite(right).sum())
    note = f"of {seen} felt by {count} sensors"
    yield equal("flipped pixels, RayCaster", flips["RayCaster"], 0, "", note)
    yield at_most("depth off, RayCaster", off, ROUNDED, "mm")
    # It also feels what it passes within the tolerance, on a rim of 1e-5 m around the silhouette: at pixels
    # of 0.164 mm, 6 % of those on it, of which a sensor has at most a few hundred.
    rim = 0.06 * 400 * count
    yield at_most("flipped pixels, SphereTracer", flips["SphereTracer"], rim, "", note)
    yield at_most("pixels missed, SphereTracer", missed, 0.1 * rim, "", "by rounding, on the silhouette")


@CASES.case("an object of the run, 2 sensors", "touch")
def two_sensors(subject):
    yield from on_the_object(subject, 2)


@CASES.case("an object of the run, 24 sensors", "touch", short=False)
def more_sensors(subject):
    yield from on_the_object(subject, 24)
