"""Run time of the steps of touch: `python -m studies.benchmarks.touch [--runs N]`.

Four sensors press on a 20,480-face object, as in a grasp. Times are processor time (all threads added up, as
on one core), medians over the runs. Errors against time: `studies.error_vs_runtime.touch`.
"""

import argparse
import os
import time

os.environ |= {"OMP_NUM_THREADS": "1", "IGL_NUM_THREADS": "1"}

import numpy as np
import pandas as pd
import trimesh
from scipy.spatial.transform import Rotation

from palpate.touch import RayCaster, local_points, sense, shade
from studies.timing import interleaved

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


def grasp_steps(mesh, runs: int) -> pd.DataFrame:
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
    times = interleaved(steps, runs, clock=time.process_time)
    return pd.DataFrame([{"step": name, "ms": 1e3 * spent.seconds} for name, spent in times.items()])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    mesh = bumpy_sphere()
    print(f"{len(mesh.faces)} faces, median of {runs} runs\n")
    print(grasp_steps(mesh, runs).to_string(index=False, float_format=lambda number: f"{number:.3g}"))


if __name__ == "__main__":
    main()
