"""Training steps one at a time, without the loop around them, whose share is the same for all models."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import torch

from palpate.learning.learners import ReconstructionLearner


class TrainingSteps:
    """Steps of a learner that has begun, from where it is."""

    def __init__(self, learner: ReconstructionLearner, autocast: Callable[[], AbstractContextManager] = nullcontext):
        self.learner, self.autocast = learner, autocast
        self.optimiser, _ = learner.optimiser(learner.device)

    def __call__(self, number: int) -> float:
        """Make the training step of a number; returns its seconds of processor time."""
        learner, start = self.learner, time.process_time()
        self.optimiser.zero_grad()
        with self.autocast():
            loss = learner(number)
        loss.backward()
        if learner.settings.clip:
            torch.nn.utils.clip_grad_norm_(learner.model.parameters(), learner.settings.clip)
        self.optimiser.step()
        return time.process_time() - start
