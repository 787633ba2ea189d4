"""The studies of closing: references against an equation of motion and geometry; errors on a small run."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp

from palpate import mesh, store
from palpate.grasp.closing import DURATION, RAMP, GraspSimulation
from palpate.grasp.patches import surface_patches
from palpate.hand import allegro, from_mjcf
from palpate.hand.model import ARMATURE, DAMPING, MAX_TORQUE, STIFFNESS
from studies.error_vs_runtime import grasps
from studies.subjects import Subject

SETTINGS = {"grasps": {"timestep": 0.004}}
ARM, RADIUS = 0.06, 0.01  # m: one finger, a sphere on a massless arm
FINGER = f"""
<mujoco>
  <worldbody>
    <body name="palm">
      <geom type="sphere" size=".001" pos="-.2 0 0"/>
      <body name="finger">
        <joint name="turn" axis="0 0 1" range="-90 90"/>
        <geom type="sphere" size="{RADIUS}" pos="{ARM} 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def finger(tmp_path_factory):
    """A hand with one hinge, turning about z from along x."""
    folder = tmp_path_factory.mktemp("hand")
    (folder / "finger.xml").write_text(FINGER)
    sensor = f"{{body: finger, position: [{ARM}, 0, 0]}}"
    (folder / "sensors.yaml").write_text(f"sensors: [{sensor}]\nopen: [0]\n")
    return from_mjcf(folder / "finger.xml", folder / "sensors.yaml")


def swing(duration: float, target: float) -> float:
    """The finger's angle after a free closing, by Runge and Kutta's method on its equation of motion."""
    mass = 1000 * 4 / 3 * np.pi * RADIUS**3
    inertia = mass * (ARM**2 + 2 / 5 * RADIUS**2) + ARMATURE

    def motion(time, state):
        angle, speed = state
        wanted = target * min(1, time / (RAMP * duration))
        torque = STIFFNESS * (wanted - angle) - 2 * np.sqrt(STIFFNESS * ARMATURE) * speed
        return speed, (np.clip(torque, -MAX_TORQUE, MAX_TORQUE) - DAMPING * speed) / inertia

    return solve_ivp(motion, (0, duration), (0, 0), rtol=1e-9, atol=1e-12, max_step=duration / 200).y[0, -1]


def far_away() -> trimesh.Trimesh:
    box = trimesh.creation.box((0.01, 0.01, 0.01))
    return box.apply_translation((0, 0, 5))


@pytest.mark.parametrize("duration", [0.05, 0.1])
def test_a_free_swing_converges_to_its_equation_of_motion(finger, duration):
    """Stopped while it moves: the error falls with the time step, and is small at that of the reference."""
    expected = swing(duration, 0.8)
    assert 0.05 < expected < 0.75
    errors = {}
    for step in (2e-3, 5e-4, grasps.REFERENCE_TIMESTEP):
        setup = replace(grasps.ClosingSettings(step), duration=duration)
        simulation = GraspSimulation(finger, grasps.face_pieces(far_away()), step)
        found = grasps.close(simulation, np.eye(4)[None], np.array([[0.8]]), setup)
        errors[step] = abs(found.joint_positions[0, 0] - expected)
    assert errors[grasps.REFERENCE_TIMESTEP] < errors[5e-4] / 3 < errors[2e-3] / 9
    assert errors[grasps.REFERENCE_TIMESTEP] < 1e-3


def test_a_finger_comes_to_rest_where_geometry_says(finger):
    """A sphere on an arm stops at a wall, at the angle whose sine is distance over arm."""
    wall = 0.04
    box = trimesh.creation.box((0.2, 0.02, 0.2))
    box.apply_translation((0, wall + 0.01, 0))
    poses, targets = np.eye(4)[None], np.array([[1.2]])
    expected = np.arcsin((wall - RADIUS) / ARM)
    setup = grasps.ClosingSettings(0.004)
    reference = grasps.at_rest(finger, box, poses, targets, setup)
    assert reference.joint_positions[0, 0] == pytest.approx(expected, abs=2e-5)
    library = grasps.close(GraspSimulation(finger, surface_patches(box), 0.004), poses, targets, setup)
    assert library.finite and abs(library.joint_positions[0, 0] - expected) > abs(
        reference.joint_positions[0, 0] - expected
    )
    for gain in (0.5, 1):  # below the torque's limit, and at it
        force = grasps.at_rest(finger, box, poses, targets, replace(setup, gain=gain)).force
        torque = min(gain * (1.2 - expected), MAX_TORQUE)
        assert force == pytest.approx(torque / (ARM * np.cos(expected)), rel=1e-3)


