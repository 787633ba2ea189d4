"""The picture of the shipped sensors in the docs: what each reads at the same places of one object.

python -m studies.benchmarks.sensors_picture docs/images/sensors.png
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from palpate import sensor as sensors
from palpate.mesh import DIAGONAL
from palpate.results.page import FAINT, LABEL, TITLE, new_figure, save, styled
from palpate.sensor import DIGIT, Sensor
from palpate.shapes import make
from palpate.touch import RayCaster, empty_reading, sense

OBJECT = ("rifle", 3)  # of the procedural classes, with the seed 0
PLACES = 3
CANDIDATES = 300  # points of the surface that are looked at for places with much to see
MOST = 0.7  # share of the DIGIT that touches at these places: the rest shows what a soft gel does at an edge
AHEAD = 0.0225  # m from the sensor plane to the surface: 2.5 mm into a gel at 25 mm
CELL, GAP, HEAD, SIDE = 1.7, 0.06, 0.62, 0.3  # inches


def shown() -> dict[str, Sensor]:
    """The sensors of the picture by their headings: those shipped, and the DIGIT with a soft gel."""
    kinds = {name: sensors.load(name) for name in sensors.shipped()}
    soft = replace(DIGIT, smoothing=kinds["gelsight_mini"].smoothing)
    return {"digit": kinds.pop("digit"), "digit, Taxim's smoothing": soft, **kinds}


def poses(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Positions (k, 3) and rotations (k, 3, 3) of sensors that look straight at points of the surface."""
    points, faces = trimesh.sample.sample_surface(mesh, CANDIDATES, seed=0)
    into = -mesh.face_normals[faces]
    helper = np.eye(3)[np.abs(into).argmin(axis=1)]
    down = np.cross(into, helper)
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    return points - AHEAD * into, np.stack([into, np.cross(down, into), down], axis=2)


@styled
def draw(path: Path | str) -> None:
    """Draw the picture: a column a sensor; its empty reading, then the readings at places with much to see."""
    scene = make(*OBJECT, 0)
    mesh = scene.to_geometry()
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(DIAGONAL / np.linalg.norm(mesh.extents))
    position, rotation = poses(mesh)
    sensed = sense(RayCaster(mesh), position, rotation)
    touched = np.isfinite(sensed.depth).mean(axis=(1, 2))
    relief = np.where(touched < MOST, sensed.reading.std(axis=(1, 2)).mean(axis=1), 0)
    # The highest of every third, so that the places differ.
    places = [int(part[relief[part].argmax()]) for part in np.array_split(np.arange(CANDIDATES), PLACES)]
    rows = ["untouched", *(f"place {number + 1}" for number in range(PLACES))]
    kinds = shown()
    width, height = SIDE + len(kinds) * (CELL + GAP), HEAD + len(rows) * (CELL + GAP)
    figure = new_figure(width, height)
    for column, (name, kind) in enumerate(kinds.items()):
        left = SIDE + column * (CELL + GAP)
        sensed = sense(RayCaster(mesh, sensor=kind), position[places], rotation[places])
        edges = " x ".join(f"{1e3 * edge:.4g}" for edge in sorted({kind.width, kind.height}, reverse=True))
        words = "{} mm, {} x {} pixels".format(edges, *kind.resolution)
        figure.text((left + CELL / 2) / width, 1 - 0.2 / height, name, ha="center", va="center", fontsize=TITLE)
        figure.text(
            (left + CELL / 2) / width, 1 - 0.45 / height, words, ha="center", va="center", fontsize=LABEL, color=FAINT
        )
        for row, reading in enumerate([empty_reading(kind), *sensed.reading]):
            bottom = 1 - (HEAD + row * (CELL + GAP) + CELL) / height
            axes = figure.add_axes((left / width, bottom, CELL / width, CELL / height))
            axes.imshow(reading, interpolation="nearest", aspect=kind.pixel[0] / kind.pixel[1])
            axes.set_axis_off()
    for row, name in enumerate(rows):
        middle = HEAD + row * (CELL + GAP) + CELL / 2
        figure.text(0.15 / width, 1 - middle / height, name, ha="center", va="center", fontsize=LABEL, rotation=90)
    save(figure, path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m studies.benchmarks.sensors_picture", description="Draw what each shipped sensor reads."
    )
    parser.add_argument("path", type=Path, help="the picture, .png")
    draw(parser.parse_args().path)
