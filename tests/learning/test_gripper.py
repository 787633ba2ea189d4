"""The shipped gripper with two round sensors of rectangular readings, end to end: from grasps to models."""

import csv
from dataclasses import fields, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
import trimesh

from palpate import Dataset, store
from palpate.experiments import Experiment
from palpate.grasp import grasp_object
from palpate.hand import Hand, from_mjcf
from palpate.hand.model import ARM, ARMATURE, MAX_TORQUE, STIFFNESS, build_spec
from palpate.learning import checkpoints, rings
from palpate.learning.checkpoints import CheckpointError
from palpate.learning.data import ExperimentData
from palpate.learning.evaluate import Trained, evaluate, evaluate_touch
from palpate.learning.learners import ReconstructionLearner, TouchDepthLearner
from palpate.learning.recipes import Settings, TouchDepthSettings
from palpate.learning.reconstruct import ReconstructionError, Reconstructor
from palpate.learning.touch_charts import read_touches, touch_charts
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction, TouchDepth
from palpate.results import dataset_tables
from palpate.scene import Scene
from palpate.sensor import DIGIT, Sensor, load
from palpate.store import StoreError
from palpate.touch import RayCaster, empty_reading, sense
from tests.learning.conftest import ARCHITECTURE, SETTINGS

HANDS = Path(__file__).parents[2] / "config/hands"
GRIPPER = from_mjcf(HANDS / "wsg50.xml", HANDS / "wsg50.yaml")
KIND = Sensor.from_description(load("dome360").description() | {"resolution": [32, 35], "height": 0.017})
ATTRIBUTES = {"seed": 0, "made_from": {}, "sensor": KIND.description()}
OBJECTS = {"rod-0": "train", "rod-1": "validation"}
GRASPS = 2
TOUCH = Experiment("gripper", "charts", "none", True, 2)
READINGS = replace(TOUCH, strategy="sphere")


def rod(number: int) -> trimesh.Trimesh:
    return trimesh.creation.capsule(height=0.3, radius=0.025 + 0.005 * number)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gripper") / "run"
    records = {stage: {} for stage in ("surface", "grasps", "touch")}
    for number, name in enumerate(OBJECTS):
        mesh = rod(number)
        points = mesh.sample(2000, seed=number) + OBJECT_POSITION
        found = grasp_object(
            mesh, mesh, points, GRIPPER, np.random.default_rng(number), GRASPS, GRASPS, thumb_share=0.0, sensor=KIND
        )
        sensed = sense(RayCaster(mesh, OBJECT_POSITION, KIND), found.sensor_position, found.sensor_rotation)
        np.testing.assert_array_equal(found.touches, sensed.success)
        poses = {"position": found.sensor_position, "rotation": found.sensor_rotation}
        records["surface"][name] = {"points": points.astype(np.float32)}
        records["grasps"][name] = vars(found)
        records["touch"][name] = poses | sensed._asdict()
    more = {
        "grasps": {f"hand/{key}": values for key, values in GRIPPER.to_arrays().items()},
        "touch": {"empty_reading": empty_reading(KIND)},
    }
    for stage, of_objects in records.items():
        path = folder / store.CONTRACT[stage].path("batch-0000")
        store.write(path, stage, store.join(stage, of_objects) | more.get(stage, {}), ATTRIBUTES)
    with (folder / "catalogue.csv").open("w", newline="") as file:
        rows = [["object", "class", "split", "batch"]]
        csv.writer(file).writerows([*rows, *([name, "rod", split, "batch-0000"] for name, split in OBJECTS.items())])
    torch.manual_seed(0)
    unet = TouchDepth(2, KIND).eval()
    described = {"width": 2, "sensor": KIND.description()}
    checkpoints.save(folder / "models/touch_depth/best.ckpt", "touch_depth", unet, described)
    touch = store.read(folder / "touch/batch-0000.zarr")
    sensors = (touch[key] for key in ("success", "position", "rotation"))
    vertices = touch_charts(unet, touch["reading"], touch["empty_reading"], *sensors)
    charts = {"object": touch["object"], "vertices": vertices}
    store.write(folder / "charts/batch-0000.zarr", "charts", charts, ATTRIBUTES)
    return folder


