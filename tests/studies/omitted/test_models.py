"""What is left out of models and packs changes nothing."""

import csv
import itertools

import numpy as np
import pytest
import torch

from palpate import scene, store
from palpate.training import families, pack
from palpate.training.checkpoints import build
from palpate.training.data import Assembler, training_samples, windows
from studies.omitted.models import (
    BOTH,
    DATA,
    FEELS,
    PARTS,
    SEES,
    SPHERE,
    difference,
    predicted,
    widened,
)
from tests.models.batches import SMALL, random_batch

NO_COPY, NO_COMM = (BOTH | {"strategy": strategy} for strategy in ("no_copy", "no_comm"))
VIEWS, OCCLUDED = SEES | {"vision": "views"}, BOTH | {"vision": "occluded"}
EXPERIMENTS = (SEES, FEELS, FEELS | {"grasps": 2}, BOTH, SPHERE, NO_COPY, NO_COMM, VIEWS, OCCLUDED)
SPARE = "spare touch charts"
EXACT = 1e-12  # m, in double precision


def left_out():
    """Experiments, and parts of their models that they leave out; None for all at once."""
    found = [(experiment, None) for experiment in EXPERIMENTS]
    for experiment, part in itertools.product(EXPERIMENTS, ("image encoder", "reading encoder", SPARE)):
        # Without touch there is no reading to encode, whatever the plan says.
        unread = part == "reading encoder" and not experiment["touch"]
        if not unread and not scene.plan("experiment", **experiment).needs(part):
            found.append((experiment, part))
    return found


@pytest.mark.parametrize(("experiment", "part"), left_out())
def test_a_part_of_the_model_without_weight_changes_no_vertex(experiment, part):
    plan = scene.plan("experiment", **experiment)
    torch.manual_seed(1)
    less = build(experiment, SMALL).double().eval()
    more = build(experiment, SMALL, plan.including(*[part] if part else [])).double().eval()
    sizes = [sum(tensor.numel() for tensor in (*model.parameters(), *model.buffers())) for model in (less, more)]
    assert sizes[0] < sizes[1]
    batch = random_batch(2, experiment["grasps"], seed=3)
    one, other = (predicted(model, batch) for model in (widened(less, more), less))
    assert difference(one, other) <= EXACT
    moved = other.tensors["vertices"][:, : len(less.start)] - less.start
    assert moved.norm(dim=2).mean() > 0.01


def test_a_part_with_weight_changes_vertices():
    """The comparison would see it."""
    plan = scene.plan("experiment", **FEELS).including("image encoder")
    torch.manual_seed(1)
    less, more = build(FEELS, SMALL).double().eval(), build(FEELS, SMALL, plan).double().eval()
    batch = random_batch(2, 1, seed=3)
    widened(less, more)
    with torch.no_grad():
        more.gcn.layers[0].weight[0] += 0.1
    assert difference(predicted(more, batch), predicted(less, batch)) > 1e-6


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Stores of three objects, with random values, and their catalogue."""
    folder = tmp_path_factory.mktemp("run")
    random = np.random.default_rng(0)
    names = ["a-0", "a-1", "a-2"]
    sizes = {"o": 3, "g": 2, "n": 7, "r": 3, "rr": 9, "p": 5, "v": 2, "q": 4}
    for stage in ("surface", "touch", "charts", "vision", "views"):
        arrays = {}
        for name, spec in store.CONTRACT[stage].arrays.items():
            shape = [axis if isinstance(axis, int) else sizes[axis] for axis in spec.shape]
            values = random.integers(0, 2 if spec.dtype == "bool" else 200, shape)
            values = values / 256 if spec.dtype.startswith("float") else values
            arrays[name] = values.astype("U8" if spec.dtype == "string" else spec.dtype)
        arrays["object"] = np.array(names)
        path = folder / store.CONTRACT[stage].path("batch-0000")
        store.write(path, stage, arrays, {"seed": 0, "config_digest": "0"})
    with (folder / "catalogue.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("object", "class", "split"), *((name, "a", "train") for name in names)])
    return folder


def packed(run, folder, experiment, plan):
    family = families.family(experiment)
    stores = {stage: [run / store.CONTRACT[stage].path("batch-0000")] for stage in families.stages(family, plan)}
    pack.write(folder / "pack.h5", family, run / "catalogue.csv", stores, plan)
    return pack.Pack.read(folder / "pack.h5")


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_a_pack_with_everything_in_gives_the_same_samples_in_the_same_order(run, tmp_path, experiment):
    plan = scene.plan("experiment", **experiment)
    less, more = (packed(run, tmp_path, experiment, each) for each in (plan, plan.including()))
    assert set(less.arrays) < set(more.arrays)
    assert windows(less, experiment, "train") == windows(more, experiment, "train")
    for step in range(5):
        samples = training_samples(less, experiment, 2, 0, step)
        assert samples == training_samples(more, experiment, 2, 0, step)
        one, other = Assembler(less)(samples), Assembler(more)(samples)
        assert one.keys() == other.keys()
        assert all(torch.equal(one[key], other[key]) for key in one)


def test_the_report_puts_back_only_what_is_left_out_and_every_part_somewhere():
    parts = set()
    for part, experiment, _ in itertools.chain(DATA, PARTS):
        plan = scene.plan("experiment", **experiment)
        assert not plan.needs(part)
        parts.add(part)
    assert parts == set(scene.SCENES["experiment"])
