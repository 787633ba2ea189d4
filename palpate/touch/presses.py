"""Presses of one object, without a hand: a sensor goes straight onto surface points, and in with stated forces."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.batch import UnusableObject
from palpate.mesh import Geometry
from palpate.sensor import Sensor
from palpate.surface.embree import RayMesh
from palpate.surface.rays import DIRECTIONS, fibonacci_sphere
from palpate.touch.gel import NotConverged
from palpate.touch.pressing import PressedReading, face_sensor, press_sensor
from palpate.touch.rays import RayCaster

ATTEMPTS = 10  # random surface points for each press that is asked for
CLEARANCE = 0.05  # m behind the sensor plane that the sensor's way is free, chosen: the length of a sensor's body
_OFFSET = 1e-5  # m off the surface that rays start, far above their rounding

# Reasons for which a point gives no press.
BLOCKED = "no free way out along the sensor's axis"
OBSTRUCTED = "something else meets the gel first"
UNSETTLED = "the contact did not settle"
THROUGH = "a force would press it through the gel"


def press_object(
    mesh: Geometry,
    surface_points: np.ndarray,
    sensor: Sensor,
    rng: np.random.Generator,
    count: int,
    forces: Sequence[float],
    tilt: float = 0.0,
    slide: float = 0.0,
    twist: float = 0.0,
    friction: float = 0.5,
) -> tuple[dict[str, np.ndarray], Counter[str]]:
    """Press a sensor onto t = `count` random surface points with e forces each; metres, newtons, radians.

    mesh: the object's, in its own frame, as are surface_points: (N, 3) on its exterior. The sensor's axis points into
    the surface, tilted by up to `tilt`; the turn about it is random. Then the surface slides by `slide` in a random
    direction and twists by `twist` on the gel, with that coefficient of friction. The same generator gives the same
    presses; of a greater count these are the first.

    Returns the arrays of the press store in the object's frame, and how many points gave no press, by reason. Poses and
    depths are those at which the gel first touches the undeformed surface. Raises UnusableObject if `ATTEMPTS` points a
    press don't give enough of them; ConfigError for a sensor whose gel can't be pressed.
    """
    face = face_sensor(sensor)
    # From so far away the whole way is seen, and all that the gel could meet at its end.
    start = sensor.gel_face + CLEARANCE
    caster = RayCaster(mesh, sensor=replace(face, range=face.range + CLEARANCE))
    rays = caster.mesh
    draws = rng.random((ATTEMPTS * count, 5))
    points = np.asarray(surface_points, dtype=float)[(draws[:, 0] * len(surface_points)).astype(int)]
    normals = _outward_normals(rays, points)
    rotations = _sensor_axes(normals, draws[:, 1:4], tilt)
    free = _has_way(rays, points, normals, rotations[:, :, 0], start)
    presses: list[dict[str, np.ndarray]] = []
    discarded: Counter[str] = Counter()
    for point, normal, rotation, is_free, direction in zip(points, normals, rotations, free, draws[:, 4], strict=True):
        if len(presses) == count:
            break
        if not is_free:
            discarded[BLOCKED] += 1
            continue
        origin = point - start * rotation[:, 0]
        depth = caster.trace(origin[None], rotation[None])[0].astype(float)
        travel = float((depth + face.face_sag).min()) - sensor.gel_face  # to the first touch
        reach = sensor.range - sensor.gel_face
        if not CLEARANCE - reach <= travel < np.inf:  # else the point is out of range at the first touch
            discarded[OBSTRUCTED] += 1
            continue
        depth -= travel
        depth[depth > face.range] = np.inf
        slip = slide * np.array([np.cos(2 * np.pi * direction), np.sin(2 * np.pi * direction)])
        try:
            readings = [press_sensor(depth, sensor, force, tuple(slip), twist, friction) for force in forces]
        except NotConverged:
            discarded[UNSETTLED] += 1
            continue
        if max(reading.strain for reading in readings) > 1:
            discarded[THROUGH] += 1
            continue
        pose = {"point": point, "normal": normal, "position": origin + travel * rotation[:, 0], "rotation": rotation}
        presses.append(pose | _arrays(readings) | {"depth": _window(depth, face, sensor)} | {"slide": slip})
    if len(presses) < count:
        reasons = ", ".join(f"{reason}: {number}" for reason, number in sorted(discarded.items()))
        raise UnusableObject(f"{len(presses)} of {count} presses found at {len(points)} surface points ({reasons})")
    arrays = {name: np.stack([press[name] for press in presses]) for name in presses[0]}
    if not slide:
        del arrays["slide"]
    return arrays, discarded


def _outward_normals(rays: RayMesh, points: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3) of the faces that points (n, 3) are on, towards the side from which more ways lead out."""
    import igl

    corners = rays.triangles.reshape(-1, 3)
    _, face, _ = igl.point_mesh_squared_distance(points, corners, np.arange(len(corners)).reshape(-1, 3))
    normals = rays.normals[face]
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    front, back = (ways_out(rays, points + side * _OFFSET * normals) for side in (1, -1))
    return np.where((back > front)[:, None], -normals, normals)


