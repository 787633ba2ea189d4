"""What grasps cost, how wrong they are, what they leave out: `python benchmarks/grasp.py [table ...]`.

Tables: stages, timestep, left_out, statistics (default: all). Objects are procedural, `--objects`
of each class, with the meshes and surface points that the workflow gives them by default: the first row of
the statistics is that of a default run. Times are processor time on one core; medians. Errors of time steps
are against the same closing at a time step of 0.1 ms.
"""

import argparse
import os
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import mujoco
import numpy as np
import pandas as pd
import trimesh

from palpate import shapes
from palpate.catalogue import generator
from palpate.grasp.closing import TIMESTEP, GraspScene
from palpate.grasp.grasp import THUMB_SHARE, Grasper, grasp_object, workspace_of
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck, deepest
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual, prepare
from palpate.surface import sample

HAND = allegro()
REFERENCE = 1e-4  # s
TIMESTEPS = (0.0005, 0.001, 0.002, 0.004, 0.005, 0.01)
CASES = 3  # closings an object
POINTS = 10_000  # of an object's surface, as in config/config.yaml
PAPER = {"bottle": 71.8, "knife": 54.1, "cellphone": 67.2, "rifle": 53.6}


class Case(NamedTuple):
    """One palm pose, clear of the object, and the targets of the closing."""

    pose: np.ndarray
    targets: np.ndarray


class Shape(NamedTuple):
    """An object: every face and the decimated mesh in its own frame, surface points (N, 3) in the world."""

    name: str
    visual: trimesh.Trimesh
    collision: trimesh.Trimesh
    points: np.ndarray


class Subject(NamedTuple):
    """An object with what grasps it, and the closings that are compared."""

    shape: Shape
    grasper: Grasper
    cases: list[Case]


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


def subjects_of(count: int) -> list[Subject]:
    return [subject(procedural(name, index)) for name in shapes.CLASSES for index in range(count)]


def subject(shape: Shape) -> Subject:
    points = shape.points.astype(float) - OBJECT_POSITION
    grasper = Grasper(shape.visual, shape.collision, points, HAND, max_penetration=np.inf)
    rng, cases = generator(0, shape.name, "benchmark"), []
    while len(cases) < CASES:
        pose = grasper.free_palm_pose(rng)
        if pose is None:
            break
        cases.append(Case(pose, grasper.workspace.targets(pose, grasper.surface)))
    return Subject(shape, grasper, cases)


def closed(scene: GraspScene, case: Case):
    """Joint positions, whether they are finite, and the processor time in ms."""
    start = time.process_time()
    scene.place(case.pose, HAND.open_joint_positions)
    result = scene.close(case.targets)
    return result.joint_positions, result.finite, 1e3 * (time.process_time() - start)


def compared(scenes, subjects, reference) -> dict:
    """Error, cost and penetration of closings in `scenes`, one an object, against reference positions."""
    joints, tips, times, depths, changed, unstable = [], [], [], [], 0, 0
    for scene, subject, expected in zip(scenes, subjects, reference, strict=True):
        for case, right in zip(subject.cases, expected, strict=True):
            found, finite, spent = closed(scene, case)
            times.append(spent)
            if not finite:
                unstable += 1
                continue
            joints.append(np.degrees(np.abs(found - right)))
            links, right_links = HAND.forward(case.pose, found), HAND.forward(case.pose, right)
            position, rotation = HAND.sensor_frames(links)
            right_position, right_rotation = HAND.sensor_frames(right_links)
            tips.append(1e3 * np.linalg.norm(position - right_position, axis=1))
            depths.append(1e3 * subject.grasper.check.in_object(links))
            caster = subject.grasper.caster
            touches = caster.succeeds(position, rotation)
            changed += (touches != caster.succeeds(right_position, right_rotation)).sum()
    return {
        "ms a closing": np.median(times),
        "joint p50, deg": np.percentile(joints, 50),
        "joint p95, deg": np.percentile(joints, 95),
        "tip p95, mm": np.percentile(tips, 95),
        "tip max, mm": np.max(tips),
        "touches changed, %": 100 * changed / (4 * max(1, len(tips))),
        "penetration max, mm": np.max(depths),
        "NaN": unstable,
    }


def reference_closings(subjects) -> list:
    scenes = [GraspScene(HAND, surface_patches(each.shape.collision), REFERENCE) for each in subjects]
    return [
        [closed(scene, case)[0] for case in each.cases] for scene, each in zip(scenes, subjects, strict=True)
    ]


def timestep(subjects) -> pd.DataFrame:
    reference = reference_closings(subjects)
    rows = {}
    for step in TIMESTEPS:
        scenes = [GraspScene(HAND, surface_patches(each.shape.collision), step) for each in subjects]
        rows[f"{1e3 * step:g} ms"] = compared(scenes, subjects, reference)
    return pd.DataFrame(rows).T


def gravity(model):
    model.opt.gravity[2] = -9.81


def friction(model):
    model.geom_condim[:] = 3


def elliptic_cone(model):
    model.geom_condim[:] = 3
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC


def no_self_collision(model):
    of_object = model.geom_bodyid == model.body("object").id
    model.geom_contype[:], model.geom_conaffinity[:] = ~of_object, of_object


def more_iterations(model):
    model.opt.iterations = 100


def unchanged(model):
    pass


