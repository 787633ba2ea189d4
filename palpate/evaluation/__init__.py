"""Evaluation: how well models do, in tables beside the paper's values, in figures, and claim by claim."""
