"""Figures of a run's dataset that show what is stored: one data point, and sheets of examples.

A dataset, or a class, without objects gives a figure that says so.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from palpate.dataset.reader import Dataset, GraspRecord
from palpate.results import products
from palpate.results.page import COLOURS, picture_grid, save, save_sentence, styled

SITE_COLOURS = [COLOURS[number] for number in (1, 0, 2, 3, 4, 5)]  # in the order of the sensors
SITE_POINT = 1.6  # points, diameter of a touched point as drawn, larger than it is
SITE_STRIDE = 13  # of touched points, those drawn
BEHIND = 2  # widths of a pixel: a point so far behind what the camera saw at its pixel's centre is hidden
HIDDEN = 0.2  # opacity of such a point
PALE = 0.45  # opacity of an image under touched points
MARGIN = 1.1  # of the part of an image that is shown, over the object
EXAMPLES = 6  # objects on a sheet
CANDIDATES = 60  # grasps looked at for the data point


@products.figure(stores=("dataset",), category="Dataset", simulated=True)
@styled
def data_point(dataset: Dataset, path: Path | str) -> None:
    """One data point: the camera's image of the object alone, and of the object in the hand; what the touch sensors
    read (faded where a sensor touched nothing); and the touched points on the object, in the colours of their readings
    (faint where the object hides them from the camera).

    The grasp is the one that `example_grasp` picks.
    """
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    save(_sheet([grasp]), path)


@products.figure(name="examples_{class_name}", stores=("dataset",), category="Dataset", simulated=True)
@styled
def examples(dataset: Dataset, class_name: str, path: Path | str) -> None:
    """Examples of class {class_name}, taken evenly from its objects and not chosen: images, readings of the sensors
    (faded where a sensor touched nothing), and the touched points on the object, in the colours of their readings
    (faint where the object hides them from the camera).

    A row an object, each with another of its grasps: the first object's first, the second's second, ...
    """
    objects = dataset.of_class(class_name).objects if class_name in dataset.classes else []
    if not objects:
        return save_sentence(f"No usable object of class {class_name} in this run", path)
    chosen = [dataset[objects[number]].grasps for number in evenly(len(objects), EXAMPLES)]
    grasps = [of_object[row % len(of_object)] for row, of_object in enumerate(chosen)]
    save(_sheet(grasps), path)


def example_grasp(dataset: Dataset) -> GraspRecord | None:
    """The grasp that shows what a data point is: of those with most touches the one of whose object most pixels are in
    sight beside the hand. Looks at no more than `CANDIDATES`, taken evenly; None for a dataset without objects."""
    if not len(dataset):
        return None
    touches = dataset.array("touch", "success")[:].sum(axis=2)
    best = np.argwhere(touches == touches.max())
    candidates = [dataset[int(row)].grasps[grasp] for row, grasp in best[evenly(len(best), CANDIDATES)]]
    return max(candidates, key=lambda grasp: (grasp.occluded_mask > 0).mean())


def _sheet(grasps: Sequence[GraspRecord]) -> Figure:
    """A row a grasp: both images, the readings, and the touched points."""
    names = [f"{grasp.object.name}, grasp {grasp.number}" for grasp in grasps]
    figure, axes = picture_grid(names, ("unoccluded", "occluded", *grasps[0].sensors, "touched points"))
    for grasp, (alone, held, *readings, touched) in zip(grasps, axes, strict=True):
        alone.imshow(grasp.object.unoccluded, interpolation="antialiased")
        held.imshow(grasp.occluded, interpolation="antialiased")
        for sensor, panel in enumerate(readings):
            draw_reading(panel, grasp.reading[sensor], grasp.success[sensor], sensor)
        _draw_touched(touched, grasp)
    return figure


def draw_reading(axes: Axes, reading: np.ndarray, touched: bool, sensor: int) -> None:
    """A sensor's image, framed in the colour of its points; an untouched one is faded."""
    axes.imshow(reading, interpolation="antialiased", alpha=1 if touched else 0.4)
    axes.spines[:].set(visible=touched, color=_site_colour(sensor), linewidth=2.2)


def _draw_touched(axes: Axes, grasp: GraspRecord) -> None:
    """The touched points on the image of the object alone, pale and grey, as its camera sees them."""
    alone, camera = grasp.object, grasp.object.vision_camera
    grey = Image.fromarray(alone.unoccluded).convert("LA").convert("RGBA")
    axes.imshow(grey, alpha=PALE, interpolation="antialiased")
    for sensor in np.flatnonzero(grasp.success):
        pixels, depth = camera.project(grasp.points[sensor][::SITE_STRIDE])
        column, row = np.clip(np.nan_to_num(pixels).astype(int), 0, camera.size - 1).T
        behind = depth - alone.unoccluded_depth[row, column] > BEHIND * depth / camera.focal_length
        opacity = np.where(behind, HIDDEN, 1)
        drawn = {"s": SITE_POINT**2, "color": _site_colour(sensor), "linewidths": 0}
        axes.scatter(*(pixels - 0.5).T, alpha=opacity, **drawn)  # the first pixel's centre is at 0
    seen = np.argwhere(alone.unoccluded_mask)
    low, high = seen.min(axis=0), seen.max(axis=0)
    (y, x), reach = (low + high) / 2, MARGIN * (high - low).max() / 2
    axes.set(xlim=(x - reach, x + reach), ylim=(y + reach, y - reach))


def _site_colour(sensor: int) -> str:
    return SITE_COLOURS[sensor % len(SITE_COLOURS)]


def evenly(count: int, most: int) -> np.ndarray:
    """At most `most` of the numbers 0 ... count - 1, evenly spaced, in order."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).round().astype(int)
