import re

import numpy as np
import pandas as pd
import pytest

from palpate.experiments import Correction, Experiment
from palpate.learning.rows import EvaluationError
from palpate.results import model_tables as tables
from palpate.results.tables import display, write_table
from tests.learning import synthetic

CLASSES = ["bottle", "knife", "cellphone", "rifle"]

CORRECTION = Correction(0.08, 0.3)


@pytest.fixture(scope="module")
def evaluations() -> pd.DataFrame:
    means = synthetic.means_of_tables()
    means |= {name: 1.0 + 0.1 * k for k, name in enumerate(synthetic.of_table("single_image"))}
    return synthetic.evaluations(means, each=4, seeds=(0, 1), seed_spread=0.01)


@pytest.fixture(scope="module")
def rings() -> pd.DataFrame:
    return synthetic.rings(synthetic.published_rings(), each=4)


def class_means(frame: pd.DataFrame, experiment: str, split: str, column: str = "chamfer") -> pd.Series:
    """Over windows, then seeds and objects, then by class; the long way."""
    rows = frame[(frame["experiment"] == experiment) & (frame["split"] == split)]
    by_object = rows.groupby(["class", "object", "seed"])[column].mean().groupby(["class", "object"]).mean()
    return by_object.groupby("class").mean()


def test_model_selection_recomputed_with_pandas(evaluations):
    setup = synthetic.of_table("model_selection")
    table = tables.model_selection(evaluations, setup, resamples=100)
    assert table["experiment"].tolist() == list(setup) and table["row"].dropna().tolist() == list(range(1, 13))
    for row in table.to_dict("records"):
        by_class = class_means(evaluations, row["experiment"], "validation")
        assert [row[name] for name in CLASSES] == pytest.approx(by_class[CLASSES].tolist())
        assert row["average"] == pytest.approx(by_class.mean())
        assert row["average_low"] < row["average"] < row["average_high"]
        assert (row["objects"], row["seeds"], row["steps"]) == (16, 2, "700")
    papers = table[table["row"].notna()]
    first = papers.iloc[0]
    assert (first["method"], first["vision"], first["touch"]) == ("sphere (paper)", "unoccluded", "yes")
    published = [first[f"{name}_paper"] for name in (*CLASSES, "average")]
    assert published == [0.775, 0.572, 1.262, 0.643, 0.813]
    assert papers["average_paper"].tolist()[3] == 0.751 and papers["touch"].tolist()[8:] == ["no"] * 4


def test_the_note_says_what_the_numbers_stand_on(evaluations):
    table = tables.model_selection(evaluations, synthetic.of_table("model_selection"), resamples=100)
    note = table.attrs["note"]
    assert "16 objects of the validation split (4 bottle, 4 knife, 4 cellphone, 4 rifle)" in note
    assert "258" in note and "bootstrap" in note


def test_input_modalities_state_the_papers_averages_only(evaluations):
    table = tables.input_modalities(evaluations, synthetic.of_table("input_modalities"), resamples=100)
    papers = table[table["experiment"].str.startswith("charts")]
    assert papers["average_paper"].tolist() == [0.991, 1.074, 0.804, 0.861, 3.05]
    assert "bottle_paper" not in table and "bottle" in table
    worst = table.set_index("experiment").loc["charts_touch"]
    beside = class_means(evaluations, "charts_touch", "validation")
    assert worst["validation"] == pytest.approx(beside.mean()) and worst["validation_low"] < worst["validation"]
    expected = class_means(evaluations, "charts_touch", "test")
    assert worst["average"] == pytest.approx(expected.mean()) and worst["vision"] == "–"


