"""A small run made by the real functions: three objects in two batches, and one that was rejected."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

import palpate.store
from palpate import seal
from palpate.batch import generator
from palpate.hand import allegro
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.sensor import DIGIT
from palpate.touch import RayCaster, empty_reading, press_object, sense, shade_pressed
from palpate.vision import Image, paper_camera
from palpate.vision.image import vision_record

ATTRIBUTES = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
BATCHES = {"batch-0000": ["ball-0000", "block-0000"], "batch-0001": ["ball-0001", "ball-0002"]}
SPLITS = {"ball-0000": "train", "block-0000": "test", "ball-0001": "train", "ball-0002": "validation"}
REJECTED = "ball-0001"
SCALE = 0.001  # the sources are in millimetres
GRASPS = 2  # an object
SIZE = 64  # pixels of an image


def shape(name: str) -> trimesh.Trimesh:
    """An icosphere or a box of the dataset's scale, in its own frame."""
    if name.startswith("ball"):
        return trimesh.creation.icosphere(subdivisions=3, radius=DIAGONAL / np.sqrt(12))
    mesh = trimesh.creation.box((0.6, 0.4, 0.3))
    mesh.apply_scale(DIAGONAL / np.linalg.norm(mesh.extents))
    return mesh.subdivide().subdivide()


def surface_points(name: str) -> np.ndarray:
    points, _ = trimesh.sample.sample_surface(shape(name), 500, seed=generator(0, name, "surface"))
    return (points + OBJECT_POSITION).astype(np.float32)


def free_hand(hand, mesh, number: int, surface: np.ndarray, rng) -> tuple[np.ndarray, np.ndarray]:
    """Pose of a palm and joint positions, drawn at random until the hand is off the surface."""
    for _ in range(1000):
        (point,), (face,) = trimesh.sample.sample_surface(mesh, 1, seed=rng)
        normal = mesh.face_normals[face]
        side = np.cross(normal, rng.normal(size=3))
        side /= np.linalg.norm(side)
        axes = np.stack([-normal, side, np.cross(-normal, side)], axis=1)
        joint = rng.uniform(*hand.joint_range.T)
        position, rotation = hand.sensor_frames(hand.forward(np.eye(4), joint))
        seen_from = pose(point + 0.022 * normal + OBJECT_POSITION, axes)
        palm = seen_from @ np.linalg.inv(pose(position[number], rotation[number]))
        if hand.signed_distance(surface, hand.forward(palm, joint)).min() > 0:
            return palm, joint
    raise AssertionError("no hand is off the surface")


def grasp(name: str) -> dict[str, np.ndarray]:
    """Hands that are off the surface; in grasp k sensor k sees it 22 mm ahead."""
    hand, rng, mesh = allegro(), generator(0, name, "grasps"), shape(name)
    surface = surface_points(name).astype(float)
    drawn = [free_hand(hand, mesh, number, surface, rng) for number in range(GRASPS)]
    palms, joints = zip(*drawn, strict=True)
    links = hand.forward(np.array(palms), np.array(joints))
    position, rotation = hand.sensor_frames(links)
    tracer = RayCaster(mesh, OBJECT_POSITION)
    felt = [sense(tracer, *sensors).success for sensors in zip(position, rotation, strict=True)]
    return {
        "joint_positions": np.array(joints),
        "palm_pose": np.array(palms),
        "link_pose": links,
        "sensor_position": position,
        "sensor_rotation": rotation,
        "touches": np.array(felt),
        "penetration": np.full(GRASPS, 3e-4),
        "attempts": np.array(7),
    }


