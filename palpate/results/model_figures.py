"""Figures of the models: the charts they start with, what they predict, their errors in numbers.

Bands and bars are 95 % bootstrap intervals, as in the tables; dashed lines are the paper's values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.experiments import METHODS, Experiment
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.protocol import RINGS
from palpate.results import model_tables as tables
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES, ratio
from palpate.results.errors import Errors, errors
from palpate.results.model_tables import Experiments
from palpate.results.page import COLOURS, INK, LABEL, PALE, TITLE, new_figure, picture_grid, save, save_sentence
from palpate.results.published import stated
from palpate.vision import Mesh, spheres

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike
    from pandas import DataFrame as Frame

    from palpate.dataset import Dataset, GraspRecord, ObjectRecord
    from palpate.learning.reconstruct import Shape

CHART_COLOURS = np.array(COLOURS)[[5, 4, 2, 3, 6]]
EXPLOSION = 0.055  # distance by which charts are moved out, in radii
AZIMUTH, ELEVATION = -133, 25  # degrees, of the view of the charts
TOUCHES = 2  # of every object
STRIDE = 7  # of a cloud's points, those that are drawn: 10,000 hide one another; 7 does not divide a row
# Rows: right and up in the picture, in the sensor's frame. Seen from the sensor, from where the reading's bottom is.
OBLIQUE = np.array([[0, 1, 0], [-0.6, 0, -0.8]])
# Methods in the order of their colours.
ORDER = ("charts", "retrieval", "template", "mean", "sphere", "no_comm", "no_copy")
PANEL = {"left": 0.075, "right": 0.99, "bottom": 0.13, "top": 0.88}  # of the width and height of a row of panels
# The models, the name of each over its columns, and the numbers of grasps in these.
MODELS = {
    "template_occluded_any": ("occluded", (0, 1)),
    "template_unoccluded_any": ("unoccluded", (0, 1, 2, 3, 4, 5)),
    "template_touch_any": ("touch only", (1, 2, 3, 4, 5)),
}
CLAY = (0.93, 0.92, 0.90)  # sRGB of a surface without its materials
SAMPLES, PIXELS = 16, 360
MARGIN = 1.06  # of a row's window, times what is in it


@products.figure(name="atlas")
def draw(path: Path | str) -> None:
    """The initial positions of the vision charts: 96 charts of 19 vertices and 24 faces that close a sphere. They are
    drawn slightly apart, to tell them from one another."""
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
    figure = new_figure(4.5, 4.5)
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho")
    style = {"edgecolors": INK, "linewidths": 0.35, "shade": True, "lightsource": LightSource(200, 40)}
    axes.add_collection3d(Poly3DCollection(corners[shown], facecolors=colours[shown], **style))
    reach = np.array([-1, 1]) * ATLAS_RADIUS * (1 + EXPLOSION)
    axes.set(xlim=reach, ylim=reach, zlim=reach)
    axes.set_box_aspect((1, 1, 1), zoom=1.6)
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    axes.set_axis_off()
    save(figure, path)


def chart_colours(chart: np.ndarray) -> np.ndarray:
    """The number of each chart's colour, by charts' numbers; different for charts that share a side."""
    return (4 * chart + chart // 2) % len(CHART_COLOURS)


@products.figure(stores=("touch",), files=("touch_depth",))
def local_predictions(dataset: Dataset, touch_depth: Path | str, path: Path | str) -> None:
    """Local predictions of the first test object of every class: the widest touch of each of two grasps. The reading;
    the true cloud of the touch site; the cloud that the U-Net predicts from the reading, at the pixels that differ from
    the untouched reading; and the touch chart fitted to it. Seen from the sensor's side; the bottom of the reading is
    in front. Colours are depths, the same in a row: dark is near to the sensor."""
    from palpate.charts import touch_chart
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
    for record in dataset.split("test"):
        first.setdefault(record.class_name, record)
    return list(first.values())


def touches(record: ObjectRecord) -> list[tuple[GraspRecord, int]]:
    """Grasp and sensor of the widest touch of each of the object's first grasps that have one."""
    widest = [(grasp, int(np.argmax([len(cloud) for cloud in grasp.points]))) for grasp in record.grasps]
    return [(grasp, sensor) for grasp, sensor in widest if grasp.success[sensor]][:TOUCHES]


