"""Evaluation: how far predictions of trained models are from the truth; and `palpate.reconstruct`."""
