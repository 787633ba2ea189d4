"""The figure of local predictions: readings of touches, the true surface, the predicted cloud, and its chart.

Import it before anything that loads embree (trimesh does), because it loads Blender.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from palpate.vision import blender

blender.load()

from palpate.camera import Camera  # noqa: E402
from palpate.charts.atlas import touch_chart  # noqa: E402  (Blender comes before embree)
from palpate.dataset import Dataset  # noqa: E402
from palpate.dataset.reader import GraspRecord, ObjectRecord  # noqa: E402
from palpate.evaluation.reconstruct import TOUCH_COLOUR, VISION_COLOUR, GraspTouches, TouchCharts  # noqa: E402
from palpate.mesh import OBJECT_POSITION  # noqa: E402
from palpate.results import products  # noqa: E402
from palpate.results.page import FAINT, LABEL, TITLE, Page, save, save_sentence, styled  # noqa: E402
from palpate.results.reconstructions import test_objects  # noqa: E402
from palpate.vision import Mesh, Renderer, looking_at, spheres  # noqa: E402

HEADINGS = ("reading", "true cloud", "predicted cloud", "touch chart")
TOUCHES = 2  # of every object
# Touches are drawn far larger than they are: Blender's rays start a fixed distance off a surface.
DRAWN_WIDTH = 0.4  # m, of a sensor
STRIDE = 7  # of a cloud's points, those that are drawn: 10,000 hide one another; 7 does not divide a row
POINT, VERTEX = 0.004, 0.006  # m, radii as drawn
SEGMENTS = 1  # of a point as a sphere: a few pixels across, it needs no more
TRUE_COLOUR = (0.5, 0.5, 0.5)  # sRGB: clay is too pale for points
PIXELS = 240
SAMPLES = 16
TOWARDS = (0.0, -0.75, 1.0)  # from the site to the camera, in the frame of `upright`
DISTANCE, FIELD_OF_VIEW = 1.5, 19.0  # m, degrees

# Rows: the axes in which a touch is drawn, in the sensor's frame. Right is the reading's right; the reading's
# top is at the back; and up is from the object to the sensor.
UPRIGHT = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]], dtype=float)


@products.figure(stores=("touch",), files=("touch_depth",))
@styled
def local_predictions(dataset: Dataset, touch_depth: Path | str, path: Path | str, threads: int = 1) -> None:
    """Local predictions of the first test object of every class: the widest touch of each of two grasps. The reading;
    the true cloud of the touch site; the cloud that the U-Net predicts from the reading, at the pixels that differ from
    the untouched reading; and the touch chart fitted to it. Seen from the sensor's side; the bottom of the reading is
    in front.

    touch_depth: the trained U-Net's folder. threads: of the CPU, for the renderer.
    """
    drawn = [(record, touches(record)) for record in test_objects(dataset)]
    drawn = [(record, chosen) for record, chosen in drawn if chosen]
    if not drawn:
        return save_sentence("No test object with a successful touch in this run", path)
    charts = TouchCharts(touch_depth)
    renderer = Renderer(samples=SAMPLES, threads=threads)
    camera = site_camera(PIXELS)
    figure, axes = _page(drawn)
    for row, (_, chosen) in enumerate(drawn):
        for place, (grasp, sensor) in enumerate(chosen):
            one_touch = GraspTouches(*(getattr(grasp, name)[[sensor]] for name in GraspTouches._fields))
            meshes = site(grasp, sensor, charts.clouds(one_touch)[0], charts(one_touch)[0])
            pictures = [grasp.reading[sensor]]
            pictures += [renderer.render_meshes(part, camera=camera).rgb for part in meshes]
            for column, picture in enumerate(pictures):
                axes(row, place, column).imshow(picture, interpolation="antialiased")
    save(figure, path)


def touches(record: ObjectRecord) -> list[tuple[GraspRecord, int]]:
    """Grasp and sensor of the widest touch of each of the object's first grasps that have one."""
    widest = [(grasp, int(np.argmax([len(cloud) for cloud in grasp.points]))) for grasp in record.grasps]
    return [(grasp, sensor) for grasp, sensor in widest if grasp.success[sensor]][:TOUCHES]


def site(grasp: GraspRecord, sensor: int, points: np.ndarray, vertices: np.ndarray) -> list[list[Mesh]]:
    """The meshes drawn for one touch: the true cloud, the predicted cloud, and the chart with its vertices.

    points: (n, 3) predicted, vertices: (81, 3) of the chart, in the world. All three share one frame: before
    the middle of the sensor, as far from it as the true cloud.
    """
    true = grasp.points[sensor].astype(float)
    out = grasp.rotation[sensor][:, 0]
    middle = grasp.position[sensor] + np.median((true - grasp.position[sensor]) @ out) * out

    def place(cloud: np.ndarray) -> np.ndarray:
        return upright(cloud - middle, grasp.rotation[sensor], max(grasp.sensor.size))

    chart = place(vertices)
    return [
        [spheres(place(true[::STRIDE]), POINT, TRUE_COLOUR, SEGMENTS)],
        [spheres(place(points[::STRIDE]), POINT, VISION_COLOUR, SEGMENTS)],
        [Mesh(chart, touch_chart().faces.numpy(), TOUCH_COLOUR), spheres(chart, VERTEX, (0.3, 0.1, 0.0))],
    ]


def upright(offsets: np.ndarray, rotation: np.ndarray, width: float) -> np.ndarray:
    """Offsets (n, 3) in the world from a site's middle, as drawn: seen from the sensor's side, enlarged.

    width: of the sensor's longer edge, metres.
    """
    return OBJECT_POSITION + DRAWN_WIDTH / width * offsets @ rotation @ UPRIGHT.T


def site_camera(size: int) -> Camera:
    """The camera of all touches."""
    towards = np.array(TOWARDS) / np.linalg.norm(TOWARDS)
    return looking_at(OBJECT_POSITION, OBJECT_POSITION + DISTANCE * towards, size, FIELD_OF_VIEW)


def _page(drawn: list[tuple[ObjectRecord, list]]):
    """A page, and the function (row, touch, column) -> axes."""
    cell, gap, between, left, head, label = 1.35, 0.04, 0.22, 0.3, 0.32, 0.2  # inches
    block = len(HEADINGS) * (cell + gap)
    page = Page(left + TOUCHES * block + (TOUCHES - 1) * between, head + len(drawn) * (cell + label))

    def corner(place: int, column: int) -> float:
        return left + place * (block + between) + column * (cell + gap)

    def axes(row: int, place: int, column: int) -> Axes:
        size = cell * (0.72 if column == 0 else 1)  # a reading is flat
        inset = (cell - size) / 2
        top = head + row * (cell + label) + label
        return page.axes(corner(place, column) + inset, top + inset, size, size, shown=False)

    for place in range(TOUCHES):
        for column, heading in enumerate(HEADINGS):
            page.text(corner(place, column) + cell / 2, head / 2, heading, fontsize=TITLE - 1)
    for row, (record, chosen) in enumerate(drawn):
        top = head + row * (cell + label)
        page.text(left / 2, top + label + cell / 2, record.name, rotation=90, fontsize=LABEL, color=FAINT)
        for place, (grasp, sensor) in enumerate(chosen):
            words = f"grasp {grasp.number}, {grasp.sensors[sensor]}"
            page.text(corner(place, 0) + block / 2, top + label / 2, words, fontsize=LABEL, color=FAINT)
    return page.figure, axes