def test_ours_stand_beside_the_papers_value_of_the_same_inputs(evaluations):
    setups = {
        "charts_occluded_touch": synthetic.EXPERIMENTS["charts_occluded_touch"],
        "template_occluded_touch": Experiment(
            "template_occluded_touch", "template", "occluded", True, 1, weights="template_5", correction=CORRECTION
        ),
        "retrieval_touch": Experiment("retrieval_touch", "retrieval", "none", True, 1, correction=CORRECTION),
    }
    ours = {"charts_occluded_touch": 1.0, "template_occluded_touch": 1.5, "retrieval_touch": 4.0}
    table = tables.input_modalities(synthetic.evaluations(ours, each=4), setups, resamples=100).set_index("experiment")
    assert table["method"].tolist() == [
        "charts, equation 1 (paper)", "template (ours)", "retrieval (no training)"
    ]  # fmt: skip
    assert table["average_paper"].tolist() == [0.991, 0.991, 3.05]
    assert table.loc["retrieval_touch", "average"] == pytest.approx(4.0, abs=0.1)
    assert table.loc["template_occluded_touch", "weights"] == "template_5" and table["weights"].isna().sum() == 2


def test_medians_are_over_objects(evaluations):
    """Of each object's mean over windows and seeds; of all classes together."""
    setup = synthetic.of_table("grasps")
    table = tables.grasps(evaluations, setup, resamples=50).set_index(["method", "input"])
    rows = evaluations[(evaluations["experiment"] == "charts_touch_3") & (evaluations["split"] == "test")]
    expected = rows.groupby("object")["chamfer"].mean().median()
    row = table.loc[("charts, equation 1 (paper)", "touch")]
    assert row["grasps_3_median"] == pytest.approx(expected) and row["grasps_3_low"] < row["grasps_3"]
    modalities = tables.input_modalities(evaluations, synthetic.of_table("input_modalities"), resamples=50)
    assert display(modalities)["average"][0].endswith(f"({modalities['average_median'][0]:.3f})")
    assert "median over objects" in modalities.attrs["note"]
    assert (
        "median"
        not in tables.surface_quality(evaluations, synthetic.of_table("input_modalities"), resamples=9).attrs["note"]
    )


def test_the_best_model_stands_beside_retrieval():
    means = {"charts_a": 1.0, "template_a": 0.8, "look_a": 0.4, "look_b": 0.5, "charts_c": 3.0}
    rows = [
        Experiment("charts_a", "charts", "occluded", True, 1),
        Experiment("template_a", "template", "occluded", True, 1, correction=CORRECTION),
        Experiment("look_b", "retrieval", "occluded", True, 1),
        Experiment("look_a", "retrieval", "occluded", True, 1, correction=CORRECTION),
        Experiment("charts_c", "charts", "none", True, 1),  # no look-up takes the same
    ]
    frame = synthetic.evaluations(means, each=4, spread=1e-3)
    (row,) = tables.retrieval(frame, {each.name: each for each in rows}, resamples=50).to_dict("records")
    assert (row["experiment"], row["method"], row["grasps"]) == ("template_a", "template (ours)", 1)
    ours, theirs = (class_means(frame, name, "test").mean() for name in ("template_a", "look_a"))
    assert (row["error"], row["retrieval"], row["ratio"]) == pytest.approx((ours, theirs, ours / theirs))
    of_object = frame[frame["split"] == "test"].groupby(["experiment", "object"])["chamfer"].mean()
    assert row["ratio_median"] == pytest.approx(of_object["template_a"].median() / of_object["look_a"].median())


