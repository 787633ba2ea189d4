import numpy as np
import pandas as pd
import pytest

from palpate.learning.rows import COLUMNS, RING_COLUMNS, EvaluationError, read
from palpate.results.errors import errors
from palpate.results.model_tables import ring_errors, ring_key, touch_errors
from tests.learning import synthetic

MEANS = {"charts_touch": 3.0, "charts_occluded": 1.0}


def test_errors_are_means_over_windows_seed_by_seed():
    frame = synthetic.evaluations(MEANS, each=3, seeds=(0, 1, 5), windows=4)
    found = errors(frame, list(MEANS), "test")
    by_hand = frame[frame["split"] == "test"].groupby(["experiment", "seed", "object"])["chamfer"].mean()
    assert len(found.objects) == 12 and found.values["charts_touch"].shape == (3, 12)
    for row, seed in enumerate((0, 1, 5)):
        for column, name in enumerate(found.objects):
            value = by_hand["charts_touch", seed, name]
            assert found.values["charts_touch"][row, column] == pytest.approx(value)
    assert found.class_names == ["bottle", "knife", "cellphone", "rifle"]
    assert found.of_class("knife").objects.tolist() == [f"test-knife-000{i}" for i in range(3)]
    assert found.steps["charts_touch"] == (700, 700)


def test_the_interval_of_an_error_ends_at_0():
    frame = synthetic.evaluations({"charts_touch": 0.1, "charts_occluded": 0.1}, each=2, spread=0.2)
    found = errors(frame, ["charts_touch", "charts_occluded"], "test").of_class("rifle")
    average = found.estimate(["charts_touch"], resamples=100)
    assert average.low == 0 < average.high
    difference = found.estimate(["charts_touch", "charts_occluded"], lambda means: means[..., 0] - means[..., 1])
    assert difference.low < 0 < difference.high


def test_unknown_classes_come_after_the_papers():
    frame = synthetic.evaluations(MEANS, each=2)
    frame["class"] = frame["class"].replace({"bottle": "anvil", "rifle": "zebra"})
    assert errors(frame, ["charts_touch"], "test").class_names == ["knife", "cellphone", "anvil", "zebra"]


def test_what_is_not_trained_was_measured_once_and_stands_for_every_seed():
    frame = synthetic.evaluations(MEANS, each=2, seeds=(3, 5))
    once = synthetic.evaluations({"retrieval_touch": 2.0}, each=2, seeds=(3,))
    with pytest.raises(EvaluationError, match=r"measured with the seeds \[3\]"):
        errors(pd.concat([frame, once]), [*MEANS, "retrieval_touch"], "test")
    found = errors(pd.concat([frame, once.assign(steps=0)]), [*MEANS, "retrieval_touch"], "test")
    alone = errors(once.assign(steps=0), ["retrieval_touch"], "test")
    assert alone.values["retrieval_touch"].shape == (1, 8)
    np.testing.assert_array_equal(found.values["retrieval_touch"], alone.values["retrieval_touch"].repeat(2, axis=0))
    assert found.values["charts_touch"].shape == (2, 8) and found.steps["retrieval_touch"] == (0, 0)
    assert np.isnan(found.between_seeds(["retrieval_touch"]))
    assert found.between_seeds(["charts_touch", "retrieval_touch"]) == found.between_seeds(["charts_touch"]) > 0


def test_rows_may_come_in_any_order():
    frame = synthetic.evaluations(MEANS, each=3, seeds=(0, 1))
    one = errors(frame, list(MEANS), "test")
    other = errors(frame.sample(frac=1, random_state=0), list(MEANS), "test")
    for name in MEANS:
        np.testing.assert_allclose(one.values[name], other.values[name])


def test_an_experiment_that_was_not_evaluated_is_named():
    frame = synthetic.evaluations(MEANS, each=2)
    with pytest.raises(EvaluationError, match=r"'sphere_occluded' on the test split; .*charts_touch"):
        errors(frame, ["sphere_occluded"], "test")
    with pytest.raises(EvaluationError, match="validation"):
        errors(frame[frame["split"] == "test"], ["charts_touch"], "validation")


