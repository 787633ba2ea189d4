"""What training, evaluation and `palpate.reconstruct` share: arrays in memory, samples, batches, and trained models."""