@products.figure(evaluations="grasps")
def multi_grasp(
    evaluations: Frame, experiments: Experiments, path: Path | str, split: str = "test", resamples: int = RESAMPLES
) -> None:
    """Chamfer distance with more grasps, relative to that with one, for each method and input; bands are 95 % bootstrap
    intervals, dashed lines the paper's values."""
    measured = errors(evaluations, list(experiments), split)
    published = stated("grasps")
    setups = tables.setups(experiments)
    inputs = list(dict.fromkeys(label for _, label in setups))
    figure, panels = _panels(len(inputs))
    for (method, label), members in setups.items():
        axes, keys = panels[inputs.index(label)], dict(sorted(members.items()))
        first = next(iter(keys.values()))
        style = _style(experiments[first])
        _line(axes, keys, _against_first(measured, keys, resamples), style, method)
        if first in published:
            paper = {count: published[key] / published[first] - 1 for count, key in keys.items() if key in published}
            axes.plot([*paper], [*paper.values()], "--", color=style["color"], lw=1, label="the paper's values")
    for axes, label in zip(panels, inputs, strict=True):
        axes.axhline(0, color=PALE, lw=0.8, zorder=0)
        title = f"{label} ({_size(measured, split)})"
        _finish(axes, "Grasps", "Chamfer distance against one grasp", title, percent=True)
    save(figure, path)


@products.figure(selections="grasp_selection", on_request=True)
def grasp_selection(
    selections: Frame, experiments: Experiments, path: Path | str, split: str = "test", resamples: int = RESAMPLES
) -> None:
    """Chamfer distance after each grasp that a strategy chose among those stored, relative to the first, with 95 %
    bootstrap intervals. The oracle takes the grasp that leaves the least error."""
    measured, chosen = tables.selection_errors(selections, experiments, split)
    figure, panels = _panels(len(experiments))
    for axes, (name, setup) in zip(panels, experiments.items(), strict=True):
        of_model = {strategy: keys for (model, strategy), keys in chosen.items() if model == name}
        for colour, (strategy, keys) in zip(COLOURS, of_model.items(), strict=False):
            _line(axes, keys, _against_first(measured, keys, resamples), {"color": colour}, strategy)
        title = f"{setup.method.label}, {setup.input_label}"
        _finish(axes, "Chosen grasps", "Chamfer distance against the first", title, percent=True)
    save(figure, path)


@products.figure(rings="extrapolation")
def error_over_rings(
    rings: Frame, experiments: Experiments, path: Path | str, split: str = "test", resamples: int = RESAMPLES
) -> None:
    """Mean squared distance from the true surface to the prediction, in square rings around each touch: this run's,
    with 95 % bootstrap intervals, for occluded and unoccluded vision; and the paper's. Charts without communication are
    copied into the mesh and change nothing else. Each panel has its own scale."""
    measured = tables.ring_errors(rings, list(experiments), split)
    published = stated("extrapolation")
    images = list(dict.fromkeys(experiment.vision for experiment in experiments.values()))
    figure = new_figure(4.5 * len(images) + 4.5, 5.2)
    *panels, papers = figure.subplots(1, len(images) + 1, gridspec_kw=PANEL | {"bottom": 0.4, "top": 0.9})
    for name, setup in experiments.items():
        place, inputs = images.index(setup.vision), setup.input_label
        estimates = [measured.estimate([tables.ring_key(name, ring)], resamples=resamples) for ring in RINGS]
        method = setup.method.label if setup.touch else f"vision alone, {setup.method.label}"
        _line(panels[place], RINGS, estimates, _style(setup), method)
        if tables.ring_key(name, RINGS[0]) in published:
            paper = [published[tables.ring_key(name, ring)] for ring in RINGS]
            papers.plot(RINGS, paper, "--o", color=COLOURS[2 * place + setup.touch], lw=1, ms=3.5, label=inputs)
    titles = [f"{image} vision ({_size(measured, split)})" for image in images]
    for axes, title in zip([*panels, papers], [*titles, "The paper"], strict=True):
        _finish(axes, "Ring, in sensor sizes", "Mean squared distance, m²", title)
        axes.set_ylim(bottom=0)
        axes.title.set_y(1.03)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
        axes.get_legend().set(loc="upper center", bbox_to_anchor=(0.5, -0.15))  # no place inside is free of lines
    save(figure, path)


def _panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    figure = new_figure(5 * count + 1, 4)
    return figure, figure.subplots(1, count, squeeze=False, sharey=True, gridspec_kw=PANEL)[0]


def _against_first(measured: Errors, keys: Mapping[int, str], resamples: int) -> np.ndarray:
    """Estimates (n, 3) of the relative change of errors against the first of them, and their intervals."""
    first = next(iter(keys.values()))
    pairs = ([key, first] for key in keys.values())
    estimates = [measured.estimate(pair, lambda means: ratio(means) - 1, resamples) for pair in pairs]
    return np.maximum(estimates, -1)  # errors are not negative


def _style(setup: Experiment) -> dict[str, Any]:
    """Colour and dashes of a line: vision alone is dotted."""
    method = setup.method.name
    number = ORDER.index(method) if method in ORDER else list(METHODS).index(method)
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": "-" if setup.touch else ":"}


