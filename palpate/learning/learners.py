"""What a training does in a step, and in a validation. All random numbers follow from the seed and the step's number,
so that an interrupted training resumes without any difference."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, cast

import torch
from torch import Tensor, nn
from torch.optim.lr_scheduler import LambdaLR, LRScheduler, OneCycleLR

from palpate.charts.atlas import radius_around
from palpate.experiments import Experiment
from palpate.learning import checkpoints
from palpate.learning.data import ExperimentData, ExperimentDataError
from palpate.learning.recipes import ReconstructionSettings, Settings, TouchDepthSettings
from palpate.learning.samples import (
    Assembler,
    Sample,
    grasps_per_sample,
    in_batches,
    shuffled,
    spread,
    training_samples,
    windows,
)
from palpate.learning.touch_charts import TouchReadings, touch_depth_loss, touched
from palpate.models import Reconstruction, SingleImageModel, TouchDepth
from palpate.models.losses import Target, Truth, cloud_loss
from palpate.models.reconstruction import HAND_SENSORS
from palpate.models.templates import LEAST_FITS, Templates, is_touched, shrunk

WARM_UP = 0.1  # share of the steps in which the schedule one_cycle rises to the highest rate
FIRST, LAST = 0.04, 1e-4  # of the highest rate: where it begins and ends
KEPT_STARTS = 4096  # samples whose starts are kept: 90 MB
VALIDATION_SEED = 1  # the same points in every validation of every model, so that their losses compare


class Diverged(RuntimeError):
    """A prediction, the loss or its gradient is not finite (names the sample), or no gradient reaches the network."""


class Learner(nn.Module, ABC):
    """A model and how it is trained: `learner(step)` is the loss of a training step. seed: of the order of samples and
    of points. samples: number of training samples. steps: of training; validation_interval: between validations; rank,
    processes: of those that share a batch, one a GPU; step: begun last; kind: of checkpoints; choices: shape of a
    sample's losses in a validation, by the values that it chooses among; () if it chooses nothing."""

    kind: ClassVar[str]
    model: nn.Module
    settings: Settings

    def __init__(self, model: nn.Module, settings: Settings, seed: int, samples: int, validation_batches: Sequence):
        super().__init__()
        self.model, self.settings, self.seed = model, settings, seed
        self.validation_batches: Sequence[Sequence] = validation_batches
        epoch_steps = -(-samples // settings.batch)
        limits = [settings.steps, settings.epochs and settings.epochs * epoch_steps]
        self.steps = min(limit for limit in limits if limit)
        self.validation_interval = min(settings.evaluate_every or epoch_steps, self.steps)
        self.rank, self.processes, self.step = 0, 1, -1
        self.choices: tuple[int, ...] = ()

    @abstractmethod
    def training_batch(self, step: int) -> Sequence:
        """The samples of a training step."""

    @abstractmethod
    def sample_names(self, batch_samples: Sequence) -> str:
        """What samples are called in messages."""

    @abstractmethod
    def losses(self, batch_samples: Sequence, generator: torch.Generator, validation: bool = False) -> Tensor:
        """The losses (B,) of some samples, at least one; in a validation as `validation_losses`. Raises Diverged if a
        prediction is not finite."""

    @abstractmethod
    def described(self) -> dict[str, Any]:
        """What a checkpoint states of the model besides its weights."""

    @property
    def device(self) -> torch.device:
        return next(self.model.parameters()).device

    def begin(self, rank: int = 0, processes: int = 1) -> None:
        """Takes the data to the model's device; to be called before the first step."""
        self.rank, self.processes = rank, processes

    def stated(self) -> dict[str, Any]:
        """What checkpoint and summary state of the model and its training, besides the weights."""
        return {"kind": self.kind, **self.described(), "settings": self.settings.row(), "seed": self.seed}

    def optimiser(self, device: torch.device) -> tuple[torch.optim.Optimizer, LRScheduler]:
        """Adam, and the schedule of its rate, for a training on a device."""
        # One pass over all weights on a CPU; a GPU has its own way.
        fused = device.type == "cpu" or None
        rate = self.settings.rate
        optimiser = torch.optim.Adam(self.model.parameters(), lr=rate, fused=fused)
        if self.settings.schedule == "constant":
            return optimiser, LambdaLR(optimiser, lambda step: 1.0)
        # The rate reaches `LAST` after the last step, hence one more; torch's rise ends a step before its share.
        return optimiser, OneCycleLR(
            optimiser,
            rate,
            total_steps=self.steps + 1,
            pct_start=(WARM_UP * self.steps + 1) / (self.steps + 1),
            div_factor=1 / FIRST,
            final_div_factor=FIRST / LAST,
            cycle_momentum=False,
        )

    def forward(self, step: int) -> Tensor:
        """The mean loss of a training step. Raises Diverged if it is not finite."""
        self.step, batch_samples = step, self._share(self.training_batch(step))
        return self._finite_losses(batch_samples, self.seed, step, f"step {step}").mean()

    def validation_losses(self) -> Tensor:
        """The losses (n, *choices) float64 of this process's share of the validation samples."""
        losses = [torch.empty(0, *self.choices, device=self.device)]
        for number, batch_samples in enumerate(self.validation_batches):
            part = self._share(batch_samples)
            losses.append(self._finite_losses(part, VALIDATION_SEED, number, "the validation", validation=True))
        return torch.cat(losses).double()

    def choose(self, losses: Tensor) -> Tensor:
        """Takes what has the least of the mean losses (*choices) of a validation; returns that loss."""
        return losses

    def _finite_losses(
        self, batch_samples: Sequence, seed: int, step: int, where: str, validation: bool = False
    ) -> Tensor:
        """The losses (B,), or (B, *choices), of a process's share of samples, which may have none."""
        if not len(batch_samples):
            return torch.empty(0, *self.choices if validation else (), device=self.device)
        number = ((seed << 32) + step) * 64 + self.rank
        losses = self.losses(batch_samples, torch.Generator().manual_seed(number % (1 << 63)), validation)
        self.check_finite("the loss", losses, batch_samples, where)
        return losses

    def step_name(self) -> str:
        """The step that was begun last, for messages."""
        return f"step {self.step}: {self.sample_names(self._share(self.training_batch(self.step)))}"

    def check_finite(self, what: str, values: Tensor, batch_samples: Sequence, where: str = "") -> None:
        """Raises Diverged, naming the first sample of a batch whose values (B, ...) are not finite."""
        is_finite = torch.isfinite(values.detach()).flatten(1).all(dim=1) if values.ndim > 1 else values.isfinite()
        if not is_finite.all():
            first = int((~is_finite).nonzero()[0])
            sample = f"{where}, " * bool(where) + self.sample_names(batch_samples[first : first + 1])
            raise Diverged(f"{what} is NaN or infinite: {sample}")

    def _share(self, batch_samples: Sequence) -> Sequence:
        return batch_samples[self.rank :: self.processes]


class ReconstructionLearner(Learner):
    """Trains reconstruction on the objects of the train split, for one experiment. data: of the train and validation
    splits. Raises ExperimentDataError if a split has no object."""

    kind = "reconstruction"
    model: Reconstruction | SingleImageModel
    settings: ReconstructionSettings

    def __init__(self, data: ExperimentData, experiment: Experiment, settings: ReconstructionSettings, seed: int):
        architecture = settings.architecture
        if data.largest is not None:
            architecture = replace(architecture, radius=radius_around(data.largest))
        train = data.of_split("train")
        validation_samples = spread(windows(data, experiment, "validation"), settings.validation_samples)
        batches = in_batches(validation_samples, settings.batch)
        if experiment.fewer_grasps:  # every object by the fewest, by one and by all
            counts = sorted({experiment.fewest_grasps, 1, grasps_per_sample(data, experiment)})
            batches = [[sample._replace(touched=n) for sample in part] for n in counts for part in batches]
        for split, number in {"train": len(train), "validation": len(validation_samples)}.items():
            if not number:
                raise ExperimentDataError(f"{data.source}: no object of the {split} split: more objects are needed")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            hand_sensors = data.hand_sensors or HAND_SENSORS
            templates, name = None, "unoccluded_silhouette"
            if experiment.plan.start == "templates":
                masks = shrunk(torch.from_numpy(data[name][train])) if name in data else None
                templates = Templates(torch.from_numpy(data["template"][train]), masks)
            model = checkpoints.build(experiment, architecture, hand_sensors, data.sensor, templates)
        by_grasp = settings.epoch == "grasps" and experiment.takes_grasps
        super().__init__(model, settings, seed, len(train) * (data.grasps if by_grasp else 1), batches)
        self.data, self.experiment = data, experiment
        self.choices = (2, len(LEAST_FITS)) if templates else ()  # without touched points, and with
        self.template = {number: place for place, number in enumerate(train)}

    def begin(self, rank: int = 0, processes: int = 1) -> None:
        super().begin(rank, processes)
        self.assemble = Assembler(self.data, self.experiment, self.device)
        self.truth = Truth(torch.from_numpy(self.data["points"]).to(self.device))
        self.starts: dict[tuple[Sample, ...], Tensor] = {}

    def training_batch(self, step: int) -> list[Sample]:
        settings = self.settings
        return training_samples(self.data, self.experiment, settings.batch, self.seed, step, settings.epoch)

    def sample_names(self, batch_samples: Sequence[Sample]) -> str:
        return ", ".join(
            f"{self.data.objects[sample.object]} grasps {list(sample.grasps)} view {sample.view}"
            for sample in batch_samples
        )

    def losses(self, batch_samples: Sequence[Sample], generator: torch.Generator, validation: bool = False) -> Tensor:
        """The network's own loss; in a validation the Chamfer distance of what it predicts, of a model with templates
        by each of `LEAST_FITS`, and 0 by those that are not of the sample."""
        model, batch = self.model, self.assemble(batch_samples)
        if self.experiment.plan.start == "templates":  # an object is no template of its own
            batch["excluded"] = torch.tensor([self.template.get(sample.object, -1) for sample in batch_samples])
            batch["start"] = self._start(batch_samples, batch)
        alternatives = model.alternatives if isinstance(model, Reconstruction) else lambda batch: [model(batch)]
        predictions = alternatives(batch) if validation else model.stages(batch)
        for prediction in predictions:
            self.check_finite("the prediction", prediction, batch_samples)
        points = self.settings.validation_points if validation else self.settings.loss_points
        target = Target(self.truth, [sample.object for sample in batch_samples], points, generator)
        with torch.autocast(self.device.type, enabled=False):
            if not validation:
                return model.loss(predictions, target)
            state, losses = generator.get_state(), []
            for prediction in predictions:  # at the same random points
                generator.set_state(state)
                losses.append(cloud_loss(model.sample(prediction.float(), batch, points, generator), target))
            if not self.choices:
                return losses[0]
            begun, other = (each[:, None] for each in losses)
            fit = cast(Templates, model.templates).fit(batch)[:, None]
            by_fit = torch.where(fit >= LEAST_FITS.to(self.device), begun, other)
            touched = is_touched(batch, len(fit)).to(self.device)
            return torch.stack([~touched, touched], dim=1)[:, :, None] * by_fit[:, None]

    def choose(self, losses: Tensor) -> Tensor:
        if not self.choices:
            return losses
        # If no validation sample is touched, or all are, both values are the best one of the samples that there are.
        measured = torch.where(losses.any(dim=1, keepdim=True), losses, losses.sum(dim=0))
        cast(Templates, self.model.templates).least_fit.copy_(LEAST_FITS[measured.argmin(dim=1).cpu()])
        return losses.amin(dim=1).sum()

    def _start(self, batch_samples: Sequence[Sample], batch: Mapping[str, Tensor]) -> Tensor:
        """The start (1824, B, 3) m of samples and their batch, which has no weights in it: once of the same inputs."""
        shown = int(self.experiment.vision == "occluded")  # grasps whose images are inputs
        taken = [None if sample.touched is None else sample.touched or shown for sample in batch_samples]
        inputs = tuple(each._replace(grasps=each.grasps[:n]) for each, n in zip(batch_samples, taken, strict=True))
        start = self.starts[inputs] if inputs in self.starts else cast(Templates, self.model.templates)(batch)
        if len(self.starts) * len(inputs) < KEPT_STARTS:
            self.starts[inputs] = start
        return start

    def described(self) -> dict[str, Any]:
        camera = self.data.common_camera(self.experiment)
        described = {
            "experiment": self.experiment.row(),
            "architecture": self.model.architecture.row(),
            "data": self.data.digest,
            # What an image is taken to be of that comes without its camera.
            "camera": None if camera is None else camera.tolist(),
            "image_size": self.data.image_size(self.experiment),
        }
        if self.experiment.touch:
            described |= {"hand_sensors": self.model.hand_sensors, "sensor": self.model.sensor.description()}
        return described


class TouchDepthLearner(Learner):
    """Trains the U-Net on the successful touches of the train split: depth from readings."""

    kind = "touch_depth"
    model: TouchDepth
    settings: TouchDepthSettings

    def __init__(self, train: TouchReadings, validation: TouchReadings, settings: TouchDepthSettings, seed: int):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = TouchDepth(settings.width, train.sensor)
        count = min(settings.validation_samples or len(validation), len(validation))
        # Evenly, not the first: touches come object by object.
        chosen = torch.arange(count) * len(validation) // count
        super().__init__(model, settings, seed, len(train), in_batches(chosen.tolist(), settings.batch))
        self.touches = {"train": train, "validation": validation}

    def begin(self, rank: int = 0, processes: int = 1) -> None:
        super().begin(rank, processes)
        self.on_device = {name: touches.to(self.device) for name, touches in self.touches.items()}

    def training_batch(self, step: int) -> list[int]:
        return shuffled(len(self.touches["train"]), self.settings.batch, self.seed, step).tolist()

    def sample_names(self, batch_samples: Sequence[int]) -> str:
        return "touches " + ", ".join(map(str, batch_samples))

    def losses(self, batch_samples: Sequence[int], generator: torch.Generator, validation: bool = False) -> Tensor:
        touches = self.on_device["validation" if validation else "train"]
        rows = torch.as_tensor(batch_samples, device=self.device)
        reading, empty = touches.reading[rows].float() / 255, touches.empty.float() / 255
        depth = self.model(reading)
        self.check_finite("the prediction", depth, batch_samples)
        with torch.autocast(self.device.type, enabled=False):
            valid, n = touched(reading, empty), self.settings.loss_points
            return touch_depth_loss(depth.float(), valid, touches.depth[rows], n, generator, touches.sensor.size)

    def described(self) -> dict[str, Any]:
        return {"width": self.settings.width, "sensor": self.model.sensor.description()}
