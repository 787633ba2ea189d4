"""Run time of grasps, and their statistics: `python -m studies.benchmarks.grasp [table ...]`.

Tables: stages, statistics, sizes (default: all). Objects are procedural, `--objects` of each class, with the
meshes and surface points that the workflow gives them by default: the first row of the statistics is that of a
default run. Those of `sizes` keep their size. Times are processor time on one core; medians. Errors against time:
`snakemake reports`.
"""

import argparse
import os
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pandas as pd
import trimesh

from palpate import shapes
from palpate.batch import generator
from palpate.grasp.closing import TIMESTEP, GraspSimulation
from palpate.grasp.grasp import THUMB_SHARE, Grasper, grasp_object, workspace_of
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual, prepare
from palpate.surface import sample

HAND = allegro()
POINTS = 10_000  # of an object's surface, as in config/config.yaml
PAPER = {"bottle": 71.8, "knife": 54.1, "cellphone": 67.2, "rifle": 53.6}
COUNTS = [f"{number} touches, %" for number in range(1, 5)]


class Shape(NamedTuple):
    """An object: every face and the decimated mesh in its own frame, surface points (N, 3) in the world."""

    name: str
    visual: trimesh.Trimesh
    collision: trimesh.Trimesh
    points: np.ndarray


@cache
def procedural(class_name: str, index: int) -> Shape:
    """An object as the workflow's stages make it."""
    name = f"{class_name}-{index:04d}"
    with tempfile.TemporaryDirectory() as folder:
        source = shapes.write(class_name, index, Path(folder) / name)
        prepare(source, Path(folder) / "meshes", levels=())
        visual, collision = load_visual(Path(folder) / "meshes"), load_collision(Path(folder) / "meshes")
    points = sample(visual, POINTS, generator(0, name, "surface")) + OBJECT_POSITION
    return Shape(name, visual, collision, points.astype(np.float32))  # as it is stored


def statistics(count: int) -> pd.DataFrame:
    """Statistics of grasps with the default settings, other shares of thumb grasps, and more attempts."""
    rows, variants = {}, {f"default: attempts 5, thumb_share {THUMB_SHARE}": {}}
    variants |= {f"thumb_share {share}": {"thumb_share": float(share)} for share in (0, 1)}
    variants |= {"attempts 10": {"attempts": 10}, "attempts 20, thumb_share 1": {"attempts": 20, "thumb_share": 1.0}}
    objects = {name: [procedural(name, index) for index in range(count)] for name in shapes.CLASSES}
    for label, settings in variants.items():
        touches, spent = {}, []
        for name, members in objects.items():
            found = []
            for each in members:
                start = time.process_time()
                rng = generator(0, each.name, "grasps")
                found.append(grasp_object(each.visual, each.collision, each.points, HAND, rng, **settings).touches)
                spent.append(1e3 * (time.process_time() - start))
            touches[name] = np.concatenate(found)
        together = np.concatenate(list(touches.values()))
        shares = 100 * np.bincount(together.sum(axis=1), minlength=5)[1:] / len(together)
        rows[label] = {name: 100 * values.mean() for name, values in touches.items()} | {"mean": 100 * together.mean()}
        rows[label] |= dict(zip(COUNTS, shares, strict=True)) | {"ms an object": np.median(spent)}
    rows["paper"] = PAPER | {"mean": 62.4} | dict(zip(COUNTS, (9.47, 26.08, 53.83, 10.61), strict=True))
    return pd.DataFrame(rows).T


