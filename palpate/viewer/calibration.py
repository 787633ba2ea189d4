"""The page of a calibration: real and simulated images of a sensor, and their difference, side by side."""

from pathlib import Path

import numpy as np

from palpate.touch.calibration import AROUND, Calibration
from palpate.viewer.html import data_uri, render, resource

SIZE = 320  # pixels of an image, at most


def calibration_page(path: Path, found: Calibration) -> None:
    """Write the page of a calibration, one HTML file; images that were left out of the fit come first."""
    differences = np.clip(128 + found.simulated.astype(int) - found.real, 0, 255).astype(np.uint8)
    stacks = {"real": found.real, "simulated": found.simulated, "difference": differences}
    images = {caption: [data_uri(image, SIZE) for image in stack] for caption, stack in stacks.items()}
    values = {"images": images, "order": np.argsort(found.fitted, kind="stable"), "left_out": ~found.fitted}
    render(path, "calibration.html.jinja", found=found, around=AROUND, style=resource("viewer.css"), **values)
