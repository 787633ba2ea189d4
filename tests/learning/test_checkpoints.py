"""Trained models as files: what is written is loaded, and what can't be used is said."""

import resource
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate import seal
from palpate.architectures import GCN, PAPER_ARCHITECTURES
from palpate.learning.checkpoints import CheckpointError, build, load, load_touch_depth, save
from palpate.models import TouchDepth
from tests.learning.conftest import ARCHITECTURE, OCCLUDED_TOUCH, TOUCH_ONLY
from tests.learning.test_recipes import EXPERIMENTS, resolve


@pytest.fixture
def model():
    return build(OCCLUDED_TOUCH, ARCHITECTURE)


@pytest.fixture
def path(tmp_path, model):
    save(
        tmp_path / "best.ckpt",
        "reconstruction",
        model,
        {"experiment": OCCLUDED_TOUCH.row(), "architecture": ARCHITECTURE.row()},
    )
    return tmp_path / "best.ckpt"


def changed(path, **values):
    torch.save(torch.load(path, weights_only=True) | values, path)
    seal.write(path)


def test_what_is_written_is_loaded(path, model):
    found = load(path, OCCLUDED_TOUCH)
    assert not found.training and (found.experiment.row(), found.sensors) == (OCCLUDED_TOUCH.row(), 4)
    expected = model.state_dict()
    assert all(torch.equal(value, expected[key]) for key, value in found.state_dict().items())


def test_the_unet(tmp_path):
    model = TouchDepth(2)
    save(tmp_path / "best.ckpt", "touch_depth", model, {"width": 2})
    found, reading = load_touch_depth(tmp_path / "best.ckpt"), torch.rand(1, 3, 100, 100)
    torch.testing.assert_close(found(reading), model.eval()(reading))


def test_the_same_model_gives_the_same_bytes(path, model):
    before = path.read_bytes()
    save(path, "reconstruction", model, {"experiment": OCCLUDED_TOUCH.row(), "architecture": ARCHITECTURE.row()})
    assert path.read_bytes() == before


def test_of_another_experiment(path):
    with pytest.raises(CheckpointError, match="was trained for .*occluded.*is asked for"):
        load(path, TOUCH_ONLY)


def test_under_the_name_of_another_model(tmp_path, model):
    described = {"experiment": OCCLUDED_TOUCH.row(), "architecture": ARCHITECTURE.row()}
    path = tmp_path / "models/charts_touch/seed-0/best.ckpt"
    save(path, "reconstruction", model, {**described, "name": "charts_touch/seed-0"})
    load(path)
    for other in ("charts/seed-0", "charts_touch/seed-1"):
        copy = tmp_path / "models" / other / "best.ckpt"
        copy.parent.mkdir(parents=True)
        shutil.copy(path, copy)
        with pytest.raises(
            CheckpointError, match=f"is the model charts_touch/seed-0, not {other}; remove it and train"
        ):
            load(copy)
    load(shutil.copy(path, tmp_path / "best.ckpt"))  # outside of a run it has any name


@pytest.mark.parametrize(
    "values",
    [
        {"weights": 3},
        {"weights": None},
        {"experiment": None},
        {"experiment": {}},
        {"experiment": replace(OCCLUDED_TOUCH, strategy="none").row()},
        {"architecture": {"gcn": 3}},
        {"architecture": []},
        {"sensor": {"name": 1}},
    ],
    ids=str,
)
def test_of_a_wrong_structure(path, values):
    changed(path, **values)
    with pytest.raises(CheckpointError, match=r"best.ckpt .*remove it and train") as error:
        load(path)
    assert "\n" not in str(error.value)


def test_of_another_architecture(path):
    changed(path, architecture=replace(ARCHITECTURE, gcn=GCN(3, 12)).row())
    with pytest.raises(CheckpointError, match="holds another model .*(image_weight|gcn.layers.0.weight)"):
        load(path)


def test_of_another_schema_version(path):
    changed(path, schema_version=7)
    with pytest.raises(CheckpointError, match="schema version 7, but this palpate reads version 4"):
        load(path)


def test_of_another_kind(path):
    with pytest.raises(CheckpointError, match="kind reconstruction, expected touch_depth"):
        load_touch_depth(path)


class Code:
    def __reduce__(self):
        return print, ("run",)


def test_no_checkpoint(tmp_path, capsys):
    run = tmp_path / "models/charts_touch/seed-0/best.ckpt"
    with pytest.raises(CheckpointError, match="train the model with: snakemake models/charts_touch/seed-0/best.ckpt"):
        load(run)
    run.parent.mkdir(parents=True)
    for content in (b"", b"no checkpoint"):
        run.write_bytes(content)
        with pytest.raises(CheckpointError, match="its seal .* can't be read"):
            load(run)
    torch.save({"schema_version": 1, "kind": Code()}, run)
    with pytest.raises(CheckpointError, match="its seal .* can't be read"):
        load(run)
    seal.write(run)
    with pytest.raises(CheckpointError, match="is no checkpoint"):
        load(run)
    assert "run" not in capsys.readouterr().out


def test_the_papers_architecture_is_that_of_what_the_model_sees():
    recipe = resolve({}, "paper")
    for name, key in {
        "sphere_occluded_touch": "occluded_touch",
        "charts_unoccluded": "unoccluded",
        "charts_touch_3": "touch",
        "single_image": "single_image",
    }.items():
        assert recipe.settings(EXPERIMENTS[name]).architecture == PAPER_ARCHITECTURES[key]


def test_no_altered_bit_changes_the_model_without_an_error(path, model):
    content, expected, rng = path.read_bytes(), model.state_dict(), np.random.default_rng(0)
    noticed = 0
    for place in rng.choice(len(content), 150, replace=False):
        altered = bytearray(content)
        altered[place] ^= 1 << rng.integers(8)
        path.write_bytes(altered)
        try:
            found = load(path).state_dict()
        except CheckpointError as error:
            noticed += 1
            assert str(path) in str(error) and "remove it and" in str(error)
        else:  # a byte that no reader looks at, such as padding
            assert all(torch.equal(found[name], value) for name, value in expected.items())
    assert noticed > 50


@pytest.mark.parametrize("kept", [0, 10, 0.5, -1])
def test_a_checkpoint_that_was_cut_off_is_an_error(path, kept):
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content)) if kept == 0.5 else kept])
    with pytest.raises(CheckpointError, match=f"{path} is damaged.*; remove it and build it again"):
        load(path)


def test_a_write_that_the_system_refuses_is_said_and_nothing_is_left(tmp_path):
    """As on a full disk: files may grow to 100 kB, and the model is larger. Torch's own writer hides the reason."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            save(tmp_path / "best.ckpt", "touch_depth", TouchDepth(16), {"width": 16})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