def ways_out(rays: RayMesh, starts: np.ndarray) -> np.ndarray:
    """In how many directions, evenly over the sphere, each of the starts (n, 3) sees infinity: (n,)."""
    directions = fibonacci_sphere(DIRECTIONS)
    blocked = rays.blocked(np.repeat(starts, DIRECTIONS, axis=0), np.tile(directions, (len(starts), 1)))
    return DIRECTIONS - blocked.reshape(len(starts), DIRECTIONS).sum(axis=1)


def _has_way(rays: RayMesh, points: np.ndarray, normals: np.ndarray, axes: np.ndarray, length: float) -> np.ndarray:
    """Whether a way of that length back along each axis (n, 3) is free, and ends outside the object: (n,) bool."""
    free = ~rays.blocked(points + _OFFSET * normals, -axes, length)
    return free & (ways_out(rays, points - length * axes) > 0)


def _sensor_axes(normals: np.ndarray, draws: np.ndarray, tilt: float) -> np.ndarray:
    """Rotations (n, 3, 3) of sensors whose x points into the surface with these normals (n, 3), uniformly within `tilt`
    of them; draws: (n, 3) random numbers between 0 and 1."""
    turn, away, around = draws.T
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    cosine = (1 - away * (1 - np.cos(tilt)))[:, None]
    side = _turned(first, np.cross(normals, first), around)
    x = np.sqrt(1 - cosine**2) * side - cosine * normals
    across = np.cross(x, first)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    y = _turned(np.cross(across, x), across, turn)
    return np.stack([x, y, np.cross(x, y)], axis=2)


def _turned(first: np.ndarray, second: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) in the planes of two (n, 3), by shares (n,) of a turn from the first."""
    angle = 2 * np.pi * turn[:, None]
    return np.cos(angle) * first + np.sin(angle) * second


def _arrays(readings: Sequence[PressedReading]) -> dict[str, np.ndarray]:
    """The arrays (e, ...) of one press, without markers of a sensor that has none."""
    fields = zip(PressedReading._fields, zip(*readings, strict=True), strict=True)
    return {name: np.stack(values) for name, values in fields if values[0] is not None}


def _window(depth: np.ndarray, face: Sensor, sensor: Sensor) -> np.ndarray:
    """The depth map (r, c) float32 of the sensor, of that of its whole gel's face."""
    rows, columns = ((many - few) // 2 for many, few in zip(face.resolution, sensor.resolution, strict=True))
    inner = depth[rows : rows + sensor.resolution[0], columns : columns + sensor.resolution[1]].astype(np.float32)
    return np.where(inner <= sensor.reach.astype(np.float32), inner, np.float32(np.inf))
