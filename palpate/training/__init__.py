"""Training: recipes, the data in memory, losses, and the loop."""

from palpate.lazy import lazy_exports

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

__all__, __getattr__ = lazy_exports(__name__, LAZY_EXPORTS)
