"""Differences of pictures against closed forms and another library."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose
from torchmetrics.functional.image import structural_similarity_index_measure

from studies.pictures import rms, similarity


def photo(seed: int) -> np.ndarray:
    """A smooth image with noise, (40, 50, 3) uint8."""
    rng = np.random.default_rng(seed)
    row, column, channel = np.ogrid[:40, :50, :3]
    waves = 120 + 60 * np.sin(row / 5 + channel) + 40 * np.cos(column / 7)
    return (waves + rng.normal(0, 12, waves.shape)).clip(0, 255).astype(np.uint8)


def test_similarity_is_that_of_another_library():
    one, other = photo(0), photo(1)
    batches = (torch.from_numpy(image.astype(np.float64)).permute(2, 0, 1)[None] for image in (one, other))
    _, full = structural_similarity_index_measure(*batches, data_range=255.0, return_full_image=True)
    expected = full[0].mean(dim=0).numpy()
    inside = np.s_[6:-6, 6:-6]  # where no window reaches over the border
    assert expected.shape == (40, 50)
    assert_allclose(similarity(one, other)[inside], expected[inside], atol=1e-6)
    assert 0.1 < similarity(one, other).mean() < 0.9


def test_similarity_of_equal_and_of_even_images():
    assert_allclose(similarity(photo(0), photo(0)), 1)
    dark, bright = np.full((2, 20, 20, 3), [[[[50]]], [[[200]]]])
    c1 = (0.01 * 255) ** 2
    assert_allclose(similarity(dark, bright), (2 * 50 * 200 + c1) / (50**2 + 200**2 + c1))


def test_rms_does_not_overflow_bytes():
    assert rms(np.uint8([0, 255]), np.uint8([255, 255])) == pytest.approx(255 / np.sqrt(2))
