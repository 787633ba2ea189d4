"""Stability of geometry: thin, sharp, tiny, huge, distant, very many and very few faces, through all stages.

A run normalises every object to the diagonal `DIAGONAL`. Other sizes, such as an object smaller than the sensor, occur
only where a user calls the library directly.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import igl
import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from palpate.batch import UnusableObject
from palpate.grasp import GraspSet, grasp_object
from palpate.grasp.patches import surface_patches
from palpate.hand import MAX_PENETRATION, allegro
from palpate.mesh import DIAGONAL, OBJECT_POSITION, load_collision, load_visual, prepare
from palpate.mesh.distance import Surface
from palpate.surface import sample
from palpate.touch import PIXEL_CENTRES, RayCaster, sense
from studies.stability.cases import Cases, Finding, at_least, at_most, equal, rejects
from studies.surface_distance import distances

CASES, HAND = Cases(), allegro()

# Metres: coordinates within 0.25 m are stored in single precision, which rounds them by up to 1.5e-8 m.
ROUNDED = 3e-8
POINTS = 4000


class PreparedMesh(NamedTuple):
    """Result of `palpate.mesh.prepare` for a source file; metres."""

    record: dict[str, Any]
    visual: trimesh.Trimesh
    collision: trimesh.Trimesh


def prepare_mesh(mesh: trimesh.Trimesh, **options) -> PreparedMesh:
    """Write a mesh to an obj file, in double precision, and prepare it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "source.obj"
        path.write_text(mesh.export(file_type="obj", include_normals=False, digits=17))
        return PreparedMesh(prepare(path, folder, **options), load_visual(folder), load_collision(folder))


def soup(vertices, faces) -> trimesh.Trimesh:
    """A mesh of triangles as they are: nothing is merged."""
    return trimesh.Trimesh(np.asarray(vertices, dtype=float), np.asarray(faces), process=False, validate=False)


def distance_off_surface(points: np.ndarray, mesh: trimesh.Trimesh) -> float:
    """Largest distance (m) from points (n, 3) to the faces of a mesh."""
    surface = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    return float(np.sqrt(igl.point_mesh_squared_distance(np.asarray(points, dtype=float), *surface)[0].max()))


def depth_along(mesh: trimesh.Trimesh, axis: int, sign: int, distance: float) -> np.ndarray:
    """Depth map (100, 100), m, of a sensor that looks along an axis at the origin, from a distance."""
    x, y = sign * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
    return RayCaster(mesh).trace(-distance * x[None], np.stack([x, y, np.cross(x, y)], axis=1)[None])[0]


def size_preserved(result: PreparedMesh, area: float, extents) -> Iterator[Finding]:
    """Findings on area and diagonal of the normalised mesh, given those of the source in any unit."""
    scale, written = DIAGONAL / np.linalg.norm(extents), result.record["visual.glb"]
    # Each side is off by rounding, twice; for a thin object its area is nearly that of its two sides.
    bound = 4 * ROUNDED * np.sqrt(written["faces"] / area) / scale + 1e-6
    yield at_most("area off", abs(written["area"] / (area * scale**2) - 1), bound, "of the area")
    diagonal = np.linalg.norm(np.ptp(result.visual.vertices, axis=0))
    yield at_most("diagonal off", abs(diagonal - DIAGONAL), 4 * ROUNDED, "m")


def sample_points(result: PreparedMesh) -> tuple[np.ndarray, list[Finding]]:
    """Points (n, 3) of the exterior in the object's frame, and findings that they lie on the surface."""
    points = sample(result.visual, POINTS, np.random.default_rng(0))
    off = distance_off_surface(points, result.visual)
    return points, [
        equal("points sampled", int(np.isfinite(points).all(axis=1).sum()), POINTS),
        at_most("points off the surface", off, 1e-6, "m", "libigl's distance to slivers is right to 1e-6 m"),
    ]


def grasp_once(result: PreparedMesh, points: np.ndarray, attempts: int = 12) -> GraspSet:
    """One grasp; raises `UnusableObject` if `attempts` palm poses give none."""
    limits = {"per_object": 1, "attempts": 1, "max_attempts": attempts, "max_penetration": MAX_PENETRATION}
    surface, rng = points + OBJECT_POSITION, np.random.default_rng(0)
    return grasp_object(result.visual, result.collision, surface, HAND, rng, **limits)


def later_stages(result: PreparedMesh) -> Iterator[Finding]:
    """Findings on surface points, a grasp and its touches: finite, on the surface, penetration within the limit."""
    points, findings = sample_points(result)
    yield from findings
    grasp = grasp_once(result, points)
    yield equal("grasp is finite", bool(np.isfinite(grasp.link_pose).all()), True)
    yield at_most("penetration", float(grasp.penetration.max()), MAX_PENETRATION, "m", "grasps.max_penetration")
    caster = RayCaster(result.visual, OBJECT_POSITION)
    sensed = sense(caster, grasp.sensor_position[0], grasp.sensor_rotation[0])
    yield equal("sensors that feel", int(sensed.success.sum()), int(grasp.touches[0].sum()))
    cloud = np.concatenate([sensed.points[k, : sensed.point_count[k]] for k in range(4)])
    off = distance_off_surface(cloud - np.array(OBJECT_POSITION), result.visual)
    # Rounding to single precision 1 m from the origin; faces seen edge-on add less.
    yield at_most("felt points off the surface", off, 1e-6, "m")