def stages(count: int) -> pd.DataFrame:
    """Processor time of each step of an object's grasps, ms."""
    rows = []
    for shape in [procedural(name, index) for name in shapes.CLASSES for index in range(count)]:
        spent = {}

        def timed(name, function, *arguments, spent=spent):
            start = time.process_time()
            result = function(*arguments)
            spent[name] = spent.get(name, 0) + 1e3 * (time.process_time() - start)
            return result

        patches = timed("patches", surface_patches, shape.collision)
        simulation = timed("compiled model", GraspSimulation, HAND, patches, TIMESTEP)
        check = timed("penetration check, set-up", PenetrationCheck, HAND, shape.visual)
        own_points = shape.points.astype(float) - OBJECT_POSITION
        grasper = Grasper(shape.visual, shape.collision, own_points, HAND, max_penetration=np.inf)
        rng = generator(1, shape.name)
        pose = timed("placement", grasper.free_palm_pose, rng)
        targets = timed("inverse kinematics", grasper.workspace.targets, pose, grasper.surface)
        simulation.place(pose, HAND.open_joint_positions)
        joints = timed("closing", simulation.close, targets).joint_positions
        links = HAND.forward(pose, joints)
        timed("touches", grasper.caster.succeeds, *HAND.sensor_frames(links))
        timed("penetration, object", check.in_object, links)
        timed("penetration, itself", check.in_itself, links)
        rows.append(spent)
    table = pd.DataFrame(rows)
    return pd.DataFrame({"median, ms": table.median(), "max, ms": table.max()})


def real_sizes() -> dict[str, trimesh.Trimesh]:
    """Objects in metres, from smaller than a sensor to larger than a hand."""
    handle = trimesh.creation.torus(0.03, 0.005)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    handle.apply_translation((0.05, 0, 0))
    feet = [(x, y, -0.22) for x, y in ((-0.2, -0.2), (-0.2, 0.2), (0.2, -0.2), (0.2, 0.2))]
    legs = [trimesh.creation.cylinder(0.02, 0.45, sections=24).apply_translation(foot) for foot in feet]
    back = trimesh.creation.box((0.45, 0.03, 0.5)).apply_translation((0, 0.21, 0.25))
    return {
        "ball, 8 mm": trimesh.creation.icosphere(radius=0.004),
        "cube, 2 cm": trimesh.creation.box((0.02, 0.02, 0.02)),
        "mug": trimesh.util.concatenate([trimesh.creation.annulus(0.038, 0.041, 0.095, sections=64), handle]),
        "book": trimesh.creation.box((0.2, 0.03, 0.28)),
        "chair": trimesh.util.concatenate([trimesh.creation.box((0.45, 0.45, 0.04)), back, *legs]),
        "ball, 1.14 m": trimesh.creation.icosphere(subdivisions=5, radius=0.57),
    }


def sizes(_: int) -> pd.DataFrame:
    """Grasps of objects that keep their size (`source.scale: keep`)."""
    rows = {}
    for name, mesh in real_sizes().items():
        with tempfile.TemporaryDirectory() as folder:
            mesh.export(Path(folder) / "object.ply")
            record = prepare(Path(folder) / "object.ply", Path(folder) / "meshes", levels=(), scale="keep")
            visual, collision = load_visual(Path(folder) / "meshes"), load_collision(Path(folder) / "meshes")
        points = sample(visual, POINTS, generator(0, name, "surface")) + OBJECT_POSITION
        start = time.process_time()
        found = grasp_object(visual, collision, points, HAND, generator(0, name, "grasps"))
        rows[name] = {
            "diagonal, m": record["diagonal"],
            "touches": " ".join(map(str, found.touches.sum(axis=1))),
            "attempts": found.attempts,
            "s": time.process_time() - start,
        }
    return pd.DataFrame(rows).T


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tables = {"stages": stages, "statistics": statistics, "sizes": sizes}
    parser.add_argument("tables", nargs="*", metavar="table", help=", ".join(tables))
    parser.add_argument("--objects", type=int, default=2, help="of each class (default 2)")
    arguments = parser.parse_args()
    workspace_of(HAND)
    for name in arguments.tables or tables:
        table = tables[name](arguments.objects)
        print(f"\n{name}\n{table.round(3).to_string()}", flush=True)


if __name__ == "__main__":
    main()