@pytest.fixture(scope="module")
def learner(run):
    return ReconstructionLearner(ExperimentData.load(run, TOUCH), TOUCH, SETTINGS, 0)


def test_its_jaws_slide_as_published_and_as_mujoco_says():
    assert GRIPPER.joint_slides.all() and GRIPPER.joint_range.tolist() == [[0.0027, 0.055]] * 2
    assert GRIPPER.sensor_names == ("upper_gel", "lower_gel") and not GRIPPER.sensor_thumb.any()
    model = mujoco.MjModel.from_xml_path(str(HANDS / "wsg50.xml"))
    data = mujoco.MjData(model)
    for joints in np.random.default_rng(0).uniform(*GRIPPER.joint_range.T, (5, 2)):
        data.qpos[:] = joints
        mujoco.mj_forward(model, data)
        links = GRIPPER.forward(np.eye(4), joints)
        position, rotation = GRIPPER.sensor_frames(links)
        faces = position + 0.019273 * rotation[..., 0]
        np.testing.assert_allclose(faces, data.site_xpos[1:], atol=1e-12)
        np.testing.assert_allclose(rotation, data.site_xmat[1:].reshape(-1, 3, 3), atol=1e-12)
        np.testing.assert_allclose(GRIPPER.geom_poses(links)[:, :3, 3], data.geom_xpos, atol=1e-12)
        # The gels' faces are a joint's position from the middle, and look at each other.
        np.testing.assert_allclose(faces[:, 2], [joints[0], -joints[1]], atol=1e-12)


def test_a_slide_is_a_hinge_at_an_arm():
    """A force at the arm's end moves the servo of either by the same length, against the same mass."""
    model = build_spec(GRIPPER).compile()
    np.testing.assert_allclose(model.actuator_gainprm[:, 0] * ARM**2, STIFFNESS)
    np.testing.assert_allclose(model.actuator_forcerange[:, 1] * ARM, MAX_TORQUE)
    np.testing.assert_allclose(model.dof_armature * ARM**2, ARMATURE)
    damping = -model.actuator_biasprm[:, 2] / (2 * np.sqrt(model.actuator_gainprm[:, 0] * model.dof_armature))
    np.testing.assert_allclose(damping, 1)  # critical


def test_jacobians_of_slides_are_those_of_finite_differences():
    from palpate.grasp.targets import DIRECTION_LENGTH, Workspace

    workspace = Workspace(GRIPPER)
    joints, step = np.array([0.02, 0.03]), 1e-6

    def features(values):
        apex, direction = workspace.apex(GRIPPER.forward(np.eye(4), values))
        return np.concatenate([apex, DIRECTION_LENGTH * direction], axis=-1)

    pose = GRIPPER.forward(np.eye(4), joints)
    found = workspace.jacobian(pose, *workspace.apex(pose))
    expected = [(features(joints + step * unit) - features(joints - step * unit)) / (2 * step) for unit in np.eye(2)]
    np.testing.assert_allclose(found, np.stack(expected, axis=-1), atol=1e-8)


def test_the_stores_explain_themselves(run):
    dataset = Dataset(run, ["surface", "grasps", "touch", "charts"])
    assert dataset.sensor.description() == KIND.description() == dataset[0].grasps[0].sensor.description()
    assert dataset.array("touch", "depth").shape == (2, GRASPS, 2, 32, 35)
    assert dataset.array("charts", "vertices").shape == (2, GRASPS, 2, 81, 3)
    grasp = dataset[0].grasps[0]
    assert grasp.sensors == ("upper_gel", "lower_gel") and grasp.reading.shape == (2, 32, 35, 3)
    hand = Hand.from_arrays(store.open(run / "grasps/batch-0000.h5"), prefix="hand/")
    assert hand.joint_slides.all() and hand.sensor_names == grasp.sensors
    scene = Scene.from_grasps(run, {name: getattr(grasp, name)[None] for name in GRASP_NAMES}, hand)
    assert scene.sensor_position.shape == (1, 2, 3)