def test_chosen_grasps_have_what_is_left_of_the_first_error():
    """A row a model and strategy, beside what was published elsewhere."""
    means = {("a", "random"): [1.0, 0.9, 0.8], ("a", "oracle"): [1.0, 0.7, 0.6], ("b", "random"): [2.0, 1.9, 1.0]}
    setups = {
        "b": Experiment("b", "template", "unoccluded", True, 2, fewer_grasps=True),
        "a": Experiment("a", "charts", "unoccluded", True, 2, fewer_grasps=True),
    }
    frame = synthetic.selections(means)
    table = tables.grasp_selection(frame, setups, resamples=50)
    measured, cited = table[table["source"] == "measured"], table[table["source"] != "measured"]
    assert measured["method"].str.extract(r"(\w+)")[0].tolist() == ["template", "charts", "charts"]
    assert measured["strategy"].tolist() == ["random", "random", "oracle"]
    assert measured["left"].tolist() == pytest.approx([0.5, 0.8, 0.6], abs=0.002)
    assert measured["grasps_0"].tolist() == pytest.approx([2, 1, 1], abs=0.002)
    last = frame[(frame["experiment"] == "a") & (frame["strategy"] == "oracle") & (frame["grasps"] == 2)]
    assert measured["grasps_2_median"].iloc[2] == pytest.approx(last["chamfer"].median())
    assert dict(zip(cited["strategy"], cited["left"], strict=True)) == {
        "random": 0.907, "learned": 0.893, "oracle": 0.772
    }  # fmt: skip
    assert "among 20 stored grasps" in table.attrs["note"]


def test_tables_say_how_far_two_seeds_differ(evaluations):
    """By the difference of the two seeds' averages; with one seed, that nothing is known of it."""
    setup = synthetic.of_table("input_modalities")
    table = tables.input_modalities(evaluations, setup, resamples=100).set_index("experiment")
    for name in setup:
        rows = evaluations[(evaluations["experiment"] == name) & (evaluations["split"] == "test")]
        one, other = (class_means(rows[rows["seed"] == seed], name, "test").mean() for seed in (0, 1))
        assert table.loc[name, "between_seeds"] == pytest.approx(abs(one - other))
    alone = tables.input_modalities(evaluations[evaluations["seed"] == 0], setup, resamples=100)
    assert "between_seeds" not in alone and "One seed" in alone.attrs["note"]
    assert "objects only" in alone.attrs["note"] and "objects only" not in table.attrs["note"]


def test_surface_quality_has_the_average_of_each_number(evaluations):
    table = tables.surface_quality(evaluations, synthetic.of_table("input_modalities"), resamples=100)
    row = table.set_index("experiment").loc["charts_occluded_touch"]
    assert row["bend_degrees"] == pytest.approx(class_means(evaluations, row.name, "test", "bend").mean())
    assert [row[name] for name in ("folded_percent", "gap_mm", "across_degrees")] == [1.0, 2.0, 30.0]
    assert row["bend_degrees_low"] < row["bend_degrees"] < row["bend_degrees_high"]


def test_grasps_have_a_row_a_setup(evaluations):
    table = tables.grasps(evaluations, synthetic.of_table("grasps"), resamples=100)
    assert not table.duplicated(["method", "input"]).any()
    table = table[table["method"] == "charts, equation 1 (paper)"].set_index("input")
    assert list(table.index) == ["unoccluded vision + touch", "touch"]
    published = [table.loc["touch", f"grasps_{count}_paper"] for count in range(1, 6)]
    assert published == [3.05, 1.769, 1.479, 1.296, 1.237]
    for count in range(1, 6):
        name = "charts_touch" if count == 1 else f"charts_touch_{count}"
        expected = class_means(evaluations, name, "test").mean()
        assert table.loc["touch", f"grasps_{count}"] == pytest.approx(expected)


def test_extrapolation_is_in_square_metres_and_times_9000(rings):
    table = tables.extrapolation(rings, synthetic.of_table("extrapolation"), resamples=100)
    names = list(synthetic.of_table("extrapolation"))
    small, scaled = table[table["unit"] == "m^2"], table[table["unit"] == "m^2 x 9000"]
    assert small["input"].tolist() == scaled["input"].tolist() and len(small) == len(names)
    touch = small.iloc[names.index("charts_occluded_touch")]
    assert touch["input"] == "occluded vision + touch" and touch["x1_paper"] == 2.569e-5
    numbers = [name for name in table if re.fullmatch(r"x\d.*", name)]
    np.testing.assert_allclose(scaled[numbers].astype(float), 9000 * small[numbers].astype(float).to_numpy())
    rows = rings[(rings["experiment"] == "charts_unoccluded") & (rings["ring"] == 3)]
    by_object = rows.groupby(["class", "object"])["distance"].mean()
    expected = by_object.groupby("class").mean().mean()
    assert small.iloc[names.index("charts_unoccluded")]["x3"] == pytest.approx(expected)


