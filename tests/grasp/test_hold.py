"""Whether a hand holds an object: a pinched box in closed form, masses, and what a label says."""

from functools import partialmethod
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from palpate.batch import generator
from palpate.grasp import Grasper, grasp_object, hold, hold_grasps
from palpate.grasp.hold import GRAVITY, HoldSimulation, body_of
from palpate.grasp.patches import surface_patches
from palpate.hand import allegro, from_mjcf
from palpate.hand.model import ARM, STIFFNESS
from palpate.mesh import OBJECT_POSITION
from palpate.seal import DamagedFile

HANDS = Path(__file__).parents[2] / "config/hands"
GRIPPER = from_mjcf(HANDS / "wsg50.xml", HANDS / "wsg50.yaml")
HALF, FRICTION, TIMESTEP = 0.02, 0.8, 0.004
BOX = trimesh.creation.box((0.06, 0.03, 2 * HALF)).apply_translation((0.0406, 0, 0)).subdivide()  # between the gels
GRIP = 1.0  # N, of each jaw
TARGETS = np.full(2, HALF - GRIP * ARM**2 / STIFFNESS)


def pinched(load, direction, friction=FRICTION, duration=1.0, timestep=TIMESTEP):
    """How far a box moves whose weight is `load` times what the friction of two jaws can carry."""
    density = load * 2 * FRICTION * GRIP / GRAVITY / BOX.volume
    simulation = HoldSimulation(GRIPPER, surface_patches(BOX), body_of(BOX, density), friction, timestep)
    gravity = GRAVITY * np.array(direction) / np.linalg.norm(direction)
    return simulation.moved(np.eye(4), np.full(2, HALF), TARGETS, gravity, duration, 0.02)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (1, 1, 0), (-1, 2, 0)])
def test_two_jaws_carry_twice_friction_times_grip(direction):
    """Within 4 %; also askew to the axes of the contacts' friction."""
    assert pinched(0.96, direction) < 0.001
    assert pinched(1.04, direction) > 0.02


@pytest.mark.parametrize("load", [0.5, 1.0])
def test_without_friction_it_falls_as_free(load):
    fallen, steps = pinched(load, (0, 1, 0), friction=0, duration=0.048), 12
    assert fallen == pytest.approx(GRAVITY * TIMESTEP**2 * steps * (steps + 1) / 2, rel=0.01)


def test_along_the_jaws_the_servos_springs_carry_it():
    """Both jaws move along: two springs against the weight."""
    load = 0.5
    expected = load * 2 * FRICTION * GRIP / (2 * STIFFNESS / ARM**2)
    assert pinched(load, (0, 0, 1)) == pytest.approx(expected, rel=0.25)  # it swings past its place at first
    assert pinched(load, (0, 0, 1)) >= expected


def test_creep_of_what_is_held_falls_with_the_time_step():
    creep = [pinched(0.9, (1, 0, 0), timestep=step) for step in (0.004, 0.002, 0.001)]
    assert creep == sorted(creep, reverse=True) and creep[-1] < creep[0] / 3


def test_mass_and_inertia_of_a_box():
    body, (x, y, z) = body_of(BOX, 500.0), BOX.extents
    mass = 500 * x * y * z
    assert body.solid and body.mass == pytest.approx(mass)
    np.testing.assert_allclose(body.centre, [0.0406, 0, 0], atol=1e-9)
    moments = mass / 12 * np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    np.testing.assert_allclose(body.inertia, np.diag(moments), atol=1e-9)
    model = HoldSimulation(GRIPPER, surface_patches(BOX), body, 1.0, TIMESTEP).model
    assert model.body("object").mass[0] == pytest.approx(mass)
    np.testing.assert_allclose(sorted(model.body("object").inertia), sorted(moments), rtol=1e-6)


def test_the_engine_has_the_inertia_of_an_askew_body():
    """Principal moments and axes, put together again: all six numbers of the matrix, each another one."""
    askew = BOX.copy().apply_transform(trimesh.transformations.euler_matrix(0.3, 0.5, 0.9))
    body = body_of(askew, 500.0)
    model = HoldSimulation(GRIPPER, surface_patches(askew), body, 1.0, TIMESTEP).model
    rotation = Rotation.from_quat(np.roll(model.body("object").iquat, -1)).as_matrix()  # MuJoCo has w first
    inertia = rotation @ np.diag(model.body("object").inertia) @ rotation.T
    numbers = np.abs(inertia[np.triu_indices(3)])
    assert np.diff(np.sort(numbers)).min() > 0.02 * numbers.max()
    np.testing.assert_allclose(inertia, body.inertia, atol=1e-6 * numbers.max())


