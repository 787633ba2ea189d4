"""A picture of images that a run holds: objects side by side, alone and below in their first grasp.

    python -m studies.benchmarks.images_picture results/demo random.png bottle-0000 knife-0000
    python -m studies.benchmarks.images_picture results/default vision.png bottle-0002 --rows grasps
    python -m studies.benchmarks.images_picture results/default views.png bottle-0002 --rows views

With `--rows grasps` a row an object: alone, its grasps, mask and depth of the first one. With `--rows views` ten views.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from palpate.dataset import Dataset, ObjectRecord

GAP = 6  # pixels, white
VIEWS = 10
FARTHEST = 2.0  # m, as white in a picture of depth


def grey(image: np.ndarray) -> np.ndarray:
    """An image (h, w) in 0..1 as (h, w, 3) uint8."""
    return np.repeat((255 * np.clip(image, 0, 1)).astype(np.uint8)[..., None], 3, axis=2)


def grasps(record: ObjectRecord) -> list[np.ndarray]:
    """An object alone, its grasps, and mask and depth of the first one."""
    first = record.grasps[0]
    drawn = [grey(first.occluded_mask > 0), grey(first.occluded_depth.astype(float) / FARTHEST)]
    return [record.unoccluded, *(grasp.occluded for grasp in record.grasps), *drawn]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("objects", nargs="+")
    parser.add_argument("--rows", choices=["objects", "grasps", "views"], default="objects")
    parser.add_argument("--width", type=int, help="pixels of the picture, at most")
    asked = parser.parse_args()
    records = list(Dataset(asked.run).select(asked.objects))
    if asked.rows == "grasps":
        rows = [grasps(record) for record in records]
    elif asked.rows == "views":
        rows = [list(record.image[:VIEWS]) for record in records]
    else:
        rows = [[record.unoccluded for record in records], [record.grasps[0].occluded for record in records]]
    framed = [[np.pad(image, ((0, GAP), (0, GAP), (0, 0)), constant_values=255) for image in row] for row in rows]
    picture = Image.fromarray(np.concatenate([np.concatenate(row, axis=1) for row in framed]))
    if asked.width:
        picture.thumbnail((asked.width, picture.height), Image.Resampling.LANCZOS)
    picture.save(asked.output, optimize=True)


if __name__ == "__main__":
    main()
