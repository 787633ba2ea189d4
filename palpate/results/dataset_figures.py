"""Figures of a run's dataset: one data point, sheets of examples, steps and closing of a grasp. Blender renders.

Import it before anything that loads embree (trimesh does), because it loads Blender. A dataset, or a class, without
objects gives a figure that says so.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from palpate.vision import blender

blender.load()

from palpate.camera import Camera, looking_at  # noqa: E402  (Blender comes before what loads embree)
from palpate.dataset.reader import Dataset, GraspRecord, ObjectRecord  # noqa: E402
from palpate.mesh import DIAGONAL, OBJECT_POSITION, load_visual, mesh_file  # noqa: E402
from palpate.results import products  # noqa: E402
from palpate.results.hand_sheet import posed_geoms  # noqa: E402
from palpate.results.page import COLOURS, figure_image, picture_grid, save, save_sentence, styled  # noqa: E402
from palpate.surface.embree import RayMesh  # noqa: E402
from palpate.vision import Mesh, Renderer, spheres  # noqa: E402

CLAY = (0.93, 0.92, 0.90)  # sRGB of a surface without its materials
POINT = 0.004  # m, radius of a surface point, where there is no mesh
SITE_COLOURS = [COLOURS[number] for number in (1, 0, 2, 3, 4, 5)]  # in the order of the sensors
SITE_POINT, SITE_STRIDE = 0.004, 13  # m, radius of a touched point as drawn, larger than it is; of points, those drawn
EXAMPLES = 6  # objects on a sheet
CANDIDATES = 60  # grasps looked at for the data point
PIXELS, STEP_PIXELS = 240, 420  # of a surface, of a step of a grasp
DISTANCE = 2.2  # m from what is looked at to the camera
MARGIN = 1.04  # of the field of view over what it must hold
AZIMUTHS, ELEVATION = range(0, 360, 30), 25  # degrees, of the views that are looked at
LIFT = 0.001  # m: how far off a surface a ray to the camera starts
BACK = 0.2  # m from the hand that is loaded to where it is placed
PAUSE, REST = 130, 1500  # ms that a frame is shown, and the last one
STEPS = (
    "1  The object",
    "2  The hand is loaded, open",
    "3  The palm is placed tangent\nto a random point of the surface",
    "4  The fingers close until\nthe surface stops them",
)


@products.figure(stores=("dataset",), category="Dataset", simulated=True)
@styled
def data_point(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 32) -> None:
    """One data point: the camera's image of the object alone, and of the object in the hand; what the touch sensors
    read (faded where a sensor touched nothing); and the object's surface with the touched points in the colours of
    their readings, seen from where most of these points are in sight.

    The grasp is the one that `example_grasp` picks. threads: of the CPU, samples: a pixel, for the renderer.
    """
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    save(_sheet([grasp], Renderer(samples=samples, threads=threads)), path)


@products.figure(name="examples_{class_name}", stores=("dataset",), category="Dataset", simulated=True)
@styled
def examples(dataset: Dataset, class_name: str, path: Path | str, threads: int = 1, samples: int = 32) -> None:
    """Examples of class {class_name}, taken evenly from its objects and not chosen: images, readings of the sensors
    (faded where a sensor touched nothing), and the surface with the touched points in the colours of their readings.

    A row an object, each with another of its grasps: the first object's first, the second's second, ... threads: of
    the CPU, samples: a pixel, for the renderer.
    """
    objects = dataset.of_class(class_name).objects if class_name in dataset.classes else []
    if not objects:
        return save_sentence(f"No usable object of class {class_name} in this run", path)
    chosen = [dataset[objects[number]].grasps for number in _evenly(len(objects), EXAMPLES)]
    grasps = [of_object[row % len(of_object)] for row, of_object in enumerate(chosen)]
    save(_sheet(grasps, Renderer(samples=samples, threads=threads)), path)


@products.figure(stores=("dataset",), category="Dataset", simulated=True)
@styled
def grasp_steps(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 32) -> None:
    """The steps of a grasp: the object; the hand, loaded open; its palm placed tangent to a random point of the
    surface, at a random distance and turned at random; its fingers, driven towards the surface by inverse kinematics,
    stopped by contact. Steps 3 and 4 are a stored grasp, the same as the data point's.

    threads: of the CPU, samples: a pixel, for the renderer.
    """
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    hand, loaded = grasp.object.hand, grasp.palm_pose.copy()
    loaded[:3, 3] -= BACK * (grasp.palm_pose @ hand.palm_anchor)[:3, 0]
    opened = [hand.forward(palm, hand.open_joint_positions) for palm in (loaded, grasp.palm_pose)]
    poses = (None, *opened, grasp.link_pose)
    drawn = [hand_points(hand, pose) for pose in poses[1:]]
    points, towards = np.concatenate([grasp.object.points, *drawn]), clear_view(grasp.object, drawn[-1])
    camera = camera_holding(points, towards, STEP_PIXELS)
    renderer = Renderer(samples=samples, threads=threads)
    seen = {"visual_glb": mesh_file(grasp.object.mesh, "visual.glb"), "camera": camera}
    figure, (panels,) = picture_grid([""], STEPS, cell=2.8)
    for panel, pose in zip(panels, poses, strict=True):
        image = renderer.render_meshes(**seen, hand=None if pose is None else hand, link_pose=pose)
        panel.imshow(image.rgb, interpolation="antialiased")
    save(figure, path)


@products.figure(
    form="gif", stores=("surface", "grasps", "touch", "frames", "vision"), category="Dataset", simulated=True
)
@styled
def closing(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 32) -> None:
    """A closing hand, with what its sensors read, slowed down: the frames of the grasp of the data point.

    threads: of the CPU, samples: a pixel, for the renderer.
    """
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    hand, frames = grasp.object.hand, grasp.frames
    drawn = [hand_points(hand, frames.link_pose[number]) for number in (0, -1)]
    points, towards = np.concatenate([grasp.object.points, *drawn]), clear_view(grasp.object, drawn[-1])
    seen = {"visual_glb": mesh_file(grasp.object.mesh, "visual.glb"), "hand": hand}
    seen["camera"] = camera_holding(points, towards, PIXELS)
    renderer, pages = Renderer(samples=samples, threads=threads), []
    for number, link_pose in enumerate(frames.link_pose):
        sensors = grasp.sensors if frames.has_touch else ()
        figure, ((picture, *readings),) = picture_grid([f"{frames.time[number]:.2f} s"], ("", *sensors))
        picture.imshow(renderer.render_meshes(**seen, link_pose=link_pose).rgb)
        for sensor, panel in enumerate(readings):
            _draw_reading(panel, frames.reading[number, sensor], frames.success[number, sensor], sensor)
        pages.append(figure_image(figure))
    palette = pages[-1].quantize(255)  # of all: else colours flicker, and every pixel is written again
    first, *others = (page.quantize(palette=palette) for page in pages)
    times = [PAUSE] * len(others) + [REST]
    first.save(path, "GIF", save_all=True, append_images=others, duration=times, loop=0, optimize=True)


def example_grasp(dataset: Dataset) -> GraspRecord | None:
    """The grasp that shows what a data point is: of those with most touches the one of whose object most pixels are in
    sight beside the hand. Looks at no more than `CANDIDATES`, taken evenly; None for a dataset without objects."""
    if not len(dataset):
        return None
    touches = dataset.array("touch", "success")[:].sum(axis=2)
    best = np.argwhere(touches == touches.max())
    candidates = [dataset[int(row)].grasps[grasp] for row, grasp in best[_evenly(len(best), CANDIDATES)]]
    return max(candidates, key=lambda grasp: (grasp.occluded_mask > 0).mean())


def clay(record: ObjectRecord) -> Mesh:
    """The object's own surface, in clay; points of it for a dataset without meshes."""
    if not (record.mesh / "visual.glb").exists():
        return spheres(record.points, POINT, CLAY, segments=1)
    mesh = load_visual(record.mesh)
    return Mesh(mesh.vertices + OBJECT_POSITION, mesh.faces, CLAY)


