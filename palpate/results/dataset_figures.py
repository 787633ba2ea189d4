"""Figures of a run's dataset: one data point, and sheets of examples. They need no display and no renderer.

The same dataset gives the same bytes. A dataset, or a class, without objects gives a figure that says so.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from palpate.dataset.reader import Dataset, GraspRecord
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.results import products
from palpate.results.page import FAINT, LABEL, PALE, TITLE, Page, save, save_sentence, styled
from palpate.results.surface_view import SurfaceView, site_colours

RING = 0.8  # radius of the ring about a site, in sensor widths
SURFACE_ASPECT = 1.5  # width of a surface's picture over its height: most objects are long
EXAMPLES = 6  # objects on a sheet
SHEET_DPI = 100
CANDIDATES = 60  # grasps looked at for the data point
# What a data point had best be: the hand hides some of the object, but not most of it. This share of it stays visible.
VISIBLE = 0.65
FULL_RELIEF = 50.0  # standard deviation of a reading's pixels (0..255); one that varies more is no better


@products.figure(stores=("dataset",), category="Dataset", simulated=True)
@styled
def data_point(dataset: Dataset, path: Path | str) -> None:
    """One data point: the camera's image of the object in the hand, and of the object alone; what the four touch
    sensors read (a faded, struck-through reading is that of a sensor that touched nothing); and the object's surface
    with the touch sites in the colours of their readings. A dashed ring marks a site that this view does not show.

    The grasp is the one that `example_grasp` picks.
    """
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    cell, gap, label, head = 2.8, 0.1, 0.22, 0.5  # inches
    widths = np.array([cell, cell, cell, SURFACE_ASPECT * cell])
    left = gap + np.concatenate([[0], np.cumsum(widths + gap)[:-1]])
    width, height = left[-1] + widths[-1], head + cell + gap
    page = Page(width, height)
    titles = ("Occluded image", "Unoccluded image", "Touch readings", "Surface and touch sites")
    for start, extent, title in zip(left, widths, titles, strict=True):
        page.text(start + extent / 2, 0.14, title, fontsize=TITLE)
    _image(page.axes(left[0], head, cell, cell), grasp.occluded)
    _image(page.axes(left[1], head, cell, cell), grasp.object.unoccluded)
    side = max(2, int(np.ceil(np.sqrt(len(grasp.sensors)))))  # readings in a row
    small = (cell - label) / side
    step, colours = (cell - small) / (side - 1), site_colours(len(grasp.sensors))
    for sensor, name in enumerate(grasp.sensors):
        row, column = divmod(sensor, side)
        axes = page.axes(left[2] + column * step, head + row * step, small, small)
        draw_reading(axes, grasp, sensor)
        touched = grasp.success[sensor]
        colour = colours[sensor] if touched else FAINT
        axes.set_title(name if touched else f"{name}: no touch", fontsize=LABEL, pad=3, color=colour)
    _surface(page.axes(left[3], head, widths[3], cell), grasp)
    save(page.figure, path)


@products.figure(name="examples_{class_name}", stores=("dataset",), category="Dataset", simulated=True)
@styled
def examples(dataset: Dataset, class_name: str, path: Path | str) -> None:
    """Examples of class {class_name}, taken evenly from its objects and not chosen: images, readings of the four
    sensors (faded and struck through where a sensor touched nothing), and the surface with the touch sites in the
    colours of their readings. A dashed ring marks a site that the view does not show.

    A row an object, each with another of its grasps: the first object's first, the second's second, ...
    """
    objects = dataset.of_class(class_name).objects if class_name in dataset.classes else []
    if not objects:
        return save_sentence(f"No usable object of class {class_name} in this run", path)
    chosen = [objects[number] for number in _evenly(len(objects), EXAMPLES)]
    sensors = dataset[chosen[0]].grasps[0].sensors
    titles = ("unoccluded", "occluded", *sensors, "touch sites")
    cell, gap, label, head = 1.55, 0.06, 0.24, 0.3  # inches
    left = gap + np.arange(len(titles)) * (cell + gap)
    widths = np.append(np.full(len(titles) - 1, cell), SURFACE_ASPECT * cell)
    width, height = left[-1] + widths[-1] + gap, head + len(chosen) * (label + cell) + gap
    page = Page(width, height, SHEET_DPI)
    for start, extent, title in zip(left, widths, titles, strict=True):
        page.text(start + extent / 2, head / 2, title, fontsize=TITLE)
    for row, name in enumerate(chosen):
        record = dataset[name]
        grasp = record.grasps[row % len(record.grasps)]
        top = head + row * (label + cell)
        words = f"{name}, grasp {grasp.number}: {int(grasp.success.sum())} of {len(sensors)} touches"
        page.text(gap, top + label / 2, words, fontsize=LABEL, color=FAINT, ha="left")
        axes = [page.axes(start, top + label, extent, cell) for start, extent in zip(left, widths, strict=True)]
        _image(axes[0], record.unoccluded)
        _image(axes[1], grasp.occluded)
        for sensor in range(len(sensors)):
            draw_reading(axes[2 + sensor], grasp, sensor)
        _surface(axes[-1], grasp)
    save(page.figure, path)


def example_grasp(dataset: Dataset) -> GraspRecord | None:
    """A grasp that shows well what a data point is; None for a dataset without objects.

    Of those with the best number of touches (all but one, so that an empty reading is shown as well; else all; else as
    many as there are): the object is large in its image, the hand leaves about
    `VISIBLE` of it in sight, and there is something to see in every touching sensor's reading. Looks at no
    more than `CANDIDATES` of them, taken evenly.
    """
    if not len(dataset):
        return None
    success = dataset.array("touch", "success")[:]
    touches, sensors = success.sum(axis=2), success.shape[2]
    rank = np.vectorize(best_counts(sensors).index)(touches)
    best = np.argwhere(rank == rank.min())
    candidates = best[_evenly(len(best), CANDIDATES)]

    def merit(grasp: GraspRecord) -> float:
        unoccluded, occluded = (grasp.object.unoccluded_mask > 0).mean(), (grasp.occluded_mask > 0).mean()
        relief = grasp.reading[grasp.success].std(axis=(1, 2)).mean(axis=-1)
        in_sight = occluded / max(unoccluded, 1e-9)
        return np.sqrt(unoccluded) * (1 - abs(in_sight - VISIBLE)) * relief.min(initial=FULL_RELIEF)

    return max((dataset[int(row)].grasps[number] for row, number in candidates), key=merit)


def best_counts(sensors: int) -> list[int]:
    """Counts of successful touches that a data point may have, the best first."""
    return [sensors - 1, sensors, *range(sensors - 2, -1, -1)] if sensors > 1 else [1, 0]


def _evenly(count: int, most: int) -> np.ndarray:
    """At most `most` of the numbers 0 ... count - 1, evenly spaced, in order."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).round().astype(int)


