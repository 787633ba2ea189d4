"""Pictures of the docs.

python -m studies.pictures shapes docs/images/shapes.png        the procedural classes, a row each
python -m studies.pictures sensors docs/images/sensors.png      what each shipped sensor reads at the same places
python -m studies.pictures gel docs/images/gel.png              readings of a gel that is pressed with rising force
python -m studies.pictures images random.png results/demo bottle-0000 knife-0000    images that a run holds:
    --rows objects    objects side by side, alone and below in their first grasp
    --rows grasps     a row an object: alone, its grasps, mask and depth of the first one
    --rows views      a row an object: ten of its views
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from palpate.vision import Renderer, paper_camera  # Blender: before anything that loads embree

import trimesh  # isort: skip

from palpate import sensor as sensors  # isort: skip
from palpate.dataset import Dataset, ObjectRecord  # isort: skip
from palpate.mesh import DIAGONAL  # isort: skip
from palpate.results.page import FAINT, LABEL, TITLE, new_figure, save, styled  # isort: skip
from palpate.scene import Scene  # isort: skip
from palpate.shapes import CLASSES, make  # isort: skip
from palpate.touch import RayCaster, empty_reading, face_sensor, press_sensor, sense  # isort: skip

GAP = 6  # pixels between images, white
COLUMNS, CELL = 12, 160  # of the picture of shapes: objects a row, and the width of each in pixels
ENLARGED = 3  # shapes are rendered this much larger than a cell, then cut to what the row shows and shrunk
FROM_BEHIND = (6, 8)  # the columns whose phones show their backs, with camera bumps
PRESSED = ("rifle", 3)  # the procedural object that sensors touch
PLACES, CANDIDATES = 3, 300  # places that are drawn, of points of the surface
MOST = 0.7  # share of the DIGIT in contact at these places: the rest shows what a soft gel does at an edge
AHEAD = 0.0225  # m from the sensor plane to the surface: 2.5 mm into a gel at 25 mm
FORCES = (0.2, 1.0, 5.0)  # N
READING, MARGIN, HEAD, SIDE = 1.7, 0.06, 0.62, 0.3  # inches
VIEWS, FARTHEST = 10, 2.0  # views in a row; m, white in a picture of depth


def normalised(class_name: str, index: int) -> trimesh.Scene:
    """A procedural object with its bounding box around the origin and the dataset's diagonal."""
    scene = make(class_name, index, 0)
    low, high = scene.bounds
    scene.apply_translation(-(low + high) / 2)
    scene.apply_scale(DIAGONAL / np.linalg.norm(high - low))
    return scene


def shapes() -> Image.Image:
    """The first objects of each procedural class, as the dataset's camera sees them."""
    renderer, camera, rows = Renderer(threads=2), paper_camera(ENLARGED * CELL), []
    with tempfile.TemporaryDirectory() as folder:
        for class_name in CLASSES:
            images = []
            for index in range(COLUMNS):
                made = Path(folder) / f"{class_name}-{index:04d}"
                made.mkdir()
                scene = normalised(class_name, index)
                if class_name == "cellphone" and index in FROM_BEHIND:
                    scene.apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0]))
                (made / "visual.glb").write_bytes(scene.export(file_type="glb"))
                images.append(renderer.render(Scene(made, camera=camera))[0])
            rows.append(_cut_row(images, CELL))
    return Image.fromarray(np.concatenate(rows))


