"""Figures of one grasp of a run's dataset that Blender renders: its steps, and its closing.

Import it before anything that loads embree (trimesh does), because it loads Blender. A dataset without objects gives a
figure that says so.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.vision import blender

blender.load()

from palpate.camera import Camera, looking_at  # noqa: E402  (Blender comes before what loads embree)
from palpate.dataset.reader import Dataset, GraspRecord, ObjectRecord  # noqa: E402
from palpate.mesh import DIAGONAL, OBJECT_POSITION, load_visual  # noqa: E402
from palpate.results import products  # noqa: E402
from palpate.results.dataset_figures import draw_reading, evenly, example_grasp  # noqa: E402
from palpate.results.hand_sheet import posed_geoms  # noqa: E402
from palpate.results.page import figure_image, picture_grid, save, save_sentence, styled  # noqa: E402
from palpate.scene import Scene  # noqa: E402
from palpate.surface.embree import RayMesh  # noqa: E402
from palpate.vision import Renderer  # noqa: E402

PIXELS, STEP_PIXELS = 208, 364  # of a frame of a closing, of a step of a grasp: as many as the figures' panels have
FRAMES = 20  # at most, of a closing
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
def grasp_steps(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 16) -> None:
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
    figure, (panels,) = picture_grid([""], STEPS, cell=2.8)
    pictures = rendered(grasp, np.array([*opened, grasp.link_pose]), STEP_PIXELS, Renderer(samples, threads=threads))
    for panel, picture in zip(panels, pictures, strict=True):
        panel.imshow(picture, interpolation="antialiased")
    save(figure, path)


@products.figure(
    form="gif", stores=("surface", "grasps", "touch", "frames", "vision"), category="Dataset", simulated=True
)
@styled
def closing(dataset: Dataset, path: Path | str, threads: int = 1, samples: int = 16) -> None:
    """A closing hand, with what its sensors read, slowed down: frames of the grasp of the data point.

    threads: of the CPU, samples: a pixel, for the renderer; a frame, which passes in a moment, gets a quarter of them.
    """
    grasp = example_grasp(dataset)
    if grasp is None:
        return save_sentence("No usable object in this run", path)
    frames, pages = grasp.frames, []
    chosen, renderer = evenly(len(frames.time), FRAMES), Renderer(max(samples // 4, 1), threads=threads)
    _, *pictures = rendered(grasp, np.asarray(frames.link_pose)[chosen], PIXELS, renderer)
    figure, ((picture, *readings),) = picture_grid(["0.00 s"], ("", *(grasp.sensors if frames.has_touch else ())))
    for number, image in zip(chosen, pictures, strict=True):
        picture.set_ylabel(f"{frames.time[number]:.2f} s")
        picture.imshow(image)
        for sensor, panel in enumerate(readings):
            draw_reading(panel, frames.reading[number, sensor], frames.success[number, sensor], sensor)
        pages.append(figure_image(figure))
        figure.set_layout_engine("none")  # all pages are laid out as the first is
        for panel in figure.axes:
            panel.images[0].remove()
    palette = pages[-1].quantize(255)  # of all: else colours flicker, and every pixel is written again
    first, *others = (page.quantize(palette=palette) for page in pages)
    times = [PAUSE] * len(others) + [REST]
    first.save(path, "GIF", save_all=True, append_images=others, duration=times, loop=0, optimize=True)


def rendered(grasp: GraspRecord, link_pose: np.ndarray, size: int, renderer: Renderer) -> list[np.ndarray]:
    """Pictures (size, size, 3) of a grasp's object, alone and with the hand in poses (n, L, 4, 4) of its links.

    All are from one camera, which looks from where most of the hand in its last pose is in sight, and holds every pose.
    """
    hand = grasp.object.hand
    drawn = [hand_points(hand, pose) for pose in link_pose]
    points, towards = np.concatenate([grasp.object.points, *drawn]), clear_view(grasp.object, drawn[-1])
    scene = Scene(grasp.object.mesh, hand, link_pose, camera=camera_holding(points, towards, size))
    alone, held = renderer.render(scene)
    return [image.rgb for image in (alone, *held)]


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