GRASP_NAMES = ("link_pose", "sensor_position", "sensor_rotation")


def test_a_jaw_that_touches_lies_on_the_rod(run):
    """A sensor's cloud is on the rod, and its gel's face is not deeper in it than the grasp allows."""
    for number, record in enumerate(Dataset(run, ["touch", "grasps"])):
        for grasp in record.grasps:
            assert grasp.success.any()
            for cloud in grasp.points:
                points = cloud - np.array(OBJECT_POSITION)
                along = np.clip(points[:, 2], -0.15, 0.15)
                distance = np.linalg.norm(points - np.stack([0 * along, 0 * along, along], axis=1), axis=1)
                np.testing.assert_allclose(distance, 0.025 + 0.005 * number, atol=4e-4)  # facets


def test_tables_count_two_touches_a_grasp(run):
    frames = dataset_tables.dataset_frames(run)
    assert (frames.grasps["touches"] == 2).all()
    shares = dataset_tables.grasp_success(frames)
    assert sorted(shares["successful_touches"].unique()) == [0, 1, 2]
    total = shares[shares["class"] == "total"]["percent"]
    assert total.sum() == pytest.approx(100, abs=0.1)


def test_rings_are_as_wide_as_the_sensor(run):
    made = rings.project_batch(
        run / "touch/batch-0000.zarr",
        lambda name, kind: rings.MeshSurface(rod(int(name[-1])), OBJECT_POSITION, kind),
    )
    touched = store.read(run / "touch/batch-0000.zarr", "success", "position", "rotation")
    assert made["ring_depth"].shape == (2, GRASPS, 2, 100, 100)
    index = tuple(np.argwhere(touched["success"])[0])
    points = np.concatenate(
        rings.ring_points(made["ring_depth"][index], touched["position"][index], touched["rotation"][index], KIND)
    )
    local = (points - touched["position"][index]) @ touched["rotation"][index]
    assert 2.5 * DIGIT.width < np.abs(local[:, 1]).max() <= 2.5 * KIND.width
    assert np.abs(local[:, 2]).max() <= 2.5 * KIND.height
    furthest = np.abs(rings.plane(KIND.size)).max(axis=0)  # the centre of the last of 100 cells
    np.testing.assert_allclose(furthest, [0, 2.475 * KIND.width, 2.475 * KIND.height])


@pytest.mark.parametrize("experiment", [TOUCH, READINGS], ids=["charts", "sphere"])
def test_a_model_of_two_sensors_takes_them_and_a_checkpoint_brings_it_back(run, tmp_path, experiment):
    data = ExperimentData.load(run, experiment)
    learner = ReconstructionLearner(data, experiment, SETTINGS, 0)
    model = learner.model.eval()
    assert model.sensors == 2 * 2 and data.hand_sensors == 2 and model.sensor.description() == KIND.description()
    learner.begin()
    with torch.no_grad():
        batch = learner.assemble(learner.validation_batches[0])
        vertices = model(batch)
    assert torch.isfinite(vertices).all() and batch["success"].shape[1] == 4
    checkpoints.save(tmp_path / "best.ckpt", "reconstruction", model, learner.described())
    again = checkpoints.load(tmp_path / "best.ckpt")
    assert again.hand_sensors == 2 and not again.sensor.geometry_difference(KIND)
    with torch.no_grad():
        assert torch.equal(again(batch), vertices)
    table = evaluate(Trained(again, experiment, 0, 1), data, 100, ["validation"])
    assert np.isfinite(table["chamfer"]).all()


