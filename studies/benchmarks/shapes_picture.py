"""The contact sheet of the procedural classes in the docs: `python -m studies.benchmarks.shapes_picture <path.png>`."""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from palpate.vision import Renderer, paper_camera  # Blender: before anything that loads embree

from palpate.mesh import DIAGONAL  # isort: skip
from palpate.scene import Scene  # isort: skip
from palpate.shapes import CLASSES, make  # isort: skip

COLUMNS = 12
# Rendered this much larger than a cell, then cut to what the row shows and shrunk.
ENLARGED = 3
GAP = 6  # pixels between cells
# Of these columns' phones the back is shown: camera bumps.
FROM_BEHIND = (6, 8)


def contact_sheet(path: Path | str, first: int = 0, columns: int = COLUMNS, size: int = 160, seed: int = 0) -> None:
    """Render `columns` consecutive objects of each class, one row a class, as the dataset's camera sees them.

    size: width of a cell in pixels.
    """
    renderer, camera = Renderer(threads=2), paper_camera(ENLARGED * size)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for class_name in CLASSES:
            images = []
            for index in range(first, first + columns):
                made = Path(folder) / f"{class_name}-{index:04d}"
                made.mkdir()
                scene = make(class_name, index, seed)
                if class_name == "cellphone" and index - first in FROM_BEHIND:
                    scene.apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0]))
                (made / "visual.glb").write_bytes(normalised(scene).export(file_type="glb"))
                images.append(renderer.render(Scene(made, camera=camera))[0])
            rows.append(row(images, size))
    Image.fromarray(np.concatenate(rows)).save(path, optimize=True)


def row(images: list, width: int) -> np.ndarray:
    """Images side by side, all cut to the window that every object fits in, shrunk to a width in pixels."""
    shown = np.any([image.mask > 0 for image in images], axis=0)
    top, bottom = np.flatnonzero(shown.any(axis=1))[[0, -1]]
    left, right = np.flatnonzero(shown.any(axis=0))[[0, -1]]
    scale = (width - GAP) / max(right - left, bottom - top)
    shape = round((right - left) * scale), round((bottom - top) * scale)
    cells = []
    for image in images:
        cut = Image.fromarray(image.rgb).crop((left, top, right + 1, bottom + 1))
        cell = Image.new("RGB", (width, shape[1] + 2 * GAP), "white")
        cell.paste(cut.resize(shape, Image.Resampling.LANCZOS), ((width - shape[0]) // 2, GAP))
        cells.append(np.asarray(cell))
    return np.concatenate(cells, axis=1)


def normalised(scene):
    """The scene with its bounding box around the origin and the dataset's diagonal."""
    low, high = scene.bounds
    scene.apply_translation(-(low + high) / 2)
    scene.apply_scale(DIAGONAL / np.linalg.norm(high - low))
    return scene


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    contact_sheet(parser.parse_args().path)
