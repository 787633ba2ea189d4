"""Options that are not the default, in one run: hand, sensor, cameras, lights, masters, frames."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

import palpate
from palpate.camera import Camera, looking_at
from palpate.grasp.penetration import geom_surface
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import SHIPPED
from palpate.store import read
from palpate.vision.image import read_layers
from tests.hand import grippers

GRASPS, POINTS, SIZE = 2, 2000, 96
CAMERAS = [
    {"position": [1.0, -0.8, 1.0], "target": [0, 0, 0.6]},
    {"position": [0, 2.5, 0.6], "rotation": [90, 0, 180], "field_of_view": 20},  # farther away than 2 m
]
SENSORS = grippers.SENSORS | {"sensors": grippers.SENSORS["sensors"][:3], "thumb": ["right_end"]}
PIXELS = 40


@pytest.fixture(scope="module")
def run(make_workflow, tmp_path_factory):
    hand = tmp_path_factory.mktemp("a hand")  # paths may have spaces
    # The drawn ball would hide the fingers.
    (hand / "hand.xml").write_text(grippers.two_fingers("degree").replace('size=".2"', 'size=".02"'))
    (hand / "sensors.yaml").write_text(yaml.safe_dump(SENSORS))
    smoothing = {"pyramid": [5e-4], "last": 1e-4, "held": 0.5}
    own = {
        "name": "own",
        "resolution": PIXELS,
        "gel": {"face": {"radius": 0.02}},
        "smoothing": smoothing,
        "background": "gel.png",
    }
    (hand / "own.yaml").write_text(yaml.safe_dump(yaml.safe_load((SHIPPED / "digit.yaml").read_text()) | own))
    Image.new("RGB", (64, 64), (90, 120, 100)).save(hand / "gel.png")
    workflow = make_workflow(
        classes=[{"class": "can", "objects": "all"}],
        surface={"points": POINTS},
        grasps={
            "per_object": GRASPS,
            "attempts": GRASPS,
            "thumb_share": 1.0,
            "hand": {"sensors": str(hand / "sensors.yaml"), "mjcf": str(hand / "hand.xml")},
        },
        touch={"sensor": str(hand / "own.yaml")},
        vision={"size": SIZE, "samples": 2, "device": "cpu", "exr": True, "background": "transparent"}
        | {"cameras": CAMERAS, "lights": [{"kind": "point", "energy": 9, "position": [1, -1, 2]}]},
        mesh={"collision_faces": 500},
        frames={"count": 6, "contacts": True, "images": 3},
        hold={"test": True, "duration": 0.1},
    )
    result = workflow("dataset", "validate", object_pages=True)
    assert result.returncode == 0, result.stderr
    return workflow.run


def test_sizes_are_those_of_the_config(run):
    dataset = palpate.Dataset(run)
    assert dataset.objects == ["can-nested-flat", "can-tall"]
    assert dataset.array("surface", "points").shape == (2, POINTS, 3)
    assert dataset.array("vision", "occluded").shape == (2, GRASPS, 2, SIZE, SIZE, 4)
    assert dataset.array("grasps", "joint_positions").shape == (2, GRASPS, 5)  # the gripper's hinges
    assert dataset.array("touch", "reading").shape == (2, GRASPS, 3, PIXELS, PIXELS, 3)
    assert dataset.sensor.name == "own" and dataset.sensor.gel_radius == 0.02
    assert (dataset.empty_reading == (90, 120, 100)).all() and (dataset.sensor.background == (90, 120, 100)).all()
    names = {path.name for path in dataset[0].mesh.iterdir()}
    assert names == {"visual.glb", "collision.ply", "mesh.json"}


def test_masters_hold_what_the_store_holds(run):
    stored = read(run / "vision/batch-0000.zarr")
    assert len(list((run / "exr/batch-0000").glob("*.exr"))) == 2 * (1 + GRASPS) * len(CAMERAS)
    for number, name in enumerate(stored["object"]):
        for camera, end in enumerate(("", "-camera-1")):
            image = read_layers(run / f"exr/batch-0000/{name}-unoccluded{end}.exr").image(None)
            np.testing.assert_array_equal(image.rgb, stored["unoccluded"][number, camera])
            for grasp in range(GRASPS):
                image = read_layers(run / f"exr/batch-0000/{name}-grasp-{grasp}{end}.exr").image(None)
                np.testing.assert_array_equal(image.depth, stored["occluded_depth"][number, grasp, camera])


def test_the_last_frame_is_the_grasp_with_its_touch_and_images(run):
    for record in palpate.Dataset(run):
        for grasp in record.grasps:
            frames = grasp.frames
            assert len(frames) == 6 and list(frames.image_frame) == [0, 2, 5]
            for name in ("joint_positions", "link_pose", "sensor_position", "sensor_rotation", "success", "depth"):
                np.testing.assert_array_equal(getattr(frames, name)[-1], getattr(grasp, name), err_msg=name)
            np.testing.assert_array_equal(frames.reading[-1], grasp.reading)
            np.testing.assert_array_equal(frames.occluded[-1], grasp.occluded)
            np.testing.assert_array_equal(grasp.seen_by(1).frames.occluded[-1], grasp.seen_by(1).occluded)
            assert (frames.reading[0][~frames.success[0]] == (90, 120, 100)).all()  # the gel's image
            assert frames.occluded.shape == (3, SIZE, SIZE, 4)


def silhouettes(record, grasp, camera):
    """What rays through pixels' centres meet of the object and of the hand in each of f frames: (f, SIZE, SIZE) bool.

    The hand's shapes are trimesh's, and so are the rays.
    """
    hand, found = record.hand, []
    shapes = [geom_surface(hand, geom).reshape(-1, 3) for geom in range(len(hand.geom_link))]
    visual = trimesh.load_mesh(record.mesh / "visual.glb").triangles + np.array(OBJECT_POSITION)
    rays = camera.rays().reshape(-1, 3)
    for links in grasp.frames.link_pose:
        poses = hand.geom_poses(links)
        placed = [shape @ pose[:3, :3].T + pose[:3, 3] for shape, pose in zip(shapes, poses, strict=True)]
        corners = np.concatenate([visual.reshape(-1, 3), *placed])
        mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
        found.append(mesh.ray.intersects_any(np.tile(camera.position, (len(rays), 1)), rays).reshape(SIZE, SIZE))
    return np.array(found)


def test_every_image_is_of_its_own_frame(run):
    """Where the silhouettes of two frames differ, an image is as that of its own."""
    compared = set()
    for record in palpate.Dataset(run):
        for number, grasp in product(range(len(CAMERAS)), record.grasps):
            seen = grasp.seen_by(number)
            outlines = silhouettes(record, grasp, Camera.from_matrices(seen.intrinsics, seen.extrinsics, SIZE))
            for image, own in zip(seen.frames.occluded, seen.frames.image_frame, strict=True):
                covered = image[..., 3] >= 128
                for other, differs in enumerate(outlines != outlines[own]):
                    if differs.sum() >= 16:  # pixels: more than the rounding at an edge
                        assert (covered == outlines[own])[differs].mean() > 0.75, (record.name, grasp, own, other)
                        compared.add((int(own), other))
    assert compared >= {(0, 1), (2, 0), (2, 1), (2, 3), (2, 5), (5, 0), (5, 2)}


def test_grasps_have_contacts_and_labels(run):
    for record in palpate.Dataset(run):
        for grasp in record.grasps:
            assert (grasp.held_along == (grasp.moved <= 0.02)).all() and grasp.held == grasp.held_along.min()
            count, position = grasp.frames.contact_count, grasp.frames.contact_position
            assert count[0] == 0 and position[-1, : count[-1]].any(axis=1).all()
    assert (run / "tables/hold.csv").read_text().startswith("class,touches,objects,grasps,all_percent")


def test_frames_have_a_figure_that_moves(run):
    with Image.open(run / "figures/closing.gif") as figure:
        assert figure.n_frames == 6 and figure.info["loop"] == 0


def test_cameras_are_those_of_the_config(run):
    dataset = palpate.Dataset(run)
    expected = [
        looking_at((0, 0, 0.6), (1, -0.8, 1), SIZE),
        replace(looking_at((0, 0, 0.6), (0, 2.5, 0.6), SIZE), focal_length=SIZE / 2 / np.tan(np.radians(10))),
    ]
    np.testing.assert_allclose(dataset.cameras(), [[camera.matrix() for camera in expected]] * 2, atol=1e-2)
    assert dataset[0].cameras == 2


def test_the_files_that_an_own_hand_names_are_inputs_of_its_grasps(make_workflow, tmp_path):
    (tmp_path / "parts").mkdir()
    trimesh.creation.box((0.01, 0.02, 0.03)).export(tmp_path / "parts/link.stl")
    model = grippers.two_fingers("degree").replace("<asset>", '<asset><mesh name="link" file="parts/link.stl"/>')
    (tmp_path / "hand.xml").write_text(model)
    (tmp_path / "sensors.yaml").write_text(yaml.safe_dump(grippers.SENSORS))
    hand = {"mjcf": str(tmp_path / "hand.xml"), "sensors": str(tmp_path / "sensors.yaml")}
    jobs = make_workflow(grasps={"hand": hand}).jobs("grasps/batch-0000.h5")
    (inputs,) = (job.inputs for job in jobs if job.rule == "grasps")
    assert inputs[2:] == [*hand.values(), str(tmp_path / "parts/link.stl")]
