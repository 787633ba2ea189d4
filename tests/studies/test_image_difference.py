"""Differences of pictures against closed forms and written-out windows."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from studies.image_difference import rms, similarity


def photo(seed: int) -> np.ndarray:
    """A smooth image with noise, (40, 50, 3) uint8."""
    rng = np.random.default_rng(seed)
    row, column, channel = np.ogrid[:40, :50, :3]
    waves = 120 + 60 * np.sin(row / 5 + channel) + 40 * np.cos(column / 7)
    return (waves + rng.normal(0, 12, waves.shape)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("row, column", [(0, 0), (3, 49), (20, 25), (39, 2)])
def test_similarity_of_a_pixel_is_that_of_its_window(row, column):
    """Wang et al. 2004, weighted moments written out; beyond the border the image is mirrored."""
    one, other = photo(0).astype(float), photo(1).astype(float)
    gauss = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    weight = (gauss[:, None] * gauss / gauss.sum() ** 2)[..., None]
    x, y = (
        np.pad(image, ((5, 5), (5, 5), (0, 0)), "symmetric")[row : row + 11, column : column + 11]
        for image in (one, other)
    )
    mx, my = ((weight * window).sum(axis=(0, 1)) for window in (x, y))
    vx, vy, both = (
        (weight * p * q).sum(axis=(0, 1)) for p, q in ((x - mx, x - mx), (y - my, y - my), (x - mx, y - my))
    )
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    expected = (2 * mx * my + c1) * (2 * both + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))
    found = similarity(one.astype(np.uint8), other.astype(np.uint8))
    assert found.shape == (40, 50) and 0.1 < found.mean() < 0.9
    assert_allclose(found[row, column], expected.mean(), atol=1e-12)


def test_similarity_of_equal_and_of_even_images():
    assert_allclose(similarity(photo(0), photo(0)), 1)
    dark, bright = np.full((2, 20, 20, 3), [[[[50]]], [[[200]]]])
    c1 = (0.01 * 255) ** 2
    assert_allclose(similarity(dark, bright), (2 * 50 * 200 + c1) / (50**2 + 200**2 + c1))


def test_rms_does_not_overflow_bytes():
    assert rms(np.uint8([0, 255]), np.uint8([255, 255])) == pytest.approx(255 / np.sqrt(2))