def _line(axes: Axes, x: Iterable[int], estimates: ArrayLike, style: dict[str, Any], label: str) -> None:
    value, low, high = np.array(estimates).T
    axes.fill_between([*x], low, high, color=style["color"], alpha=0.12, lw=0)
    axes.plot([*x], value, marker="o", lw=1.6, ms=4, label=label, **style)


def _finish(axes: Axes, x: str, y: str, title: str, percent: bool = False) -> None:
    from matplotlib.ticker import MaxNLocator, PercentFormatter

    axes.set_title(title, fontsize=TITLE)
    axes.set_xlabel(x, fontsize=LABEL)
    axes.set_ylabel(y, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 1)
    axes.spines[["top", "right"]].set_visible(False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if percent:
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.legend(fontsize=LABEL - 1.5, frameon=False)


def _size(measured: Errors, split: str) -> str:
    counts = {"object": len(measured.objects), "seed": max(map(len, measured.values.values()))}
    return ", ".join([f"{split} split", *(f"{count} {what}{'s' * (count != 1)}" for what, count in counts.items())])


@products.figure(
    models=tuple(MODELS),
    files=("touch_depth",),
    stores=("meshes", "surface", "touch", "vision"),
)
def reconstructions(dataset: Dataset, models: Mapping[str, Path | str], path: Path | str, threads: int = 1) -> None:
    """The first test object of every class, not chosen, as the models of strategy `template` (ours) of this run
    reconstruct it: from its occluded or unoccluded image, alone and with the touches of one or more grasps, and from
    the touches of one to five grasps alone. All renders are from the images' camera; a row shows the part of them that
    is not empty. Vision charts are blue, the charts of successful touches orange.

    models: folders by experiments; columns are drawn for those of `MODELS` that are given. Touches are those of the
    object's first grasps, an occluded image that of the first. Raises what `Reconstructor` raises.
    """
    from palpate.vision import Renderer  # isort: skip (Blender: before anything that loads embree)
    from palpate.learning.reconstruct import Reconstructor, of_object

    records = first_test_objects(dataset)
    if not records:
        return save_sentence("No usable test object in this run", path)
    renderer = Renderer(samples=SAMPLES, threads=threads)

    def render(record: ObjectRecord, mesh: Mesh) -> np.ndarray:
        camera = record.vision_camera
        camera = replace(camera, focal_length=camera.focal_length * PIXELS / camera.size, size=PIXELS)
        return renderer.render_meshes([mesh], camera=camera).rgb

    columns = {
        "occluded\nimage": [record.grasps[0].occluded for record in records],
        "unoccluded\nimage": [record.unoccluded for record in records],
        "ground\ntruth": [render(record, clay(record)) for record in records],
    }
    for name, (inputs, counts) in MODELS.items():
        if name not in models:
            continue
        reconstructor = Reconstructor(models[name])
        for count in counts:
            pictures = columns[f"{inputs}\n{count} grasp{'s' * (count > 1)}" if count else f"{inputs}\nalone"] = []
            for record in records:
                inputs_of_one = of_object(record, reconstructor.experiment, range(max(count, 1)))
                shape = reconstructor(*inputs_of_one._replace(touches=record.grasps[:count]))
                pictures.append(render(record, coloured(shape)))
    figure, axes = picture_grid([record.name for record in records], list(columns), cell=1.3)
    for row, pictures in zip(axes, zip(*columns.values(), strict=True), strict=True):
        (left, top), (right, bottom) = window(pictures)
        for panel, picture in zip(row, pictures, strict=True):
            panel.imshow(picture, interpolation="antialiased", extent=(0, 1, 1, 0))
            panel.set(xlim=(left, right), ylim=(bottom, top))
    save(figure, path)


def window(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Two opposite corners ((2, 2), shares of width and height) of the smallest square with all that is not the
    background, the colour of the first pixel, in any of some square pictures (p, p, 3)."""
    filled = [np.argwhere((picture != picture[0, 0]).any(axis=2))[:, ::-1] / len(picture) for picture in pictures]
    low, high = np.concatenate(filled).min(axis=0), np.concatenate(filled).max(axis=0)
    half = MARGIN * (high - low).max() / 2
    return np.array([(low + high) / 2 - half, (low + high) / 2 + half])


def coloured(shape: Shape) -> Mesh:
    """A reconstruction with the charts of successful touches in another colour."""
    from palpate.learning.reconstruct import TOUCH_COLOUR, VISION_COLOUR

    return Mesh(shape.vertices, shape.faces, np.where(shape.touch[:, None], TOUCH_COLOUR, VISION_COLOUR))


def clay(record: ObjectRecord) -> Mesh:
    """The object's own surface, in clay; points of it for a dataset without meshes."""
    if not (record.mesh / "visual.glb").exists():
        return spheres(record.points, radius=0.004, colours=CLAY, segments=1)
    mesh = load_visual(record.mesh)
    return Mesh(mesh.vertices + OBJECT_POSITION, mesh.faces, np.array(CLAY))
