"""The figure of reconstructions across modalities and numbers of grasps, rendered by Blender.

Import it before anything that loads embree (trimesh does), because it loads Blender.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from palpate.vision import blender

blender.load()

from palpate.dataset import Dataset  # noqa: E402
from palpate.dataset.reader import ObjectRecord  # noqa: E402
from palpate.evaluation.reconstruct import (  # noqa: E402  (Blender comes before embree)
    TOUCH_COLOUR,
    VISION_COLOUR,
    Reconstructor,
    Shape,
    of_object,
)
from palpate.mesh import OBJECT_POSITION, load_visual  # noqa: E402
from palpate.results.page import FAINT, LABEL, TITLE, new_figure, save, save_sentence, styled  # noqa: E402
from palpate.results.surface_view import CLAY  # noqa: E402
from palpate.vision import Mesh, Renderer, spheres  # noqa: E402
from palpate.camera import Camera, paper_camera  # noqa: E402

# Columns: the experiment, the group it stands in, and its own heading.
SETUPS = (
    ("charts_occluded", "Occluded vision", "alone"),
    ("charts_occluded_touch", "Occluded vision", "and touch"),
    ("charts_unoccluded", "Unoccluded vision", "alone"),
    ("charts_unoccluded_touch", "Unoccluded vision", "and touch"),
    ("charts_touch", "Touch only", "1 grasp"),
    *((f"charts_touch_{count}", "Touch only", f"{count} grasps") for count in (2, 3, 4, 5)),
)
EXPERIMENTS = tuple(experiment for experiment, *_ in SETUPS)
STAGES = ("surface", "touch", "vision")  # whose objects can be drawn

POINT = 0.004  # m, radius of a surface point, where there is no mesh
SAMPLES = 16
PIXELS = 240
# The paper's camera with a narrower field of view: objects, 0.5 m across at most, fill its image to two
# thirds, and predictions can be as large as the initial sphere.
ZOOM = 1.3


@styled
def reconstructions(
    dataset: Dataset,
    models: Mapping[str, Path | str],
    path: Path | str,
    fit: str = "direct",
    threads: int = 1,
) -> None:
    """Draw the first test object of every class as each model reconstructs it, with inputs and ground truth.

    models: folder of each trained model by its experiment, of `EXPERIMENTS`; of these, columns are drawn for
    those given. A model that takes n grasps gets the object's first n; images are those of the first.
    fit: how touch charts are fitted, `direct` or `adam`. threads: of the CPU, for the renderer.

    Raises ValueError for an experiment that the figure has no column for, and what `Reconstructor` raises.
    """
    if unknown := sorted(set(models) - set(EXPERIMENTS)):
        raise ValueError(f"no column for {', '.join(unknown)}: expected some of {', '.join(EXPERIMENTS)}")
    records = test_objects(dataset)
    if not records:
        return save_sentence("No usable test object in this run", path)
    setups = [setup for setup in SETUPS if setup[0] in models]
    renderer = Renderer(samples=SAMPLES, threads=threads)
    camera = shared_camera(PIXELS)

    def render(mesh: Mesh) -> np.ndarray:
        return renderer.render_meshes([mesh], camera=camera).rgb

    cells = {(row, "truth"): render(ground_truth(record)) for row, record in enumerate(records)}
    for experiment, *_ in setups:
        reconstructor = Reconstructor(models[experiment], fit=fit)
        for row, record in enumerate(records):
            shape = reconstructor(*of_object(record, reconstructor.experiment))
            cells[row, experiment] = render(coloured(shape))
    _page(records, setups, cells, path)


def test_objects(dataset: Dataset) -> list[ObjectRecord]:
    """The first test object of every class, in the catalogue's order; not chosen for what comes out."""
    first: dict[str, ObjectRecord] = {}
    for record in dataset:
        if record.split == "test":
            first.setdefault(record.class_name, record)
    return list(first.values())


test_objects.__test__ = False  # it is not a test


def ground_truth(record: ObjectRecord) -> Mesh:
    """The object's own surface, in clay; points of it for a dataset without meshes."""
    if not (record.mesh / "visual.glb").exists():
        return spheres(record.points, POINT, CLAY, segments=1)
    mesh = load_visual(record.mesh)
    return Mesh(mesh.vertices + OBJECT_POSITION, mesh.faces, CLAY)


def coloured(shape: Shape) -> Mesh:
    """A reconstruction with the charts of successful touches in another colour."""
    return Mesh(shape.vertices, shape.faces, np.where(shape.touch[:, None], TOUCH_COLOUR, VISION_COLOUR))


def shared_camera(size: int) -> Camera:
    """The camera of all of the figure's renders: the paper's, `ZOOM` times closer."""
    camera = paper_camera(size)
    return replace(camera, focal_length=ZOOM * camera.focal_length)


def frame(size: int) -> tuple[float, float]:
    """From which to which pixel coordinate, both ways, `shared_camera` sees an image of the dataset."""
    return 0.5 * size * (1 - 1 / ZOOM), 0.5 * size * (1 + 1 / ZOOM)


def _page(records: list[ObjectRecord], setups: list[tuple], cells: dict, path: Path | str) -> None:
    cell, gap, between, left, head = 1.3, 0.02, 0.14, 0.3, 0.5  # inches
    columns = [("image", "Input images", "occluded"), ("image", "Input images", "unoccluded")]
    columns += [("truth", "", "Ground truth"), *setups]
    start, x = [], left
    for number, (_, group, _) in enumerate(columns):
        x += between if number and group != columns[number - 1][1] else 0
        start.append(x)
        x += cell + gap
    width, height = x, head + len(records) * (cell + gap)
    figure = new_figure(width, height)

    def axes(row: int, column: int) -> Axes:
        bottom = height - head - (row + 1) * (cell + gap) + gap
        made = figure.add_axes((start[column] / width, bottom / height, cell / width, cell / height))
        made.set_axis_off()
        return made

    for group, members in _groups(columns):
        middle = (start[members[0]] + start[members[-1]] + cell) / 2
        figure.text(middle / width, 1 - 0.14 / height, group, ha="center", va="center", fontsize=TITLE)
    for column, (_, _, heading) in enumerate(columns):
        x = (start[column] + cell / 2) / width
        figure.text(x, 1 - 0.37 / height, heading, ha="center", va="center", fontsize=LABEL)
    for row, record in enumerate(records):
        y = 1 - (head + (row + 0.5) * (cell + gap)) / height
        figure.text(
            left / 2 / width,
            y,
            record.name,
            ha="center",
            va="center",
            rotation=90,
            fontsize=LABEL,
            color=FAINT,
        )
        for column, image in enumerate((record.grasps[0].occluded, record.unoccluded)):
            panel = axes(row, column)
            panel.imshow(image, interpolation="antialiased")
            low, high = frame(len(image))
            # Matplotlib has the middle of the first pixel at 0.
            panel.set(xlim=(low - 0.5, high - 0.5), ylim=(high - 0.5, low - 0.5))
        for column, (name, *_) in enumerate(columns[2:], start=2):
            axes(row, column).imshow(cells[row, name], interpolation="antialiased")
    save(figure, path)


def _groups(columns: Iterable[tuple]) -> list[tuple[str, list[int]]]:
    """Numbers of the columns that stand under one heading, for every heading that is not empty."""
    found: dict[str, list[int]] = {}
    for number, (_, group, _) in enumerate(columns):
        found.setdefault(group, []).append(number)
    return [(group, members) for group, members in found.items() if group]
