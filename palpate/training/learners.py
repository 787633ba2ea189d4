"""Trainings as Lightning modules: the loss of a step, and that of the validation.

Lightning's batch is only the number of a step, or of a validation batch; the module takes the samples from memory
itself. All random numbers of a step follow from the seed and the step's number, so that an interrupted training
resumes without any difference.
"""

import copy
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import lightning.pytorch as lightning
import torch
from torch import Tensor

from palpate.charts.atlas import radius_around
from palpate.experiments import Experiment
from palpate.inference import checkpoints
from palpate.inference.data import ExperimentData, ExperimentDataError
from palpate.inference.samples import Assembler, grasps_per_sample, windows
from palpate.inference.touches import touched
from palpate.models import TouchDepth
from palpate.models.reconstruction import HAND_SENSORS
from palpate.training.implicit import Targets, implicit_loss
from palpate.training.losses import Truth, cloud_loss, moving_charts_loss, touch_depth_loss
from palpate.training.recipes import ReconstructionSettings, Settings, TouchDepthSettings
from palpate.training.samples import shuffled, spread, training_samples
from palpate.training.single_image import LOSSES
from palpate.training.touches import Touches

log = logging.getLogger(__name__)

WARM_UP = 0.1  # share of the steps in which the schedule one_cycle rises to the highest rate
FIRST, LAST = 0.04, 1e-4  # of the highest rate: where it begins and ends
SPIKE = 1000  # a gradient this many times as large as any before gets a warning
VALIDATION_SEED = 1  # the same points in every validation of every model, so that their losses compare


class Diverged(RuntimeError):
    """A prediction, the loss, or its gradient is NaN or infinite; the message names the sample."""


