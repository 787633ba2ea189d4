"""Recipes: the shipped ones, what a run sets otherwise, and what is said of mistakes."""

from dataclasses import replace
from pathlib import Path

import pytest

from palpate.architectures import GCN, PAPER_ARCHITECTURES
from palpate.configuration import ConfigError
from palpate.experiments import Experiments
from palpate.learning.recipes import Recipe, layers_of_blocks, tuning_grid, tuning_settings

PROJECT = Path(__file__).parents[2]
FILE = PROJECT / "config/recipes.yaml"
SCHEMA = PROJECT / "workflow/schemas/recipes.schema.yaml"
EXPERIMENTS = Experiments.read(
    PROJECT / "config/experiments.yaml", PROJECT / "workflow/schemas/experiments.schema.yaml"
).experiments


def resolve(override, name="fast", file=FILE):
    return Recipe.read(file, name, override, SCHEMA)


def test_the_papers_numbers():
    """Supplement, "Optimization Details" of local and of global charts, and "Single Image ..."."""
    recipe = resolve({}, "paper")
    depth = recipe.touch_depth
    assert (depth.rate, depth.batch, depth.epochs, depth.width) == (5e-5, 32, 114, 64)
    for experiment in EXPERIMENTS.values():
        if experiment.architecture:  # not the paper's
            continue
        found = recipe.settings(experiment)
        assert found.architecture in PAPER_ARCHITECTURES.values() or experiment.strategy in (
            "psg",
            "pixel2mesh",
            "r2n2",
        )
        schedule = found.rate, found.batch, found.epochs, found.patience
        single = experiment.vision == "views"
        assert schedule == ((1e-5, 64, 40, None) if single else (3e-5, 16, 260, 70))


def test_every_experiment_has_settings():
    recipe = resolve({})
    for name, experiment in EXPERIMENTS.items():
        assert recipe.settings(experiment).batch >= 1, name


@pytest.mark.parametrize("name", ["fast", "paper"])
def test_the_published_single_image_networks_keep_their_share_of_the_steps(name):
    """Of whatever length single_image has: of steps, epochs, and the steps between evaluations."""
    factor = 1.3
    for lengths in ({"steps": 1000, "evaluate_every": 100}, {"steps": 4000, "epochs": 30}):
        override = {"reconstruction": lengths, "modalities": {"single_image": {"epochs": lengths.get("epochs")}}}
        recipe = resolve(override | {"strategies": {"psg": {"steps_factor": factor}}}, name)
        ours = recipe.settings(EXPERIMENTS["single_image"])
        theirs = recipe.settings(EXPERIMENTS["single_image_psg"])
        ours, theirs = ours.row(), theirs.row()
        assert "steps_factor" not in theirs  # it has been applied: a checkpoint's settings hold the steps themselves
        assert {key: ours[key] for key in lengths} == lengths
        for key in ("steps", "epochs", "evaluate_every"):
            assert theirs[key] == (ours[key] and pytest.approx(factor * ours[key], abs=0.5))


def test_a_length_never_falls_to_none():
    recipe = resolve({"reconstruction": {"steps": 4}, "strategies": {"r2n2": {"steps_factor": 0.01}}})
    assert recipe.settings(EXPERIMENTS["single_image_r2n2"]).steps == 1


def test_an_override_is_merged_deeply_and_the_file_left_as_it_is():
    before = resolve({})
    changed = resolve({"reconstruction": {"rate": 0.5, "architecture": {"gcn": {"layers": 2}}}})
    assert changed.reconstruction["rate"] == 0.5
    found, expected = (recipe.reconstruction["architecture"]["gcn"] for recipe in (changed, before))
    assert found == expected | {"layers": 2}
    assert changed.reconstruction["batch"] == before.reconstruction["batch"]
    assert changed.touch_depth == before.touch_depth
    assert resolve({}) == before