def _frame(axes: Axes, colour=PALE, width: float = 0.8) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set(color=colour, linewidth=width)


def _image(axes: Axes, image: np.ndarray) -> None:
    axes.imshow(image, interpolation="antialiased")
    _frame(axes)


def draw_reading(axes: Axes, grasp: GraspRecord, sensor: int) -> None:
    """A sensor's image, framed in its site's colour; an untouched one is faded and struck through."""
    touched = grasp.success[sensor]
    axes.imshow(grasp.reading[sensor], interpolation="antialiased", alpha=1 if touched else 0.5)
    _frame(axes, site_colours(sensor + 1)[sensor] if touched else PALE, 2.2 if touched else 0.8)
    if not touched:
        axes.plot([0, 1], [0, 1], color=FAINT, linewidth=0.8, transform=axes.transAxes)


def _surface(axes: Axes, grasp: GraspRecord) -> None:
    """The object from its best side, a ring about every site: dashed if the object hides it."""
    sites = [cloud - np.array(OBJECT_POSITION) for cloud in grasp.points]
    surface = SurfaceView(load_visual(grasp.object.mesh), sites, grasp.sensor)
    box = axes.get_window_extent()
    view = surface.best_view((round(box.height), round(box.width)))
    picture = surface.draw(view)
    axes.imshow(np.clip(picture.image, 0, 1), interpolation="antialiased")
    for centre, hidden, colour in zip(picture.centres, picture.hidden, site_colours(len(sites)), strict=True):
        if np.isfinite(centre).all():
            style = {"linewidth": 1.2, "linestyle": (0, (2, 1.5)) if hidden else "solid", "clip_on": False}
            radius = RING * max(grasp.sensor.size) / view.scale
            axes.add_patch(Circle(centre, radius, fill=False, color=colour, **style))
    axes.set_axis_off()
