"""The figures of the four steps of a grasp and of its closing, rendered by Blender.

Import it before anything that loads embree (trimesh does), because it loads Blender.
"""

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from palpate.vision import blender

blender.load()

from palpate.camera import Camera, looking_at  # noqa: E402
from palpate.dataset import Dataset  # noqa: E402
from palpate.dataset.reader import FramesRecord, GraspRecord  # noqa: E402
from palpate.hand import Hand  # noqa: E402  (Blender comes before what loads embree)
from palpate.mesh import DIAGONAL, OBJECT_POSITION, load_visual, mesh_file  # noqa: E402
from palpate.results import products  # noqa: E402
from palpate.results.dataset_figures import draw_reading, example_grasp  # noqa: E402
from palpate.results.hand_sheet import posed_geoms  # noqa: E402
from palpate.results.page import LABEL, TITLE, Page, figure_image, new_figure, save, save_sentence, styled  # noqa: E402
from palpate.results.surface_view import direction  # noqa: E402
from palpate.surface.embree import RayMesh  # noqa: E402
from palpate.vision import Renderer  # noqa: E402

STEPS = (
    "1  The object",
    "2  The hand is loaded, open",
    "3  The palm is placed tangent\nto a random point of the surface",
    "4  The fingers close until\nthe surface stops them",
)
PIXELS = 580
DISTANCE = 2.2  # m from the object to the camera
TALLEST, WIDEST, NARROWEST = 3.2, 3.1, 2.7  # inches of a picture, of one, and of a step with its words
MARGIN = 1.04  # of the field of view over what it must hold
# Views that are looked at: degrees of azimuth and elevation.
AZIMUTHS = range(0, 360, 15)
ELEVATIONS = (15, 35)
HAND_STRIDE = 5  # of the hand's vertices, those that are looked at
CLOSING = 4.2  # inches of the picture of the closing hand, and its dots an inch
CLOSING_DPI = 100
PAUSE, REST = 130, 1500  # ms that a frame is shown, and the last one
BESIDE = 0.05  # m between the object and the open hand that is loaded


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
    hand = grasp.object.hand
    towards = best_direction(grasp, hand)
    opened = hand.open_joint_positions
    loaded = hand.forward(beside(grasp.object.points, towards, hand), opened)
    placed = hand.forward(grasp.palm_pose, opened)
    poses = (None, loaded, placed, grasp.link_pose)
    points = [grasp.object.points, *(hand_points(hand, pose) for pose in poses[1:])]
    camera = camera_holding(np.concatenate(points), towards)
    renderer = Renderer(samples=samples, threads=threads)
    seen = {"visual_glb": mesh_file(grasp.object.mesh, "visual.glb"), "camera": camera, "background": None}
    hands = [{"hand": None if pose is None else hand, "link_pose": pose} for pose in poses]
    save(_page(_cropped([renderer.render_meshes(**seen, **each).rgb for each in hands])), path)


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
    hand, frames, towards = grasp.object.hand, grasp.frames, best_direction(grasp, grasp.object.hand)
    points = [grasp.object.points, *(hand_points(hand, frames.link_pose[number]) for number in (0, -1))]
    camera = camera_holding(np.concatenate(points), towards, round(CLOSING * CLOSING_DPI))
    renderer = Renderer(samples=samples, threads=threads)
    seen = {"visual_glb": mesh_file(grasp.object.mesh, "visual.glb"), "camera": camera, "hand": hand}
    pages = []
    for number, link_pose in enumerate(frames.link_pose):
        picture = renderer.render_meshes(**seen, link_pose=link_pose).rgb
        pages.append(_closing_page(picture, frames, number, grasp.sensors))
    palette = pages[-1].quantize(255)  # of all: else colours flicker, and every pixel is written again
    first, *others = (page.quantize(palette=palette) for page in pages)
    times = [PAUSE] * len(others) + [REST]
    first.save(path, "GIF", save_all=True, append_images=others, duration=times, loop=0, optimize=True)


