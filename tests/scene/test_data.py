"""Plans of the data stages reach the engines that are built from them."""

import mujoco
import numpy as np
import pytest
import trimesh

from palpate import mesh
from palpate.grasp import grasp_object
from palpate.grasp.closing import GraspScene
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import geom_surface
from palpate.grasp.reach import Reach, reach_of
from palpate.hand import allegro, from_mjcf
from palpate.mesh.decimate import decimate
from palpate.scene import plan
from tests.hand import grippers

HAND = allegro()
GRASP = plan("grasp")


def rod():
    return trimesh.creation.box((0.04, 0.04, 0.45)).subdivide()


def model(*parts, hand=HAND):
    visual = rod()
    return GraspScene(
        hand, surface_patches(visual), plan=GRASP.including(*parts) if parts else GRASP, visual=visual
    ).model


def of_object(compiled):
    return compiled.geom_bodyid == compiled.body("object").id


def test_a_grasp_s_model_has_nothing_that_its_plan_leaves_out():
    compiled = model()
    patches = len(surface_patches(rod()))
    assert patches > 100
    assert compiled.ngeom == HAND.geom_collides.sum() + patches
    assert compiled.nq == compiled.nv == 16 and compiled.npair == 0 and compiled.neq == 0
    assert not compiled.opt.gravity.any() and not compiled.body_gravcomp.any()
    assert (compiled.geom_condim == 1).all()
    assert compiled.nexclude == np.triu(HAND.adjacent_links(), k=1).sum()


def test_gravity_is_put_in_with_what_carries_the_hand():
    compiled = model("gravity")
    np.testing.assert_array_equal(compiled.opt.gravity, [0, 0, -9.81])
    assert (compiled.body_gravcomp[1:] == 1).all()
    sagging = model("sag under gravity")
    np.testing.assert_array_equal(sagging.opt.gravity, [0, 0, -9.81])
    assert not sagging.body_gravcomp.any()


def test_the_object_s_degrees_of_freedom_are_put_in_held_or_loose():
    held, loose = model("object degrees of freedom"), model("loose object")
    for compiled in (held, loose):
        assert compiled.nv == 16 + 6
        assert compiled.jnt_type[-1] == mujoco.mjtJoint.mjJNT_FREE
    assert held.neq == 1 and held.eq_type[0] == mujoco.mjtEq.mjEQ_WELD
    assert loose.neq == 0
    assert loose.body("object").mass < held.body("object").mass


def test_visual_geometry_is_put_in_without_colliding_or_weighing():
    less, compiled = model(), model("visual geometry")
    assert compiled.ngeom == less.ngeom + 1 and compiled.nmesh == less.nmesh + 1
    drawn = np.flatnonzero((compiled.geom_contype == 0) & (compiled.geom_conaffinity == 0))
    assert len(drawn) == 1 and compiled.geom_bodyid[drawn[0]] == compiled.body("object").id
    assert compiled.mesh_facenum[compiled.geom_dataid[drawn[0]]] == len(rod().faces)
    np.testing.assert_allclose(compiled.body_mass, less.body_mass)


def test_geoms_of_a_hand_that_are_drawn_only_are_put_in(tmp_path):
    (tmp_path / "gripper.xml").write_text(grippers.two_fingers("degree"))
    hand = from_mjcf(tmp_path / "gripper.xml", grippers.SENSORS)
    drawn = int((~hand.geom_collides).sum())
    assert drawn == 1
    assert model("visual geometry", hand=hand).ngeom == model(hand=hand).ngeom + 1 + drawn


def test_pairs_that_cannot_meet_are_put_in():
    patches = len(surface_patches(rod()))
    palm = int((HAND.geom_link == 0).sum())
    assert model("pairs of palm and object").npair == palm * patches
    assert model("pairs of object patches").npair == patches * (patches - 1) // 2
    joined = model("pairs of joined links")
    assert joined.nexclude == 0
    assert joined.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT


def test_friction_and_self_collision():
    assert (model("friction").geom_condim == 3).all()
    visual = rod()
    compiled = GraspScene(HAND, surface_patches(visual), plan=GRASP.without("self-collision")).model
    mine = ~of_object(compiled)
    assert not (compiled.geom_contype[mine] & compiled.geom_conaffinity[mine]).any()
    assert (compiled.geom_contype[mine] & compiled.geom_conaffinity[~mine][0]).all()


def test_no_joint_positions_take_the_hand_out_of_its_reach():
    rng = np.random.default_rng(0)
    links = HAND.forward(np.eye(4), rng.uniform(*HAND.joint_range.T, (500, 16)))
    poses = HAND.geom_poses(links)
    farthest = max(
        np.linalg.norm(
            geom_surface(HAND, geom).reshape(-1, 3) @ poses[:, geom, :3, :3].swapaxes(1, 2)
            + poses[:, geom, None, :3, 3],
            axis=2,
        ).max()
        for geom in range(len(HAND.geom_kind))
    )
    assert 0.7 * reach_of(HAND) < farthest < reach_of(HAND)


