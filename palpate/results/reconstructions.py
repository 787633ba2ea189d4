"""The figure of reconstructions across modalities and numbers of grasps, rendered by Blender.

All meshes of a row are seen by one camera. It is as close as `ZOOM`, or as far away as it takes to show `SHOWN` of the
vertices of every mesh. Vertices that are still outside are marked at the edge of the picture, and counted.

Import it before anything that loads embree (trimesh does), because it loads Blender.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from palpate.vision import blender

blender.load()

from palpate.camera import Camera, paper_camera  # noqa: E402
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
from palpate.results import products  # noqa: E402
from palpate.results.page import COLOURS, FAINT, INK, LABEL, TITLE, Page, save, save_sentence, styled  # noqa: E402
from palpate.results.surface_view import CLAY  # noqa: E402
from palpate.vision import Mesh, Renderer, spheres  # noqa: E402

# The models, the group of columns of each, and the numbers of grasps in these.
MODELS = {
    "pooled_occluded_any": ("Occluded vision", (0, 1)),
    "pooled_unoccluded_any": ("Unoccluded vision", (0, 1, 2, 3, 4, 5)),
    "pooled_touch_any": ("Touch only", (1, 2, 3, 4, 5)),
}

POINT = 0.004  # m, radius of a surface point, where there is no mesh
SAMPLES = 16
PIXELS = 240
# The images' camera with a narrower field of view. By the paper's, objects, 0.5 m across at most, fill its image to two
# thirds, and predictions can be as large as the initial sphere.
ZOOM = 1.3
SHOWN = 0.98  # of the vertices of each mesh of a row
MARGIN = 0.03  # of the picture's edge, free on each side where the camera moves away
WIRE = 0.006  # m: sides this far behind the surface that the picture shows are hidden


@products.figure(
    models=("pooled_occluded_any", "pooled_unoccluded_any", "pooled_touch_any"),  # `MODELS`
    files=("touch_depth",),
    stores=("meshes", "surface", "touch", "vision"),
)
@styled
def reconstructions(
    dataset: Dataset,
    models: Mapping[str, Path | str],
    path: Path | str,
    threads: int = 1,
    wires: bool = False,
) -> None:
    """The first test object of every class, not chosen, as the models of this run with pooled touch (ours) reconstruct
    it: from its occluded or unoccluded image, alone and with the touches of one or more grasps, and from the touches of
    one to five grasps alone. All renders are from the images' camera, moved closer. Vision charts are blue, the charts
    of successful touches orange.

    models: folder of each trained model by its experiment, of `MODELS`; of these, columns are drawn for those given.
    The touches are those of the object's first grasps, an occluded image that of the first.
    threads: of the CPU, for the renderer. wires: draw the sides of the faces too.

    Raises ValueError for an experiment that the figure has no column for, and what `Reconstructor` raises.
    """
    if unknown := sorted(set(models) - set(MODELS)):
        raise ValueError(f"no column for {', '.join(unknown)}: expected some of {', '.join(MODELS)}")
    records = test_objects(dataset)
    if not records:
        return save_sentence("No usable test object in this run", path)
    meshes = {(row, "truth"): ground_truth(record) for row, record in enumerate(records)}
    columns = []
    for name, (group, counts) in MODELS.items():
        reconstructor = Reconstructor(models[name]) if name in models else None
        for count in counts if reconstructor else ():
            heading = "alone" if not count else f"{count} grasp{'s' * (count > 1)}"
            columns.append((f"{name} {count}", group, heading))
            for row, record in enumerate(records):
                image, touches, camera = of_object(record, reconstructor.experiment, range(max(count, 1)))
                meshes[row, columns[-1][0]] = coloured(reconstructor(image, touches[:count], camera))
    renderer = Renderer(samples=SAMPLES, threads=threads)
    cells, zooms = {}, []
    for row in range(len(records)):
        drawn = {column: mesh for (number, column), mesh in meshes.items() if number == row}
        seen_by = records[row].vision_camera
        zooms.append(zoom_of(drawn.values(), seen_by))
        camera = shared_camera(PIXELS, zooms[row], seen_by)
        for column, mesh in drawn.items():
            image = renderer.render_meshes([mesh], camera=camera)
            sides = visible_sides(mesh, camera, image.depth) if wires and column != "truth" else None
            cells[row, column] = Cell(image.rgb, *marks(mesh, camera), sides)
    _page(records, columns, cells, zooms, path)


class Cell(NamedTuple):
    """A picture (s, s, 3); where vertices leave it, at its edge (k, 2) in pixels, and how many do; sides (n, 2, 2)."""

    rgb: np.ndarray
    edge: np.ndarray
    outside: int
    sides: np.ndarray | None


def drawn_vertices(mesh: Mesh) -> np.ndarray:
    """(n, 3) the vertices of faces that have an area: charts without a touch are points somewhere."""
    corners = np.asarray(mesh.vertices)[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.asarray(mesh.vertices)[np.unique(mesh.faces[area > 0])]


def zoom_of(meshes: Iterable[Mesh], images: Camera | None = None) -> float:
    """How much closer than the images' (None: the paper's) the camera is for these meshes to be in its picture."""
    zooms = [ZOOM]
    for mesh in meshes:
        pixels, depth = shared_camera(1, 1.0, images).project(drawn_vertices(mesh))
        away = np.abs(pixels - 0.5).max(axis=1)
        away[depth <= 0] = np.inf
        # The least distance within which so many are; one that is not finite moves no camera.
        reach = np.quantile(away, SHOWN, method="higher")
        zooms += [(0.5 - MARGIN) / reach] if np.isfinite(reach) else []
    return min(zooms)


def marks(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, int]:
    """Where vertices that are outside the picture leave it, (k, 2) pixels on its edge, and their number."""
    pixels, depth = camera.project(drawn_vertices(mesh))
    inside = (depth > 0) & ((pixels >= 0) & (pixels <= camera.size)).all(axis=1)
    left = pixels[~inside & (depth > 0)] - camera.size / 2
    # From the picture's middle to the vertex, as far as the edge.
    edge = left / np.abs(left).max(axis=1, keepdims=True) * camera.size / 2 + camera.size / 2
    return np.unique(np.round(edge), axis=0), int(np.sum(~inside))


def visible_sides(mesh: Mesh, camera: Camera, depth: np.ndarray) -> np.ndarray:
    """(n, 2, 2) pixels of both ends of the faces' sides that nothing hides, by the middle of each."""
    sides = np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    ends = np.asarray(mesh.vertices)[sides]
    middle, away = camera.project(ends.mean(axis=1))
    inside = (away > 0) & ((middle >= 0) & (middle < camera.size)).all(axis=1)
    sides, (column, row), away = ends[inside], middle[inside].astype(int).T, away[inside]
    return camera.project(sides[away <= depth[row, column].astype(float) + WIRE])[0]


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