class Learner(lightning.LightningModule):
    """A model and how it is trained.

    Subclasses define `kind` (of their checkpoints), `training_batch(step)` (the samples of this process in a step),
    `sample_names(batch_samples)` (for messages), `losses(batch_samples, generator, model, validation=False)` (B,), and
    `described()` (what a checkpoint states of the model besides its weights).

    model: to be trained. settings: of the recipe. seed: of the order of samples and of points. samples: number of
    training samples. validation_samples: those of a validation, in order.

    Attributes: eval_model, of validation and checkpoint: `model`, or its moving average; steps, number of training
    steps; validation_interval, steps between validations.
    """

    def __init__(
        self, model: torch.nn.Module, settings: Settings, seed: int, samples: int, validation_samples: Sequence
    ):
        super().__init__()
        self.model, self.settings, self.seed = model, settings, seed
        self.averaged = copy.deepcopy(model).requires_grad_(False) if settings.ema else None
        self.validation_samples = validation_samples
        epoch_steps = -(-samples // settings.batch)
        limits = [settings.steps, settings.epochs and settings.epochs * epoch_steps]
        self.steps = min(limit for limit in limits if limit)
        self.validation_interval = min(settings.evaluate_every or epoch_steps, self.steps)
        self.largest_norm = 0.0  # norm of a gradient in this process

    @property
    def eval_model(self) -> torch.nn.Module:
        return self.model if self.averaged is None else self.averaged

    def stated(self) -> dict[str, Any]:
        """What checkpoint and summary state of the model and its training, besides the weights."""
        return {"kind": self.kind, **self.described(), "settings": self.settings.row(), "seed": self.seed}

    def train_dataloader(self) -> range:
        """Numbers of the steps up to the next validation, which are Lightning's epoch."""
        first = self.trainer.current_epoch * self.validation_interval
        return range(first, min(first + self.validation_interval, self.steps))

    def val_dataloader(self) -> range:
        """Numbers of the validation batches, each of as many samples as a step."""
        return range(-(-len(self.validation_samples) // self.settings.batch))

    def configure_optimizers(self) -> dict[str, Any]:
        kind = {"adam": torch.optim.Adam, "adamw": torch.optim.AdamW}[self.settings.optimiser]
        # One pass over all weights on a CPU; a GPU has its own way, and Lightning refuses it in mixed precision.
        fused = (self.device.type == "cpu" and not (self._trainer and "mixed" in self.trainer.precision)) or None
        rate, decay = self.settings.rate, self.settings.weight_decay
        optimiser = kind(self.model.parameters(), lr=rate, weight_decay=decay, fused=fused)
        if self.settings.schedule == "constant":
            return {"optimizer": optimiser}
        # The rate reaches `LAST` after the last step, hence one more; torch's rise ends a step before its share.
        scheduler = torch.optim.lr_scheduler.OneCycleLR(
            optimiser,
            rate,
            total_steps=self.steps + 1,
            pct_start=(WARM_UP * self.steps + 1) / (self.steps + 1),
            div_factor=1 / FIRST,
            final_div_factor=FIRST / LAST,
            cycle_momentum=False,
        )
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def training_step(self, step: int, _: int) -> Tensor:
        batch_samples = self.training_batch(step)
        self.current_step = f"step {step}: {self.sample_names(batch_samples)}"
        losses = self.losses(batch_samples, self._generator(self.seed, step), self.model)
        self.check_finite("the loss", losses, batch_samples, f"step {step}")
        return losses.mean()

    def on_before_optimizer_step(self, _: torch.optim.Optimizer) -> None:
        # One such gradient would turn every weight into NaN. In float16 Lightning looks itself: it lowers the
        # loss's scale and leaves out the step.
        if self.trainer.precision == "16-mixed":
            return
        gradients = [weights.grad for weights in self.model.parameters() if weights.grad is not None]
        norm = float(torch.nn.utils.get_total_norm(gradients))
        if not math.isfinite(norm):
            raise Diverged(f"the gradient is NaN or infinite in {self.current_step}")
        if not self.settings.clip and norm > SPIKE * self.largest_norm > 0:
            text = "the gradient is %.0f times as large as any before in %s; the optimiser's averages stay off for "
            text += "thousands of steps: look at the sample, or clip the gradient (config training.override)"
            log.warning(text, norm / self.largest_norm, self.current_step)
        self.largest_norm = max(self.largest_norm, norm)

    def on_train_batch_end(self, *_: Any) -> None:
        if self.averaged is None:
            return
        # A short memory at first, so that the random first weights are forgotten.
        decay = min(self.settings.ema, self.global_step / (self.global_step + 10))
        states = self.averaged.state_dict().values(), self.model.state_dict().values()
        for average, value in zip(*states, strict=True):
            if average.is_floating_point():
                average.lerp_(value, 1 - decay)
            else:
                average.copy_(value)

    def on_validation_epoch_start(self) -> None:
        self._validation: list[Tensor] = []

    def validation_step(self, number: int, _: int) -> None:
        first = number * self.settings.batch
        samples = self.validation_samples[first : first + self.settings.batch][self._rank()]
        losses = self.losses(samples, self._generator(VALIDATION_SEED, number), self.eval_model, True)
        self.check_finite("the loss", losses, samples, "the validation")
        self._validation.append(losses.detach().double())

    def on_validation_epoch_end(self) -> None:
        losses = torch.cat(self._validation)
        total = torch.stack([losses.sum(), losses.new_tensor(float(len(losses)))])
        total = self.all_gather(total).reshape(-1, 2).sum(dim=0)
        self.log("validation_loss", total[0] / total[1])  # in double precision

    def check_finite(self, what: str, values: Tensor, batch_samples: Any, where: str = "") -> None:
        """Raises Diverged, naming the first sample of a batch whose values (B, ...) are not finite."""
        is_finite = torch.isfinite(values.detach()).flatten(1).all(dim=1) if values.ndim > 1 else values.isfinite()
        if not is_finite.all():
            first = int((~is_finite).nonzero()[0])
            sample = f"{where}, " * bool(where) + self.sample_names(batch_samples[first : first + 1])
            raise Diverged(f"{what} is NaN or infinite: {sample}")

    def _rank(self) -> slice:
        """This process's share of a list of samples; there is a process for each GPU."""
        return slice(self.global_rank, None, self.trainer.world_size)

    def _generator(self, seed: int, step: int) -> torch.Generator:
        number = ((seed << 32) + step) * 64 + self.global_rank
        return torch.Generator().manual_seed(number % (1 << 63))


class ReconstructionLearner(Learner):
    """Trains reconstruction on the objects of the train split, for one experiment.

    data: of the train and validation splits. extra_loss: from the model and its predictions (B, ...) to a term (B,) of
    a training step's loss (`studies/surface_terms.py`); its `repr` is stated by the checkpoint. Raises
    ExperimentDataError if a split has no object.
    """

    kind = "reconstruction"

    def __init__(
        self,
        data: ExperimentData,
        experiment: Experiment,
        settings: ReconstructionSettings,
        seed: int,
        extra_loss: Callable[[torch.nn.Module, Tensor], Tensor] | None = None,
    ):
        self.data, self.experiment, self.extra_loss = data, experiment, extra_loss
        self.architecture = settings.architecture
        if data.largest is not None:
            self.architecture = replace(self.architecture, radius=radius_around(data.largest))
        train = data.of_split("train")
        validation_samples = spread(windows(data, experiment, "validation"), settings.validation_samples)
        if experiment.fewer_grasps:  # batch by batch another number of touched grasps
            counts = range(experiment.fewest_grasps, grasps_per_sample(data, experiment) + 1)
            validation_samples = [
                sample._replace(touched=counts[k // settings.batch % len(counts)])
                for k, sample in enumerate(validation_samples)
            ]
        for split, number in {"train": len(train), "validation": len(validation_samples)}.items():
            if not number:
                raise ExperimentDataError(f"{data.source}: no object of the {split} split: more objects are needed")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            hand_sensors = data.hand_sensors or HAND_SENSORS
            model = checkpoints.build(experiment, self.architecture, hand_sensors, data.sensor)
        by_grasp = settings.epoch == "grasps" and experiment.takes_grasps
        super().__init__(model, settings, seed, len(train) * (data.grasps if by_grasp else 1), validation_samples)

    def on_fit_start(self) -> None:
        self.assemble = Assembler(self.data, self.experiment, self.device)
        points = torch.from_numpy(self.data["points"]).to(self.device)
        self.truth = Truth(points.to(next(self.model.parameters()).dtype))
        if self.experiment.strategy == "implicit":
            self.targets = Targets(self.data, self.experiment, self.device, self.truth.points.dtype)

    def training_batch(self, step):
        settings = self.settings
        samples = training_samples(self.data, self.experiment, settings.batch, self.seed, step, settings.epoch)
        return samples[self._rank()]

    def sample_names(self, batch_samples):
        names = self.data.objects
        return ", ".join(f"{names[each.object]} grasps {list(each.grasps)} view {each.view}" for each in batch_samples)

    def losses(self, batch_samples, generator, model, validation=False):
        if not batch_samples:
            return torch.empty(0, device=self.device)
        dtype = self.truth.points.dtype
        batch = self.assemble(batch_samples)
        batch = {key: values.to(dtype) if values.is_floating_point() else values for key, values in batch.items()}
        if self.experiment.strategy == "implicit" and not validation:
            target = self.targets(batch_samples, self.settings.loss_points, generator)
            return implicit_loss(model, *model.supervised(batch, target.points), target)
        loss = None if validation else LOSSES.get(self.experiment.strategy, moving_charts_loss)
        predictions = model.stages(batch) if loss else [model(batch)]
        for prediction in predictions:
            self.check_finite("the prediction", prediction, batch_samples)
        points = self.settings.validation_points if validation else self.settings.loss_points
        against = self.truth, [sample.object for sample in batch_samples], points, generator
        with torch.autocast(self.device.type, enabled=False):
            if loss:
                found = loss(model, predictions, *against)
                return found + self.extra_loss(model, predictions[-1].to(dtype)) if self.extra_loss else found
            return cloud_loss(model.sample(predictions[-1].to(dtype), points, generator), *against)

    def described(self):
        camera = self.data.common_camera(self.experiment)
        described = {
            "experiment": self.experiment.row(),
            "architecture": self.architecture.row(),
            "data": self.data.digest,
            # What an image is taken to be of that comes without its camera.
            "camera": None if camera is None else camera.tolist(),
            "image_size": self.data.image_size(self.experiment),
        }
        if self.experiment.touch:
            described |= {"hand_sensors": self.model.hand_sensors, "sensor": self.model.sensor.description()}
        return described | ({"extra_loss": repr(self.extra_loss)} if self.extra_loss else {})


class TouchDepthLearner(Learner):
    """Trains the U-Net on the successful touches of the train split: depth from readings."""

    kind = "touch_depth"

    def __init__(self, train: Touches, validation: Touches, settings: TouchDepthSettings, seed: int):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = TouchDepth(settings.width, train.sensor)
        count = min(settings.validation_samples or len(validation), len(validation))
        # Evenly, not the first: touches come object by object.
        chosen = torch.arange(count) * len(validation) // count
        self.touches = {"train": train, "validation": validation}
        super().__init__(model, settings, seed, len(train), chosen.numpy())

    def on_fit_start(self) -> None:
        self.on_device = {
            name: Touches(*(tensor.to(self.device) for tensor in touches[:3]), touches.sensor)
            for name, touches in self.touches.items()
        }

    def training_batch(self, step):
        return shuffled(len(self.touches["train"]), self.settings.batch, self.seed, step)[self._rank()]

    def sample_names(self, batch_samples):
        return "touches " + ", ".join(str(int(row)) for row in batch_samples)

    def losses(self, batch_samples, generator, model, validation=False):
        if not len(batch_samples):
            return torch.empty(0, device=self.device)
        touches = self.on_device["validation" if validation else "train"]
        rows = torch.as_tensor(batch_samples, device=self.device)
        dtype = next(model.parameters()).dtype
        reading, empty = touches.reading[rows].to(dtype) / 255, touches.empty.to(dtype) / 255
        depth = model(reading)
        self.check_finite("the prediction", depth, batch_samples)
        with torch.autocast(self.device.type, enabled=False):
            valid, true = touched(reading, empty), touches.depth[rows].to(dtype)
            n = self.settings.loss_points
            return touch_depth_loss(depth.to(dtype), valid, true, n, generator, touches.sensor.size)

    def described(self):
        return {"width": self.settings.width, "sensor": self.model.sensor.description()}