def pose(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def touch(name: str, grasps: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    position, rotation = grasps["sensor_position"], grasps["sensor_rotation"]
    felt = sense(RayCaster(shape(name), OBJECT_POSITION), position.reshape(-1, 3), rotation.reshape(-1, 3, 3))
    felt = {key: array.reshape(GRASPS, 4, *array.shape[1:]) for key, array in felt._asdict().items()}
    return {"position": position, "rotation": rotation, **felt}


def vision(name: str) -> dict[str, np.ndarray]:
    """What trimesh's own rays see from the paper's camera; a wall before the right half is the hand."""
    camera = paper_camera(SIZE)
    rays = camera.rays().reshape(-1, 3)
    mesh = shape(name).apply_translation(OBJECT_POSITION)
    origins = np.broadcast_to(camera.position, rays.shape)
    hits, pixels, _ = mesh.ray.intersects_location(origins, rays, multiple_hits=False)
    depth = np.full(SIZE**2, np.inf)
    depth[pixels] = camera.project(hits)[1]
    depth = depth.reshape(SIZE, SIZE)
    mask = np.where(np.isfinite(depth), 255, 0)
    wall = np.arange(SIZE) >= SIZE // 2
    image = np.where(mask[..., None], np.uint8(200), np.uint8(90)) * np.ones(3, np.uint8)
    held = Image(np.where(wall[:, None], np.uint8(50), image), np.where(wall, 0, mask), np.where(wall, 0.7, depth))
    return vision_record([(Image(image, mask, depth), [held] * GRASPS)], [camera])


def build(folder: Path) -> None:
    """Write the whole run."""
    rows = []
    (folder / "sources").mkdir(parents=True)
    for batch, names in BATCHES.items():
        for name in names:
            source = folder / "sources" / f"{name}.obj"
            source.write_text(f"# {name}\n")
            digest = hashlib.sha256(source.read_bytes()).hexdigest()
            rows.append(f"{name},{name.split('-')[0]},{SPLITS[name]},{batch},{source.name},{digest}")
    header = "object,class,split,batch,source,checksum"
    (folder / "catalogue.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "catalogue").mkdir()
    for batch in BATCHES:
        mine = [row for row in rows if row.split(",")[3] == batch]
        (folder / f"catalogue/{batch}.csv").write_text("\n".join([header, *mine]) + "\n")
    (folder / "rejected.csv").write_text(f"object,stage,reason\n{REJECTED},grasps,too few grasps\n")
    hand = {f"hand/{key}": array for key, array in allegro().to_arrays().items()}
    for batch, names in BATCHES.items():
        for name in names:
            mesh_folder = folder / "meshes" / batch / name
            mesh_folder.mkdir(parents=True)
            shape(name).export(mesh_folder / "visual.glb")
            shape(name).export(mesh_folder / "collision.ply")
            record = {"source": {"scale": "diagonal"}, "scale": SCALE, "diagonal": DIAGONAL}
            (mesh_folder / "mesh.json").write_text(json.dumps(record))
        seal.write(folder / "meshes" / batch)
        kept = [name for name in names if name != REJECTED]
        grasps = {name: grasp(name) for name in kept}
        arrays = {
            "surface": palpate.store.join(
                "surface", {name: {"points": surface_points(name), "scale": SCALE} for name in names}
            ),
            "grasps": palpate.store.join("grasps", grasps) | hand,
            "touch": palpate.store.join("touch", {name: touch(name, grasps[name]) for name in kept})
            | {"empty_reading": empty_reading()},
            "vision": palpate.store.join("vision", {name: vision(name) for name in kept}),
        }
        for stage, stored in arrays.items():
            path = folder / palpate.store.CONTRACT[stage].path(batch)
            palpate.store.write(path, stage, stored, ATTRIBUTES)


FRAMES: dict[tuple[str, str], dict[str, np.ndarray]] = {}  # arrays by stage and batch: made once a process


def add_frames(folder: Path) -> None:
    """Give the run, as it was built, the arrays of `make_frames`."""
    if not FRAMES:
        FRAMES.update(make_frames(folder))
    for (stage, batch), arrays in FRAMES.items():
        palpate.store.write(folder / palpate.store.CONTRACT[stage].path(batch), stage, arrays, ATTRIBUTES)


def make_frames(folder: Path, count: int = 3) -> dict[tuple[str, str], dict[str, np.ndarray]]:
    """Frames from the open hand on the straight way to the run's grasps, and images of the first and last."""
    hand, made = allegro(), {}
    for batch in BATCHES:
        grasps = palpate.store.read(folder / f"grasps/{batch}.h5")
        images = palpate.store.open(folder / f"vision/{batch}.zarr")
        records, pictures = {}, {}
        for row, name in enumerate(grasps["object"]):
            shares = np.linspace(0, 1, count)[:, None]
            start, end = hand.open_joint_positions, grasps["joint_positions"][row]
            joints = start + shares * (end - start)[:, None]
            joints[:, -1] = end
            links = hand.forward(grasps["palm_pose"][row][:, None], joints)
            position, rotation = hand.sensor_frames(links)
            for own, kept in ((links, "link_pose"), (position, "sensor_position"), (rotation, "sensor_rotation")):
                own[:, -1] = grasps[kept][row]
            depth = RayCaster(shape(name), OBJECT_POSITION).trace(position.reshape(-1, 3), rotation.reshape(-1, 3, 3))
            depth = depth.reshape(*position.shape[:3], *depth.shape[1:])
            records[name] = {
                **{"time": np.tile(0.2 * np.arange(count), (GRASPS, 1)), "joint_positions": joints},
                **{"joint_velocities": np.zeros_like(joints), "link_pose": links, "sensor_position": position},
                **{"sensor_rotation": rotation, "depth": depth, "success": np.isfinite(depth).any(axis=(3, 4))},
            }
            pictures[name] = {
                "image_frame": np.tile([0, count - 1], (GRASPS, 1)),
                "occluded": np.repeat(images["occluded"][row][:, None], 2, axis=1),
            }
        made["frames", batch] = palpate.store.join("frames", records) | {"empty_reading": empty_reading()}
        made["frame_images", batch] = palpate.store.join("frame_images", pictures)
    return made


PRESSES: dict[str, dict[str, np.ndarray]] = {}  # arrays by batch: made once a process


def add_presses(folder: Path) -> None:
    """Give the run two presses an object, with three forces each."""
    if not PRESSES:
        for batch, names in BATCHES.items():
            records = {}
            for name in names:  # grasps, which rejected one, are not read
                points, draw = surface_points(name) - OBJECT_POSITION, generator(0, name, "press")
                arrays, _ = press_object(shape(name), points, DIGIT, draw, 2, (0.5, 1.0, 2.0), tilt=0.05)
                records[name] = arrays | {key: arrays[key] + OBJECT_POSITION for key in ("point", "position")}
            empty = shade_pressed(np.zeros(DIGIT.resolution), DIGIT)
            PRESSES[batch] = palpate.store.join("press", records) | {"empty_reading": empty}
    for batch, arrays in PRESSES.items():
        palpate.store.write(folder / palpate.store.CONTRACT["press"].path(batch), "press", arrays, ATTRIBUTES)


BUILT: list[Path] = []  # of this process: the fixture is of several folders


@pytest.fixture(scope="session")
def built(tmp_path_factory) -> Path:
    """The run, to be read only."""
    if not BUILT:
        folder = tmp_path_factory.mktemp("runs") / "small"
        build(folder)
        BUILT.append(folder)
    return BUILT[0]


@pytest.fixture
def run(built, tmp_path) -> Path:
    """A copy of the run, to be damaged."""
    return shutil.copytree(built, tmp_path / "small")