def shared_camera(size: int, zoom: float = ZOOM, images: Camera | None = None) -> Camera:
    """The camera of all renders of a row: that of its images (None: the paper's), `zoom` times closer."""
    camera = images or paper_camera()
    return replace(camera, focal_length=zoom * camera.focal_length * size / camera.size, size=size)


def frame(size: int, zoom: float = ZOOM) -> tuple[float, float]:
    """From which to which pixel coordinate, both ways, `shared_camera` sees an image of the dataset."""
    return 0.5 * size * (1 - 1 / zoom), 0.5 * size * (1 + 1 / zoom)


def _page(records: list[ObjectRecord], setups: list[tuple], cells: dict, zooms: list[float], path: Path | str) -> None:
    cell, gap, between, left, head = 1.3, 0.02, 0.14, 0.3, 0.5  # inches
    columns = [("image", "Input images", "occluded"), ("image", "Input images", "unoccluded")]
    columns += [("truth", "", "Ground truth"), *setups]
    groups = [group for _, group, _ in columns]
    start, x = [], left
    for number, group in enumerate(groups):
        x += between if number and group != groups[number - 1] else 0
        start.append(x)
        x += cell + gap
    page = Page(x, head + len(records) * (cell + gap))
    for group in filter(None, dict.fromkeys(groups)):
        last = len(groups) - 1 - groups[::-1].index(group)
        page.text((start[groups.index(group)] + start[last] + cell) / 2, 0.14, group, fontsize=TITLE)
    for x, (_, _, heading) in zip(start, columns, strict=True):
        page.text(x + cell / 2, 0.37, heading, fontsize=LABEL)
    for row, record in enumerate(records):
        top = head + row * (cell + gap)
        page.text(left / 2, head + (row + 0.5) * (cell + gap), record.name, rotation=90, fontsize=LABEL, color=FAINT)
        panels = [page.axes(x, top, cell, cell, shown=False) for x in start]
        for panel, image in zip(panels, (record.grasps[0].occluded, record.unoccluded), strict=False):
            panel.imshow(image, interpolation="antialiased")
            low, high = frame(len(image), zooms[row])
            # Matplotlib has the middle of the first pixel at 0.
            panel.set(xlim=(low - 0.5, high - 0.5), ylim=(high - 0.5, low - 0.5))
        for panel, (name, *_) in zip(panels[2:], columns[2:], strict=True):
            _draw(panel, cells[row, name])
    save(page.figure, path)


def _draw(panel: Axes, cell: Cell) -> None:
    panel.imshow(cell.rgb, interpolation="antialiased")
    size = len(cell.rgb)
    panel.set(xlim=(-0.5, size - 0.5), ylim=(size - 0.5, -0.5))
    # Matplotlib has the middle of the first pixel at 0.
    if cell.sides is not None:
        panel.add_collection(LineCollection(cell.sides - 0.5, colors=INK, linewidths=0.15))
    if cell.outside:
        panel.plot(*(cell.edge.T - 0.5), "o", color=COLOURS[1], ms=2.5, mew=0, clip_on=False)
        panel.text(2, size - 4, f"{cell.outside} outside", color=COLOURS[1], fontsize=LABEL - 3)