def test_pieces_are_the_faces():
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    pieces = grasps.face_pieces(box, thickness=0.01)
    assert len(pieces) == len(box.faces)
    outer = np.array([piece[:3] for piece in pieces])
    np.testing.assert_array_equal(outer, box.triangles)
    volumes = [trimesh.convex.convex_hull(piece).volume for piece in pieces]
    np.testing.assert_allclose(volumes, 0.01 * box.area_faces)
    assert all((np.abs(piece) <= box.bounds[1] + 1e-12).all() for piece in pieces)
    hair = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]], [[0, 1, 2]], process=False)
    assert grasps.face_pieces(hair) == []


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with one object, a barrel, and the Allegro hand."""
    folder = tmp_path_factory.mktemp("run")
    subject = Subject("barrel-0000", "barrel", "batch-0000", folder / "meshes/batch-0000/barrel-0000")
    subject.folder.mkdir(parents=True)
    made = trimesh.creation.cylinder(radius=0.04, height=0.2, sections=40)
    made.export(subject.folder / "visual.glb")
    made.export(subject.folder / "collision.ply")
    points = trimesh.sample.sample_surface(made, 2000, seed=0)[0] + mesh.OBJECT_POSITION
    names, attributes = np.array(["another", subject.name]), {"made_from": {}, "seed": 0}
    surface = np.stack([np.zeros_like(points), points]).astype(np.float32)
    (folder / "surface").mkdir()
    store.write(folder / "surface/batch-0000.zarr", "surface", {"object": names, "points": surface}, attributes)
    arrays = {
        "object": names,
        "joint_positions": np.zeros((2, 0, 16)),
        "palm_pose": np.zeros((2, 0, 4, 4)),
        "link_pose": np.zeros((2, 0, 17, 4, 4)),
        "sensor_position": np.zeros((2, 0, 4, 3)),
        "sensor_rotation": np.zeros((2, 0, 4, 3, 3)),
        "touches": np.zeros((2, 0, 4), dtype=bool),
        "penetration": np.zeros((2, 0), dtype=np.float32),
        "attempts": np.zeros(2, dtype=np.int32),
    }
    (folder / "grasps").mkdir()
    arrays |= {f"hand/{key}": array for key, array in allegro().to_arrays().items()}
    store.write(folder / "grasps/batch-0000.h5", "grasps", arrays, attributes)
    return folder, subject


@pytest.fixture(scope="module")
def closing(run):
    """The study and its case, of two closings and fewer models than usual."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grasps, "CLOSINGS", 2)
        for field, values in {"timestep": (1e-4, 1e-3, 4e-3, 1e-2), "cell": (0.05,)}.items():
            name, _, factor = grasps.KNOBS[field]
            patch.setitem(grasps.KNOBS, field, (name, values, factor))
        study = grasps.study(run[0], [run[1]], SETTINGS)
        ((_, case),) = study.cases()
        yield study, case


@pytest.fixture(scope="module")
def rows(closing):
    """Errors by method, knob and value."""
    study, case = closing
    return {(m.name, m.knob, m.value): study.errors(case, m.run(case)) for m in study.methods()}


def test_the_reference_is_converged(closing):
    study, case = closing
    inputs = (case.grasper.hand, case.collision, case.poses[:1], case.targets[:1], study.default)
    for changes in ({"timestep": 2e-4}, {"duration": 1.2}, {"thickness": 5e-4, "integrator": "euler"}):
        other = grasps.at_rest(*inputs, **changes)
        assert np.degrees(np.abs(other.joint_positions - case.at_rest.joint_positions[:1])).mean() < 0.005, changes
        assert other.force == pytest.approx(case.at_rest.force[:1], rel=0.02), changes


def test_the_reference_has_no_error(closing):
    study, case = closing
    errors = study.errors(case, case.at_rest._replace(setup=study.default))
    assert errors["joint"] == errors["tip"] == errors["flipped"] == 0 < errors["joint, same motion"]
    assert errors["force"] == errors["force over gain"] == 0 < errors["force, same motion"]
    assert 0 <= errors["penetration"] < 0.05
    same = case.same_motion._replace(setup=study.default)
    errors = study.errors(case, same)
    assert errors["joint, same motion"] == errors["force, same motion"] == 0 < errors["joint"]
    off = study.errors(case, same._replace(force=same.force + [0.5, -1.5]))
    assert off["force, same motion"] == pytest.approx(1.0) and same.force.min() > 0


