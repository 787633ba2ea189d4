"""Differences of two images: root mean square and structural similarity."""

import numpy as np

# Of Wang et al., Image Quality Assessment: From Error Visibility to Structural Similarity (2004).
WINDOW = 11  # pixels
SIGMA = 1.5  # pixels
GREY_RANGE = 255.0  # grey level


def rms(image: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference of grey levels or colours, arrays of one shape."""
    return float(np.sqrt(np.mean((np.asarray(image, dtype=float) - other) ** 2)))


def similarity(image: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Structural similarity of two 8-bit images (h, w, c) at every pixel, the mean of the channels: (h, w).

    Wang et al. 2004: Gaussian windows of 11 x 11 pixels and 1.5 of deviation; beyond the border the image is
    mirrored.
    """
    import torch  # here: most studies do without it
    from torchmetrics.functional.image import structural_similarity_index_measure

    edge = WINDOW // 2
    padded = (
        np.pad(image.astype(float), [(edge, edge), (edge, edge), (0, 0)], "symmetric") for image in (image, other)
    )
    _, similarity_map = structural_similarity_index_measure(
        *(torch.from_numpy(image).permute(2, 0, 1)[None] for image in padded),
        sigma=SIGMA,
        data_range=GREY_RANGE,
        return_full_image=True,
    )
    return similarity_map[0, :, edge:-edge, edge:-edge].mean(dim=0).numpy()
