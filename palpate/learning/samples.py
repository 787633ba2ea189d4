"""The samples of an evaluation, and the batch of tensors that samples make."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData, ExperimentDataError
from palpate.learning.inputs import camera_array, inputs


class Sample(NamedTuple):
    """What a model takes at once: an object, some of its grasps (none if nothing depends on a grasp), a view.

    object: its number in the data. grasps: numbers of its grasps; an occluded image is that of the first. view: number
    of the view, or of the camera, of its image. window: number among the samples of its object, in an evaluation.
    touched: of how many of the grasps, from the first on, the touches are given; None: of all.
    """

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
        raise ExperimentDataError(
            f"{data.source}: {data.grasps} grasps an object, but the experiment needs "
            f"{experiment.grasps}: raise grasps.per_object in the config"
        )
    return min(experiment.grasps, data.grasps)


def windows(data: ExperimentData, experiment: Experiment, *splits: str) -> list[Sample]:
    """The samples that an evaluation on some splits has, object by object.

    Grasps g to g + n - 1, modulo the number of grasps, for every g (once if n is all of them), if the model takes any;
    each with every view, or every camera. The paper leaves open which grasps it measures on.
    """
    n, total = grasps_per_sample(data, experiment), data.grasps
    starts = range(1) if n in (0, total) else range(total)
    choices = [tuple((start + k) % total for k in range(n)) for start in starts]
    views = [(grasps, view) for grasps in choices for view in range(data.images(experiment) or 1)]
    return [
        Sample(number, grasps, view, window)
        for number in data.of_split(*splits)
        for window, (grasps, view) in enumerate(views)
    ]


class Assembler:
    """Batches of samples as `palpate.models.Reconstruction.forward` takes them: `assembler(samples)`.

    The arrays that an experiment takes stay on the device, images as bytes.
    """

    TOUCH_ARRAYS = ("success", "position", "rotation", "charts", "reading")

    def __init__(self, data: ExperimentData, experiment: Experiment, device: torch.device | str = "cpu"):
        self.experiment, self.device = experiment, torch.device(device)
        names = [item.name for item in inputs(experiment) if item.name != "points"]
        self.tensors = {name: torch.from_numpy(data[name]).to(device) for name in names}

    def __call__(self, samples: Sequence[Sample]) -> dict[str, Tensor]:
        objects, grasps, views = (
            torch.tensor([getattr(sample, name) for sample in samples], dtype=torch.int64, device=self.device)
            for name in ("object", "grasps", "view")
        )
        batch = {}
        if self.experiment.has_vision:
            image = (objects, grasps[:, 0], views) if self.experiment.vision == "occluded" else (objects, views)
            batch["camera"] = self.tensors[camera_array(self.experiment)][objects, views]
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
    """Pixels (..., s, s, 3) uint8 as (..., 3, s, s) float32 in [0, 1]; the layout in memory is kept.

    Of four channels the last is opacity: these images are put over white.
    """
    colours = images.movedim(-1, -3).float() / 255
    if colours.shape[-3] == 3:
        return colours
    colours, opacity = colours.split((3, 1), dim=-3)
    return 1 - opacity * (1 - colours)
