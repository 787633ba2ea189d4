"""Readings of real sensors, simulated: the elastic gel beside a rigid cap, Taxim's filter and the untouched image.

python -m studies.real_readings taxim-1.4.1-py3-none-any.whl real.png

The wheel (MIT; github.com/Robo-Touch/Taxim), or the folder that it was unpacked to, has 48 images of a GelSight and 24
of a GelSight Mini with a ball of 4 mm (the Mini's is assumed), circles drawn by hand, and an untouched image each.
Nothing is downloaded. Every second image fits the lights or the table of colours, anew for each geometry; the others
measure.
"""

import argparse
import tempfile
import time
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from palpate import sensor as sensors
from palpate.touch.calibration import WIDEST, Calibration, Indentation, calibrate, offsets, press_indenter

SENSORS = {"GelSight": "gelsight", "GelSight Mini": "gelsight_mini"}
PIXEL, SHAPE = 0.0295e-3, (480, 640)  # m and pixels of Taxim's images (taxim/calib/*/params.json)
BALL = 0.002  # m, radius: `ball_radius = 4.00/2` in Taxim's Basics/sensorParams.py
SENSOR = replace(  # of both; a pixel's edge is four of the images'
    sensors.load("gelsight_mini"), resolution=(120, 160), height=SHAPE[0] * PIXEL, width=SHAPE[1] * PIXEL, gel_size=None
)
# Taxim's filter as a share of the image's width and height (params.json: deform_pyramid_sigma_rel), and its contact.
PYRAMID = (0.04765625, 0.02421875, 0.0125, 0.00546875, 0.003125, 0.00171875)
LAST, HELD = 0.003125, 0.4
SHOWN = 3  # images of each sensor in the picture


def unpack(source: Path, folder: Path) -> None:
    """Folders of `palpate calibrate` by the names of `SENSORS`, from the wheel or its unpacked folder."""
    for name in SENSORS.values():
        (folder / name).mkdir()
        inside = f"taxim/calib/{name}/dataPack.npz"
        if source.is_dir():
            pack = np.load(source / inside, allow_pickle=True)
        else:
            with zipfile.ZipFile(source) as wheel:
                pack = np.load(wheel.extract(inside, folder), allow_pickle=True)
        save_image(pack["f0"], folder / name / "untouched.bmp")
        lines = ["image,row,column,radius"]
        for number, (image, centre, radius) in enumerate(
            zip(pack["imgs"], pack["touch_center"], pack["touch_radius"], strict=True)
        ):
            save_image(image, folder / name / f"{number:03d}.bmp")
            lines.append(f"{number:03d}.bmp,{centre[1]},{centre[0]},{radius}")
        (folder / name / "circles_by_hand.csv").write_text("\n".join(lines))


def save_image(image: np.ndarray, path: Path) -> None:
    Image.fromarray(np.ascontiguousarray(image[..., ::-1])).save(path)  # the pack has blue first, as OpenCV


@cache
def elastic(indentation: Indentation) -> tuple[np.ndarray, float]:
    """The face (r, c), m, and the contact's radius, m, of `press_indenter`."""
    return press_indenter(indentation, SENSOR)


@cache
def cap(indentation: Indentation) -> tuple[np.ndarray, float]:
    """In their place: the ball's cap over its circle, as Taxim has it; flat around it."""
    away = np.hypot(*offsets(indentation, SENSOR))
    radius = min(indentation.radius * np.sqrt(np.prod(SENSOR.pixel)), WIDEST * BALL)
    height = np.sqrt(np.maximum(BALL**2 - away**2, 0)) - np.sqrt(BALL**2 - radius**2)
    return np.maximum(height, 0), radius


@cache
def taxim(indentation: Indentation) -> tuple[np.ndarray, float]:
    """In their place: that cap after Taxim's pyramid of Gaussian filters (taxim_torch.py)."""
    rigid, radius = cap(indentation)
    held, height = rigid > HELD * rigid.max(), rigid
    for share in PYRAMID:
        height = np.where(held, rigid, gaussian_filter(height, share * SENSOR.resolution[1], mode="mirror"))
    return gaussian_filter(height, LAST * SENSOR.resolution[1], mode="mirror"), radius


GEOMETRIES = {"rigid cap": cap, "Taxim's filter": taxim, "elastic layer": elastic}


def measure(folder: Path, by_hand: bool, table: bool) -> list[Calibration]:
    """The calibrations of a folder by each of `GEOMETRIES`."""
    circles = folder / "circles_by_hand.csv" if by_hand else None
    return [
        calibrate(folder, SENSOR, BALL, circles, table, lambda indentation, _, made=made: made(indentation))
        for made in GEOMETRIES.values()
    ]


def picture(found: list[Calibration]) -> Image.Image:
    """Rows of images that were left out, evenly: real, simulated and difference, two sensors side by side."""
    columns = []
    for calibrated in found:
        left_out = np.flatnonzero(~calibrated.fitted)
        for number in left_out[np.linspace(0, len(left_out) - 1, SHOWN).astype(int)]:
            real, simulated = calibrated.real[number], calibrated.simulated[number]
            difference = np.clip(128 + simulated.astype(int) - real, 0, 255).astype(np.uint8)
            columns.append(np.concatenate([real, simulated, difference]))
    return Image.fromarray(np.concatenate(columns, axis=1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="the wheel taxim 1.4.1, or the folder it was unpacked to")
    parser.add_argument("picture", type=Path, help="of real and simulated images, .png")
    args = parser.parse_args()
    print(f"| sensor | circles | untouched; noise | colours | {' | '.join(GEOMETRIES)} |")
    print("|---|---|---|---|---|---|---|")
    shown, began = [], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        unpack(args.source, Path(folder))
        for name, below in SENSORS.items():
            for circles, colours in ((a, b) for a in ("by hand", "found") for b in ("lights", "table")):
                fits = measure(Path(folder, below), circles == "by hand", colours == "table")
                kept = ~fits[0].fitted
                still = f"{fits[0].untouched_error[kept].mean():.2f}; {fits[0].noise[kept].mean():.2f}"
                errors = " | ".join(f"{fit.error[kept].mean():.2f}" for fit in fits)
                print(f"| {name} | {circles} | {still} | {colours} | {errors} |", flush=True)
            shown.append(fits[-1])
    print(f"{time.perf_counter() - began:.0f} s")
    picture(shown).save(args.picture, optimize=True)


if __name__ == "__main__":
    main()
