"""What `palpate check` draws: a hand with its sensor frames, and below it images and readings of an object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.results.page import COLOURS, INK, LABEL, TITLE, new_figure, styled
from palpate.vision.geom import triangles

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from palpate.hand import Hand
    from palpate.sensor import Sensor

AXES = ("#D62728", "#2CA02C", "#1F77B4")  # of x, y and z, as most viewers colour them
GEL, END = COLOURS[4], COLOURS[3]
LENGTH = 0.012  # m, of the axes
COLUMNS = 6  # pictures in a row
VIEWS = (-35, 145)  # degrees of azimuth
LEGEND = "x red, y green, z blue; orange: the gel's face; lines: from the sensor plane to the end of its range"
WIDTH, HAND, ROW = 11.0, 5.0, 2.1  # inches: of the sheet; heights of the hand and of a row of pictures


@styled
def check_sheet(hand: Hand, sensor: Sensor, pictures: Mapping[str, np.ndarray]) -> Figure:
    """The open hand from two sides, with the frame, the gel's face and the range of each sensor; below it pictures
    (rows, columns, 3 or 4) uint8 with their titles."""
    rows = -(-len(pictures) // COLUMNS)
    height = HAND + ROW * rows
    figure = new_figure(WIDTH, height)
    title = f"{hand.name}, open; {len(hand.sensor_names)} sensors {sensor.name}\n{LEGEND}"
    figure.suptitle(title, fontsize=TITLE - 1, y=1 - 0.1 / height)
    for number, azimuth in enumerate(VIEWS):
        place = (number / len(VIEWS), ROW * rows / height, 1 / len(VIEWS), (HAND - 0.5) / height)
        panel: Any = figure.add_axes(place, projection="3d", computed_zorder=False)
        _draw_hand(panel, hand, sensor)
        panel.view_init(elev=22, azim=azimuth)
    for number, (title, picture) in enumerate(pictures.items()):
        row, column = divmod(number, COLUMNS)
        place = (column / COLUMNS, (ROW * (rows - 1 - row) + 0.05) / height, 0.98 / COLUMNS, (ROW - 0.35) / height)
        axes = figure.add_axes(place)
        axes.imshow(picture)
        axes.set_title(title, fontsize=LABEL)
        axes.set_axis_off()
    return figure


def posed_geoms(hand: Hand, link_pose: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each geom of a hand in a pose its vertices (n, 3) and triangles (f, 3, 3), in the frame of `link_pose`."""
    geoms = hand.geom_kind, hand.geom_size, hand.geom_vertices, hand.geom_faces, hand.geom_poses(link_pose)
    shapes = []
    for *geom, pose in zip(*geoms, strict=True):
        points, faces, _ = triangles(*geom)
        points = points @ pose[:3, :3].T + pose[:3, 3]
        shapes.append((points, points[faces]))
    return shapes


def _draw_hand(axes: Axes3D, hand: Hand, sensor: Sensor) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    links = hand.forward(np.eye(4), hand.open_joint_positions)
    shapes, (positions, rotations) = posed_geoms(hand, links), hand.sensor_frames(links)
    for (_, faces), rgba in zip(shapes, hand.geom_rgba, strict=True):
        axes.add_collection3d(Poly3DCollection(faces, facecolor=(*rgba[:3], 0.18), edgecolor="none", zorder=1))
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2 * (sensor.width, sensor.height)
    for name, position, rotation in zip(hand.sensor_names, positions, rotations, strict=True):
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
    points = np.concatenate([*(points for points, _ in shapes), positions])
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set_box_aspect(high - low, zoom=1.1)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_axis_off()