def test_the_unet_learns_from_readings_of_another_size(run):
    dataset = Dataset(run, ["touch"])
    learner = TouchDepthLearner(*(read_touches(dataset, split) for split in OBJECTS.values()), UNET_SETTINGS, 0)
    learner.begin()
    assert learner.model.sensor.resolution == (32, 35)
    adam, losses = torch.optim.Adam(learner.model.parameters(), 3e-3), []
    for _ in range(12):
        loss = learner.losses(np.array([0]), torch.Generator().manual_seed(0))
        adam.zero_grad()
        loss.sum().backward()
        adam.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.5 * losses[0], losses
    model = checkpoints.load_touch_depth(run / "models/touch_depth/best.ckpt")
    table = evaluate_touch(model, 1, Dataset(run, ["touch", "charts"]), 100, ["train", "validation"])
    assert np.isfinite(table[["cloud", "chart"]]).all(axis=None)


UNET_SETTINGS = TouchDepthSettings(width=2, **{each.name: getattr(SETTINGS, each.name) for each in fields(Settings)})


def test_charts_of_touches_lie_within_the_sensor(run):
    arrays = store.read(run / "touch/batch-0000.zarr", "success", "position", "rotation")
    charts = store.read(run / "charts/batch-0000.zarr", "vertices")["vertices"]
    for index in zip(*np.nonzero(arrays["success"]), strict=True):
        local = (charts[index] - arrays["position"][index]) @ arrays["rotation"][index]
        across = np.hypot(*local[:, 1:].T)
        assert across.max() <= KIND.rim + max(KIND.pixel) and np.ptp(across) > max(KIND.pixel)


def test_models_refuse_data_of_another_sensor(run, learner):
    data = ExperimentData.load(run, TOUCH)
    of_digits = Reconstruction(TOUCH, ARCHITECTURE).eval()
    trained = Trained(of_digits, replace(TOUCH, name="theirs"), 0, 1)
    with pytest.raises(CheckpointError, match="theirs was trained with sensor 'digit'.*width.*of a hand: 4 and 2"):
        evaluate(trained, data, 100)
    with pytest.raises(CheckpointError, match="the model of touches was trained with sensor 'digit'"):
        evaluate_touch(TouchDepth(2), 1, Dataset(run, ["touch", "charts"]))


def test_reconstruct_takes_touches_of_its_sensor_only(run, learner):
    folder = run / "models/gripper/seed-0"
    checkpoints.save(folder / "best.ckpt", "reconstruction", learner.model.eval(), learner.described())
    model, grasps = Reconstructor(folder), Dataset(run, ["touch"])["rod-0"].grasps
    assert np.isfinite(model(touches=grasps).vertices).all()
    others = [replace_sensor(grasp, DIGIT) for grasp in grasps]
    with pytest.raises(ReconstructionError, match="trained with sensor 'dome360', but the touches are of 'digit'"):
        model(touches=others)
    small = [replace_sensor(grasp, KIND, grasp.reading[:, :30, :30]) for grasp in grasps]
    with pytest.raises(ReconstructionError, match=r"reading.*expected \(4, 32, 35, 3\)"):
        model(touches=small)


class Touched:
    """A grasp's touches as a user may give them."""


def replace_sensor(grasp, kind, reading=None):
    made = Touched()
    made.__dict__ = {name: getattr(grasp, name) for name in ("reading", "position", "rotation", "success")}
    made.sensor = kind
    made.reading = grasp.reading if reading is None else reading
    return made


def test_a_store_that_does_not_state_its_sensor_is_named(run, tmp_path):
    arrays = store.read(run / "touch/batch-0000.zarr")
    attributes = {name: value for name, value in ATTRIBUTES.items() if name != "sensor"}
    with pytest.raises(StoreError, match=r"batch-0000.zarr: attributes \['sensor'\] are missing"):
        store.write(tmp_path / "touch/batch-0000.zarr", "touch", arrays, attributes)


def test_open_hands_with_their_fingers_in_each_other_are_refused():
    with pytest.raises(ValueError, match="mm deep in each other"):
        closed = replace(GRIPPER, open_joint_positions=np.array([-0.01, -0.01]))
        grasp_object(rod(0), rod(0), rod(0).sample(100) + OBJECT_POSITION, closed, np.random.default_rng(0))