def test_patches_out_of_reach_are_those_with_no_point_in_reach():
    patches = surface_patches(rod())
    engine = GraspScene(HAND, patches, plan=GRASP.without("patches out of reach"))
    pose = np.eye(4)
    pose[:3, 3] = (0.03, 0, 0.4)
    engine.place(pose, HAND.open_joint_positions)
    near = engine.model.geom_contype[of_object(engine.model)] == 1
    nearest = np.array([np.linalg.norm(patch - pose[:3, 3], axis=1).min() for patch in patches])
    assert near[nearest <= reach_of(HAND)].all()
    assert not near.all() and (nearest[~near] > reach_of(HAND)).all()
    # Put near again, all are back.
    pose[:3, 3] = 0
    engine.place(pose, HAND.open_joint_positions)
    assert engine.model.geom_contype[of_object(engine.model)].all()
    assert Reach(HAND, patches, engine.model).within(np.zeros(3)).all()


def test_grasps_say_how_much_was_left_out_and_are_the_same_with_it_put_in():
    visual = rod()
    points = trimesh.sample.sample_surface(visual, 1000, seed=0)[0] + mesh.OBJECT_POSITION
    patches = len(surface_patches(visual))
    found = {}
    for parts in ((), ("visual geometry", "gravity", "faces out of the hand", "links apart")):
        less = GRASP.including(*parts) if parts else GRASP
        rng = np.random.default_rng(1)
        found[parts] = grasp_object(visual, visual, points, HAND, rng, per_object=2, attempts=2, plan=less)
    default, more = found.values()
    assert default.left_out == {
        "visual faces": len(visual.faces),
        "pairs of palm and object": 4 * patches,
        "pairs of object patches": patches * (patches - 1) // 2,
    }
    assert "visual faces" not in more.left_out
    np.testing.assert_allclose(more.joint_positions, default.joint_positions, atol=1e-8)
    np.testing.assert_array_equal(more.palm_pose, default.palm_pose)
    np.testing.assert_allclose(more.penetration, default.penetration, atol=1e-8)


def test_a_mesh_that_is_small_already_is_not_decimated_unless_asked_to():
    solid = rod().subdivide()
    vertices, faces = np.float32(solid.vertices).astype(float), np.asarray(solid.faces, dtype=np.int64)
    same = decimate(vertices, faces, len(faces))
    assert same[0] is vertices and same[1] is faces
    collapsed = decimate(vertices, faces, len(faces), plan=plan("mesh"))
    assert collapsed[0] is not vertices
    np.testing.assert_array_equal(collapsed[0], vertices)
    np.testing.assert_array_equal(collapsed[1], faces)
    assert len(decimate(vertices, faces, len(faces) // 2)[1]) <= len(faces) // 2


@pytest.mark.parametrize("seed", range(6))
def test_decimating_an_untidy_mesh_to_all_its_faces_changes_nothing(seed):
    """Holes, faces folded back, and faces across the solid: edges with three faces and more."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = ball.faces[rng.random(len(ball.faces)) < 0.8]
    across = rng.permuted(np.tile(np.arange(len(ball.vertices)), (10, 1)), axis=1)[:, :3]
    faces = np.concatenate([faces, faces[:5, ::-1], across])
    used, faces = np.unique(faces, return_inverse=True)
    vertices = np.float32(ball.vertices[used]).astype(float)
    faces = faces.reshape(-1, 3).astype(np.int64)
    for count in (len(faces), 2 * len(faces)):
        found = decimate(vertices, faces, count, plan=plan("mesh"))
        np.testing.assert_array_equal(found[0], vertices)
        np.testing.assert_array_equal(found[1], faces)


def test_levels_that_are_the_mesh_itself_are_named(tmp_path):
    solid = rod().subdivide()
    solid.export(tmp_path / "rod.ply")
    faces = len(solid.faces)
    record = mesh.prepare(tmp_path / "rod.ply", tmp_path / "a", collision_faces=faces, levels=(faces // 2, faces - 1))
    assert mesh.not_decimated(record) == {"collision.ply": faces}
    everything = mesh.prepare(tmp_path / "rod.ply", tmp_path / "b", collision_faces=faces, levels=(), plan=plan("mesh"))
    assert (tmp_path / "a/collision.ply").read_bytes() == (tmp_path / "b/collision.ply").read_bytes()
    # It was measured, and what is measured of a surface against itself is rounding.
    assert 0 < everything["collision.ply"]["source_to_level"]["max"] < 1e-9
