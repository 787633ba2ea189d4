"""Pictures of a run's objects, and how far two of them are apart."""

from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from palpate import store
from palpate.hand import Hand
from studies.subjects import Subject

# Of Wang et al., Image Quality Assessment: From Error Visibility to Structural Similarity (2004).
WINDOW = 11  # pixels
SIGMA = 1.5  # pixels
K1, K2 = 0.01, 0.03
LARGEST = 255.0  # grey level


def held(run: Path, subject: Subject) -> tuple[Hand, np.ndarray]:
    """The hand of a run, and the poses of its links in the grasps of an object: (g, L, 4, 4)."""
    arrays = store.read(run / "grasps" / f"{subject.batch}.h5")
    row = arrays["object"].tolist().index(subject.name)
    return Hand.from_arrays(arrays, prefix="hand/"), arrays["link_pose"][row]


def rms(one: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference of grey levels or colours, arrays of one shape."""
    return float(np.sqrt(np.mean((np.asarray(one, dtype=float) - other) ** 2)))


def similarity(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Structural similarity of two 8-bit images (h, w, c) at every pixel, the mean of the channels: (h, w).

    Wang et al. 2004: Gaussian windows of 11 x 11 pixels and 1.5 of deviation; beyond the border the image is
    mirrored.
    """
    x, y = np.asarray(one, dtype=float), np.asarray(other, dtype=float)

    def mean(values: np.ndarray) -> np.ndarray:
        return gaussian_filter(values, (SIGMA, SIGMA, 0), radius=(WINDOW // 2, WINDOW // 2, 0))

    c1, c2 = (K1 * LARGEST) ** 2, (K2 * LARGEST) ** 2
    mx, my = mean(x), mean(y)
    vx, vy, cov = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    of_channels = (2 * mx * my + c1) * (2 * cov + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2))
    return of_channels.mean(axis=-1)
