"""What surface points cost and how wrong they are: `python benchmarks/surface.py [--runs N]`.

Shapes whose exterior is known in closed form. `hidden` is the share of points where no straight line leads
outside; `missing` the share of the exterior's area that gets no points because it went unseen; `spread` is
chi-square per degree of freedom over cells of equal area (1 is ideal). Times are processor time, medians over
the runs, search tree included.
"""

import argparse
import functools
import os
import time
from collections.abc import Callable
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pandas as pd
import trimesh
from scipy.spatial.transform import Rotation

from palpate.shapes import CLASSES, make
from palpate.surface.depth_maps import VIEWS, sample_by_depth_maps
from palpate.surface.embree import Scene
from palpate.surface.rays import fibonacci_sphere, sample_by_area, sample_by_rays, sees_out

COUNT = 10_000
CELLS = 256
OBLIQUE = Rotation.from_euler("xyz", [0.5, 0.7, 0.3]).as_matrix()


class Shape(NamedTuple):
    """A mesh and where its points should be.

    `part` names the part of the surface that each point is on, `area` gives the exterior area of each part, 0
    for hidden ones.
    """

    name: str
    mesh: trimesh.Trimesh
    part: Callable[[np.ndarray], np.ndarray]
    area: dict[int, float]


def box(size: float, faces: int) -> trimesh.Trimesh:
    mesh = trimesh.creation.box((size,) * 3)
    while len(mesh.faces) < faces:
        mesh = mesh.subdivide()
    return mesh


def nested_boxes() -> Shape:
    mesh = trimesh.util.concatenate([box(0.28, 5000), box(0.27, 5000), box(0.1, 1000)])
    return Shape("box in box", mesh, lambda p: (np.abs(p).max(axis=1) < 0.1399).astype(int), {0: 1, 1: 0})


def two_spheres() -> Shape:
    left, right = (trimesh.creation.icosphere(subdivisions=4, radius=0.1) for _ in range(2))
    left.apply_translation((-0.05, 0, 0))
    right.apply_translation((0.05, 0, 0))

    def inside_either(points):
        to_centre = [np.linalg.norm(points - [x, 0, 0], axis=1) for x in (-0.05, 0.05)]
        return (np.minimum(*to_centre) < 0.0995).astype(int)

    return Shape("overlapping spheres", trimesh.util.concatenate([left, right]), inside_either, {0: 1, 1: 0})


def cup(depth_over_radius: float) -> Shape:
    """A cup with walls 2 % of its radius thick: outside, inside wall and floor are all exterior."""
    radius, inner = 0.05, 0.049
    height = radius * depth_over_radius
    profile = np.array([[0, 0], [radius, 0], [radius, height], [inner, height], [inner, 0.001], [0, 0.001]])
    mesh = trimesh.creation.revolve(profile, sections=96)
    while len(mesh.faces) < 5000:
        mesh = mesh.subdivide()

    def part(points):
        distance = np.hypot(points[:, 0], points[:, 1])
        wall = (distance < inner + 2e-4) & (points[:, 2] > 0.00101)
        floor = (distance < inner) & (np.abs(points[:, 2] - 0.001) < 1e-6)
        return wall * 1 + floor * 2

    outside = np.pi * radius**2 + 2 * np.pi * radius * height + np.pi * (radius**2 - inner**2)
    area = {0: outside, 1: 2 * np.pi * inner * (height - 0.001), 2: np.pi * inner**2}
    return Shape(f"cup {depth_over_radius:g} radii deep", mesh, part, area)


def torus() -> Shape:
    mesh = trimesh.creation.torus(0.2, 0.06, major_sections=100, minor_sections=50)
    return Shape("torus", mesh, lambda p: np.zeros(len(p), dtype=int), {0: 1})


def errors(shape: Shape, points: np.ndarray) -> dict[str, float]:
    part = shape.part(points)
    total = sum(shape.area.values())
    share = {name: (part == name).mean() for name in shape.area}
    missing = sum(
        max(0.0, shape.area[name] / total * (1 - share[name] / share[0] * shape.area[0] / shape.area[name]))
        for name in shape.area
        if shape.area[name] > 0 and name != 0
    )
    return {
        "hidden, %": 100 * sum(share[name] for name in shape.area if shape.area[name] == 0),
        "missing, %": 100 * missing,
    }


