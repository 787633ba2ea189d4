"""Training: recipes, the data in memory, losses, and the loop."""

from importlib import import_module

# Public names by module, imported when they are used: planning a workflow waits neither for torch nor for zarr.
LAZY_EXPORTS = {
    "recipes": ("modality", "resolve", "settings"),
    "data": ("TrainingData", "TrainingDataError"),
    "checkpoints": ("CheckpointError", "load", "load_touch_depth"),
    "samples": ("Assembler", "Sample", "windows"),
    "learners": ("Diverged", "ReconstructionLearner", "TouchDepthLearner"),
    "machine": ("Machine",),
    "loop": ("train",),
    "losses": ("Truth", "reconstruction_loss"),
    "touches": ("Touches", "object_charts", "read_touches", "touch_charts"),
}

__all__ = [name for names in LAZY_EXPORTS.values() for name in names]


def __getattr__(name: str):
    for module, names in LAZY_EXPORTS.items():
        if name in names:
            return getattr(import_module(f"palpate.training.{module}"), name)
    raise AttributeError(f"module 'palpate.training' has no attribute {name!r}")