def test_an_open_mesh_has_the_volume_of_its_hull_and_a_sheet_that_of_its_thickness():
    open_box = trimesh.Trimesh(BOX.vertices, BOX.faces[2:], process=False)
    body = body_of(open_box, 1.0)
    assert not body.solid and body.mass == pytest.approx(BOX.volume, rel=1e-6)
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0], [0, 0.2, 0]], [[0, 1, 2], [0, 2, 3]])
    body = body_of(sheet, 1.0)
    assert not body.solid and body.mass == pytest.approx(0.1 * 0.2 * 0.001, rel=1e-6)
    assert HoldSimulation(GRIPPER, surface_patches(sheet), body, 1.0, TIMESTEP).model.body("object").mass[0] == 1e-3


def test_patches_of_an_open_object_are_made_once(monkeypatch):
    open_box = trimesh.Trimesh(BOX.vertices, BOX.faces[2:], process=False)
    points = trimesh.sample.sample_surface(open_box, 100, seed=0)[0]
    grasper = Grasper(open_box, open_box, points, GRIPPER, hold=KEYS)
    expected = body_of(open_box, KEYS["density"])
    monkeypatch.setattr(hold, "surface_patches", None)
    assert grasper.loose().body.mass == expected.mass


HAND = allegro()
BAR = trimesh.creation.box((0.03, 0.03, 0.3)).subdivide().subdivide()
POINTS = trimesh.sample.sample_surface(BAR, 2000, seed=0)[0] + OBJECT_POSITION
KEYS = {"friction": 0.8, "density": 100.0, "distance": 0.02, "duration": 0.3}


@pytest.fixture(scope="module")
def kept():
    return vars(grasp_object(BAR, BAR, POINTS, HAND, generator(0, "bar"), per_object=3, attempts=5, thumb_share=1.0))


def held(kept, seed=0, remedy="", **changes):
    grasper = Grasper(BAR, BAR, POINTS - OBJECT_POSITION, HAND, thumb_share=1.0, hold=KEYS | changes)
    return hold_grasps(grasper, kept, generator(seed, "bar"), remedy)


def test_labels_follow_from_what_moved(kept):
    found = held(kept)
    assert found["moved"].shape == found["held_along"].shape == (3, 6)
    np.testing.assert_array_equal(found["held_along"], found["moved"] <= 0.02)
    np.testing.assert_array_equal(found["held"], found["held_along"].all(axis=1))
    assert {0, 1} == {*found["held_along"].flat}
    assert found["mass"] == pytest.approx(KEYS["density"] * BAR.volume) and found["solid"]
    again = held(kept)
    for name, values in found.items():
        np.testing.assert_array_equal(again[name], values)


def test_whatever_moves_is_held_where_it_may_move_as_far(kept):
    found = held(kept, distance=1.0)
    assert (found["held"] == 1).all() and (found["moved"] < 1.0).all()
    assert (held(kept, distance=1e-6)["held"] == 0).all()


def test_what_the_engine_cannot_simulate_is_not_a_label(kept, monkeypatch):
    """Along +x, speeds are NaN at the start: the engine resets its state, and goes on."""

    class Spoiled(HoldSimulation):
        def place(self, palm_pose, joint_positions):
            super().place(palm_pose, joint_positions)
            if self.model.opt.gravity[0] > 0:
                self.data.qvel[:] = np.nan

    monkeypatch.setattr(Grasper, "loose", partialmethod(Grasper.loose, Spoiled))
    found = held(kept)
    assert (found["held"] == -1).all() and (found["held_along"][:, 0] == -1).all()
    assert np.isinf(found["moved"][:, 0]).all() and np.isfinite(found["moved"][:, 1:]).all()
    assert (found["held_along"][:, 1:] >= 0).all()


def test_grasps_of_another_seed_are_an_error(kept):
    with pytest.raises(DamagedFile, match="make them again"):
        held(kept, seed=1, remedy="make them again")