def _cut_row(images: list, width: int) -> np.ndarray:
    """Images side by side, all cut to the window that every object fits in, shrunk to a width in pixels."""
    shown = np.any([image.mask > 0 for image in images], axis=0)
    (top, bottom), (left, right) = (np.flatnonzero(shown.any(axis=axis))[[0, -1]] for axis in (1, 0))
    scale = (width - GAP) / max(right - left, bottom - top)
    shape, cells = (round((right - left) * scale), round((bottom - top) * scale)), []
    for image in images:
        cut = Image.fromarray(image.rgb).crop((left, top, right + 1, bottom + 1))
        cell = Image.new("RGB", (width, shape[1] + 2 * GAP), "white")
        cell.paste(cut.resize(shape, Image.Resampling.LANCZOS), ((width - shape[0]) // 2, GAP))
        cells.append(np.asarray(cell))
    return np.concatenate(cells, axis=1)


def looking_at_surface(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Positions (k, 3) and rotations (k, 3, 3) of sensors that look straight at points of the surface."""
    points, faces = trimesh.sample.sample_surface(mesh, CANDIDATES, seed=0)
    into = -mesh.face_normals[faces]
    down = np.cross(into, np.eye(3)[np.abs(into).argmin(axis=1)])
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    return points - AHEAD * into, np.stack([into, np.cross(down, into), down], axis=2)


@styled
def draw_sensors(path: Path) -> None:
    """A column a shipped sensor, and the DIGIT with a soft gel: its empty reading, then places with much to see."""
    kinds = {name: sensors.load(name) for name in sensors.shipped()}
    digit = kinds.pop("digit")
    soft = replace(digit, smoothing=kinds["gelsight_mini"].smoothing)
    kinds = {"digit": digit, "digit, Taxim's smoothing": soft, **kinds}
    mesh = normalised(*PRESSED).to_geometry()
    position, rotation = looking_at_surface(mesh)
    sensed = sense(RayCaster(mesh), position, rotation)
    touched = np.isfinite(sensed.depth).mean(axis=(1, 2))
    relief = np.where(touched < MOST, sensed.reading.std(axis=(1, 2)).mean(axis=1), 0)
    # The highest of every third, so that the places differ.
    places = [int(part[relief[part].argmax()]) for part in np.array_split(np.arange(CANDIDATES), PLACES)]
    rows = ["untouched", *(f"place {number + 1}" for number in range(PLACES))]
    width, height = SIDE + len(kinds) * (READING + MARGIN), HEAD + len(rows) * (READING + MARGIN)
    figure = new_figure(width, height)
    centred = {"ha": "center", "va": "center"}
    for column, (name, kind) in enumerate(kinds.items()):
        left = SIDE + column * (READING + MARGIN)
        sensed = sense(RayCaster(mesh, sensor=kind), position[places], rotation[places])
        edges = " x ".join(f"{1e3 * edge:.4g}" for edge in sorted({kind.width, kind.height}, reverse=True))
        words, middle = "{} mm, {} x {} pixels".format(edges, *kind.resolution), (left + READING / 2) / width
        figure.text(middle, 1 - 0.2 / height, name, fontsize=TITLE, **centred)
        figure.text(middle, 1 - 0.45 / height, words, fontsize=LABEL, color=FAINT, **centred)
        for row, reading in enumerate([empty_reading(kind), *sensed.reading]):
            bottom = 1 - (HEAD + row * (READING + MARGIN) + READING) / height
            axes = figure.add_axes((left / width, bottom, READING / width, READING / height))
            axes.imshow(reading, interpolation="nearest", aspect=kind.pixel[0] / kind.pixel[1])
            axes.set_axis_off()
    for row, name in enumerate(rows):
        middle = HEAD + row * (READING + MARGIN) + READING / 2
        figure.text(0.15 / width, 1 - middle / height, name, fontsize=LABEL, rotation=90, **centred)
    save(figure, path)


@styled
def draw_gel(path: Path) -> None:
    """Readings of one place of an object: not pressed, pressed with `FORCES`, and the pressures; two sensors."""
    mesh = normalised(*PRESSED).to_geometry()
    position, rotation = looking_at_surface(mesh)
    digit = sensors.load("digit")
    depths = RayCaster(mesh, sensor=face_sensor(digit)).trace(position[::3], rotation[::3])
    pressed = [press_sensor(depth, digit, FORCES[1]) for depth in depths]
    # Of the places whose contact the image shows, that with the most to see.
    relief = [each["indentation"].std() * (each["inside"] > 0.99) for each in pressed]
    at = slice(3 * int(np.argmax(relief)), 3 * int(np.argmax(relief)) + 1)
    names, columns = ("digit", "gelsight_mini"), ("not pressed", *(f"{force:g} N" for force in FORCES))
    width = SIDE + len(columns) * (READING + MARGIN)
    height = HEAD / 2 + 2 * len(names) * (READING + MARGIN)
    figure = new_figure(width, height)
    for row, name in enumerate(names):
        kind = replace(sensors.load(name), markers={"rows": 8, "columns": 10} if row else None)
        depth = RayCaster(mesh, sensor=face_sensor(kind)).trace(position[at], rotation[at])[0]
        readings = [press_sensor(depth, kind, force) for force in FORCES]
        flat = sense(RayCaster(mesh, sensor=kind), position[at], rotation[at]).reading[0]
        pressures = [None, *(1e-3 * each["pressure"] for each in readings)]
        images = [[flat, *(each["reading"] for each in readings)], pressures]
        for below, of_row in enumerate(images):
            bottom = 1 - (HEAD / 2 + (2 * row + below + 1) * (READING + MARGIN)) / height
            words = name if below == 0 else "pressure"
            figure.text(0.15 / width, bottom + READING / 2 / height, words, rotation=90, ha="center", va="center")
            for column, image in enumerate(of_row):
                if image is None:
                    continue
                left = SIDE + column * (READING + MARGIN)
                axes = figure.add_axes((left / width, bottom, READING / width, READING / height))
                most = np.percentile(image[image > 0], 99) if below and (image > 0).any() else None
                axes.imshow(image, cmap="magma", vmax=most, aspect=kind.pixel[0] / kind.pixel[1])
                axes.set_axis_off()
                if below:
                    axes.set_title(f"to {most or 0:.0f} kPa", fontsize=LABEL, y=0.02, color="white")
                elif not row:
                    axes.set_title(columns[column], fontsize=TITLE)
    save(figure, path)


def _grey(image: np.ndarray) -> np.ndarray:
    """An image (h, w) in 0..1 as (h, w, 3) uint8."""
    return np.repeat((255 * np.clip(image, 0, 1)).astype(np.uint8)[..., None], 3, axis=2)


def _with_grasps(record: ObjectRecord) -> list[np.ndarray]:
    first = record.grasps[0]
    drawn = [_grey(first.occluded_mask > 0), _grey(first.occluded_depth.astype(float) / FARTHEST)]
    return [record.unoccluded, *(grasp.occluded for grasp in record.grasps), *drawn]


def images(run: Path, objects: Sequence[str], rows: str = "objects", width: int | None = None) -> Image.Image:
    """Images of a run, as the module's docstring has them; width: at most, in pixels."""
    records = list(Dataset(run).select(objects))
    grid = {
        "objects": lambda: [
            [record.unoccluded for record in records],
            [record.grasps[0].occluded for record in records],
        ],
        "grasps": lambda: [_with_grasps(record) for record in records],
        "views": lambda: [list(record.image[:VIEWS]) for record in records],
    }[rows]()
    framed = [[np.pad(image, ((0, GAP), (0, GAP), (0, 0)), constant_values=255) for image in row] for row in grid]
    picture = Image.fromarray(np.concatenate([np.concatenate(row, axis=1) for row in framed]))
    if width:
        picture.thumbnail((width, picture.height), Image.Resampling.LANCZOS)
    return picture


def main() -> None:
    """Draw the picture that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", choices=["shapes", "sensors", "gel", "images"])
    parser.add_argument("path", type=Path, help="the picture, .png")
    parser.add_argument("run", type=Path, nargs="?", help="of images")
    parser.add_argument("objects", nargs="*", help="of images")
    parser.add_argument("--rows", choices=["objects", "grasps", "views"], default="objects", help="of images")
    parser.add_argument("--width", type=int, help="of images: pixels of the picture, at most")
    args = parser.parse_args()
    if args.picture in ("sensors", "gel"):
        (draw_sensors if args.picture == "sensors" else draw_gel)(args.path)
    elif args.picture == "images" and args.objects:
        images(args.run, args.objects, args.rows, args.width).save(args.path, optimize=True)
    elif args.picture == "images":
        parser.error("images: name a run and its objects")
    else:
        shapes().save(args.path, optimize=True)


if __name__ == "__main__":
    main()