def test_forces_in_proportion_to_the_gain_have_no_error_over_it(closing):
    study, case = closing
    setup, force = replace(study.default, gain=3 * study.default.gain), 3 * case.at_rest.force
    errors = study.errors(case, case.at_rest._replace(setup=setup, force=force))
    assert errors["force over gain"] == pytest.approx(0, abs=1e-12)
    assert errors["force"] == pytest.approx(2 * case.at_rest.force.mean()) and np.isnan(errors["force, same motion"])


def test_errors_are_what_they_are_called(closing):
    study, case = closing
    off = case.at_rest.joint_positions.copy()
    off[:, 3] += np.radians(16)
    errors = study.errors(case, grasps.Closings(off, True, study.default, case.at_rest.force))
    assert errors["joint"] == pytest.approx(1)
    turned = case.grasper.hand.sensor_frames(case.grasper.hand.forward(case.poses, off))[0]
    still = case.grasper.hand.sensor_frames(case.grasper.hand.forward(case.poses, case.at_rest.joint_positions))[0]
    assert errors["tip"] == pytest.approx(1e3 * np.linalg.norm(turned - still, axis=-1).mean())
    unstable = study.errors(case, grasps.Closings(off, False, study.default, case.at_rest.force))
    assert list(unstable) == list(study.units) and np.isnan(list(unstable.values())).all()


def test_what_is_chosen_is_what_the_library_does(closing):
    study, case = closing
    chosen = [each for each in study.methods() if each.chosen]
    assert sorted(each.knob for each in chosen) == sorted(name for name, *_ in grasps.KNOBS.values())
    simulation = GraspSimulation(case.grasper.hand, surface_patches(case.collision), SETTINGS["grasps"]["timestep"])
    expected = []
    for pose, targets in zip(case.poses, case.targets, strict=True):
        simulation.place(pose, case.grasper.hand.open_joint_positions)
        expected.append(simulation.close(targets).joint_positions)
    for method in chosen:
        np.testing.assert_array_equal(method.run(case).joint_positions, expected)


def test_settings_between_the_studied_are_studied_too(run):
    study = grasps.study(run[0], [run[1]], {"grasps": {"timestep": 0.003}})
    (chosen,) = [m for m in study.methods() if m.chosen and m.knob == "time step, ms"]
    assert chosen.value == 3


def test_a_knob_that_tightens_errs_less(rows):
    """Time step and closing time, as far as theory promises it: a shorter ramp may be better or worse."""
    same = [rows["closing", "time step, ms", value]["joint, same motion"] for value in (10, 4, 1, 0.1)]
    assert same == sorted(same, reverse=True) and same[-1] < 1e-3 < 1e-2 < same[0]
    time = [rows["closing", "closing time, s", value]["joint"] for value in (0.1, 0.2, 0.4, 0.8)]
    assert time == sorted(time, reverse=True) and time[-1] < time[0] / 20
    converged, few = (rows["closing", "iterations", n]["joint, same motion"] for n in (100, 20))
    assert few == pytest.approx(converged, abs=1e-3)


def test_forces_follow_the_gain_and_stiff_contacts(rows, closing):
    """Forces at rest don't depend on the time step, and grow with the gain; soft contacts let fingers through."""
    mean = closing[1].at_rest.force.mean()
    assert all(rows["closing", "time step, ms", step]["force"] < 0.05 * mean for step in (0.1, 1, 4, 10))
    assert rows["closing", "time step, ms", 4]["force, same motion"] < 0.05 * mean
    greater = rows["closing", "servo gain, N m / rad", 3]  # proportion makes up nine tenths of the change
    assert greater["force"] > mean and greater["force over gain"] < greater["force"] / 10
    soft = [rows["closing", "time constant of contacts, time steps", value] for value in (2, 8, 32)]
    depths = [errors["penetration"] for errors in soft]
    assert depths == sorted(depths) and 10 * soft[0]["force"] < soft[-1]["force"]


def test_same_motion_is_compared_only_where_it_is_the_same(rows):
    for (_, knob, value), errors in rows.items():
        if (knob, value) == ("iterations", 1):  # so few that the engine may warn
            continue
        other = (
            (knob == "closing time, s" and value != DURATION)
            or (knob.startswith("ramp") and value != RAMP)
            or (knob.startswith("cell") and value != 25)
            or (knob.startswith("servo gain") and value != STIFFNESS)
        )
        assert np.isnan(errors["joint, same motion"]) == other, (knob, value)
        assert np.isfinite(errors["joint"]), (knob, value)
