"""Omissions of rendering: a naive renderer, and each item of its needless work compared with the engine.

Import it before anything that loads embree, because it loads Blender.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from palpate.vision import Image, Renderer, blender, paper_camera, views

bpy = blender.load()

import numpy as np  # noqa: E402  (Blender comes before what loads embree)
import yaml  # noqa: E402

from palpate.batch import generator  # noqa: E402
from palpate.camera import Camera  # noqa: E402
from palpate.scene import Scene  # noqa: E402
from palpate.vision.image import Layers  # noqa: E402
from palpate.vision.renderer import POINT_FILTER  # noqa: E402
from studies.omitted.omission import OMITTED, Omission  # noqa: E402
from studies.scenes import rms, scene_of  # noqa: E402
from studies.subjects import Subject  # noqa: E402

UNOCCLUDED, OCCLUDED, VIEW = "unoccluded image", "occluded image", "view"
# Grey levels (RMS over pixels that show something) by which an image without an item may differ, mostly because of
# other random numbers. The error of an image with 16 samples is 4.
BOUND = 1.5
VIEWS, GRASPS = 8, 2  # that are rendered
OUT_OF_SIGHT = (0.0, 0.0, -1000.0)  # m: position of a hand that no image shows

_DECLARED = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
CYCLES_WITH, CYCLES_WITHOUT = _DECLARED["cycles_with"], _DECLARED["cycles_without"]
OMITTED_ITEMS = {kind: (*_DECLARED[kind], *_DECLARED["every_picture"]) for kind in (UNOCCLUDED, OCCLUDED, VIEW)}


class NaiveRenderer(Renderer):
    """The engine with needless work added, or with light or the hand removed.

    Attributes:
        changes: pairs of a kind of image and an item. Items of `OMITTED_ITEMS` and `CYCLES_WITH` are added; those of
            `CYCLES_WITHOUT`, and the hand of an occluded image, are removed.
    """

    changes: frozenset[tuple[str, str]] = frozenset()
    _kind = UNOCCLUDED  # of the image that is being rendered

    def _changed(self, item: str) -> bool:
        return (self._kind, item) in self.changes

    def render(self, scene: Scene) -> tuple[Image, list[Image]]:
        """As `Renderer.render`, with the changes of images."""
        self._kind = UNOCCLUDED
        if (OCCLUDED, "hand's meshes for every object") in self.changes:
            scene = replace(scene, hand=copy(scene.hand))  # another hand than before, though it is the same
        return super().render(scene)

    def render_views(self, scene: Scene, cameras: Sequence[Camera]) -> list[Image]:
        """As `Renderer.render_views`, with the changes of views."""
        self._kind = VIEW
        return super().render_views(scene, cameras)

    def draw_unoccluded(self, scene: Scene, points: np.ndarray, suffix: str = "") -> Layers:
        """The object alone, with a hand that is out of sight, or once for every grasp."""
        if self._changed("hand") and len(scene.link_pose):
            away = scene.link_pose[0].copy()
            away[:, :3, 3] += OUT_OF_SIGHT
            self.pose_hand(away)
        for _ in range(max(1, len(scene.link_pose)) if self._changed("render for every grasp") else 1):
            layers = super().draw_unoccluded(scene, points)
        return layers

    def draw_occluded(self, scene: Scene, points: np.ndarray, grasp: int, suffix: str = "") -> Layers:
        """The object in a grasp, or without the hand."""
        self._kind = OCCLUDED
        if self._changed("hand"):
            return self.draw(scene.camera, points)
        return super().draw_occluded(scene, points, grasp)

    def import_object(self, path: Path, position: Sequence[float]) -> np.ndarray:
        """The object's file, with its cameras and lamps."""
        before = set(bpy.data.objects)
        points = super().import_object(path, position)
        if self._changed("cameras and lamps of the file"):
            for body in set(bpy.data.objects) - before:
                body.hide_render = False
        return points

    def read_file(self, path: Path) -> None:
        """Reads a file, with materials of no triangle."""
        # Blender's importer fails to read unused materials of a file that has no image.
        if not self._changed("materials of no triangle") or b'"images"' not in path.read_bytes():
            return super().read_file(path)
        bpy.ops.import_scene.gltf(filepath=str(path), loglevel=50, import_unused_materials=True)

    def draw(self, camera: Camera, points: np.ndarray, master: str | None = None) -> Layers:
        """What is in Blender, with other settings of Cycles, or with the geometry given to it again."""
        items = {**CYCLES_WITH, **CYCLES_WITHOUT}
        changed = [settings for item, settings in items.items() if self._changed(item)]
        self.cycles = {name: value for settings in changed for name, value in settings.items()}
        if self._changed("geometry for every picture"):
            bpy.context.scene.render.use_persistent_data = False
        return super().draw(camera, points, master)

    def rectangle(self, camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """The pixels that are rendered: those around what is drawn, too."""
        if self._changed("pixels around what is drawn"):
            return np.zeros(2), np.full(2, camera.size)
        return super().rectangle(camera, points)

    def render_centres(self) -> Layers:
        """Mask and depth, with as many samples as colours have."""
        if self._changed("samples of mask and depth"):
            return self.render_layers(self.samples, POINT_FILTER)
        return super().render_centres()


def omissions(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> Iterable[Omission]:
    """Omissions for the first object: unoccluded, occluded in its first grasps, and views from all around."""
    pictures = _Comparisons(Path(run), subjects[0], settings)
    yield from pictures.exact_omissions()
    yield from pictures.light_omissions()


class _Comparisons:
    """Images of one object by the engine and by naive variants of it."""

    def __init__(self, run: Path, subject: Subject, settings: Mapping[str, Any]):
        self.subject, self.settings = subject, settings
        self.scene = scene_of(run, subject, camera=paper_camera(settings["vision"]["size"]))

    @cached_property
    def renderer(self) -> NaiveRenderer:
        """The renderer of all images, whose changes are set for each."""
        return NaiveRenderer(self.settings["vision"]["samples"], self.settings["vision"]["device"])

    def unoccluded(self, grasps: int = 0) -> list[Image]:
        """The image of the object alone, for a number of grasps; as many times as it is rendered."""
        scene = replace(self.scene, link_pose=self.scene.link_pose[:grasps])
        image, _ = self.renderer.render(scene)
        again = (UNOCCLUDED, "render for every grasp") in self.renderer.changes
        return [image] * (max(1, len(scene.link_pose)) if again else 1)

    def occluded(self) -> list[Image]:
        """The object in its first grasp."""
        return self.renderer.render(replace(self.scene, link_pose=self.scene.link_pose[:1]))[1]

    def views(self) -> list[Image]:
        """The first of the object's views."""
        size = self.settings["views"]["size"]
        at = views.viewpoints(generator(self.settings["seed"], self.subject.name, "views"), VIEWS)
        self.renderer.samples = self.settings["views"]["samples"]
        try:
            return self.renderer.render_views(self.scene, [views.camera(viewpoint, size) for viewpoint in at])
        finally:
            self.renderer.samples = self.settings["vision"]["samples"]

    def exact_omissions(self) -> Iterator[Omission]:
        """Items without which every bit is the same."""
        for kind, item, when in _DECLARED["exact"]:
            grasps = {"hand": 1, "render for every grasp": GRASPS}.get(item, 0)
            make = {UNOCCLUDED: partial(self.unoccluded, grasps), OCCLUDED: self.occluded, VIEW: self.views}[kind]
            runs = partial(self._with_change, make, kind, item), make
            size = image_bytes if item == "render for every grasp" else None
            yield Omission(kind, item, when, self.subject.name, *runs, largest_difference, "grey levels", size=size)

    def light_omissions(self) -> Iterator[Omission]:
        """Items that change the paths of light: those within a bound are omitted, the others stay."""
        for state, items in _DECLARED["light"].items():
            for item in items:
                made = partial(self._with_change, self.occluded, OCCLUDED, item), self.occluded
                when, made = ("always", made) if state == OMITTED else ("never: it stays", made[::-1])
                unit, difference = "grey levels (RMS)", foreground_rms
                yield Omission(OCCLUDED, item, when, self.subject.name, *made, difference, unit, BOUND, state=state)

    def _with_change(self, make: Callable[[], Any], kind: str, item: str) -> Any:
        """Call a function that renders, with one item changed."""
        self.renderer.changes = frozenset({(kind, item)})
        try:
            return make()
        finally:
            self.renderer.changes = frozenset()


def image_bytes(images: list[Image]) -> int:
    """Bytes of all arrays of images."""
    return sum(array.nbytes for image in images for array in image)


def largest_difference(images: list[Image], others: list[Image]) -> float:
    """The largest difference of colours and masks, in grey levels; infinite if a depth differs in a bit.

    A single image is compared with each of the others.
    """
    count = max(len(images), len(others))
    images, others = (group * count if len(group) == 1 else group for group in (images, others))
    worst = 0.0
    for image, other in zip(images, others, strict=True):
        if not np.array_equal(image.depth, other.depth):
            return float("inf")
        for array, same in ((image.rgb, other.rgb), (image.mask, other.mask)):
            worst = max(worst, float(np.abs(array.astype(int) - same).max()))
    return worst


def foreground_rms(images: list[Image], others: list[Image]) -> float:
    """RMS difference of colours, in grey levels, over pixels that show something in either image."""
    pairs = list(zip(images, others, strict=True))
    foreground = [np.isfinite(image.depth) | np.isfinite(other.depth) for image, other in pairs]
    return rms(*(np.concatenate([pair[k].rgb[at] for pair, at in zip(pairs, foreground, strict=True)]) for k in (0, 1)))