def spread(points: np.ndarray, reference: np.ndarray) -> float:
    """Chi-square per degree of freedom of points over cells that hold the same share of `reference`.

    Cells split the reference (many points that are uniform by construction) in halves again and again, along
    axes that no face is parallel to.
    """
    points, reference = points @ OBLIQUE, reference @ OBLIQUE
    place, truth = np.zeros(len(points), dtype=int), np.zeros(len(reference), dtype=int)
    for level in range(int(np.log2(CELLS))):
        for cell in np.unique(truth):
            axis = np.ptp(reference[truth == cell], axis=0).argmax()
            middle = np.median(reference[truth == cell][:, axis])
            truth[(truth == cell) & (reference[:, axis] > middle)] += 2**level
            place[(place == cell) & (points[:, axis] > middle)] += 2**level
    cells = truth.max() + 1
    observed = np.bincount(place, minlength=cells)
    expected = np.bincount(truth, minlength=cells) * len(points) / len(reference)
    return float(((observed - expected) ** 2 / expected).sum() / (cells - 1))


def milliseconds(mesh: trimesh.Trimesh, method, runs: int) -> float:
    times = []
    for run in range(runs):
        start = time.process_time()
        method(Scene(mesh), COUNT, np.random.default_rng(run))
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def measure(shape: Shape, method, runs: int) -> dict[str, float]:
    points = method(Scene(shape.mesh), COUNT, np.random.default_rng(0))
    candidates, face = trimesh.sample.sample_surface(shape.mesh, 400_000, seed=0)
    exterior = np.isin(
        shape.part(np.asarray(candidates)), [name for name, area in shape.area.items() if area]
    )
    row = {"shape": shape.name, "faces": len(shape.mesh.faces), "ms": milliseconds(shape.mesh, method, runs)}
    return row | errors(shape, points) | {"spread": spread(points, np.asarray(candidates)[exterior])}


def procedural_objects(runs: int) -> pd.DataFrame:
    """Objects with hidden parts and narrow gaps; what is missing is measured against 1024 directions."""
    rows = []
    for class_name in CLASSES:
        mesh = make(class_name, 1).to_geometry()
        scene = Scene(mesh)
        points, face = sample_by_area(scene, 2 * COUNT, np.random.default_rng(0))
        exterior = sees_out(scene, points, face, 1024).mean()
        for directions in (32, 64, 128):
            method = functools.partial(sample_by_rays, directions=directions)
            seen = sees_out(scene, points, face, directions).mean()
            rows.append(
                {
                    "object": class_name,
                    "faces": len(mesh.faces),
                    "exterior, %": 100 * exterior,
                    "directions": directions,
                    "ms": milliseconds(mesh, method, runs),
                    "missing, %": 100 * (1 - seen / exterior),
                }
            )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    shapes = [torus(), nested_boxes(), two_spheres(), cup(1), cup(2), cup(4), cup(8)]
    methods = {
        f"rays, {n} directions": functools.partial(sample_by_rays, directions=n)
        for n in (16, 32, 64, 128, 256)
    }
    for size in (64, 128, 256, 512):
        methods[f"depth maps, 6 x {size}"] = functools.partial(sample_by_depth_maps, resolution=size)
    more = np.concatenate([VIEWS, fibonacci_sphere(14)])
    methods["depth maps, 20 x 256"] = functools.partial(sample_by_depth_maps, resolution=256, views=more)
    rows = [
        {"method": name} | measure(shape, method, runs)
        for shape in shapes
        for name, method in methods.items()
    ]
    print(f"{COUNT} points, median of {runs} runs\n")
    for table in (pd.DataFrame(rows), procedural_objects(runs)):
        print(table.to_string(index=False, float_format=lambda number: f"{number:.3g}"), "\n")


if __name__ == "__main__":
    main()
