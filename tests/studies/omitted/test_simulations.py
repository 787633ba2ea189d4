"""Simulations that are changed have what they say they have, and the engine's has nothing of it."""

import mujoco
import numpy as np
import pytest
import trimesh

from palpate import mesh
from palpate.grasp import grasp_object
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import Grasper
from palpate.grasp.patches import surface_patches
from palpate.hand import allegro, from_mjcf
from studies.omitted.simulations import ChangedSimulation, EveryFace, EveryPair
from tests.hand import grippers

HAND = allegro()
TIMESTEP = 0.004


def rod():
    return trimesh.creation.box((0.04, 0.04, 0.45)).subdivide()


@pytest.fixture(scope="module")
def patches():
    return surface_patches(rod())


def changed(patches, *items, hand=HAND):
    return ChangedSimulation(hand, patches, TIMESTEP, items, rod()).model


def of_object(model):
    return model.geom_bodyid == model.body("object").id


def test_the_engine_s_model_has_nothing_that_is_omitted(patches):
    model = GraspSimulation(HAND, patches).model
    assert len(patches) > 100
    assert model.ngeom == HAND.geom_collides.sum() + len(patches)
    assert model.nq == model.nv == 16 and model.npair == 0 and model.neq == 0
    assert not model.opt.gravity.any() and not model.body_gravcomp.any()
    assert (model.geom_condim == 1).all()
    assert model.nexclude == np.triu(HAND.adjacent_links(), k=1).sum()


def test_without_changes_it_is_the_engine_s_model(patches):
    engine, same = GraspSimulation(HAND, patches).model, changed(patches)
    for name in ("body_mass", "geom_solref", "geom_solimp", "geom_condim", "geom_pos", "jnt_range", "mesh_vert"):
        np.testing.assert_array_equal(getattr(same, name), getattr(engine, name))


def test_gravity_is_put_in_with_what_carries_the_hand(patches):
    model = changed(patches, "gravity")
    np.testing.assert_array_equal(model.opt.gravity, [0, 0, -9.81])
    assert (model.body_gravcomp[1:] == 1).all()
    sagging = changed(patches, "sag under gravity")
    np.testing.assert_array_equal(sagging.opt.gravity, [0, 0, -9.81])
    assert not sagging.body_gravcomp.any()


def test_the_object_s_degrees_of_freedom_are_put_in_held_or_loose(patches):
    held, loose = changed(patches, "object degrees of freedom"), changed(patches, "loose object")
    for model in (held, loose):
        assert model.nv == 16 + 6
        assert model.jnt_type[-1] == mujoco.mjtJoint.mjJNT_FREE
    assert held.neq == 1 and held.eq_type[0] == mujoco.mjtEq.mjEQ_WELD
    assert loose.neq == 0
    assert loose.body("object").mass < held.body("object").mass


def test_visual_geometry_is_put_in_without_colliding_or_weighing(patches):
    less, model = changed(patches), changed(patches, "visual geometry")
    assert model.ngeom == less.ngeom + 1 and model.nmesh == less.nmesh + 1
    drawn = np.flatnonzero((model.geom_contype == 0) & (model.geom_conaffinity == 0))
    assert len(drawn) == 1 and model.geom_bodyid[drawn[0]] == model.body("object").id
    assert model.mesh_facenum[model.geom_dataid[drawn[0]]] == len(rod().faces)
    np.testing.assert_allclose(model.body_mass, less.body_mass)


def test_geoms_of_a_hand_that_are_drawn_only_are_put_in(patches, tmp_path):
    (tmp_path / "gripper.xml").write_text(grippers.two_fingers("degree"))
    hand = from_mjcf(tmp_path / "gripper.xml", grippers.SENSORS)
    assert int((~hand.geom_collides).sum()) == 1
    less, more = GraspSimulation(hand, patches).model, changed(patches, "visual geometry", hand=hand)
    assert more.ngeom == less.ngeom + 2
    np.testing.assert_allclose(more.body_mass, less.body_mass)


def test_pairs_that_cannot_meet_are_put_in(patches):
    palm = int((HAND.geom_link == 0).sum())
    assert changed(patches, "pairs of palm and object").npair == palm * len(patches)
    assert changed(patches, "pairs of object patches").npair == len(patches) * (len(patches) - 1) // 2
    joined = changed(patches, "pairs of joined links")
    assert joined.nexclude == 0
    assert joined.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT


def test_friction_and_self_collision(patches):
    assert (changed(patches, "friction").geom_condim == 3).all()
    model = changed(patches, "self-collision")
    mine = ~of_object(model)
    assert not (model.geom_contype[mine] & model.geom_conaffinity[mine]).any()
    assert (model.geom_contype[mine] & model.geom_conaffinity[~mine][0]).all()


def test_grasps_say_how_much_is_omitted_and_are_the_same_with_it_put_in(patches):
    visual = rod()
    points = trimesh.sample.sample_surface(visual, 1000, seed=0)[0]
    default = grasp_object(
        visual, visual, points + mesh.OBJECT_POSITION, HAND, np.random.default_rng(1), per_object=2, attempts=2
    )
    assert default.omitted == {
        "visual faces": len(visual.faces),
        "pairs of palm and object": 4 * len(patches),
        "pairs of object patches": len(patches) * (len(patches) - 1) // 2,
    }
    # The same attempts, one after the other, with everything that can be put in.
    naive = Grasper(visual, visual, points + mesh.OBJECT_POSITION - mesh.OBJECT_POSITION, HAND)
    naive.simulation = ChangedSimulation(HAND, patches, TIMESTEP, ("visual geometry", "gravity"), visual)
    naive.check = Naive(HAND, visual)
    rng, found = np.random.default_rng(1), []
    while len(found) < 2:
        result = naive.attempt(rng)
        if not isinstance(result, str):
            found.append(result)
    found.sort(key=lambda grasp: -grasp.touches.sum())
    joints, depths = (np.array([getattr(each, name) for each in found]) for name in ("joint_positions", "penetration"))
    np.testing.assert_allclose(joints, default.joint_positions, atol=1e-8)
    np.testing.assert_allclose(depths, default.penetration, atol=1e-8)
    palms = np.array([each.palm_pose for each in found])
    palms[:, :3, 3] += mesh.OBJECT_POSITION
    np.testing.assert_array_equal(palms, default.palm_pose)


class Naive(EveryFace, EveryPair):
    """A check of penetration that omits nothing."""
