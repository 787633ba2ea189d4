"""Training steps one at a time, without Lightning, whose share is the same for all models."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import torch

from palpate.training.learners import ReconstructionLearner


class TrainingSteps:
    """Steps of a learner that is ready: in `on_fit_start`, or after a training, from where they go on."""

    def __init__(self, learner: ReconstructionLearner, autocast: Callable[[], AbstractContextManager] = nullcontext):
        self.learner, self.autocast = learner, autocast
        learner._rank = lambda: slice(None)  # all samples of a step: one process, and there may be no Trainer
        self.optimiser = learner.configure_optimizers()["optimizer"]

    def __call__(self, number: int) -> float:
        """Make the training step of a number; returns its seconds of processor time."""
        learner, start = self.learner, time.process_time()
        self.optimiser.zero_grad()
        generator = torch.Generator().manual_seed(number)
        with self.autocast():
            loss = learner.losses(learner.training_batch(number), generator, learner.model).mean()
        loss.backward()
        if learner.settings.clip:
            torch.nn.utils.clip_grad_norm_(learner.model.parameters(), learner.settings.clip)
        self.optimiser.step()
        return time.process_time() - start
