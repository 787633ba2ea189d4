"""The figure of reconstructions across modalities and numbers of grasps, rendered by Blender."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.camera import paper_camera
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.results import products
from palpate.results.local_predictions import first_test_objects
from palpate.results.page import picture_grid, save, save_sentence
from palpate.vision import Mesh, spheres

if TYPE_CHECKING:
    from palpate.dataset import Dataset, ObjectRecord
    from palpate.learning.reconstruct import Shape

# The models, the name of each over its columns, and the numbers of grasps in these.
MODELS = {
    "template_occluded_any": ("occluded", (0, 1)),
    "template_unoccluded_any": ("unoccluded", (0, 1, 2, 3, 4, 5)),
    "template_touch_any": ("touch only", (1, 2, 3, 4, 5)),
}

CLAY = (0.93, 0.92, 0.90)  # sRGB of a surface without its materials
POINT = 0.004  # m, radius of a surface point, where there is no mesh
SAMPLES = 16
PIXELS = 360
MARGIN = 1.06  # of a row's window, times what is in it


@products.figure(
    models=("template_occluded_any", "template_unoccluded_any", "template_touch_any"),  # `MODELS`
    files=("touch_depth",),
    stores=("meshes", "surface", "touch", "vision"),
)
def reconstructions(dataset: Dataset, models: Mapping[str, Path | str], path: Path | str, threads: int = 1) -> None:
    """The first test object of every class, not chosen, as the models of strategy `template` (ours) of this run
    reconstruct it: from its occluded or unoccluded image, alone and with the touches of one or more grasps, and from
    the touches of one to five grasps alone. All renders are from the images' camera; a row shows the part of them that
    is not empty. Vision charts are blue, the charts of successful touches orange.

    models: folder of each trained model by its experiment; columns are drawn for those of `MODELS` that are given.
    The touches are those of the object's first grasps, an occluded image that of the first.
    threads: of the CPU, for the renderer.

    Raises what `Reconstructor` raises.
    """
    from palpate.vision import Renderer  # isort: skip (Blender: before anything that loads embree)
    from palpate.learning.reconstruct import Reconstructor, of_object

    records = first_test_objects(dataset)
    if not records:
        return save_sentence("No usable test object in this run", path)
    renderer = Renderer(samples=SAMPLES, threads=threads)

    def render(record: ObjectRecord, mesh: Mesh) -> np.ndarray:
        camera = record.vision_camera or paper_camera()
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
                prediction = reconstructor(*inputs_of_one._replace(touches=record.grasps[:count]))
                pictures.append(render(record, coloured(prediction)))
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
        return spheres(record.points, POINT, CLAY, segments=1)
    mesh = load_visual(record.mesh)
    return Mesh(mesh.vertices + OBJECT_POSITION, mesh.faces, np.array(CLAY))
