"""The picture of a hand with its sensor frames, to be looked at before a run.

python -m palpate.results.hand_sheet config/hands/wsg50.xml config/hands/wsg50.yaml digit docs/images/hand.png
python -m palpate.results.hand_sheet dome360 hand.png      the Allegro
"""

import sys

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from scipy.spatial import ConvexHull

from palpate.hand import Hand, allegro, from_mjcf
from palpate.results.page import COLOURS, FAINT, INK, LABEL, PALE, TITLE, new_figure, save, styled
from palpate.sensor import Sensor, load
from palpate.vision.geom import triangles

AXES = dict(zip("xyz", ("#D62728", "#2CA02C", "#1F77B4"), strict=True))  # as most viewers colour them
GEL, END = COLOURS[4], COLOURS[3]
LENGTH = 0.012  # m, of the axes' arrows
VIEW = {"elev": 22, "azim": -35}  # degrees
SIDES = 6  # sensors of which the side is drawn
MARGIN = 0.008  # m around a sensor seen from the side
LEGEND = "x red, y green, z blue; dotted: sensor plane, orange: gel's face, dashed: range; mm"
PANEL, WHOLE = 2.3, 4.8  # inches


@styled
def hand_figure(hand: Hand, sensor: Sensor) -> Figure:
    """The open hand with the frame, the gel's face and the range of each sensor.

    Left the whole hand. Right each of the first sensors from its side, with the geoms of its link: its gel's face has
    to lie on them, where contact stops the finger.
    """
    links = hand.forward(np.eye(4), hand.open_joint_positions)
    geoms = zip(hand.geom_kind, hand.geom_size, hand.geom_vertices, hand.geom_faces, strict=True)
    shapes = [triangles(*geom) for geom in geoms]
    poses = hand.geom_poses(links)
    placed = [points @ pose[:3, :3].T + pose[:3, 3] for (points, *_), pose in zip(shapes, poses, strict=True)]
    frames = list(zip(*hand.sensor_frames(links), strict=True))
    shown = frames[:SIDES]
    rows = -(-len(shown) // 2)
    width, height = WHOLE + min(len(shown), 2) * PANEL, max(WHOLE, rows * PANEL) + 0.5
    figure = new_figure(width, height)
    size = f"{1e3 * sensor.width:.4g} x {1e3 * sensor.height:.4g} mm"
    figure.text(0.99, 0.12 / height, LEGEND, ha="right", va="center", fontsize=LABEL, color=FAINT)
    title = f"{hand.name}, open; {len(frames)} sensors {sensor.name} of {size}"
    figure.text(0.5, 1 - 0.25 / height, title, ha="center", va="center", fontsize=TITLE)
    whole = figure.add_axes((0, 0, WHOLE / width, 1 - 0.5 / height), projection="3d", computed_zorder=False)
    _draw_whole(
        whole, hand, sensor, [points[faces] for points, (_, faces, _) in zip(placed, shapes, strict=True)], frames
    )
    for number, (position, rotation) in enumerate(shown):
        row, column = divmod(number, 2)
        left, bottom = WHOLE + column * PANEL + 0.42, height - 0.5 - (row + 1) * PANEL + 0.5
        axes = figure.add_axes((left / width, bottom / height, (PANEL - 0.5) / width, (PANEL - 0.75) / height))
        mine = np.flatnonzero(hand.geom_collides & (hand.geom_link == hand.sensor_link[number]))
        outlines = [((placed[geom] - position) @ rotation, hand.geom_rgba[geom]) for geom in mine]
        _draw_side(axes, hand.sensor_names[number], sensor, outlines)
    return figure


def _draw_whole(axes, hand: Hand, sensor: Sensor, geoms: list[np.ndarray], frames: list) -> None:
    """The hand in the palm's frame: geoms as triangles (f, 3, 3), and every sensor's axes, gel and range."""
    for triangle, rgba in zip(geoms, hand.geom_rgba, strict=True):
        axes.add_collection3d(Poly3DCollection(triangle, facecolor=(*rgba[:3], 0.18), edgecolor="none", zorder=1))
    for name, (position, rotation) in zip(hand.sensor_names, frames, strict=True):
        at = {x: _rectangle(sensor, x) @ rotation.T + position for x in (0, sensor.gel_face, sensor.range)}
        near, face, end = at.values()
        axes.add_collection3d(Poly3DCollection([face], facecolor=GEL, edgecolor=INK, alpha=0.8, zorder=2))
        sweep = [[*near, near[0]], [*end, end[0]], *zip(near, end, strict=True)]
        axes.add_collection3d(Line3DCollection(sweep, colors=END, linewidths=0.7, zorder=3))
        for axis, colour in zip(rotation.T, AXES.values(), strict=True):
            axes.plot(*np.stack([position, position + LENGTH * axis]).T, color=colour, linewidth=2, zorder=4)
        axes.text(*(position - LENGTH * rotation[:, 0]), name, fontsize=LABEL, zorder=5)
    points = np.concatenate([np.concatenate(geoms).reshape(-1, 3), np.array([position for position, _ in frames])])
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set_box_aspect(high - low, zoom=1.0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.view_init(**VIEW)
    axes.set_axis_off()


def _draw_side(axes: Axes, name: str, sensor: Sensor, outlines: list) -> None:
    """A sensor from its side, x to the right and z down; outlines: points (n, 3) in its frame, and their colours."""
    for points, rgba in outlines:
        across = 1e3 * points[:, [0, 2]]
        axes.add_patch(Polygon(across[ConvexHull(across).vertices], facecolor=(*rgba[:3], 0.35), edgecolor=FAINT))
    half = 500 * sensor.height
    middle, edges = sensor.resolution[1] // 2, np.array([-half, half])
    reach = 1e3 * sensor.reach[:, middle]
    axes.fill_betweenx(1e3 * sensor.pixel_centres[0], 0, reach, where=reach > 0, color=END, alpha=0.12, linewidth=0)
    for x, colour, style in ((0, INK, ":"), (sensor.gel_face, GEL, "-"), (sensor.range, END, "--")):
        axes.plot(np.full(2, 1e3 * x), edges, color=colour, linestyle=style, linewidth=2)
    for vector, colour in (((1, 0), AXES["x"]), ((0, 1), AXES["z"])):
        axes.annotate("", 1e3 * LENGTH * np.array(vector) / 2, (0, 0), arrowprops={"arrowstyle": "->", "color": colour})
    margin = 1e3 * MARGIN
    axes.set(xlim=(-margin, 1e3 * max(sensor.range, sensor.gel_face) + margin), ylim=(half + margin, -half - margin))
    axes.set_aspect("equal", adjustable="box")
    axes.set_title(name, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 2, colors=FAINT)
    axes.spines[:].set_color(PALE)


def _rectangle(sensor: Sensor, x: float) -> np.ndarray:
    """(4, 3) corners of the sensor's plane moved to x, sensor frame."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2 * (sensor.width, sensor.height)
    return np.column_stack([np.full(4, x), corners])


if __name__ == "__main__":
    *files, name, output = sys.argv[1:]
    kind = load(name)
    save(hand_figure(from_mjcf(*files, kind.gel_face) if files else allegro(kind.gel_face), kind), output)