def left_out(subjects) -> pd.DataFrame:
    """What is left out, put back in; and self-collision, which is kept, taken out. Against the default."""
    reference = [[closed(each.grasper.scene, case)[0] for case in each.cases] for each in subjects]
    rows = {}
    for label, change in {
        "the default": unchanged,
        "gravity": gravity,
        "friction": friction,
        "friction, elliptic cone": elliptic_cone,
        "100 solver iterations": more_iterations,
        "no self-collision": no_self_collision,
    }.items():
        scenes = []
        for each in subjects:
            scene = GraspScene(HAND, surface_patches(each.shape.collision))
            change(scene.model)
            scenes.append(scene)
        rows[label] = compared(scenes, subjects, reference)
    rows["patches out of reach left out"] = compared_near(subjects, reference)
    return pd.DataFrame(rows).T


def compared_near(subjects, reference) -> dict:
    """As `compared`, with the patches only that the hand can reach at each palm pose: a scene a closing."""
    rows = []
    for each, expected in zip(subjects, reference, strict=True):
        patches = surface_patches(each.shape.collision)
        reach = np.linalg.norm(HAND.sensor_position, axis=1).max() + 0.25
        for case, right in zip(each.cases, expected, strict=True):
            near = [p for p in patches if np.linalg.norm(p - case.pose[:3, 3], axis=1).min() < reach]
            scene = GraspScene(HAND, near)
            rows.append(compared([scene], [each._replace(cases=[case])], [[right]]))
    return pd.DataFrame(rows).agg(
        {name: "median" if "p50" in name or "closing" in name else "max" for name in rows[0]}
    )


def statistics(count: int) -> pd.DataFrame:
    """The default's grasps, and those with the thumb in every attempt or the best of more attempts."""
    rows = {}
    made = {name: [procedural(name, index) for index in range(count)] for name in shapes.CLASSES}
    for label, settings in {
        f"default: attempts 5, thumb_share {THUMB_SHARE}": {},
        "thumb_share 0": {"thumb_share": 0.0},
        "thumb_share 1": {"thumb_share": 1.0},
        "attempts 10": {"attempts": 10},
        "attempts 20, thumb_share 1": {"attempts": 20, "thumb_share": 1.0},
    }.items():
        touches, spent = {}, []
        for name, members in made.items():
            found = []
            for each in members:
                start = time.process_time()
                rng = generator(0, each.name, "grasps")
                found.append(grasp_object(each.visual, each.collision, each.points, HAND, rng, **settings))
                spent.append(1e3 * (time.process_time() - start))
            touches[name] = np.concatenate([each.touches for each in found])
        together = np.concatenate(list(touches.values()))
        shares = np.bincount(together.sum(axis=1), minlength=5)[1:] / len(together)
        rows[label] = (
            {name: 100 * values.mean() for name, values in touches.items()}
            | {"mean": 100 * together.mean()}
            | {f"{number} touches, %": 100 * share for number, share in enumerate(shares, start=1)}
            | {"ms an object": np.median(spent)}
        )
    shares = {f"{number} touches, %": value for number, value in enumerate((9.47, 26.08, 53.83, 10.61), 1)}
    rows["paper"] = PAPER | {"mean": 62.4} | shares
    return pd.DataFrame(rows).T


def stages(subjects) -> pd.DataFrame:
    """Where the time of an object goes, in ms of processor time."""
    rows = []
    for each in subjects:
        spent = {}

        def timed(name, function, *arguments, spent=spent):
            start = time.process_time()
            result = function(*arguments)
            spent[name] = spent.get(name, 0) + 1e3 * (time.process_time() - start)
            return result

        patches = timed("patches", surface_patches, each.shape.collision)
        scene = timed("compiled model", GraspScene, HAND, patches, TIMESTEP)
        check = timed("penetration check, set-up", PenetrationCheck, HAND, each.shape.visual)
        grasper = each.grasper
        rng = generator(1, each.shape.name)
        pose = timed("placement", grasper.free_palm_pose, rng)
        targets = timed("inverse kinematics", grasper.workspace.targets, pose, grasper.surface)
        scene.place(pose, HAND.open_joint_positions)
        joints = timed("closing", scene.close, targets).joint_positions
        links = HAND.forward(pose, joints)
        timed("touches", grasper.caster.succeeds, *HAND.sensor_frames(links))
        found = timed("penetration, object", check.in_object, links)
        timed("penetration, itself", check.in_itself, links)
        every = timed("(penetration, nothing left out)", everywhere, check, links)
        assert abs(found - every) < 5e-4, "what is left out of the penetration check changes it"
        rows.append(spent)
    table = pd.DataFrame(rows)
    return pd.DataFrame({"median, ms": table.median(), "max, ms": table.max()})


def everywhere(check: PenetrationCheck, link_pose) -> float:
    """The penetration check without its sorting by place: every triangle against every geom."""
    poses = HAND.geom_poses(link_pose)
    depth = 0.0
    for geom in check.geoms:
        depth = deepest(check.triangles, lambda p, g=geom: HAND.geom_distance(g, p, poses[g]), depth)
    return depth


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tables = ("stages", "timestep", "left_out", "statistics")
    parser.add_argument("tables", nargs="*", metavar="table", help=", ".join(tables))
    parser.add_argument("--objects", type=int, default=2, help="of each class (default 2)")
    arguments = parser.parse_args()
    workspace_of(HAND)
    chosen = arguments.tables or tables
    subjects = subjects_of(arguments.objects) if set(chosen) & {"stages", "timestep", "left_out"} else []
    for name in chosen:
        table = statistics(arguments.objects) if name == "statistics" else globals()[name](subjects)
        print(f"\n{name}\n{table.round(3).to_string()}", flush=True)


if __name__ == "__main__":
    main()
