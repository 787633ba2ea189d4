"""Figures of a run's dataset: a data point, and sheets of examples and presses, which show what is stored; steps and
closing of a grasp, which Blender renders; the sheet of `palpate check`. Without objects a figure says so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from palpate import vision
from palpate.camera import Camera, looking_at
from palpate.mesh import DIAGONAL, OBJECT_POSITION, load_geometry
from palpate.results import products
from palpate.results.page import (
    COLOURS,
    INK,
    LABEL,
    PALE,
    SENSOR_COLOURS,
    TITLE,
    new_figure,
    next_page,
    picture_grid,
    save,
    save_animation,
    save_sentence,
    styled,
)
from palpate.scene import Scene
from palpate.vision.geom import triangles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from palpate.dataset import Dataset, GraspRecord, ObjectRecord
    from palpate.dataset.reader import PressRecord
    from palpate.hand import Hand
    from palpate.sensor import Sensor

SITE_POINT = 1.6  # points, diameter of a touched point as drawn, larger than it is
SITE_STRIDE = 13  # of touched points, those drawn
BEHIND = 2  # widths of a pixel: a point so far behind what the camera saw at its pixel's centre is hidden
HIDDEN = 0.35  # share of its colour that such a point has, over white: points lie too close for opacity
UNDER_POINTS = 0.45  # opacity of an image under touched points
MARGIN = 1.1  # of the part of an image that is shown, over the object
EXAMPLES = 6  # objects on a sheet
CANDIDATES = 60  # grasps looked at for the data point
PIXELS, STEP_PIXELS = 208, 364  # of a frame of a closing, of a step of a grasp: as many as the figures' panels have
FRAMES = 20  # at most, of a closing
DISTANCE = 2.2  # m from what is looked at to the camera
HOLDING = 1.04  # of the field of view over what it must hold
AZIMUTHS, ELEVATION = range(0, 360, 30), 25  # degrees, of the views that are looked at
LIFT = 0.001  # m: how far off a surface a ray to the camera starts
BACK = 0.2  # m from the hand that is loaded to where it is placed
PAUSE, REST = 130, 1500  # ms that a frame is shown, and the last one
CLASSES = 4  # whose presses a figure shows, at most
ARROWS, STRETCH = 12, 15  # across a picture of sideways motion; their length over the motion's
PRESSINGS = 12  # forces of the animation of a press
NO_PRESS = "No object of this run was pressed"
# Of the sheet of `palpate check`.
AXES = ("#D62728", "#2CA02C", "#1F77B4")  # of x, y and z, as most viewers colour them
GEL, END = COLOURS[4], COLOURS[3]
LENGTH = 0.012  # m, of the axes
COLUMNS = 6  # pictures in a row
VIEWS = (-35, 145)  # degrees of azimuth
LEGEND = "x red, y green, z blue; orange: the gel's face; lines: from the sensor plane to the end of its range"
WIDTH, HAND, ROW = 11.0, 5.0, 2.1  # inches: of the sheet; heights of the hand and of a row of pictures
STEPS = (
    "1  The object",
    "2  The hand is loaded, open",
    "3  The palm is placed tangent\nto a random point of the surface",
    "4  The fingers close until\nthe surface stops them",
)


@products.figure(stores=("dataset",), category="Dataset", simulated=True)
def data_point(dataset: Dataset, path: Path | str) -> None:
    """One data point: the camera's image of the object alone, and of the object in the hand; what the touch sensors
    read (faded where a sensor touched nothing); and the touched points on the object, in the colours of their readings
    (faint where the object hides them from the camera)."""
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    save(_sheet([grasp]), path)


@products.figure(name="examples_{class_name}", stores=("dataset",), category="Dataset", simulated=True)
def examples(dataset: Dataset, class_name: str, path: Path | str) -> None:
    """Examples of class {class_name}, taken evenly from its objects and not chosen: images, readings of the sensors
    (faded where a sensor touched nothing), and the touched points on the object, in the colours of their readings
    (faint where the object hides them from the camera).

    A row an object, each with another of its grasps: the first object's first, the second's second, ..."""
    objects = dataset.of_class(class_name).objects if class_name in dataset.classes else []
    if not objects:
        return save_sentence(f"No usable object of class {class_name} in this run", path)
    chosen = [dataset[objects[number]].grasps for number in _evenly(len(objects), EXAMPLES)]
    save(_sheet([of_object[row % len(of_object)] for row, of_object in enumerate(chosen)]), path)


@products.figure(stores=("dataset",), category="Dataset", simulated=True)
def grasp_steps(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 16) -> None:
    """The steps of a grasp: the object; the hand, loaded open; its palm placed tangent to a random point of the
    surface, at a random distance and turned at random; its fingers, driven towards the surface by inverse kinematics,
    stopped by contact. Steps 3 and 4 are a stored grasp, the same as the data point's."""
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    hand, loaded = grasp.object.hand, grasp.palm_pose.copy()
    loaded[:3, 3] -= BACK * (grasp.palm_pose @ hand.palm_anchor)[:3, 0]
    opened = [hand.forward(palm, hand.open_joint_positions) for palm in (loaded, grasp.palm_pose)]
    figure, (panels,) = picture_grid([""], STEPS, cell=2.8)
    pictures = rendered(grasp, np.array([*opened, grasp.link_pose]), STEP_PIXELS, samples, threads)
    for panel, picture in zip(panels, pictures, strict=True):
        panel.imshow(picture, interpolation="antialiased")
    save(figure, path)


