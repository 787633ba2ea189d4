"""The page of a calibration: real and simulated images of a sensor, and their difference, side by side."""

from pathlib import Path

import numpy as np

from palpate.touch.calibration import AROUND, Calibration
from palpate.viewer.html import data_uri, render, resource

SIZE = 320  # pixels of an image, at most


def calibration_page(path: Path, calibration: Calibration) -> None:
    """Write the page of a calibration, one HTML file; images that were left out of the fit come first."""
    left_out, rows = ~calibration.fitted, []
    for number in np.argsort(calibration.fitted, kind="stable"):
        real, simulated = calibration.real[number], calibration.simulated[number]
        difference = np.clip(128 + simulated.astype(int) - real, 0, 255).astype(np.uint8)
        images = {"real": real, "simulated": simulated, "difference": difference}
        rows.append({
            "name": calibration.indentations[number].image.name,
            "fitted": calibration.fitted[number],
            "error": calibration.error[number],
            "untouched": calibration.untouched_error[number],
            "images": {caption: data_uri(image, SIZE) for caption, image in images.items()},
        })  # fmt: skip
    render(
        path,
        "calibration.html.jinja",
        name=calibration.sensor.name,
        around=AROUND,
        measured=int(left_out.sum()),
        error=calibration.error[left_out].mean(),
        untouched=calibration.untouched_error[left_out].mean(),
        noise=calibration.noise[left_out].mean(),
        rows=rows,
        style=resource("viewer.css"),
    )
