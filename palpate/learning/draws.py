"""Which samples a model takes in which step of its training."""

from collections.abc import Sequence

import numpy as np

from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.samples import Sample, grasps_per_sample

WITHOUT_TOUCH = 0.5  # share of steps; with fewer, vision alone learns less (docs/evidence/trials.md)


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


def shuffled(count: int, size: int, seed: int | Sequence[int], step: int) -> np.ndarray:
    """(size,) numbers below `count` that step `step` (from 0) takes: each once before any again.

    It depends on nothing but the arguments, so that training can resume at any step.
    """
    first = step * size
    places = np.arange(first, first + size)
    seeds = np.atleast_1d(seed)
    epochs = {int(e): np.random.default_rng([*seeds, int(e)]).permutation(count) for e in set(places // count)}
    return np.array([epochs[int(place) // count][int(place) % count] for place in places])


def grasps_by_class(data: ExperimentData, size: int, seed: int, step: int) -> list[tuple[int, int]]:
    """Objects of the train split and their grasps that a step takes, as the authors' released training takes them.

    An epoch has as many as there are grasps, of each class the same number, each once before any again.
    """
    objects = data.of_split("train")
    classes = sorted({data.classes[each] for each in objects})
    members = [[each for each in objects if data.classes[each] == name] for name in classes]
    share = -(-len(objects) * data.grasps // len(classes))
    taken, epochs = [], {}
    for place in range(step * size, (step + 1) * size):
        epoch, here = divmod(place, share * len(classes))
        if epoch not in epochs:
            pairs = [
                (each[k // data.grasps], int(k % data.grasps))
                for stream, each in enumerate(members)
                for k in shuffled(len(each) * data.grasps, share, (seed, 3, stream), epoch)
            ]
            epochs[epoch] = [pairs[k] for k in np.random.default_rng([seed, 4, epoch]).permutation(len(pairs))]
        taken.append(epochs[epoch][here])
    return taken


def training_samples(
    data: ExperimentData, experiment: Experiment, size: int, seed: int, step: int, epoch: str = "objects"
) -> list[Sample]:
    """The samples of one training step: objects of the train split in random order, each with a random subset
    of its grasps, in random order, and the image of a random view or camera.

    epoch: `objects`, each once; `grasps`, each once if the experiment takes any, as `grasps_by_class` has them.

    They depend on nothing but the number of grasps that the experiment takes, so that experiments with the same number
    see the same samples at the same step. An experiment with `fewer_grasps` gets the touches of a random number of
    them, up to its own, the same for all samples of a step; with vision, half of the steps have none.
    """
    objects = data.of_split("train")
    n = grasps_per_sample(data, experiment)
    # A stream of its own; `shuffled` seeds its streams with two numbers.
    random = np.random.default_rng([seed, step, 1])
    touched = None
    if experiment.fewer_grasps:
        draw = np.random.default_rng([seed, step, 2])
        without = experiment.fewest_grasps == 0 and draw.random() < WITHOUT_TOUCH
        touched = 0 if without else int(draw.integers(1, n + 1))
    chosen = [objects[place] for place in shuffled(len(objects), size, seed, step)]
    grasps = [tuple(int(g) for g in random.permutation(data.grasps)[:n]) if n else () for _ in chosen]
    if n and epoch == "grasps":
        pairs = grasps_by_class(data, size, seed, step)
        chosen = [each for each, _ in pairs]
        grasps = [(first, *(g for g in some if g != first))[:n] for (_, first), some in zip(pairs, grasps, strict=True)]
    images = data.images(experiment)
    views = [int(random.integers(images)) if images else 0 for _ in chosen]  # after all grasps: see above
    return [Sample(*each, touched=touched) for each in zip(chosen, grasps, views, strict=True)]
