"""Training: recipes, packs of data in memory, losses, and the loop."""

from importlib import import_module

# Loaded when they are first asked for: a workflow that only plans waits neither for torch nor for zarr.
ROOMS = {
    "families": ("family", "stages"),
    "recipes": ("modality", "resolve", "settings"),
    "pack": ("Pack", "PackError"),
    "checkpoints": ("CheckpointError", "load", "load_touch_depth"),
    "data": ("Assembler", "Sample", "windows"),
    "learners": ("Diverged", "ReconstructionLearner", "TouchDepthLearner"),
    "loop": ("Machine", "train"),
    "losses": ("Truth", "reconstruction_loss"),
    "touches": ("Touches", "read_touches", "touch_charts"),
}

__all__ = [name for names in ROOMS.values() for name in names]


def __getattr__(name: str):
    for room, names in ROOMS.items():
        if name in names:
            return getattr(import_module(f"palpate.training.{room}"), name)
    raise AttributeError(f"module 'palpate.training' has no attribute {name!r}")