def _closing_page(picture: np.ndarray, frames: FramesRecord, number: int, sensors: tuple[str, ...]) -> Image.Image:
    """One frame: the picture, its time, and beside it the readings, two in a row."""
    rows = -(-len(sensors) // 2) if frames.has_touch else 0
    cell = CLOSING / max(2, rows)
    page = Page(CLOSING + 2 * cell * bool(rows), CLOSING, CLOSING_DPI)
    page.axes(0, 0, CLOSING, CLOSING, shown=False).imshow(picture)
    page.text(0.1, CLOSING - 0.15, f"{frames.time[number]:.2f} s", fontsize=TITLE, ha="left")
    for sensor, name in enumerate(sensors if rows else ()):
        x, y = CLOSING + sensor % 2 * cell, sensor // 2 * cell
        reads = SimpleNamespace(success=frames.success[number], reading=frames.reading[number])
        draw_reading(page.axes(x + 0.05, y + 0.25, cell - 0.3, cell - 0.3), reads, sensor)
        page.text(x + cell / 2 - 0.1, y + 0.13, name, fontsize=LABEL)
    return figure_image(page.figure)


def best_direction(grasp: GraspRecord, hand: Hand) -> np.ndarray:
    """(3,) unit vector from the object to the camera that sees the closing fingers best.

    The object hides less of the closed hand than from most sides, and is not seen end on; and the view is from the
    hand's side, where fingers curl in the picture's plane. The hand counts as much as the other two together.
    """
    mesh = RayMesh(load_visual(grasp.object.mesh))
    closed = hand_points(hand, grasp.link_pose)[::HAND_STRIDE] - OBJECT_POSITION
    across = (grasp.palm_pose @ hand.palm_anchor)[:3, 1]

    def seen(towards: np.ndarray) -> float:
        return 1 - mesh.blocked(closed, np.tile(3 * DIAGONAL * towards, (len(closed), 1)), reach=1).mean()

    def area(towards: np.ndarray) -> float:
        return np.prod(np.ptp(grasp.object.points @ _picture_axes(towards).T, axis=0))

    directions = [direction(*view) for view in itertools.product(AZIMUTHS, ELEVATIONS)]
    clear, largest = list(map(seen, directions)), max(map(area, directions))
    score = [2 * c + abs(d @ across) + area(d) / largest for d, c in zip(directions, clear, strict=True)]
    return directions[np.argmax(np.where(clear >= np.median(clear), score, -np.inf))]


def beside(points: np.ndarray, towards: np.ndarray, hand: Hand) -> np.ndarray:
    """(4, 4) pose of the palm that is loaded: its face upright, to the right of the object, facing it.

    The open hand is `BESIDE` off the object, its middle as high as the object's. points: (n, 3) of the
    object. towards: (3,) from it to the camera, which says where right is.
    """
    right, _ = _picture_axes(towards)
    face = np.eye(4)
    face[:3, :3] = np.stack([-right, np.cross((0, 0, 1), -right), (0, 0, 1)], axis=1)
    face[:3, 3] = OBJECT_POSITION
    pose = face @ np.linalg.inv(hand.palm_anchor)
    drawn = hand_points(hand, hand.forward(pose, hand.open_joint_positions))
    pose[:3, 3] += ((points @ right).max() + BESIDE - (drawn @ right).min()) * right
    pose[2, 3] += OBJECT_POSITION[2] - (drawn[:, 2].min() + drawn[:, 2].max()) / 2
    return pose


def hand_points(hand: Hand, link_pose: np.ndarray) -> np.ndarray:
    """(n, 3) vertices of the drawn hand in the world."""
    return np.concatenate([points for points, _ in posed_geoms(hand, link_pose)])


def camera_holding(points: np.ndarray, towards: np.ndarray, size: int = PIXELS) -> Camera:
    """A camera that looks from direction `towards` (3,) at the middle of points (n, 3) and holds them all."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    camera = looking_at(middle, middle + DISTANCE * towards, size)
    pixels, _ = camera.project(points)
    reach = np.abs(pixels - size / 2).max()
    return replace(camera, focal_length=camera.focal_length * size / 2 / (MARGIN * reach))


def _picture_axes(towards: np.ndarray) -> np.ndarray:
    """(2, 3) directions to the right and up in the picture of a camera in direction `towards` (3,)."""
    right = np.cross((0, 0, 1), towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right)])


def _cropped(pictures: list[np.ndarray]) -> list[np.ndarray]:
    """The pictures (RGBA) cut to one size: the rows that any of them uses, each about its own middle."""
    used = [np.nonzero(picture[..., 3]) for picture in pictures]
    top, bottom = min(rows.min() for rows, _ in used), max(rows.max() for rows, _ in used) + 1
    width = round(1.06 * max(np.ptp(columns) for _, columns in used))
    cut = []
    for picture, (_, columns) in zip(pictures, used, strict=True):
        picture = np.pad(picture, ((0, 0), (width, width), (0, 0)))
        left = width + (columns.min() + columns.max() + 1 - width) // 2
        cut.append(picture[top:bottom, left : left + width])
    return cut


def _page(pictures: list[np.ndarray]) -> Figure:
    """The pictures in a row, a title under each."""
    rows, columns = pictures[0].shape[:2]
    foot = 0.5  # inches, as are the others
    inch = max(rows / TALLEST, columns / WIDEST)  # in pixels
    width, picture = max(columns / inch, NARROWEST), rows / inch
    height = picture + foot
    figure = new_figure(len(pictures) * width, height)
    for number, (image, title) in enumerate(zip(pictures, STEPS, strict=True)):
        left = number / len(pictures)
        axes = figure.add_axes((left, foot / height, 1 / len(pictures), picture / height))
        axes.imshow(image, interpolation="antialiased")
        axes.set_axis_off()
        figure.text(left + 0.5 / len(pictures), foot / 2 / height, title, ha="center", va="center", fontsize=TITLE - 1)
    return figure
