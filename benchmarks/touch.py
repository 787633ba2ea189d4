"""What touch costs and how wrong it is: `python benchmarks/touch.py [--runs N]`.

Four sensors press on a 20,480-face object, as in a grasp. Times are processor time (all threads added up, as
on one core), medians over the runs; errors are against every ray tested with every face, in double precision.
"""

import argparse
import os
import time

os.environ |= {"OMP_NUM_THREADS": "1", "IGL_NUM_THREADS": "1"}

import numpy as np
import pandas as pd
import trimesh
from scipy.spatial.transform import Rotation

from palpate.touch import RESOLUTION, SENSOR_RANGE, RayCaster, SphereTracer, local_points, sense, shade
from palpate.touch.sensor import SENSOR_PLANE

# Where the surface meets the gel: about 19 mm from the sensor plane.
CONTACT = 0.019


def bumpy_sphere() -> trimesh.Trimesh:
    """20,480 faces, 0.5 m in diagonal, with bumps of a few millimetres."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.1443)
    x, y, z = mesh.vertices.T
    mesh.vertices *= (1 + 0.02 * np.sin(90 * x) * np.sin(80 * y + 1) * np.sin(100 * z))[:, None]
    return mesh


def four_contacts(mesh: trimesh.Trimesh, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses of four sensors that press on random spots, tilted by up to about 20 degrees."""
    points, face = trimesh.sample.sample_surface(mesh, 4, seed=seed)
    random = Rotation.random(4, random_state=seed)
    tilt = Rotation.from_rotvec(0.2 * random.as_rotvec() / np.pi)
    rotation = random.as_matrix()
    for frame, x in zip(rotation, tilt.apply(-mesh.face_normals[face]), strict=True):
        frame[:, 0] = x
        frame[:, 1] = np.cross(frame[:, 2], x) / np.linalg.norm(np.cross(frame[:, 2], x))
        frame[:, 2] = np.cross(x, frame[:, 1])
    return points - CONTACT * rotation[:, :, 0], rotation


def milliseconds(function, runs: int) -> float:
    times = []
    for _ in range(runs):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def trimesh_depth(mesh, position, rotation) -> np.ndarray:
    """The same depth maps by trimesh's wrapper around Embree."""
    depth = np.full((len(position), RESOLUTION**2), np.inf)
    for k in range(len(position)):
        start = SENSOR_PLANE.reshape(-1, 3) @ rotation[k].T + position[k]
        direction = np.tile(rotation[k, :, 0], (len(start), 1))
        place, ray, _ = mesh.ray.intersects_location(start, direction, multiple_hits=False)
        depth[k, ray] = (place - start[ray]) @ rotation[k, :, 0]
    depth[depth > SENSOR_RANGE] = np.inf
    return depth.reshape(-1, RESOLUTION, RESOLUTION)


def exact_depth(mesh, position, rotation, pixels) -> np.ndarray:
    """(k, n) depth of the flat `pixels` (n,) of each sensor: every ray, every face (Moeller and Trumbore)."""
    a, b, c = np.asarray(mesh.triangles).transpose(1, 0, 2)
    depth = np.full((len(position), len(pixels)), np.inf)
    for k in range(len(position)):
        across = np.cross(rotation[k, :, 0], c - a)
        determinant = np.einsum("fi,fi->f", b - a, across)
        for i, pixel in enumerate(SENSOR_PLANE.reshape(-1, 3)[pixels]):
            away = position[k] + rotation[k] @ pixel - a
            turned = np.cross(away, b - a)
            u = np.einsum("fi,fi->f", away, across) / determinant
            v = turned @ rotation[k, :, 0] / determinant
            t = np.einsum("fi,fi->f", turned, c - a) / determinant
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= SENSOR_RANGE)
            depth[k, i] = t[inside].min(initial=np.inf)
    return depth


def compare_methods(mesh, runs: int) -> pd.DataFrame:
    position, rotation = four_contacts(mesh, seed=0)
    pixels = np.random.default_rng(0).choice(RESOLUTION**2, 200, replace=False)
    exact = exact_depth(mesh, position, rotation, pixels)
    caster = RayCaster(mesh)
    mesh.ray.intersects_any(position, rotation[:, :, 0])
    methods = {"embree": (lambda: caster.trace(position, rotation), runs)}
    methods["trimesh's wrapper"] = (lambda: trimesh_depth(mesh, position, rotation), runs)
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        tracer = SphereTracer(mesh, tolerance=tolerance)
        methods[f"sphere tracing, {tolerance:.0e} m"] = (
            lambda tracer=tracer: tracer.trace(position, rotation),
            max(3, runs // 10),
        )
    rows = []
    for name, (function, repeats) in methods.items():
        depth = function().reshape(4, -1)[:, pixels]
        both = np.isfinite(depth) & np.isfinite(exact)
        error = np.abs(depth[both] - exact[both])
        rows.append(
            {
                "depth of four sensors": name,
                "ms": milliseconds(function, repeats),
                "median error, m": np.median(error),
                "worst error, m": error.max(),
                "wrong hits or misses, %": 100 * (np.isfinite(depth) != np.isfinite(exact)).mean(),
            }
        )
    table = pd.DataFrame(rows)
    table.insert(2, "times embree", table["ms"] / table["ms"][0])
    return table


def whole_grasp(mesh, runs: int) -> pd.DataFrame:
    caster = RayCaster(mesh)
    position, rotation = four_contacts(mesh, seed=0)
    away = position - 0.03 * rotation[:, :, 0]
    depth = caster.trace(position, rotation)

    def first_trace():
        RayCaster(mesh).trace(position[:1], rotation[:1])

    steps = {
        "search tree, once an object": first_trace,
        "four sensors, all: depth, points, readings": lambda: sense(caster, position, rotation),
        "  depth": lambda: caster.trace(position, rotation),
        "  points": lambda: [local_points(*args) for args in zip(depth, position, rotation, strict=True)],
        "  readings": lambda: shade(depth),
        "success only": lambda: caster.succeeds(position, rotation),
        "four sensors that touch nothing": lambda: sense(caster, away, rotation),
    }
    return pd.DataFrame([{"step": name, "ms": milliseconds(step, runs)} for name, step in steps.items()])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    mesh = bumpy_sphere()
    print(f"{len(mesh.faces)} faces, median of {runs} runs\n")
    for table in (whole_grasp(mesh, runs), compare_methods(mesh, runs)):
        print(table.to_string(index=False, float_format=lambda number: f"{number:.3g}"), "\n")


if __name__ == "__main__":
    main()