def test_modality_then_strategy():
    recipe = resolve(
        {
            "reconstruction": {"batch": 3, "rate": 0.1, "clip": 7.0},
            "modalities": {"occluded_touch": {"batch": 5, "rate": 0.2}},
            "strategies": {"sphere": {"rate": 0.3}},
        }
    )
    found = recipe.settings(EXPERIMENTS["sphere_occluded_touch"])
    assert (found.batch, found.rate, found.clip) == (5, 0.3, 7.0)
    found = recipe.settings(EXPERIMENTS["charts_occluded_touch"])
    assert (found.batch, found.rate) == (5, 0.2)
    found = recipe.settings(EXPERIMENTS["charts_unoccluded_touch"])
    assert (found.batch, found.rate) == (3, 0.1)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ({"reconstruction": {"raet": 1}}, "fast.reconstruction.raet: unknown key; did you mean 'rate'?"),
        ({"modalities": {"ocluded": {}}}, "fast.modalities.ocluded: unknown key; did you mean 'occluded'?"),
        (
            {"modalities": {"touch": {"stesp": 1}}},
            "fast.modalities.touch.stesp: unknown key; did you mean 'steps'?",
        ),
        ({"touch_depth": {"batch": 0}}, "fast.touch_depth.batch: 0 is less than the minimum"),
        ({"reconstruction": {"schedule": "cosine"}}, "fast.reconstruction.schedule: 'cosine' is not one of"),
        ({"reconstruction": {"architecture": {"gcn": {"depth": 1}}}}, "gcn.depth: unknown key"),
        ({"reconstruction": {"architecture": {"deformations": 0}}}, "deformations: 0 is less than the minimum"),
        ({"reconstruction": {"architecture": {"failed_charts": "kept"}}}, "failed_charts: 'kept' is not one of"),
        ({"epochs": 3}, "fast.epochs: unknown key"),
        ({"strategies": {"pold": {}}}, "'pold' is not one of charts, no_copy"),
        (
            {"reconstruction": {"architecture": {"failed": "fixed"}}},
            "fast.reconstruction.architecture.failed: unknown key; did you mean 'failed_charts'?",
        ),
        ({"reconstruction": {"steps": None, "epochs": None}}, "reconstruction needs steps or epochs"),
        ({"modalities": {"touch": {"steps": None}}}, "modalities.touch needs steps or epochs"),
        ({"touch_depth": {"patience": 5}}, "touch_depth has patience, which needs schedule constant"),
        ({"strategies": {"sphere": {"patience": 5}}}, "strategies.sphere has patience"),
    ],
)
def test_each_mistake_is_one_clear_line(override, said):
    with pytest.raises(ConfigError) as error:
        resolve(override)
    assert said in str(error.value)
    assert "training.override" in str(error.value) or "needs" in str(error.value)


def test_a_part_of_an_architecture_is_merged_into_the_whole():
    override = {"modalities": {"occluded": {"architecture": {"gcn": {"layers": 2}}}}}
    experiment = EXPERIMENTS["charts_occluded"]
    whole = resolve({}).settings(experiment).architecture
    found = resolve(override).settings(experiment).architecture
    assert found == replace(whole, gcn=replace(whole.gcn, layers=2)) != whole
    with pytest.raises(ConfigError, match="recipe paper, modalities.occluded does not fit") as error:
        resolve(override, "paper")
    assert "gcn.width: missing" in str(error.value)


def test_a_recipe_that_does_not_exist():
    with pytest.raises(ConfigError, match="no recipe 'slow' .*known: fast, paper"):
        resolve({}, "slow")


@pytest.mark.parametrize(
    ("text", "said"), [("paper: {}", "key 'paper' stands twice"), ("x: [", "can't be read as YAML")]
)
def test_a_file_that_is_not_right_is_named(tmp_path, text, said):
    grid = PROJECT / "config/tuning.yaml"
    for file, read in ((FILE, lambda path: resolve({}, file=path)), (grid, lambda path: tuning_grid(path, "small"))):
        changed = tmp_path / file.name
        changed.write_text(f"{file.read_text()}\n{text}\n")
        with pytest.raises(ConfigError, match=rf"{changed}: .*{said}"):
            read(changed)


def test_the_supplements_grid():
    points = tuning_grid(PROJECT / "config/tuning.yaml", "paper")
    assert len(points) == len({tuple(point.values()) for point in points}) == 3**4
    assert {point["rate"] for point in points} == {1e-4, 3e-5, 1e-5}
    assert {point["cnn_layers"] for point in points} == {12, 15, 18}
    assert {point["gcn_layers"] for point in points} == {15, 20, 25}
    assert {point["width"] for point in points} == {150, 200, 250}
    with pytest.raises(ConfigError, match="no grid 'huge' .*known: small, paper"):
        tuning_grid(PROJECT / "config/tuning.yaml", "huge")


def test_points_lay_their_layers_as_the_papers_tables_do():
    settings = resolve({}, "paper").settings(EXPERIMENTS["charts_occluded_touch"])
    base = PAPER_ARCHITECTURES["occluded_touch"]
    point = {"rate": 3e-5, "cnn_layers": 18, "gcn_layers": 21, "width": 250}
    found = tuning_settings(settings, point, None)
    assert found.architecture == base and found == settings
    point = {"rate": 1e-4, "cnn_layers": 12, "gcn_layers": 15, "width": 150}
    found = tuning_settings(settings, point, 40)
    assert found.architecture.encoder.layers == PAPER_ARCHITECTURES["unoccluded"].encoder.layers
    assert found.architecture.encoder.pool == [6, 9, 12]
    assert found.architecture.gcn == GCN(15, 150)
    assert (found.rate, found.steps, found.epochs) == (1e-4, 40, 260)
    assert layers_of_blocks(15) == [4, 4, 4, 3]
    with pytest.raises(ConfigError, match="6 CNN layers"):
        layers_of_blocks(6)
