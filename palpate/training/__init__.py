"""Training: recipes, packs of data in memory, losses, and the loop. Recipes and packs need no torch."""

from importlib import import_module

from palpate.training.pack import Pack, PackError
from palpate.training.recipes import family, modality, resolve, settings

# Loaded when they are first asked for: a workflow that only plans must not wait for torch.
LATER = {
    "checkpoints": ("CheckpointError", "load", "load_touch_depth"),
    "data": ("Assembler", "Sample", "windows"),
    "learners": ("Diverged", "ReconstructionLearner", "TouchDepthLearner"),
    "loop": ("Machine", "train"),
    "losses": ("Truth", "reconstruction_loss"),
    "touches": ("Touches", "read_touches", "touch_charts"),
}

__all__ = [
    "Pack",
    "PackError",
    "family",
    "modality",
    "resolve",
    "settings",
    "CheckpointError",
    "load",
    "load_touch_depth",
    "Assembler",
    "Sample",
    "windows",
    "Diverged",
    "ReconstructionLearner",
    "TouchDepthLearner",
    "Machine",
    "train",
    "Truth",
    "reconstruction_loss",
    "Touches",
    "read_touches",
    "touch_charts",
]


def __getattr__(name: str):
    for room, names in LATER.items():
        if name in names:
            return getattr(import_module(f"palpate.training.{room}"), name)
    raise AttributeError(f"module 'palpate.training' has no attribute {name!r}")