def test_local_touch_charts_recomputed_with_pandas():
    touches = synthetic.touches(each=3)
    table = tables.local_touch_charts(touches, resamples=100).set_index("prediction")
    by_object = touches.groupby(["class", "object"])[["cloud", "chart"]].mean().groupby("class").mean()
    for label, part in (("local point cloud", "cloud"), ("touch chart", "chart")):
        assert table.loc[label, CLASSES].tolist() == pytest.approx(by_object.loc[CLASSES, part].tolist())
        assert table.loc[label, "average"] == pytest.approx(by_object[part].mean())
    assert table.loc["local point cloud", "bottle_paper"] == 0.0099
    assert np.isnan(table.loc["touch chart", "bottle_paper"])


def test_single_image_is_by_pixel2meshs_protocol_and_cites(evaluations):
    table = tables.single_image(evaluations, synthetic.of_table("single_image"), resamples=100)
    measured = table.iloc[0]
    chamfer = class_means(evaluations, "single_image", "test").mean()
    assert measured["chamfer"] == pytest.approx(chamfer / 9000 * (0.57 / 0.5) ** 2 * 1000)
    assert measured["f1_tau"] == pytest.approx(50) and measured["f1_2tau"] == pytest.approx(70)
    assert table.iloc[4]["chamfer"] == 0.369
    assert table["from"].tolist()[4:] == ["the paper", *["cited by the paper"] * 8]
    assert table["source"].tolist() == ["measured"] * 4 + ["cited"] * 9
    # What is cited has no interval and is no result of this run, also where the method is measured too.
    assert table[table["source"] == "cited"][["chamfer_low", "objects", "seeds", "steps"]].isna().all(axis=None)


def test_classes_that_the_paper_has_not_stand_without_its_values(evaluations):
    renamed = evaluations.assign(**{"class": evaluations["class"].replace("rifle", "mug")})
    table = tables.model_selection(renamed, synthetic.of_table("model_selection"), resamples=100)
    assert "mug" in table and "mug_paper" not in table and "rifle" not in table
    assert table["knife_paper"].notna().all()


def test_a_missing_experiment_is_an_error(evaluations, rings):
    some = evaluations[evaluations["experiment"] != "no_comm_occluded_touch"]
    with pytest.raises(EvaluationError, match="no_comm_occluded_touch"):
        tables.model_selection(some, synthetic.of_table("model_selection"))
    with pytest.raises(EvaluationError, match="charts_unoccluded_touch"):
        tables.extrapolation(
            rings[rings["experiment"] != "charts_unoccluded_touch"], synthetic.of_table("extrapolation")
        )


def test_what_is_written_says_the_same_in_three_forms(tmp_path, evaluations):
    table = tables.model_selection(evaluations, synthetic.of_table("model_selection"), resamples=100)
    write_table(table, tmp_path / "tables" / "model_selection.csv")
    read = pd.read_csv(tmp_path / "tables" / "model_selection.csv")
    assert list(read.columns) == list(table.columns)
    np.testing.assert_allclose(read["knife_low"], table["knife_low"], rtol=1e-5)
    lines = (tmp_path / "tables" / "model_selection.md").read_text().splitlines()
    header, body = lines[0].strip("|").split("|"), [line.strip("|").split("|") for line in lines[2 : 2 + len(table)]]
    columns = [name.strip() for name in header]
    assert "bottle low" not in columns and "bottle paper" in columns
    tex = (tmp_path / "tables" / "model_selection.tex").read_text().splitlines()
    for number, cells in enumerate(body):
        row = dict(zip(columns, (cell.strip() for cell in cells), strict=True))
        value, low, high = map(float, re.fullmatch(r"(\S+) \[(\S+), (\S+)\]", row["rifle"]).groups())
        expected = table.iloc[number][["rifle", "rifle_low", "rifle_high"]].tolist()
        assert [value, low, high] == pytest.approx(expected, abs=0.00051)
        in_tex = [cell.strip().replace(r"\_", "_") for cell in tex[4 + number].removesuffix(r"\\").split("&")]
        assert in_tex == [cell.strip().replace("–", "--") for cell in cells]
    assert lines[-1] == table.attrs["note"] and tex[-1] == f"% {table.attrs['note']}"


