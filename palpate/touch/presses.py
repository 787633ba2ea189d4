"""Presses of one object, without a hand: a sensor goes straight onto surface points, and in with stated forces."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.batch import UnusableObject
from palpate.mesh import Geometry
from palpate.sensor import Sensor
from palpate.surface import DIRECTIONS, fibonacci_sphere
from palpate.surface.embree import RayMesh
from palpate.touch.gel import NotConverged
from palpate.touch.rays import RayCaster
from palpate.touch.reading import face_sensor, face_window, press_sensor, stacked

ATTEMPTS = 10  # random surface points for each press that is asked for
CLEARANCE = 0.05  # m behind the sensor plane that the sensor's way is free, chosen: the length of a sensor's body
_OFFSET = 1e-5  # m off the surface that rays start, far above their rounding


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

    Returns the arrays of the press store in the object's frame, at the first touch, and how many points gave no press,
    by reason. Raises UnusableObject if `ATTEMPTS` points a press don't give enough; ConfigError for a gel that can't be
    pressed.
    """
    face, window = face_sensor(sensor), face_window(sensor)
    # From so far away the whole way is seen, and all that the gel could meet at its end.
    start = sensor.gel_face + CLEARANCE
    caster = RayCaster(mesh, sensor=replace(face, range=face.range + CLEARANCE))
    rays = caster.mesh
    draws = rng.random((ATTEMPTS * count, 5))
    points = np.asarray(surface_points, dtype=float)[(draws[:, 0] * len(surface_points)).astype(int)]
    normals = rays.normals_at(points)
    front, back = (ways_out(rays, points + side * _OFFSET * normals) for side in (1, -1))
    normals = np.where((back > front)[:, None], -normals, normals)  # towards the side from which more ways lead out
    rotations = _sensor_axes(normals, draws[:, 1:4], tilt)
    axes = rotations[:, :, 0]
    free = ~rays.blocked(points + _OFFSET * normals, -axes, start) & (ways_out(rays, points - start * axes) > 0)
    presses: list[dict[str, np.ndarray]] = []
    discarded: Counter[str] = Counter()
    for point, normal, rotation, is_free, direction in zip(points, normals, rotations, free, draws[:, 4], strict=True):
        if len(presses) == count:
            break
        if not is_free:
            discarded["no free way out along the sensor's axis"] += 1
            continue
        origin = point - start * rotation[:, 0]
        depth = caster.trace(origin[None], rotation[None])[0].astype(float)
        travel = float((depth + face.face_sag).min()) - sensor.gel_face  # to the first touch
        if not CLEARANCE - (sensor.range - sensor.gel_face) <= travel < np.inf:  # else the point stays out of range
            discarded["something else meets the gel first"] += 1
            continue
        depth -= travel
        depth[depth > face.range] = np.inf
        slip = slide * np.array([np.cos(2 * np.pi * direction), np.sin(2 * np.pi * direction)])
        try:
            readings = [press_sensor(depth, sensor, force, tuple(slip), twist, friction) for force in forces]
        except NotConverged:
            discarded["the contact did not settle"] += 1
            continue
        if max(reading["strain"] for reading in readings) > 1:
            discarded["a force would press it through the gel"] += 1
            continue
        pose = {"point": point, "normal": normal, "position": origin + travel * rotation[:, 0], "rotation": rotation}
        seen = depth[window].astype(np.float32)
        seen[seen > sensor.reach.astype(np.float32)] = np.inf
        presses.append(pose | stacked(readings) | {"depth": seen} | ({"slide": slip} if slide else {}))
    if len(presses) < count:
        reasons = ", ".join(f"{reason}: {number}" for reason, number in sorted(discarded.items()))
        raise UnusableObject(f"{len(presses)} of {count} presses found at {len(points)} surface points ({reasons})")
    return stacked(presses), discarded


def ways_out(rays: RayMesh, starts: np.ndarray) -> np.ndarray:
    """In how many directions, evenly over the sphere, each of the starts (n, 3) sees infinity: (n,)."""
    directions = np.tile(fibonacci_sphere(DIRECTIONS), (len(starts), 1))
    return (~rays.blocked(np.repeat(starts, DIRECTIONS, axis=0), directions)).reshape(-1, DIRECTIONS).sum(axis=1)


def _sensor_axes(normals: np.ndarray, draws: np.ndarray, tilt: float) -> np.ndarray:
    """Rotations (n, 3, 3) of sensors whose x points into the surface with these normals (n, 3), uniformly within `tilt`
    of them; draws: (n, 3) random numbers between 0 and 1."""
    turn, away, around = (draws * [2 * np.pi, 1, 2 * np.pi]).T[..., None]
    first, second = np.moveaxis(tangents(normals), -2, 0)
    cosine = 1 - away * (1 - np.cos(tilt))
    x = np.sqrt(1 - cosine**2) * (np.cos(around) * first + np.sin(around) * second) - cosine * normals
    across = np.cross(x, first)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    y = np.cos(turn) * np.cross(across, x) + np.sin(turn) * across
    return np.stack([x, y, np.cross(x, y)], axis=2)


def tangents(normals: np.ndarray) -> np.ndarray:
    """Of unit vectors (..., 3) two others (..., 2, 3) that are orthogonal to them and to each other."""
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=-1)])
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=-2)
