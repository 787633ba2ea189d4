"""A picture of images that a run holds: objects side by side, alone and below in their first grasp.

    python -m studies.benchmarks.images_picture results/demo random.png bottle-0000 knife-0000

docs/images/random.png is of the run that docs/vision.md describes.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from palpate.dataset import Dataset

GAP = 6  # pixels, white


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("objects", nargs="+")
    asked = parser.parse_args()
    records = list(Dataset(asked.run).select(asked.objects))
    rows = [[record.unoccluded for record in records], [record.grasps[0].occluded for record in records]]
    framed = [[np.pad(image, ((0, GAP), (0, GAP), (0, 0)), constant_values=255) for image in row] for row in rows]
    Image.fromarray(np.concatenate([np.concatenate(row, axis=1) for row in framed])).save(asked.output, optimize=True)


if __name__ == "__main__":
    main()
