"""Cases of contact hold on a procedural object, and fail without the code that guards them."""

import numpy as np
import pytest

from palpate import shapes
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import PENETRATING, UNSETTLED, UNSTABLE, Grasper
from palpate.grasp.patches import surface_patches
from palpate.mesh import load_collision, prepare
from studies.stability import shapes as simple_shapes
from studies.stability.cases import FAILS, HOLDS, REJECTED, examine
from studies.stability.closings import (
    CLOSED,
    HAND,
    JOINT_TOLERANCE,
    RecordingSimulation,
    changed_copy,
    closing_setup,
    hold_targets,
    joints_agree,
    soundness,
)
from studies.stability.contact import (
    CASES,
    combined,
    converges,
    faster_closing,
    gains,
    mass,
    no_unsound_accepted,
    none_accepted,
    setting,
)
from studies.subjects import Subject


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    source = shapes.write("knife", 1, folder / "source")
    prepare(source, folder / "meshes")
    return Subject("knife-0001", "knife", "batch-0000", folder / "meshes")


@pytest.fixture(scope="module")
def on_a_plate():
    return simple_shapes.shape_setup(simple_shapes.placed_at_pad(simple_shapes.plate(), simple_shapes.bent_finger()))


@pytest.mark.parametrize("case", [case for case in CASES if case.short], ids=str)
def test_short_cases_hold(case, subject):
    rows = examine("contact", case, subject)
    assert {row["verdict"] for row in rows} <= {HOLDS, REJECTED}, [r for r in rows if r["verdict"] == FAILS]


def test_every_finding_of_an_exploding_contact_fails(subject):
    """No refsafe, and contacts a thousand times stiffer than the time step can follow."""
    exploded = closing_setup(subject).record(setting(safe=False, solref=(4e-6, 1)))
    verdicts = {finding.quantity: finding.verdict for finding in soundness(exploded)}
    assert verdicts["engine's warnings"] == FAILS
    assert verdicts["kinetic energy over the servos' work"] == FAILS
    assert joints_agree(exploded, closing_setup(subject).record()).verdict == FAILS


def test_energy_that_no_servo_gave_is_seen_though_the_engine_does_not_warn():
    """A finger that starts in a plate, and is meant to stay where it is, is pushed out by the contact."""
    still = HAND.open_joint_positions
    pushed = simple_shapes.shape_setup(
        simple_shapes.placed_at_pad(simple_shapes.plate(width=0.02), still, 0.001), still
    ).record()
    assert not pushed[0].warnings and pushed[0].energy_gain > 1
    verdicts = {finding.quantity: finding.verdict for finding in soundness(pushed)}
    assert verdicts["engine's warnings"] == HOLDS
    assert verdicts["kinetic energy over the servos' work"] == FAILS
    assert no_unsound_accepted([pushed[0]._replace(outcome=CLOSED)], "").verdict == FAILS
    assert no_unsound_accepted([pushed[0]._replace(outcome=UNSETTLED)], "").verdict == HOLDS


def test_depth_at_a_time_step_of_20_ms_is_why_it_is_rejected(subject):
    """The guard of the simulation is got round by editing the model that it has made."""

    def slow(simulation):
        simulation.model.opt.timestep = 0.02
        simulation.model.geom_solref[:, 0] = simulation.model.jnt_solref[:, 0] = 0.04
        simulation.ramp = simulation.ramp[::5]
        simulation.steps = len(simulation.ramp)

    recorded = closing_setup(subject).record(slow)
    assert [finding.verdict for finding in soundness(recorded)][-1] == FAILS
    assert {PENETRATING, UNSETTLED} & {each.outcome for each in recorded}
    with pytest.raises(ValueError, match="not between"):
        GraspSimulation(HAND, surface_patches(load_collision(subject.folder)), 0.02)


def test_heavy_links_still_move_at_the_end_and_are_not_taken(subject):
    heavy = closing_setup(subject).record(mass(1e4))
    assert {each.outcome for each in heavy} == {UNSETTLED}
    assert none_accepted(heavy, "").verdict == REJECTED
    assert none_accepted(closing_setup(subject).record(), "").verdict == FAILS
    assert joints_agree(heavy, closing_setup(subject).record()).verdict == FAILS


def test_energy_of_a_free_undamped_finger_is_that_of_its_servos_springs():
    """1 N m / rad, stretched by 0.4 rad: 0.08 J, which go to and fro."""

    def undamped(simulation):
        simulation.model.dof_damping[:] = 0
        simulation.model.actuator_biasprm[:, 2] = 0
        simulation.model.opt.timestep = 1e-4
        simulation.ramp = np.ones(600)

    simulation = RecordingSimulation(
        changed_copy(simple_shapes.shape_setup(simple_shapes.distant_ball()).grasper.simulation, undamped)
    )
    simulation.place(np.eye(4), HAND.open_joint_positions)
    targets = HAND.open_joint_positions.copy()
    targets[5] = 0.4
    springs = np.array([((data.qpos - targets) ** 2).sum() / 2 for data in simulation.closing(targets)])
    kinetic, work = np.array(simulation.kinetic), np.cumsum(simulation.work)
    np.testing.assert_allclose(kinetic + springs, 0.08, rtol=0.01)
    assert kinetic.max() > 0.06
    assert (work >= kinetic * (1 - 1e-6)).all()


def test_a_knob_that_does_not_converge_fails(on_a_plate):
    ends = [on_a_plate.record(combined(gains(factor), hold_targets)) for factor in (1, 1.1, 2, 8)]
    assert converges(ends, "gains").verdict == FAILS
    assert converges(ends[::-1], "gains").verdict == HOLDS


def test_a_wall_in_the_way_is_seen_in_the_agreement(on_a_plate):
    nothing = simple_shapes.shape_setup(simple_shapes.distant_ball())
    joint_change = joints_agree(on_a_plate.record(hold_targets), nothing.record(hold_targets))
    assert joint_change.verdict == FAILS and joint_change.value > JOINT_TOLERANCE
    assert (
        joints_agree(
            on_a_plate.record(combined(faster_closing(10), hold_targets)), on_a_plate.record(hold_targets)
        ).verdict
        == HOLDS
    )


def test_recording_does_not_change_a_closing(subject):
    setup = closing_setup(subject)
    simulation, closing = setup.grasper.simulation, setup.closings[0]
    simulation.place(closing.pose, HAND.open_joint_positions)
    expected = simulation.close(closing.targets).joint_positions
    np.testing.assert_array_equal(setup.record()[0].joints, expected)


def test_reasons_are_told_apart(subject):
    setup = closing_setup(subject)
    assert isinstance(setup.grasper, Grasper)
    assert UNSTABLE in {each.outcome for each in setup.record(setting(safe=False, solref=(4e-6, 1)))}
    assert {each.outcome for each in setup.record()} == {CLOSED}
