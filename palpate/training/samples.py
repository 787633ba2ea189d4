"""Which samples a model takes in which step, and the batch of tensors that they make."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate.training.data import TrainingData, TrainingDataError
from palpate.training.inputs import camera_array, inputs, takes_grasps


class Sample(NamedTuple):
    """What a model takes at once: an object, some of its grasps (none if nothing depends on a grasp), a view.

    Attributes:
        object: its number in the data.
        grasps: numbers of its grasps; an occluded image is that of the first.
        view: number of the view, or of the camera, that its image is of.
        window: number of this sample among those of its object, in an evaluation.
    """

    object: int
    grasps: tuple[int, ...] = ()
    view: int = 0
    window: int = 0


def _grasps_a_sample(data: TrainingData, experiment: Mapping[str, Any]) -> int:
    """How many grasps a sample has: 0 if the model takes none. Raises TrainingDataError if there are fewer."""
    if not takes_grasps(experiment):
        return 0
    if experiment.get("fewer_grasps"):
        return min(experiment["grasps"], data.grasps)
    if experiment["grasps"] > data.grasps:
        raise TrainingDataError(
            f"{data.source}: {data.grasps} grasps an object, but the experiment needs "
            f"{experiment['grasps']}: raise grasps.per_object in the config"
        )
    return experiment["grasps"]


def windows(data: TrainingData, experiment: Mapping[str, Any], *splits: str) -> list[Sample]:
    """The samples that an evaluation on some splits has, object by object.

    Grasps g to g + n - 1, modulo the number of grasps, for every g (once if n is all of them); none for a model that
    takes neither touch nor occluded vision. Each of them with every view, or every camera. The paper leaves open which
    grasps it measures on.
    """
    n, total = _grasps_a_sample(data, experiment), data.grasps
    starts = range(1) if n in (0, total) else range(total)
    of_grasps = [tuple((start + k) % total for k in range(n)) for start in starts]
    of_object = [(grasps, view) for grasps in of_grasps for view in range(data.images(experiment) or 1)]
    return [
        Sample(number, grasps, view, window)
        for number in data.of_split(*splits)
        for window, (grasps, view) in enumerate(of_object)
    ]


def spread(samples: Sequence[Sample], an_object: int | None) -> list[Sample]:
    """At most `an_object` samples of each object (None: all), evenly over its windows; the windows differ by object."""
    by_object: dict[int, list[Sample]] = {}
    for sample in samples:
        by_object.setdefault(sample.object, []).append(sample)
    chosen = []
    for order, of_object in enumerate(by_object.values()):
        count = min(an_object or len(of_object), len(of_object))
        chosen += [
            of_object[k] for k in sorted((order + j * len(of_object) // count) % len(of_object) for j in range(count))
        ]
    return chosen


def shuffled(count: int, size: int, seed: int, step: int) -> np.ndarray:
    """(size,) numbers below `count` that step `step` (from 0) takes: each once before any again.

    It depends on nothing but the arguments, so that training can go on at any step.
    """
    first = step * size
    places = np.arange(first, first + size)
    epochs = {int(e): np.random.default_rng([seed, int(e)]).permutation(count) for e in set(places // count)}
    return np.array([epochs[int(place) // count][int(place) % count] for place in places])


def training_samples(
    data: TrainingData, experiment: Mapping[str, Any], size: int, seed: int, step: int
) -> list[Sample]:
    """The samples of one training step: objects of the train split in random order, each with a random subset
    of its grasps, in random order, and the image of a random view or camera.

    They depend on nothing but the number of grasps that the experiment takes, so that experiments with the same number
    see the same samples at the same step. An experiment with `fewer_grasps` takes a random number of them, up to its
    own, the same for all samples of a step.
    """
    objects = data.of_split("train")
    n = _grasps_a_sample(data, experiment)
    # A stream of its own; `shuffled` seeds its streams with two numbers.
    random = np.random.default_rng([seed, step, 1])
    if n and experiment.get("fewer_grasps"):
        n = int(np.random.default_rng([seed, step, 2]).integers(n)) + 1
    chosen = [objects[place] for place in shuffled(len(objects), size, seed, step)]
    grasps = [tuple(int(g) for g in random.permutation(data.grasps)[:n]) if n else () for _ in chosen]
    images = data.images(experiment)
    views = [int(random.integers(images)) if images else 0 for _ in chosen]  # after all grasps: see above
    return [Sample(*each) for each in zip(chosen, grasps, views, strict=True)]


class Assembler:
    """Batches of samples as tensors. The arrays that an experiment takes stay on the device, images as bytes.

    `assembler(samples)` is what `palpate.models.Reconstruction` takes:

    | key | shape | unit |
    |---|---|---|
    | `image` | (B, 3, s, s) float32 | sRGB in [0, 1] |
    | `camera` | (B, 3, 4) float32 | world, m, to pixels of the image |
    | `success`, `position`, `rotation` | (B, s n), (B, s n, 3), (B, s n, 3, 3) | m, world |
    | `charts` | (B, s n, 81, 3) float32 | m, world |
    | `reading` | (B, s n, 3, r, c) float32 | RGB in [0, 1] |
    """

    IMAGE_ARRAYS = ("unoccluded", "occluded", "views")
    TOUCH_ARRAYS = ("success", "position", "rotation", "charts", "reading")

    def __init__(self, data: TrainingData, experiment: Mapping[str, Any], device: torch.device | str = "cpu"):
        self.device = torch.device(device)
        names = [item.name for item in inputs(experiment) if item.name != "points"]
        self.cameras = camera_array(experiment)
        self.tensors = {name: torch.from_numpy(data[name]).to(device) for name in names}

    def __call__(self, samples: Sequence[Sample]) -> dict[str, Tensor]:
        objects = self._index([sample.object for sample in samples])
        batch = {}
        for name in self.IMAGE_ARRAYS:
            if name in self.tensors:
                batch["image"] = to_colours(self._image(name, objects, samples))
        if self.cameras:
            batch["camera"] = self.tensors[self.cameras][objects, self._index([s.view for s in samples])]
        touch_arrays = [name for name in self.TOUCH_ARRAYS if name in self.tensors]
        if touch_arrays:
            grasps = self._index([sample.grasps for sample in samples])
            for name in touch_arrays:
                batch[name] = self.tensors[name][objects[:, None], grasps].flatten(1, 2)
        if "reading" in batch:
            batch["reading"] = to_colours(batch["reading"])
        return batch

    def _image(self, name: str, objects: Tensor, samples: Sequence[Sample]) -> Tensor:
        views = self._index([sample.view for sample in samples])
        if name == "occluded":
            return self.tensors[name][objects, self._index([sample.grasps[0] for sample in samples]), views]
        return self.tensors[name][objects, views]

    def _index(self, numbers: Sequence) -> Tensor:
        return torch.tensor(numbers, dtype=torch.int64, device=self.device)


def to_colours(images: Tensor) -> Tensor:
    """Pixels (..., s, s, 3) uint8 as (..., 3, s, s) float32 in [0, 1]; the layout in memory is kept.

    Of four channels the last is opacity: these images are put over white.
    """
    colours = images.movedim(-1, -3).float() / 255
    if colours.shape[-3] == 3:
        return colours
    colours, opacity = colours.split((3, 1), dim=-3)
    return 1 - opacity * (1 - colours)
