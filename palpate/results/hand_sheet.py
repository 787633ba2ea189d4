"""The picture of a hand with its sensor frames, to be looked at before a run.

python -m palpate.results.hand_sheet config/hands/wsg50.xml config/hands/wsg50.yaml digit docs/images/hand.png
python -m palpate.results.hand_sheet dome360 hand.png      the Allegro
"""

import argparse

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

AXES = ("#D62728", "#2CA02C", "#1F77B4")  # of x, y and z, as most viewers colour them
GEL, END = COLOURS[4], COLOURS[3]
LENGTH, MARGIN = 0.012, 0.008  # m, of the axes; around a sensor seen from the side
SIDES = 6  # sensors of which the side is drawn
LEGEND = "x red, y green, z blue; dotted: sensor plane, orange: gel's face, dashed: range; mm"
WIDTH, ROW = 9.4, 2.4  # inches


@styled
def hand_figure(hand: Hand, sensor: Sensor) -> Figure:
    """The open hand with the frame, the gel's face and the range of each sensor.

    Left the whole hand. Right each of the first sensors from its side, with the geoms of its link: its gel's face has
    to lie on them, where contact stops the finger.
    """
    links = hand.forward(np.eye(4), hand.open_joint_positions)
    shapes = posed_geoms(hand, links)
    frames = list(zip(hand.sensor_names, *hand.sensor_frames(links), hand.sensor_link, strict=True))
    rows = max(2, -(-min(len(frames), SIDES) // 2))
    figure = new_figure(WIDTH, rows * ROW)
    figure.suptitle(f"{hand.name}, open; {len(frames)} sensors {sensor.name}", fontsize=TITLE)
    figure.text(0.98, 0.02, LEGEND, ha="right", fontsize=LABEL, color=FAINT)
    grid = figure.add_gridspec(rows, 4, left=0, right=0.98, bottom=0.1, wspace=0.3, hspace=0.35)
    _draw_whole(figure.add_subplot(grid[:, :2], projection="3d", computed_zorder=False), hand, sensor, shapes, frames)
    for number, (name, position, rotation, link) in enumerate(frames[:SIDES]):
        own = np.flatnonzero(hand.geom_collides & (hand.geom_link == link))
        outlines = [((shapes[geom][0] - position) @ rotation, hand.geom_rgba[geom]) for geom in own]
        _draw_side(figure.add_subplot(grid[number // 2, 2 + number % 2]), name, sensor, outlines)
    return figure


def posed_geoms(hand: Hand, link_pose: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each geom of a hand in a pose its vertices (n, 3) and triangles (f, 3, 3), in the frame of `link_pose`."""
    geoms = zip(hand.geom_kind, hand.geom_size, hand.geom_vertices, hand.geom_faces, strict=True)
    shapes = []
    for geom, pose in zip(geoms, hand.geom_poses(link_pose), strict=True):
        points, faces, _ = triangles(*geom)
        points = points @ pose[:3, :3].T + pose[:3, 3]
        shapes.append((points, points[faces]))
    return shapes


def _draw_whole(axes: Axes, hand: Hand, sensor: Sensor, shapes: list, frames: list) -> None:
    """The hand in the palm's frame, and every sensor's axes, gel and range."""
    for (_, faces), rgba in zip(shapes, hand.geom_rgba, strict=True):
        axes.add_collection3d(Poly3DCollection(faces, facecolor=(*rgba[:3], 0.18), edgecolor="none", zorder=1))
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2 * (sensor.width, sensor.height)
    for name, position, rotation, _ in frames:
        near, face, end = (
            np.column_stack([np.full(4, x), corners]) @ rotation.T + position
            for x in (0, sensor.gel_face, sensor.range)
        )
        axes.add_collection3d(Poly3DCollection([face], facecolor=GEL, edgecolor=INK, alpha=0.8, zorder=2))
        sweep = [[*near, near[0]], [*end, end[0]], *zip(near, end, strict=True)]
        axes.add_collection3d(Line3DCollection(sweep, colors=END, linewidths=0.7, zorder=3))
        for axis, colour in zip(rotation.T, AXES, strict=True):
            axes.plot(*np.stack([position, position + LENGTH * axis]).T, color=colour, linewidth=2, zorder=4)
        axes.text(*(position - LENGTH * rotation[:, 0]), name, fontsize=LABEL, zorder=5)
    points = np.concatenate([points for points, _ in shapes] + [position[None] for _, position, *_ in frames])
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set_box_aspect(high - low, zoom=1.0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.view_init(elev=22, azim=-35)
    axes.set_axis_off()


def _draw_side(axes: Axes, name: str, sensor: Sensor, outlines: list) -> None:
    """A sensor from its side, x to the right and z down; outlines: points (n, 3) in its frame, and their colours."""
    for points, rgba in outlines:
        across = 1e3 * points[:, [0, 2]]
        axes.add_patch(Polygon(across[ConvexHull(across).vertices], facecolor=(*rgba[:3], 0.35), edgecolor=FAINT))
    rows, reach = 1e3 * sensor.pixel_centres[0], 1e3 * sensor.reach[:, sensor.resolution[1] // 2]
    axes.fill_betweenx(rows, 0, reach, where=reach > 0, color=END, alpha=0.12, linewidth=0)
    for x, colour, style in ((0, INK, ":"), (sensor.gel_face, GEL, "-"), (sensor.range, END, "--")):
        axes.plot([1e3 * x] * 2, rows[[0, -1]], color=colour, linestyle=style, linewidth=2)
    for vector, colour in zip(np.eye(2) * 500 * LENGTH, AXES[::2], strict=True):
        axes.annotate("", vector, (0, 0), arrowprops={"arrowstyle": "->", "color": colour})
    margin, half = 1e3 * MARGIN, 500 * sensor.height
    axes.set(xlim=(-margin, 1e3 * sensor.range + margin), ylim=(half + margin, -half - margin), aspect="equal")
    axes.set_title(name, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 2, colors=FAINT)
    axes.spines[:].set_color(PALE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m palpate.results.hand_sheet", description=__doc__.splitlines()[0])
    parser.add_argument(
        "hand", nargs="*", help="an own hand's model file and the file of its sensors; none: the Allegro"
    )
    parser.add_argument("sensor", help="one that is shipped, or the path of its file")
    parser.add_argument("output", help="the picture, .png")
    args = parser.parse_args()
    kind = load(args.sensor)
    hand = from_mjcf(*args.hand, kind.gel_face) if args.hand else allegro(kind.gel_face)
    save(hand_figure(hand, kind), args.output)