def clear_view(record: ObjectRecord, points: np.ndarray) -> np.ndarray:
    """(3,) unit vector from the object to a camera: in the middle of the directions in which the object hides least of
    the points (n, 3), world frame."""
    mesh, tilt = RayMesh(load_visual(record.mesh)), np.radians(ELEVATION)
    turns = np.radians(AZIMUTHS)
    level = np.cos(tilt) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    directions = np.column_stack([level, np.full(len(turns), np.sin(tilt))])
    starts = (np.reshape(points, (-1, 3)) - OBJECT_POSITION + LIFT * towards for towards in directions)
    hidden = [
        mesh.blocked(start, np.broadcast_to(2 * DIAGONAL * towards, start.shape), reach=1).sum()
        for start, towards in zip(starts, directions, strict=True)
    ]
    best = directions[np.equal(hidden, min(hidden))]
    return best[np.argmax(best @ best.mean(axis=0))]


def camera_holding(points: np.ndarray, towards: np.ndarray, size: int) -> Camera:
    """A camera of `size` pixels that looks from direction `towards` (3,) at the middle of points (n, 3) and holds them
    all."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    camera = looking_at(middle, middle + DISTANCE * towards, size)
    reach = np.abs(camera.project(points)[0] - size / 2).max()
    return replace(camera, focal_length=camera.focal_length * size / 2 / (MARGIN * reach))


def hand_points(hand, link_pose: np.ndarray) -> np.ndarray:
    """(n, 3) vertices of the drawn hand in the world."""
    return np.concatenate([points for points, _ in posed_geoms(hand, link_pose)])


def _sheet(grasps: Sequence[GraspRecord], renderer: Renderer) -> Figure:
    """A row a grasp: both images, the readings, and the surface with the touched points."""
    names = [f"{grasp.object.name}, grasp {grasp.number}" for grasp in grasps]
    figure, axes = picture_grid(names, ("unoccluded", "occluded", *grasps[0].sensors, "touched points"))
    for grasp, (alone, held, *readings, surface) in zip(grasps, axes, strict=True):
        alone.imshow(grasp.object.unoccluded, interpolation="antialiased")
        held.imshow(grasp.occluded, interpolation="antialiased")
        for sensor, panel in enumerate(readings):
            _draw_reading(panel, grasp.reading[sensor], grasp.success[sensor], sensor)
        surface.imshow(_touched_surface(grasp, renderer), interpolation="antialiased")
    return figure


def _draw_reading(axes: Axes, reading: np.ndarray, touched: bool, sensor: int) -> None:
    """A sensor's image, framed in the colour of its points; an untouched one is faded."""
    axes.imshow(reading, interpolation="antialiased", alpha=1 if touched else 0.4)
    axes.spines[:].set(visible=touched, color=_site_colour(sensor), linewidth=2.2)


def _touched_surface(grasp: GraspRecord, renderer: Renderer) -> np.ndarray:
    """(s, s, 3) picture of the object in clay with the touched points on it."""
    body = clay(grasp.object)
    sites = [
        spheres(cloud[::SITE_STRIDE], SITE_POINT, to_rgb(_site_colour(sensor)), segments=1)
        for sensor, cloud in enumerate(grasp.points)
        if len(cloud)
    ]
    towards = clear_view(grasp.object, np.concatenate(grasp.points))
    camera = camera_holding(np.asarray(body.vertices), towards, PIXELS)
    return renderer.render_meshes([body, *sites], camera=camera).rgb


def _site_colour(sensor: int) -> str:
    return SITE_COLOURS[sensor % len(SITE_COLOURS)]


def _evenly(count: int, most: int) -> np.ndarray:
    """At most `most` of the numbers 0 ... count - 1, evenly spaced, in order."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).round().astype(int)
