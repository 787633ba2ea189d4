"""Models trained, applied and measured: their arrays, samples, recipes, losses, checkpoints, predictions and errors."""