@CASES.case("blade of 0.2 mm", "meshes, surface, grasps, touch")
def blade(subject):
    """Both sides are kept, at the same distance, also after decimation."""
    extents = (0.45, 0.2, 2e-4)
    result = prepare_mesh(trimesh.creation.box(extents).subdivide().subdivide().subdivide(), collision_faces=100)
    yield from size_preserved(result, 2 * (0.45 * 0.2 + 0.45 * 2e-4 + 0.2 * 2e-4), extents)
    thickness = 2e-4 * DIAGONAL / np.linalg.norm(extents)
    for name, mesh in (("visual", result.visual), ("collision", result.collision)):
        off = abs(float(np.ptp(mesh.vertices[:, 2])) - thickness)
        yield at_most(f"thickness off, {name}", off, 2 * ROUNDED, "m", f"of {thickness:.3g} m")
    _, worst = distances(*(Surface(mesh.vertices, mesh.faces) for mesh in (result.visual, result.collision)))
    yield at_most("decimated off the source", worst, 1e-5, "m", "5 % of the thickness")
    gap = [depth_along(result.visual, 2, sign, 0.01) for sign in (1, -1)]
    sensed = float(np.abs(0.02 - gap[0] - gap[1] - thickness).max())
    yield at_most("felt thickness off", sensed, 2e-8, "m")
    points, _ = sample_points(result)
    above = float((points[:, 2] > 0).mean())
    yield at_most("share of points above off a half", abs(above - 0.5), 2 / np.sqrt(POINTS), "", "4 sigma")
    yield from later_stages(result)


@CASES.case("sheet without thickness", "meshes, surface, grasps, touch")
def sheet(subject):
    """A rectangle, and two back to back on the same corners: both have the same depth from either side."""
    corners, one = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    for name, faces in (("single", one), ("double", [*one, (0, 2, 1), (0, 3, 2)])):
        result = prepare_mesh(soup(corners, faces))
        yield equal(f"faces kept, {name}", len(result.visual.faces), 2)
        for sign in (1, -1):
            off = float(np.abs(depth_along(result.visual, 2, sign, 0.01) - 0.01).max())
            yield at_most(f"depth off, {name}, from {sign:+d} z", off, 1e-8, "m")
        yield from size_preserved(result, 2.0, (2, 1, 0))
        yield from later_stages(result)


@CASES.case("needle", "meshes, surface, grasps, touch")
def needle(subject):
    """A needle 1 mm wide and 0.5 m long is grasped. A hair of 10 micrometres is rejected with a reason."""
    section = 12 * np.sin(np.pi / 6) / 2  # area of a regular dodecagon of radius 1
    side = 12 * 2 * np.sin(np.pi / 12)
    result = prepare_mesh(trimesh.creation.cylinder(radius=1e-3, height=1, sections=12))
    yield from size_preserved(result, 2 * section * 1e-6 + side * 1e-3, (2e-3, 2e-3, 1))
    yield from later_stages(result)
    hair = prepare_mesh(trimesh.creation.cylinder(radius=1e-5, height=1, sections=12))
    points, findings = sample_points(hair)
    yield from findings
    reason = "no surface that a finger could stop at"
    yield rejects("grasp of a hair of 10 micrometres", lambda: grasp_once(hair, points), UnusableObject, reason)


def with_slivers(box: trimesh.Trimesh, share: float) -> trimesh.Trimesh:
    """Split each face in three at a point near its first edge, at a distance of `share` times its height."""
    a, b, c = np.asarray(box.triangles).transpose(1, 0, 2)
    points = (1 - share) * (a + b) / 2 + share * c
    new = len(box.vertices) + np.arange(len(points))
    first, second, third = np.asarray(box.faces).T
    faces = [(first, second, new), (second, third, new), (third, first, new)]
    return soup(np.concatenate([box.vertices, points]), np.concatenate([np.stack(part, axis=1) for part in faces]))


@CASES.case("slivers of aspect 1e6", "meshes, surface, grasps, touch")
def slivers(subject):
    """A third of the faces are as thin as rounding errors: the box stays closed, its depth maps the same."""
    box = trimesh.creation.box((0.4, 0.2, 0.1)).subdivide().subdivide()
    area = 2 * (0.4 * 0.2 + 0.4 * 0.1 + 0.2 * 0.1)
    plain, result = prepare_mesh(box), prepare_mesh(with_slivers(box, 2e-6))
    yield equal("closed", result.record["visual.glb"]["closed"], True)
    yield from size_preserved(result, area, (0.4, 0.2, 0.1))
    for axis in range(3):
        distance = 0.5 * float(np.ptp(plain.visual.vertices[:, axis])) + 0.01
        both = [depth_along(mesh.visual, axis, 1, distance) for mesh in (plain, result)]
        yield at_most(f"depth changes, along {'xyz'[axis]}", float(np.abs(both[0] - both[1]).max()), 2e-7, "m")
    yield from later_stages(result)
    flat = soup([(0, 0, 0), (1, 0, 0), (0.5, 0.9e-6, 0)], [(0, 1, 2)])
    reason = "none of its 1 triangles has an area"
    yield rejects("one sliver, alone", lambda: prepare_mesh(flat), UnusableObject, reason)


