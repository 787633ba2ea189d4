"""A small run, made by the stages' own functions, but the hand is placed at random near the surface."""

import csv
from pathlib import Path

import numpy as np
import pytest

from palpate import shapes, surface
from palpate.batch import generator
from palpate.dataset import Dataset
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION, load_visual, prepare
from palpate.sensor import DIGIT
from palpate.store import join, write
from palpate.touch import RayCaster, empty_reading, sense
from palpate.vision import Image, paper_camera
from palpate.vision.image import vision_record

ATTRIBUTES = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
BATCH = "batch-0000"
CURL = np.array([0.0, 0.9, 0.7, 0.5] * 3 + [1.2, 0.5, 0.5, 0.5])  # of the joints of a hand about to close
TRIALS = 60


def build_run(folder: Path, objects: list[str], grasps: int = 2, vision=None) -> None:
    """Write a run of one batch; objects are named `<class>-<index>`, those of class sock are rejected.

    vision: gives an object's record of the vision store; without it images are of one colour.
    """
    folder.mkdir(parents=True)
    usable = [name for name in objects if not name.startswith("sock")]
    hand = allegro()
    records = {stage: {} for stage in ("surface", "grasps", "touch", "vision")}
    for name in usable:
        class_name, index = name.split("-")
        source = shapes.write(class_name, int(index), folder / f"{name}.glb")
        meshes = folder / "meshes" / BATCH / name
        prepare(source, meshes, collision_faces=1000)
        mesh, rng = load_visual(meshes), generator(0, name, "test")
        points = surface.sample(mesh, 10000, rng) + OBJECT_POSITION
        tracer = RayCaster(mesh, OBJECT_POSITION)
        poses = [random_grasp(hand, mesh, tracer, rng) for _ in range(grasps)]
        grasp = grasp_record(hand, poses)
        records["surface"][name] = {"points": points.astype(np.float32)}
        records["grasps"][name] = grasp
        records["touch"][name] = touch_record(tracer, grasp)
        records["vision"][name] = (vision or plain_images)(meshes, hand, grasp)
    extra = {
        "touch": {"empty_reading": empty_reading()},
        "grasps": {f"hand/{name}": array for name, array in hand.to_arrays().items()},
    }
    for stage, suffix in (("surface", "zarr"), ("grasps", "h5"), ("touch", "zarr"), ("vision", "zarr")):
        arrays = join(stage, records[stage]) | extra.get(stage, {})
        write(folder / stage / f"{BATCH}.{suffix}", stage, arrays, ATTRIBUTES)
    splits = ("train", "validation", "test")
    rows = [(name, name.split("-")[0], splits[i % 3], BATCH) for i, name in enumerate(objects)]
    write_csv(folder / "catalogue.csv", ("object", "class", "split", "batch"), rows)
    rejected = [(name, "grasps", "flat") for name in objects if name not in usable]
    write_csv(folder / "rejected.csv", ("object", "stage", "reason"), rejected)


def write_csv(path: Path, header: tuple, rows: list[tuple]) -> None:
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def random_grasp(hand, mesh, tracer, rng) -> tuple[np.ndarray, np.ndarray]:
    """Palm pose and joint positions: of many placements over the surface, the one with most touches."""
    best = (-1, None, None)
    for point, face in zip(*mesh.sample(TRIALS, return_index=True, seed=int(rng.integers(2**31))), strict=True):
        normal = mesh.face_normals[face]
        tangent = np.cross(normal, rng.normal(size=3))
        tangent /= np.linalg.norm(tangent)
        rotation = np.stack([-normal, np.cross(tangent, -normal), tangent], axis=1)
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = point + OBJECT_POSITION - rotation @ [0.0113 + rng.uniform(0.01, 0.05), 0, 0.02]
        joints = CURL * rng.uniform(0.5, 1.5)
        touches = tracer.succeeds(*hand.sensor_frames(hand.forward(pose, joints))).sum()
        if touches > best[0]:
            best = (touches, pose, joints)
    return best[1:]


def grasp_record(hand, poses) -> dict[str, np.ndarray]:
    palm, joints = (np.stack(part) for part in zip(*poses, strict=True))
    link = hand.forward(palm, joints)
    position, rotation = hand.sensor_frames(link)
    count = len(poses)
    return {
        "joint_positions": joints,
        "palm_pose": palm,
        "link_pose": link,
        "sensor_position": position,
        "sensor_rotation": rotation,
        "touches": np.ones((count, 4), bool),
        "penetration": np.linspace(1e-4, 3e-4, count, dtype=np.float32),
        "attempts": np.int32(7),
    }


def touch_record(tracer, grasp) -> dict[str, np.ndarray]:
    position, rotation = grasp["sensor_position"], grasp["sensor_rotation"]
    readings = [sense(tracer, *pose) for pose in zip(position, rotation, strict=True)]
    arrays = {name: np.stack([getattr(r, name) for r in readings]) for name in readings[0]._fields}
    return arrays | {"position": position, "rotation": rotation}


def plain_images(meshes, hand, grasp) -> dict[str, np.ndarray]:
    """Images of an object that the hand hides by half."""
    count, size = len(grasp["palm_pose"]), 64
    half = np.zeros((size, size), np.uint8)
    half[: size // 2] = 255
    depth = np.ones((size, size), np.float16)
    alone = Image(np.full((size, size, 3), 200, np.uint8), np.full((size, size), 255, np.uint8), depth)
    held = Image(np.full((size, size, 3), 90, np.uint8), half, depth)
    return vision_record([(alone, [held] * count)], [paper_camera(size)])


@pytest.fixture(scope="session")
def run(tmp_path_factory) -> Path:
    """A run of two bottles, a knife, and a sock that could not be grasped."""
    folder = tmp_path_factory.mktemp("reports") / "run"
    build_run(folder, ["bottle-0000", "bottle-0001", "knife-0000", "sock-0000"])
    return folder


@pytest.fixture
def dataset(run) -> Dataset:
    return Dataset(run)
