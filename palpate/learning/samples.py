"""The samples of evaluations and of training steps, and the batch of tensors that samples make."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData, ExperimentDataError
from palpate.learning.inputs import inputs
from palpate.strategies import CAMERAS

WITHOUT_TOUCH = 0.5  # share of steps; with fewer, vision alone learns less (docs/evidence/trials.md)


S = TypeVar("S")


class Sample(NamedTuple):
    """What a model takes at once: an object's number, numbers of its grasps (an occluded image is that of the first),
    and of the view or camera. window: among the samples of its object, in an evaluation. touched: of how many of the
    grasps, from the first on, the touches are given; None: of all."""

    object: int
    grasps: tuple[int, ...] = ()
    view: int = 0
    window: int = 0
    touched: int | None = None


def grasps_per_sample(data: ExperimentData, experiment: Experiment) -> int:
    """How many grasps a sample has: 0 if the model takes none. Raises ExperimentDataError if there are fewer."""
    if not experiment.takes_grasps:
        return 0
    if experiment.grasps > data.grasps and not experiment.fewer_grasps:
        too_few = f"{data.grasps} grasps an object, but the experiment needs {experiment.grasps}"
        raise ExperimentDataError(f"{data.source}: {too_few}: raise grasps.per_object in the config")
    return min(experiment.grasps, data.grasps)


def windows(data: ExperimentData, experiment: Experiment, *splits: str) -> list[Sample]:
    """The samples of an evaluation on some splits, object by object: grasps g to g + n - 1, modulo their number, for
    every g (once if n is all), if the model takes any; each with every view or camera. The paper does not say."""
    n, total = grasps_per_sample(data, experiment), data.grasps
    starts = range(1) if n in (0, total) else range(total)
    choices = [tuple((start + k) % total for k in range(n)) for start in starts]
    views = [(grasps, view) for grasps in choices for view in range(data.images(experiment) or 1)]
    return [
        Sample(number, grasps, view, window)
        for number in data.of_split(*splits)
        for window, (grasps, view) in enumerate(views)
    ]


def spread(samples: Sequence[Sample], per_object: int | None) -> list[Sample]:
    """At most `per_object` samples of each object (None: all), evenly over its windows; these differ by object."""
    chosen = []
    for order, (_, group) in enumerate(groupby(samples, lambda sample: sample.object)):
        windows = list(group)
        total = len(windows)
        count = min(per_object or total, total)
        chosen += [windows[k] for k in sorted((order + j * total // count) % total for j in range(count))]
    return chosen


def in_batches(samples: Sequence[S], size: int) -> list[Sequence[S]]:
    """The samples in order, `size` at a time; the last batch has what is left."""
    return [samples[first : first + size] for first in range(0, len(samples), size)]


def shuffled(count: int, size: int, seed: int | Sequence[int], step: int) -> np.ndarray:
    """(size,) numbers below `count` that step `step` (from 0) takes: each once before any again."""
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    places = range(step * size, (step + 1) * size)
    return np.array([_permutation(count, *seeds, place // count)[place % count] for place in places])


@lru_cache(maxsize=64)  # an epoch's, of each class in `grasps_by_class`
def _permutation(count: int, *seeds: int) -> np.ndarray:
    return np.random.default_rng(seeds).permutation(count)


def grasps_by_class(data: ExperimentData, size: int, seed: int, step: int) -> list[tuple[int, int]]:
    """Objects of the train split and their grasps that a step takes, as the authors' released training takes them. An
    epoch has as many as there are grasps, of each class the same number, each once before any again."""
    objects = data.of_split("train")
    classes = sorted({data.classes[number] for number in objects})
    members = [[number for number in objects if data.classes[number] == name] for name in classes]
    share = -(-len(objects) * data.grasps // len(classes))
    epoch_size, taken = share * len(classes), []
    for place, number in enumerate(shuffled(epoch_size, size, (seed, 4), step), start=step * size):
        stream, of_class = divmod(int(number), share)
        of_class += place // epoch_size * share  # among all that the epochs so far take of this class
        grasps = len(members[stream]) * data.grasps
        grasp = int(shuffled(grasps, 1, (seed, 3, stream), of_class)[0])
        taken.append((members[stream][grasp // data.grasps], grasp % data.grasps))
    return taken


def training_samples(
    data: ExperimentData, experiment: Experiment, size: int, seed: int, step: int, epoch: str = "objects"
) -> list[Sample]:
    """The samples of one training step: objects of the train split in random order, each with random grasps, in random
    order, and a random view or camera. epoch: `objects`, each once; `grasps`, each once, as `grasps_by_class` has them.
    Experiments with the same number of grasps see the same samples. With `fewer_grasps` the touches are of a random
    number of them, the same for all samples of a step; with vision, half of the steps have none."""
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
        chosen = [number for number, _ in pairs]
        drawn = zip(pairs, grasps, strict=True)
        grasps = [(first, *(grasp for grasp in others if grasp != first))[:n] for (_, first), others in drawn]
    images = data.images(experiment)
    # Drawn after all grasps, which are then the same without images.
    views = [int(random.integers(images)) if images else 0 for _ in chosen]
    return [Sample(*what, touched=touched) for what in zip(chosen, grasps, views, strict=True)]


class Assembler:
    """Batches as `palpate.models.Reconstruction.forward` takes them: `assembler(samples)`."""

    TOUCH_ARRAYS = ("success", "position", "rotation", "charts", "reading")

    def __init__(self, data: ExperimentData, experiment: Experiment, device: torch.device | str = "cpu"):
        self.experiment, self.device = experiment, torch.device(device)
        names = [item.name for item in inputs(experiment) if item.name != "points"]
        self.tensors = {name: torch.from_numpy(data[name]).to(device) for name in names}

    def __call__(self, samples: Sequence[Sample]) -> dict[str, Tensor]:
        objects, grasps, views = (
            torch.tensor(numbers, dtype=torch.int64, device=self.device)
            for numbers in zip(*((sample.object, sample.grasps, sample.view) for sample in samples), strict=True)
        )
        batch = {}
        if self.experiment.has_vision:
            image = (objects, grasps[:, 0], views) if self.experiment.vision == "occluded" else (objects, views)
            batch["camera"] = self.tensors[CAMERAS[self.experiment.vision]][objects, views]
            if self.experiment.takes_masks:
                masks = {"mask": f"{self.experiment.vision}_silhouette", "hand": "hand_silhouette"}
                batch |= {key: self.tensors[name][image] for key, name in masks.items() if name in self.tensors}
                batch["camera_number"] = views
            if self.experiment.plan.takes_images:
                batch["image"] = to_colours(self.tensors[self.experiment.vision][image])
        for name in self.TOUCH_ARRAYS:
            if name in self.tensors:
                batch[name] = self.tensors[name][objects[:, None], grasps[:, : samples[0].touched]].flatten(1, 2)
        if "reading" in batch:
            batch["reading"] = to_colours(batch["reading"])
        return batch


def to_colours(images: Tensor) -> Tensor:
    """Pixels (..., s, s, 3) uint8 as (..., 3, s, s) float32 in [0, 1]; the layout in memory is kept. Of four channels
    the last is opacity: these images are put over white."""
    colours = images.movedim(-1, -3).float() / 255
    if colours.shape[-3] == 3:
        return colours
    colours, opacity = colours.split((3, 1), dim=-3)
    return 1 - opacity * (1 - colours)