def clearance(patches: list[np.ndarray], points: np.ndarray) -> float:
    """Smallest distance (m) by which points (n, 3) are outside the convex hulls of patches; negative inside."""
    nearest = np.inf
    for patch in patches:
        equations = ConvexHull(patch).equations  # (h, 4): outward normal and offset
        outside = (points @ equations[:, :3].T + equations[:, 3]).max(axis=1)
        nearest = min(nearest, float(outside.min()))
    return nearest


@CASES.case("hole narrower than a finger", "meshes, surface, touch")
def narrow_hole(subject):
    """A tube 0.48 m long with a bore of 10 mm: contact geometry leaves it open, sensors see into it."""
    tube = trimesh.creation.annulus(r_min=0.005, r_max=0.06, height=0.48, sections=48)
    result = prepare_mesh(tube)
    scale = DIAGONAL / np.linalg.norm(tube.extents)
    bore = 0.005 * scale
    axis = np.column_stack([np.zeros((50, 2)), np.linspace(-0.23, 0.23, 50)])
    # A patch spans a quarter of the bore's round: its chord is cos(45 deg) of the radius off the axis.
    free = clearance(surface_patches(result.collision), axis)
    yield at_least("axis of the bore clear of contact geometry", free, 0.95 * bore * np.cos(np.pi / 4), "m")
    depth = depth_along(result.visual, 2, 1, 0.24 * scale + 0.005)
    radius = np.hypot(*np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES))
    clear = np.abs(radius - bore) > 2e-5  # the bore is a polygon, 48 sides
    wrong = (np.isinf(depth) != (radius < bore)) & clear
    yield equal("pixels wrong looking into the bore", int(wrong.sum()), 0)
    points, _ = sample_points(result)
    inside = np.hypot(points[:, 0], points[:, 1]) < 1.01 * bore
    yield at_least("points sampled in the mouth of the bore", int(inside.sum()), 1)


@CASES.case("deep concavity", "meshes, surface")
def deep_cup(subject):
    """A beaker: its inside belongs to the exterior surface, and contact geometry does not fill it."""
    profile = [(0, -0.1), (0.05, -0.1), (0.05, 0.15), (0.046, 0.15), (0.046, -0.096), (0, -0.096)]
    cup = trimesh.creation.revolve(profile, sections=64)
    result = prepare_mesh(cup)
    scale = DIAGONAL / np.linalg.norm(cup.extents)
    middle = np.column_stack([np.zeros((20, 2)), np.linspace(-0.09, 0.11, 20) * scale])
    # The floor is 0.096 + 0.025 below the middle, the wall is a quarter's chord away at the least.
    free = clearance(surface_patches(result.collision), middle)
    yield at_least("inside clear of contact geometry", free, 0.02 * scale, "m")
    points, _ = sample_points(result)
    within = (np.hypot(points[:, 0], points[:, 1]) < 0.0475 * scale) & (points[:, 2] > -0.123 * scale)
    yield at_least("points sampled inside", int(within.sum()), POINTS // 10)


@CASES.case("object smaller than the sensor", "surface, grasps, touch")
def smaller_than_the_sensor(subject):
    """Balls of 4 mm and 0.1 mm diameter, passed directly to the library: depth as in closed form.

    The last fits between the rays, 0.164 mm apart, so that no pixel sees it.
    """
    y, z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
    for radius in (2e-3, 5e-5):
        ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
        depth = depth_along(ball, 0, 1, 0.01)
        square = radius**2 - y**2 - z**2
        sure = np.abs(square) > 2e-3 * radius**2  # where the polyhedron can't differ from the ball
        wrong = (np.isfinite(depth) != (square > 0)) & sure
        yield equal(f"pixels wrong, radius {radius:g} m", int(wrong.sum()), 0)
        inside = (square > 0.1 * radius**2) & np.isfinite(depth)
        off = np.abs(depth - (0.01 - np.sqrt(np.maximum(square, 0))))[inside]
        # Faces are inside the ball by up to 4e-4 of the radius; seen aslant that is three times as much.
        yield at_most(f"depth off, radius {radius:g} m", float(off.max(initial=0)), 2e-3 * radius + 1e-9, "m")
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2e-3)
    result = PreparedMesh({}, ball, ball)
    points, findings = sample_points(result)
    yield from findings
    grasp = grasp_once(result, points, attempts=30)
    yield at_most("penetration", float(grasp.penetration.max()), MAX_PENETRATION, "m")
