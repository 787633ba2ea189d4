"""The figure of local predictions: readings of touches, the true surface, the predicted cloud, and its chart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.results import products
from palpate.results.page import INK, picture_grid, save, save_sentence

if TYPE_CHECKING:
    from palpate.dataset import Dataset, GraspRecord, ObjectRecord

TOUCHES = 2  # of every object
STRIDE = 7  # of a cloud's points, those that are drawn: 10,000 hide one another; 7 does not divide a row
# Rows: right and up in the picture, in the sensor's frame. Seen from the sensor, from where the reading's bottom is.
OBLIQUE = np.array([[0, 1, 0], [-0.6, 0, -0.8]])


@products.figure(stores=("touch",), files=("touch_depth",))
def local_predictions(dataset: Dataset, touch_depth: Path | str, path: Path | str) -> None:
    """Local predictions of the first test object of every class: the widest touch of each of two grasps. The reading;
    the true cloud of the touch site; the cloud that the U-Net predicts from the reading, at the pixels that differ from
    the untouched reading; and the touch chart fitted to it. Seen from the sensor's side; the bottom of the reading is
    in front. Colours are depths, the same in a row: dark is near to the sensor.

    touch_depth: the trained U-Net's folder.
    """
    from palpate.charts.atlas import touch_chart
    from palpate.learning.reconstruct import GraspTouches, TouchCharts

    drawn = [touch for record in first_test_objects(dataset) for touch in touches(record)]
    if not drawn:
        return save_sentence("No test object with a successful touch in this run", path)
    charts, faces = TouchCharts(touch_depth), touch_chart().faces.numpy()
    names = [f"{grasp.object.name}\ngrasp {grasp.number}, {grasp.sensors[sensor]}" for grasp, sensor in drawn]
    figure, axes = picture_grid(names, ("reading", "true cloud", "predicted cloud", "touch chart"))
    for (grasp, sensor), (reading, *panels) in zip(drawn, axes, strict=True):
        touch = GraspTouches(*(getattr(grasp, name)[[sensor]] for name in GraspTouches._fields))
        clouds = grasp.points[sensor][::STRIDE], charts.clouds(touch)[0][::STRIDE], charts(touch)[0]
        local = [(cloud - grasp.position[sensor]) @ grasp.rotation[sensor] for cloud in clouds]
        middle = OBLIQUE @ [np.median(local[0][:, 0]), 0, 0]
        reading.imshow(grasp.reading[sensor], interpolation="antialiased")
        for panel, points in zip(panels, local, strict=True):
            right, up = points @ OBLIQUE.T[:, 0], points @ OBLIQUE.T[:, 1]
            depths = {"cmap": "viridis", "vmin": local[0][:, 0].min(), "vmax": local[0][:, 0].max()}
            if panel is panels[-1]:
                panel.tripcolor(right, up, faces, facecolors=points[faces, 0].mean(axis=1), ec=INK, lw=0.3, **depths)
            else:
                panel.scatter(right, up, c=points[:, 0], s=1.5, **depths)
            half = 0.6 * max(grasp.sensor.size)
            panel.set(xlim=middle[0] + np.array([-half, half]), ylim=middle[1] + np.array([-half, half]), aspect=1)
    save(figure, path)


def first_test_objects(dataset: Dataset) -> list[ObjectRecord]:
    """The first test object of every class, in the catalogue's order; not chosen for what comes out."""
    first: dict[str, ObjectRecord] = {}
    for record in dataset:
        if record.split == "test":
            first.setdefault(record.class_name, record)
    return list(first.values())


def touches(record: ObjectRecord) -> list[tuple[GraspRecord, int]]:
    """Grasp and sensor of the widest touch of each of the object's first grasps that have one."""
    widest = [(grasp, int(np.argmax([len(cloud) for cloud in grasp.points]))) for grasp in record.grasps]
    return [(grasp, sensor) for grasp, sensor in widest if grasp.success[sensor]][:TOUCHES]
