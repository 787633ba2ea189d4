"""A run's presses: their table, a figure of readings at rising forces, and the same as an animation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.results import products
from palpate.results.bootstrap import ratio_interval
from palpate.results.page import next_page, picture_grid, save, save_animation, save_sentence

if TYPE_CHECKING:
    from pandas import DataFrame

    from palpate.dataset import Dataset
    from palpate.dataset.reader import PressRecord

CLASSES = 4  # whose presses a figure shows, at most
ARROWS, STRETCH = 12, 15  # across a picture of sideways motion; their length over the motion's
FRAMES, PAUSE, REST = 12, 150, 1200  # of the animation; ms that one is shown, and the last one
NOTHING = "No object of this run was pressed"


@products.table(stores=("surface", "press"), category="Dataset", simulated=True)
def presses(dataset: Dataset) -> DataFrame:
    """Presses by class and force (N), means over presses with 95 % bootstrap intervals over objects: area of contact
    within the image (mm²), how far the sensor goes on from its first touch (`depth`, mm), and the percentage of the
    force that is within the image. `pressure` is the mean of each press's largest (kPa), `strain` the largest of all.
    """
    import pandas as pd

    rows = []
    for record in dataset:
        for press in record.presses:
            area = (press.pressure > 0).sum(axis=(1, 2)) * np.prod(press.sensor.pixel)
            pressure = press.pressure.max(axis=(1, 2)).astype(float) / 1e3
            values = {"force": press.force, "area": 1e6 * area, "depth": 1e3 * press.approach, "one": 1}
            values |= {"inside_percent": 100 * press.inside, "pressure": pressure, "strain": press.strain}
            rows.append(pd.DataFrame({"object": record.name, "class": record.class_name} | values))
    if not rows:
        return pd.DataFrame({"class": [], "force": []})
    measured, table = pd.concat(rows), []
    for name in [*measured["class"].unique(), "total"]:
        members = measured if name == "total" else measured[measured["class"] == name]
        for force, chosen in members.groupby("force"):
            by_object = chosen.groupby("object", sort=False)
            sums, classes = by_object[["area", "depth", "inside_percent", "one"]].sum(), by_object["class"].first()
            row: dict[str, Any] = {"class": name, "force": force, "objects": len(sums), "presses": len(chosen)}
            for column, most in {"area": np.inf, "depth": np.inf, "inside_percent": 100}.items():
                row |= ratio_interval(sums[column], sums["one"], classes).within(0, most).columns(column)
            table.append(row | {"pressure": chosen["pressure"].mean(), "strain": chosen["strain"].max()})
    return pd.DataFrame(table).round(3)


@products.figure(name="presses", stores=("surface", "press"), category="Dataset", simulated=True)
def draw_presses(dataset: Dataset, path: Path | str) -> None:
    """Presses of a sensor onto objects, at rising forces: what it reads, and at the greatest force the pressure (white
    is none; each to its own largest) and how the gel's face moves sideways (arrows, 15 times as long as the motion).

    Of each class that press whose reading differs most from that of the untouched gel.
    """
    shown = example_presses(dataset)
    if not shown:
        return save_sentence(NOTHING, path)
    names = [f"{press.object.name}, press {press.number}" for press in shown]
    forces = [f"{force:g} N" for force in shown[0].force]
    figure, axes = picture_grid(names, [*forces, f"pressure at {forces[-1]}", f"motion at {forces[-1]}"])
    for press, (*readings, pressure, motion) in zip(shown, axes, strict=True):
        for panel, reading in zip(readings, press.reading, strict=True):
            panel.imshow(reading, interpolation="antialiased")
        pressure.imshow(press.pressure[-1], cmap="Reds", vmin=0, interpolation="antialiased")
        rows, columns = (np.linspace(0, n - 1, ARROWS).round().astype(int) for n in press.sensor.resolution)
        y, z = press.displacement[-1][np.ix_(rows, columns)].transpose(2, 0, 1)
        motion.imshow(press.reading[-1], alpha=0.3, interpolation="antialiased")
        height, width = (STRETCH / edge for edge in press.sensor.pixel)
        motion.quiver(columns, rows, y * width, z * height, angles="xy", scale_units="xy", scale=1, width=0.008)
        for panel in (pressure, motion):
            panel.spines[:].set(visible=True, color="#bdbdbd")
    save(figure, path)


@products.figure(form="gif", stores=("meshes", "surface", "press"), category="Dataset", simulated=True)
def pressing(dataset: Dataset, path: Path | str) -> None:
    """A sensor that is pressed onto objects with a rising force: what it reads, and the pressure on its gel (white is
    none, dark red the largest of each).

    The presses of `presses`, pressed anew at more forces.
    """
    from palpate.mesh import OBJECT_POSITION, load_geometry
    from palpate.touch import RayCaster, face_sensor, press_sensors

    shown = example_presses(dataset)
    if not shown:
        return save_sentence(NOTHING, path)
    forces = max(shown[0].force) * np.linspace(1 / FRAMES, 1, FRAMES)
    films = []
    for press in shown:
        tracer = RayCaster(load_geometry(press.object.mesh), OBJECT_POSITION, face_sensor(press.sensor))
        poses = (np.broadcast_to(place, (FRAMES, *place.shape)) for place in (press.position, press.rotation))
        films.append(press_sensors(tracer, press.sensor, *poses, forces))
    figure, axes = picture_grid([f"{forces[0]:.2f} N", "pressure"], [press.object.name for press in shown], cell=1.25)
    pages = []
    for number, force in enumerate(forces):
        axes[0, 0].set_ylabel(f"{force:.2f} N")
        for film, (reading, pressure) in zip(films, axes.T, strict=True):
            reading.imshow(film["reading"][number])
            pressure.imshow(film["pressure"][number], cmap="Reds", vmin=0, vmax=film["pressure"].max())
        pages.append(next_page(figure))
    save_animation(pages, path, PAUSE, REST)


def example_presses(dataset: Dataset) -> list[PressRecord]:
    """Of each class, `CLASSES` at most, the press whose last reading differs most from that of the untouched gel."""
    chosen: dict[str, tuple[float, PressRecord]] = {}
    empty: dict[str, np.ndarray] = {}  # of each batch
    for record in dataset:
        if record.class_name in chosen or len(chosen) < CLASSES:
            for press in record.presses:
                if record.batch not in empty:
                    empty[record.batch] = press.empty_reading.astype(float)
                difference = np.abs(press.reading[-1] - empty[record.batch]).mean()
                if difference > chosen.get(record.class_name, (-1, press))[0]:
                    chosen[record.class_name] = difference, press
    return [press for _, press in chosen.values()]