def test_a_class_with_one_object_shows_no_interval(tmp_path, evaluations):
    few = evaluations[(evaluations["class"] != "knife") | (evaluations["object"].str.endswith("0000"))]
    table = tables.input_modalities(few, synthetic.of_table("input_modalities"), resamples=100)
    assert table["knife_low"].isna().all() and table["average_low"].isna().all()
    assert table["bottle_low"].notna().all()
    shown = display(table)
    assert re.fullmatch(r"\d\.\d{3} \(\d\.\d{3}\)", shown["average"][0]) and "[" in shown["bottle"][0]


def test_small_numbers_keep_their_digits(rings):
    shown = display(tables.extrapolation(rings, synthetic.of_table("extrapolation"), resamples=100))
    first = list(synthetic.of_table("extrapolation")).index("charts_occluded")
    assert shown["x1_paper"][first] == "6.69e-05" and shown["x1_paper"][first + len(shown) // 2] == "0.602"


def test_the_single_image_table_parts_what_is_measured_from_what_is_cited(evaluations, tmp_path):
    experiments = synthetic.of_table("single_image")
    made = tables.single_image(evaluations, experiments, resamples=100)
    write_table(made, tmp_path / "single_image.csv")
    table = pd.read_csv(tmp_path / "single_image.csv")
    assert table["source"].tolist() == ["measured"] * 4 + ["cited"] * 9
    measured, cited = table[table["source"] == "measured"], table[table["source"] == "cited"]
    assert measured["from"].tolist() == list(experiments)
    assert measured["method"].tolist()[1:] == [f"in the manner of {name}" for name in ("PSG", "Pixel2Mesh", "3D-R2N2")]
    for row in measured.to_dict("records"):
        chamfer = class_means(evaluations, row["from"], "test").mean()
        assert row["chamfer"] == pytest.approx(chamfer / 9000 * (0.57 / 0.5) ** 2 * 1000, rel=1e-5)
    assert measured[["chamfer_low", "objects", "seeds", "steps"]].notna().all(axis=None)
    # What is cited has no interval and is no result of this run, also where the method is measured too.
    assert {"PSG", "Pixel2Mesh", "3D-R2N2", "N3MR", "MVD", "GEOMetrics"} <= set(cited["method"])
    assert cited[["chamfer_low", "objects", "seeds", "steps"]].isna().all(axis=None)
    lines = (tmp_path / "single_image.md").read_text().splitlines()[2:15]
    assert [line.split("|")[1].strip() for line in lines] == table["source"].tolist()


def test_the_table_of_a_grid_has_the_best_first():
    points = [{"rate": 1.0}, {"rate": 2.0}]
    said = {"best_step": 5, "steps": 9, "seconds": 3.0, "parameters": 7, "kind": "x"}
    said |= {"machine": {"found": "cpu"}, "validated": 4}
    table = tables.tuning(points, [said | {"validation_loss": 4.0}, said | {"validation_loss": 2.0}])
    assert list(table["rate"]) == [2.0, 1.0]
    assert "kind" not in table and table["seconds"][0] == 3.0