def test_an_object_that_only_some_were_measured_on_is_named():
    frame = synthetic.evaluations(MEANS, each=2, seeds=(0, 1))
    gone = (frame["experiment"] == "charts_touch") & (frame["object"] == "test-knife-0001")
    for lost in (gone, gone & (frame["seed"] == 1)):
        with pytest.raises(EvaluationError, match=r"charts_touch.*test-knife-0001"):
            errors(frame[~lost], list(MEANS), "test")


def test_an_error_that_is_not_a_number_is_named():
    frame = synthetic.evaluations(MEANS, each=2)
    frame.loc[frame["object"] == "test-rifle-0000", "chamfer"] = np.nan
    with pytest.raises(EvaluationError, match="test-rifle-0000: chamfer is nan"):
        errors(frame, list(MEANS), "test")


def test_a_sample_that_was_measured_twice_is_named():
    frame = synthetic.evaluations(MEANS, each=2)
    with pytest.raises(EvaluationError, match="measured twice: .*test-bottle-0000"):
        errors(pd.concat([frame, frame[frame["object"] == "test-bottle-0000"]]), list(MEANS), "test")


def test_files_are_read_one_after_the_other(tmp_path):
    frame = synthetic.evaluations(MEANS, each=2)
    paths = []
    for name, rows in frame.groupby("experiment"):
        paths.append(tmp_path / f"{name}.csv")
        rows.assign(more=1).to_csv(paths[-1], index=False)
    found = read(paths)
    assert list(found.columns) == list(COLUMNS) and len(found) == len(frame)
    pd.testing.assert_series_equal(
        found.groupby("experiment")["chamfer"].sum(), frame.groupby("experiment")["chamfer"].sum()
    )


def test_a_missing_file_says_how_to_build_it(tmp_path):
    path = tmp_path / "evaluations/charts_touch/seed-0.csv"
    with pytest.raises(EvaluationError, match="snakemake evaluations/charts_touch/seed-0.csv"):
        read([path])
    path.parent.mkdir(parents=True)
    synthetic.evaluations(MEANS, each=2).drop(columns=["chamfer", "steps"]).to_csv(path)
    with pytest.raises(EvaluationError, match=r"no columns \['chamfer', 'steps'\]"):
        read([path])
    with pytest.raises(EvaluationError, match="no evaluations"):
        read([])


def test_an_object_without_surface_in_a_ring_is_left_out_everywhere():
    names = ("charts_occluded", "charts_touch")
    means = {(name, ring): 1e-5 * ring for name in names for ring in range(1, 6)}
    rings = synthetic.rings(means, each=3, spread=0)
    empty = (rings["object"] == "test-knife-0001") & (rings["ring"] == 5)
    rings.loc[empty, "distance"] = np.nan
    # A touch of another object has no points in a ring, but that object's other touch has.
    one = (rings["object"] == "test-rifle-0000") & (rings["ring"] == 4) & (rings["grasp"] == 0)
    rings.loc[one, "distance"] = np.nan
    found = ring_errors(rings[list(RING_COLUMNS)], names, "test")
    assert len(found.objects) == 11 and "test-knife-0001" not in found.objects
    ratio = found.values[ring_key("charts_touch", 4)] / found.values[ring_key("charts_touch", 2)]
    np.testing.assert_allclose(ratio, 2)


def test_a_ring_evaluation_that_is_missing_is_named():
    rings = synthetic.rings({("charts_touch", ring): 1.0 for ring in range(1, 6)}, each=2)
    with pytest.raises(EvaluationError, match="no ring evaluation of experiment 'charts_occluded'"):
        ring_errors(rings, ["charts_occluded"], "test")


def test_errors_of_touches_are_means_over_an_objects_touches():
    touches = synthetic.touches(each=2)
    found = touch_errors(touches, "test")
    by_hand = touches.groupby("object")[["cloud", "chart"]].mean().loc[found.objects]
    np.testing.assert_allclose(found.values["cloud"][0], by_hand["cloud"])
    np.testing.assert_allclose(found.values["chart"][0], by_hand["chart"])