@products.figure(
    form="gif", stores=("surface", "grasps", "touch", "frames", "vision"), category="Dataset", simulated=True
)
def closing(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 16) -> None:
    """A closing hand, with what its sensors read, slowed down: frames of the grasp of the data point."""
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    frames, pages = grasp.frames, []
    chosen = _evenly(len(frames.time), FRAMES)
    # A frame, which passes in a moment, gets a quarter of the samples.
    _, *pictures = rendered(grasp, frames.link_pose[chosen], PIXELS, max(samples // 4, 1), threads)
    figure, ((picture, *readings),) = picture_grid(["0.00 s"], ("", *(grasp.sensors if frames.has_touch else ())))
    for number, image in zip(chosen, pictures, strict=True):
        picture.set_ylabel(f"{frames.time[number]:.2f} s")
        picture.imshow(image)
        for sensor, panel in enumerate(readings):
            _draw_reading(panel, frames.reading[number, sensor], frames.success[number, sensor], sensor)
        pages.append(next_page(figure))
    save_animation(pages, path, PAUSE, REST)


def example_grasp(dataset: Dataset) -> GraspRecord | None:
    """The grasp that shows what a data point is: of those with most touches the one of whose object most pixels are in
    sight beside the hand. Looks at no more than `CANDIDATES`, taken evenly; None for a dataset without objects."""
    if not len(dataset):
        return None
    touches = dataset.array("touch", "success")[:].sum(axis=2)
    best = np.argwhere(touches == touches.max())
    candidates = [dataset[int(row)].grasps[grasp] for row, grasp in best[_evenly(len(best), CANDIDATES)]]
    return max(candidates, key=lambda grasp: (grasp.occluded_mask > 0).mean())


def rendered(grasp: GraspRecord, link_pose: np.ndarray, size: int, samples: int, threads: int) -> list[np.ndarray]:
    """Pictures (size, size, 3) of a grasp's object, alone and with the hand in poses (n, L, 4, 4) of its links. All are
    from one camera, which looks from where most of the hand in its last pose is in sight, and holds every pose."""
    hand, renderer = grasp.object.hand, vision.Renderer(samples, threads=threads, centres=False)
    drawn = [hand_points(hand, pose) for pose in link_pose]
    points, towards = np.concatenate([grasp.object.points, *drawn]), clear_view(grasp.object, drawn[-1])
    scene = Scene(grasp.object.mesh, hand, link_pose, camera=camera_holding(points, towards, size))
    alone, held = renderer.render(scene)
    return [image.rgb for image in (alone, *held)]


def clear_view(record: ObjectRecord, points: np.ndarray) -> np.ndarray:
    """(3,) unit vector to a camera: amid the directions in which the object hides least of points (n, 3)."""
    from palpate.surface.embree import RayMesh  # embree: after Blender

    mesh, tilt = RayMesh(load_geometry(record.mesh)), np.radians(ELEVATION)
    turns = np.radians(AZIMUTHS)
    level = np.cos(tilt) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    directions = np.column_stack([level, np.full(len(turns), np.sin(tilt))])
    hidden = []
    for towards in directions:
        starts = np.reshape(points, (-1, 3)) - OBJECT_POSITION + LIFT * towards
        hidden.append(mesh.blocked(starts, np.broadcast_to(2 * DIAGONAL * towards, starts.shape), reach=1).sum())
    best = directions[np.equal(hidden, min(hidden))]
    return best[np.argmax(best @ best.mean(axis=0))]


def camera_holding(points: np.ndarray, towards: np.ndarray, size: int) -> Camera:
    """A camera of `size` pixels, in direction `towards` (3,) from the middle of points (n, 3), that holds them all."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    camera = looking_at(middle, middle + DISTANCE * towards, size)
    reach = np.abs(camera.project(points)[0] - size / 2).max()
    return replace(camera, focal_length=camera.focal_length * size / 2 / (HOLDING * reach))


def hand_points(hand: Hand, link_pose: np.ndarray) -> np.ndarray:
    return np.concatenate([points for points, _ in posed_geoms(hand, link_pose)])


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


def _sheet(grasps: Sequence[GraspRecord]) -> Figure:
    """A row a grasp: both images, the readings, and the touched points."""
    names = [f"{grasp.object.name}, grasp {grasp.number}" for grasp in grasps]
    figure, axes = picture_grid(names, ("unoccluded", "occluded", *grasps[0].sensors, "touched points"))
    for grasp, (alone, held, *readings, touched) in zip(grasps, axes, strict=True):
        alone.imshow(grasp.object.unoccluded, interpolation="antialiased")
        held.imshow(grasp.occluded, interpolation="antialiased")
        for sensor, panel in enumerate(readings):
            _draw_reading(panel, grasp.reading[sensor], grasp.success[sensor], sensor)
        _draw_touched(touched, grasp)
    return figure


def _draw_reading(axes: Axes, reading: np.ndarray, touched: bool, sensor: int) -> None:
    """A sensor's image, framed in the colour of its points; an untouched one is faded."""
    axes.imshow(reading, interpolation="antialiased", alpha=1 if touched else 0.4)
    axes.spines[:].set(visible=touched, color=SENSOR_COLOURS[sensor % len(SENSOR_COLOURS)], linewidth=2.2)


def _draw_touched(axes: Axes, grasp: GraspRecord) -> None:
    """The touched points on the image of the object alone, pale and grey, as its camera sees them."""
    from matplotlib.colors import to_rgb

    alone, camera = grasp.object, grasp.object.vision_camera
    grey = Image.fromarray(alone.unoccluded).convert("LA").convert("RGBA")
    axes.imshow(grey, alpha=UNDER_POINTS, interpolation="antialiased")
    for sensor in np.flatnonzero(grasp.success):
        pixels, depth = camera.project(grasp.points[sensor][::SITE_STRIDE])
        column, row = np.clip(np.nan_to_num(pixels).astype(int), 0, camera.size - 1).T
        behind = depth - alone.unoccluded_depth[row, column] > BEHIND * depth / camera.focal_length
        full = np.array(to_rgb(SENSOR_COLOURS[sensor % len(SENSOR_COLOURS)]))
        colour = 1 - np.where(behind, HIDDEN, 1)[:, None] * (1 - full)
        x, y = (pixels - 0.5).T  # the first pixel's centre is at 0
        axes.scatter(x, y, s=SITE_POINT**2, c=colour, linewidths=0)
    seen = np.argwhere(alone.unoccluded_mask)
    low, high = seen.min(axis=0), seen.max(axis=0)
    (row, column), reach = (low + high) / 2, MARGIN * (high - low).max() / 2
    axes.set(xlim=(column - reach, column + reach), ylim=(row + reach, row - reach))


@products.figure(name="presses", stores=("surface", "press"), category="Dataset", simulated=True)
def draw_presses(dataset: Dataset, path: Path | str) -> None:
    """Presses of a sensor onto objects, at rising forces: what it reads, and at the greatest force the pressure (white
    is none; each to its own largest) and how the gel's face moves sideways (arrows, 15 times as long as the motion).

    Of each class that press whose reading differs most from that of the untouched gel.
    """
    shown = example_presses(dataset)
    if not shown:
        return save_sentence(NO_PRESS, path)
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
            panel.spines[:].set(visible=True, color=PALE)
    save(figure, path)


@products.figure(form="gif", stores=("meshes", "surface", "press"), category="Dataset", simulated=True)
def pressing(dataset: Dataset, path: Path | str) -> None:
    """A sensor that is pressed onto objects with a rising force: what it reads, and the pressure on its gel (white is
    none, dark red the largest of each).

    The presses of `presses`, pressed anew at more forces.
    """
    from palpate.touch import RayCaster, face_sensor, press_sensors

    shown = example_presses(dataset)
    if not shown:
        return save_sentence(NO_PRESS, path)
    forces = max(shown[0].force) * np.linspace(1 / PRESSINGS, 1, PRESSINGS)
    films = []
    for press in shown:
        tracer = RayCaster(load_geometry(press.object.mesh), OBJECT_POSITION, face_sensor(press.sensor))
        poses = (np.broadcast_to(place, (len(forces), *place.shape)) for place in (press.position, press.rotation))
        films.append(press_sensors(tracer, press.sensor, *poses, forces))
    figure, axes = picture_grid([f"{forces[0]:.2f} N", "pressure"], [press.object.name for press in shown], cell=1.25)
    pages = []
    for number, force in enumerate(forces):
        axes[0, 0].set_ylabel(f"{force:.2f} N")
        for film, (reading, pressure) in zip(films, axes.T, strict=True):
            reading.imshow(film["reading"][number])
            pressure.imshow(film["pressure"][number], cmap="Reds", vmin=0, vmax=film["pressure"].max())
        pages.append(next_page(figure))
    save_animation(pages, path, 150, 1200)


def example_presses(dataset: Dataset) -> list[PressRecord]:
    """Of each class, `CLASSES` at most, the press whose last reading differs most from that of the untouched gel."""
    chosen: dict[str, tuple[float, PressRecord]] = {}
    for record in dataset:
        if record.class_name in chosen or len(chosen) < CLASSES:
            for press in record.presses:
                difference = np.abs(press.reading[-1] - press.empty_reading.astype(float)).mean()
                if difference > chosen.get(record.class_name, (-1, press))[0]:
                    chosen[record.class_name] = difference, press
    return [press for _, press in chosen.values()]


def _evenly(count: int, most: int) -> np.ndarray:
    """At most `most` of the numbers 0 ... count - 1, evenly spaced, in order."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).round().astype(int)
