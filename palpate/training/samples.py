"""Which samples a model takes in which step of its training."""

from collections.abc import Sequence

import numpy as np

from palpate.experiments import Experiment
from palpate.inference.data import ExperimentData
from palpate.inference.samples import Sample, grasps_per_sample


def spread(samples: Sequence[Sample], per_object: int | None) -> list[Sample]:
    """At most `per_object` samples of each object (None: all), evenly over its windows; these differ by object."""
    by_object: dict[int, list[Sample]] = {}
    for sample in samples:
        by_object.setdefault(sample.object, []).append(sample)
    chosen = []
    for order, windows in enumerate(by_object.values()):
        total = len(windows)
        count = min(per_object or total, total)
        chosen += [windows[k] for k in sorted((order + j * total // count) % total for j in range(count))]
    return chosen


def shuffled(count: int, size: int, seed: int, step: int) -> np.ndarray:
    """(size,) numbers below `count` that step `step` (from 0) takes: each once before any again.

    It depends on nothing but the arguments, so that training can resume at any step.
    """
    first = step * size
    places = np.arange(first, first + size)
    epochs = {int(e): np.random.default_rng([seed, int(e)]).permutation(count) for e in set(places // count)}
    return np.array([epochs[int(place) // count][int(place) % count] for place in places])


def training_samples(data: ExperimentData, experiment: Experiment, size: int, seed: int, step: int) -> list[Sample]:
    """The samples of one training step: objects of the train split in random order, each with a random subset
    of its grasps, in random order, and the image of a random view or camera.

    They depend on nothing but the number of grasps that the experiment takes, so that experiments with the same number
    see the same samples at the same step. An experiment with `fewer_grasps` takes a random number of them, up to its
    own, the same for all samples of a step.
    """
    objects = data.of_split("train")
    n = grasps_per_sample(data, experiment)
    # A stream of its own; `shuffled` seeds its streams with two numbers.
    random = np.random.default_rng([seed, step, 1])
    if n and experiment.fewer_grasps:
        n = int(np.random.default_rng([seed, step, 2]).integers(n)) + 1
    chosen = [objects[place] for place in shuffled(len(objects), size, seed, step)]
    grasps = [tuple(int(g) for g in random.permutation(data.grasps)[:n]) if n else () for _ in chosen]
    images = data.images(experiment)
    views = [int(random.integers(images)) if images else 0 for _ in chosen]  # after all grasps: see above
    return [Sample(*each) for each in zip(chosen, grasps, views, strict=True)]
