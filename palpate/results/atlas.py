"""Figure of the atlas: the vision charts as they start, a closed sphere, each moved out slightly.

After the paper's figure "Initial positions of vision charts in a closed sphere". It depends on no run.
"""

from pathlib import Path
from typing import Any

import numpy as np

from palpate.mesh import OBJECT_POSITION
from palpate.results import products
from palpate.results.page import COLOURS, INK, new_figure, save

EXPLOSION = 0.055  # distance by which charts are moved out, in radii
CHART_COLOURS = np.array(COLOURS)[[5, 4, 2, 3, 6]]
AZIMUTH, ELEVATION = -133, 25  # degrees, of the view
SIZE = 4.5  # inches


@products.figure(name="atlas")
def draw(path: Path | str) -> None:
    """The initial positions of the vision charts: 96 charts of 19 vertices and 24 faces that close a sphere. They are
    drawn slightly apart, to tell them from one another.
    """
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    from palpate.charts import ATLAS_RADIUS, vision_atlas

    atlas = vision_atlas()
    vertices = atlas.vertices.double().numpy() - OBJECT_POSITION
    chart, faces = atlas.chart.numpy(), atlas.faces.numpy()
    middle = np.stack([vertices[chart == number].mean(axis=0) for number in range(chart.max() + 1)])
    out = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    corners = (vertices + EXPLOSION * ATLAS_RADIUS * out[chart])[faces]
    colours = CHART_COLOURS[chart_colours(chart[faces[:, 0]])]
    # What faces away would be seen through the slits between charts.
    azimuth, elevation = np.radians([AZIMUTH, ELEVATION])
    towards = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    shown = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ towards > 0
    figure = new_figure(SIZE, SIZE)
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho")
    style = {"edgecolors": INK, "linewidths": 0.35, "shade": True, "lightsource": LightSource(200, 40)}
    axes.add_collection3d(Poly3DCollection(corners[shown], facecolors=colours[shown], **style))
    reach = ATLAS_RADIUS * (1 + EXPLOSION)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-reach, reach))
    axes.set_box_aspect((1, 1, 1), zoom=1.6)
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    axes.set_axis_off()
    save(figure, path)


def chart_colours(chart: np.ndarray) -> np.ndarray:
    """The number of each chart's colour, by charts' numbers; different for charts that share a side."""
    return (4 * chart + chart // 2) % len(CHART_COLOURS)
