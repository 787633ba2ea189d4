"""What strategy `implicit` is trained with: signed distances at points around the object, and masks of its image."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from palpate.experiments import Experiment
from palpate.inference.data import ExperimentData
from palpate.inference.inputs import TARGETS
from palpate.inference.samples import Sample
from palpate.models.implicit import MASK, Implicit

MILLIMETRES = 1e3
MASK_WEIGHT = 3.0  # mm of distance, of a nat of the masks


class Target(NamedTuple):
    """Of the samples of a step: points (B, n, 3) m, world; their distances (B, n) m; masks (B, 2, 64, 64) in 0 to 1."""

    points: Tensor
    distances: Tensor
    masks: Tensor


class Targets:
    """The targets of samples: `targets(samples, n, generator)`, at n random points of those that an object has."""

    def __init__(self, data: ExperimentData, experiment: Experiment, device: torch.device):
        self.arrays = {name: torch.from_numpy(data[name]).to(device) for name in TARGETS if name in data}
        self.occluded = experiment.vision == "occluded"

    def __call__(self, samples: Sequence[Sample], n: int, generator: torch.Generator) -> Target:
        arrays, found = self.arrays, []
        for sample in samples:
            chosen = torch.randint(arrays["distance"].shape[1], (n,), generator=generator)
            whole = arrays["unoccluded_mask"][sample.object, sample.view]
            seen = arrays["occluded_mask"][sample.object, sample.grasps[0], sample.view] if self.occluded else whole
            masks = functional.adaptive_avg_pool2d(torch.stack([whole, seen]).float() / 255, MASK)
            found.append((*(arrays[name][sample.object][chosen] for name in ("distance_points", "distance")), masks))
        return Target(*(torch.stack(each) for each in zip(*found, strict=True)))


def implicit_loss(model: Implicit, distances: Tensor, odds: Tensor, target: Target) -> Tensor:
    """(B,) mean difference (mm) of predicted and true distances, and the masks' cross entropy (nats).

    True distances are clamped to the model's `clamp`, beyond which a prediction may be anything on its side of the
    surface. distances, odds: of `Implicit.supervised`, at the target's points.
    """
    true = target.distances.clamp(-model.clamp, model.clamp)
    difference = distances - true
    beyond = (true.abs() == model.clamp) & (difference * true > 0)
    difference = difference.abs().masked_fill(beyond, 0)
    entropy = functional.binary_cross_entropy_with_logits(odds, target.masks, reduction="none").mean(dim=(1, 2, 3))
    return MILLIMETRES / model.relative_size * difference.mean(dim=1) + MASK_WEIGHT * entropy
