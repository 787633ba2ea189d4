"""Which samples come when, and what their batches hold."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from palpate.experiments import Experiment
from palpate.learning.data import ExperimentDataError
from palpate.learning.samples import Assembler, Sample, shuffled, spread, to_colours, training_samples, windows
from tests.learning.conftest import OCCLUDED_TOUCH, TOUCH_ONLY, made_up

VIEWS = Experiment("views", "charts", "views", False, 1)


@given(st.integers(1, 30), st.integers(1, 12), st.integers(0, 3), st.integers(0, 200))
def test_every_number_once_before_any_comes_again(count, size, seed, step):
    steps = -(-2 * count // size)
    stream = np.concatenate([shuffled(count, size, seed, k) for k in range(steps)])
    assert sorted(stream[:count]) == sorted(stream[count : 2 * count]) == list(range(count))
    np.testing.assert_array_equal(shuffled(count, size, seed, step), shuffled(count, size, seed, step))


def test_orders_differ_between_epochs_and_seeds():
    orders = {tuple(shuffled(20, 20, seed, epoch)) for seed in range(3) for epoch in range(3)}
    assert len(orders) == 9


def test_windows_wrap_around():
    data = made_up(grasps=5)
    found = windows(data, replace(OCCLUDED_TOUCH, grasps=3), "test")
    assert [sample.grasps for sample in found] == [(0, 1, 2), (1, 2, 3), (2, 3, 4), (3, 4, 0), (4, 0, 1)]
    assert [sample.window for sample in found] == [0, 1, 2, 3, 4]
    assert {data.splits[sample.object] for sample in found} == {"test"}


def test_one_window_where_there_is_no_other():
    data = made_up(grasps=3)
    assert len(windows(data, replace(OCCLUDED_TOUCH, grasps=3), "validation")) == 2
    alone = Experiment("alone", "charts", "unoccluded", False, 1)
    assert windows(made_up("unoccluded", "none"), alone, "test") == [Sample(6)]


def test_every_view_is_a_window():
    found = windows(made_up("views", "none"), VIEWS, "validation", "test")
    assert [(sample.object, sample.view) for sample in found] == [(o, v) for o in (4, 5, 6) for v in range(5)]


def test_too_few_grasps_is_said(data):
    with pytest.raises(ExperimentDataError, match="3 grasps an object, but the experiment needs 4"):
        windows(data, replace(OCCLUDED_TOUCH, grasps=4), "train")
    with pytest.raises(ExperimentDataError, match="grasps.per_object"):
        training_samples(data, replace(OCCLUDED_TOUCH, grasps=4), 2, 0, 0)


def test_spread_takes_windows_of_every_object_evenly():
    samples = [Sample(o, (), 0, window) for o in (3, 8) for window in range(5)]
    assert spread(samples, None) == samples and spread(samples, 9) == samples
    one = spread(samples, 1)
    assert [sample.object for sample in one] == [3, 8] and one[0].window != one[1].window
    assert [sum(sample.object == o for sample in spread(samples, 3)) for o in (3, 8)] == [3, 3]
    assert len(set(spread(samples, 3))) == 6


def test_training_sees_every_object_of_its_split_and_every_grasp(data):
    seen = [sample for step in range(200) for sample in training_samples(data, TOUCH_ONLY, 2, 7, step)]
    assert {sample.object for sample in seen} == set(data.of_split("train"))
    assert {sample.grasps for sample in seen} == {(a, b) for a in range(3) for b in range(3) if a != b}


def test_a_step_does_not_depend_on_those_before(data):
    later = training_samples(data, TOUCH_ONLY, 3, 7, 41)
    for step in range(41):
        training_samples(data, TOUCH_ONLY, 3, 7, step)
    assert training_samples(data, TOUCH_ONLY, 3, 7, 41) == later
    assert training_samples(data, TOUCH_ONLY, 3, 8, 41) != later


def test_a_batch_sample_by_sample():
    data = made_up("occluded", "charts", cameras=2)
    samples = [Sample(2, (1, 0)), Sample(5, (2, 1), 1), Sample(2, (0, 2))]
    batch = Assembler(data, replace(TOUCH_ONLY, strategy="template", vision="occluded"))(samples)
    assert batch["image"].dtype == torch.float32 and tuple(batch["image"].shape) == (3, 3, 24, 24)
    for place, sample in enumerate(samples):
        image = data["occluded"][sample.object, sample.grasps[0], sample.view].transpose(2, 0, 1) / 255
        np.testing.assert_allclose(batch["image"][place], image, atol=1e-7)
        for name in ("success", "position", "rotation", "charts"):
            expected = np.concatenate([data[name][sample.object, grasp] for grasp in sample.grasps])
            np.testing.assert_array_equal(batch[name][place], expected)
        np.testing.assert_array_equal(batch["camera"][place], data["image_camera"][sample.object, sample.view])
        for key, name in (("mask", "occluded_silhouette"), ("hand", "hand_silhouette")):
            np.testing.assert_array_equal(batch[key][place], data[name][sample.object, sample.grasps[0], sample.view])
    assert batch["camera_number"].tolist() == [0, 1, 0]
    of_touches = {"success", "position", "rotation", "charts"}
    assert set(batch) == {"image", "camera", "mask", "hand", "camera_number"} | of_touches


def test_a_batch_of_readings_and_of_views():
    data = made_up("none", "readings")
    batch = Assembler(data, replace(TOUCH_ONLY, strategy="sphere"))([Sample(1, (2,))])
    np.testing.assert_allclose(batch["reading"][0], data["reading"][1, 2].transpose(0, 3, 1, 2) / 255, atol=1e-7)
    data = made_up("views", "none")
    batch = Assembler(data, VIEWS)([Sample(0, (), 3), Sample(6, (), 1)])
    np.testing.assert_array_equal(batch["camera"], np.stack([data["camera"][0, 3], data["camera"][6, 1]]))
    np.testing.assert_allclose(batch["image"][1], data["views"][6, 1].transpose(2, 0, 1) / 255, atol=1e-7)


def test_an_unoccluded_image_goes_with_any_grasp():
    data = made_up("unoccluded", "charts", cameras=3)
    batch = Assembler(data, replace(OCCLUDED_TOUCH, vision="unoccluded"))([Sample(3, (2,)), Sample(3, (1,), 2)])
    for place, view in enumerate((0, 2)):
        image = data["unoccluded"][3, view].transpose(2, 0, 1) / 255
        np.testing.assert_allclose(batch["image"][place], image, atol=1e-7)
        np.testing.assert_array_equal(batch["camera"][place], data["image_camera"][3, view])


def test_images_of_several_cameras_are_samples_of_their_own():
    one, three = (made_up("occluded", "charts", cameras=count) for count in (1, 3))
    measured = windows(three, OCCLUDED_TOUCH, "test")
    assert {(sample.grasps, sample.view) for sample in measured} == {((g,), k) for g in range(3) for k in range(3)}
    assert sorted(sample.window for sample in measured) == list(range(9))
    seen = [training_samples(three, OCCLUDED_TOUCH, 2, 7, step) for step in range(60)]
    assert {sample.view for samples in seen for sample in samples} == {0, 1, 2}
    # Objects and grasps are those that a run with one camera sees, and an experiment without images.
    for step, samples in enumerate(seen):
        assert [each._replace(view=0) for each in samples] == training_samples(one, OCCLUDED_TOUCH, 2, 7, step)
        assert [each._replace(view=0) for each in samples] == training_samples(
            made_up("none", "charts"), replace(OCCLUDED_TOUCH, vision="none"), 2, 7, step
        )


def test_opacity_is_put_over_white():
    pixels = np.array([[[200, 100, 0, 255], [200, 100, 0, 0], [200, 100, 0, 51]]], np.uint8)
    found = to_colours(torch.from_numpy(pixels))
    expected = np.array([[200, 100, 0], [255, 255, 255], [244, 224, 204]]).T[:, None] / 255
    np.testing.assert_allclose(found, expected, atol=1e-6)
