"""Figure of the atlas: the vision charts as they start, a closed sphere, each moved out slightly.

After the paper's figure "Initial positions of vision charts in a closed sphere". It depends on no run.
"""

from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba_array

from palpate.charts import ATLAS_RADIUS, vision_atlas
from palpate.mesh import OBJECT_POSITION
from palpate.results import products
from palpate.results.page import COLOURS, new_figure, save, styled

EXPLOSION = 0.055  # distance by which charts are moved out, in radii
TOWARDS_CAMERA = np.array([-0.62, -0.66, 0.42])  # from the sphere's centre, world frame
LIGHT = np.array([-0.75, -0.25, 0.62])  # towards the lamp, world frame
AMBIENT = 0.45  # share of the light that comes from all around
# Mixed with white: neighbours differ, for colour-blind readers too.
CHART_COLOURS = to_rgba_array([COLOURS[number] for number in (5, 4, 2, 3, 6)])[:, :3]
WHITE = 0.25  # share of white in them
EDGE = (0.15, 0.15, 0.18)  # RGB of the faces' sides
SIZE = 4.5  # inches


@products.figure(name="atlas")
@styled
def draw(path: Path | str) -> None:
    """The initial positions of the vision charts: 96 charts of 19 vertices and 24 faces that close a sphere. They are
    drawn slightly apart, to tell them from one another.
    """
    atlas = vision_atlas()
    vertices = atlas.vertices.double().numpy() - OBJECT_POSITION
    chart, faces = atlas.chart.numpy(), atlas.faces.numpy()
    middle = np.stack([vertices[chart == number].mean(axis=0) for number in range(chart.max() + 1)])
    out = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    corners = (vertices + EXPLOSION * ATLAS_RADIUS * out[chart])[faces]

    depth = unit(TOWARDS_CAMERA)
    right = unit(np.cross([0, 0, 1], depth))
    up = np.cross(depth, right)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    lit = AMBIENT + (1 - AMBIENT) * np.maximum(normal @ unit(LIGHT), 0)
    paint = CHART_COLOURS * (1 - WHITE) + WHITE
    colour = lit[:, None] * paint[chart_colours(chart, atlas.joined.numpy())[chart[faces[:, 0]]]]
    # From the back to the front; what faces away is hidden but for slits between charts, and omitted.
    shown = np.argsort(corners.mean(axis=1) @ depth)
    shown = shown[normal[shown] @ depth > 0]

    figure = new_figure(SIZE, SIZE)
    axes = figure.add_axes((0, 0, 1, 1))
    flat = np.stack([corners @ right, corners @ up], axis=2)[shown]
    axes.add_collection(PolyCollection(flat, facecolors=colour[shown], edgecolors=EDGE, linewidths=0.35))
    reach = 1.02 * (1 + EXPLOSION) * ATLAS_RADIUS
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set_axis_off()
    save(figure, path)


def unit(vector: np.ndarray) -> np.ndarray:
    """The unit vector along a vector."""
    return vector / np.linalg.norm(vector)


def chart_colours(chart: np.ndarray, joined: np.ndarray) -> np.ndarray:
    """The number of each chart's colour (96,), different for charts that share a side."""
    pairs, shared = np.unique(np.sort(chart[joined], axis=1), axis=0, return_counts=True)
    sides = pairs[shared > 1]  # charts that only meet at a corner share one vertex
    colours = np.full(chart.max() + 1, -1)
    for number in range(len(colours)):
        neighbours = sides[(sides == number).any(axis=1)]
        used = set(colours[neighbours].ravel())
        # In turn over the colours, so that all of them are used.
        order = (np.arange(len(CHART_COLOURS)) + number) % len(CHART_COLOURS)
        colours[number] = next(colour for colour in order if colour not in used)
    return colours
