"""Evaluation: errors of trained models' predictions; and `palpate.reconstruct`."""
