"""Omissions of rendering: a naive renderer, and each item of its needless work compared with the engine.

Import it before anything that loads embree, because it loads Blender.
"""

import base64
import io
import json
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from palpate.vision import Image, Renderer, blender, paper_camera, views

bpy = blender.load()

import numpy as np  # noqa: E402  (Blender comes before what loads embree)
from PIL import Image as PillowImage  # noqa: E402

from palpate.batch import generator  # noqa: E402
from palpate.scene import Scene  # noqa: E402
from palpate.vision.renderer import POINT_FILTER  # noqa: E402
from studies.image_difference import rms  # noqa: E402
from studies.omitted.omission import OMITTED, STAYS, Omission  # noqa: E402
from studies.scenes import scene_of  # noqa: E402
from studies.subjects import Subject  # noqa: E402

UNOCCLUDED, OCCLUDED, VIEW = "unoccluded image", "occluded image", "view"
# Grey levels (RMS over pixels that show something) by which an image without an item may differ, mostly because of
# other random numbers. The error of an image with 16 samples is 4.
BOUND = 1.5
VIEWS = 8  # that are rendered
TEXTURE = 1024  # pixels, the side of the texture that is added and used by nothing
OUT_OF_SIGHT = (0.0, 0.0, -1000.0)  # m: position of a hand that no image shows

# Settings of Cycles that add an item that the engine omits, and that remove one that it has.
CYCLES_WITH = {
    "bounces of light after the fourth": {"diffuse_bounces": 12, "glossy_bounces": 12},
    "paths of more than 6 bounces": {"max_bounces": 12, "transmission_bounces": 12},
    "caustics": {"caustics_reflective": True, "caustics_refractive": True},
    "tree of lights": {"use_light_tree": True},
}
CYCLES_WITHOUT = {
    "second to fourth bounce of light": {"diffuse_bounces": 1, "glossy_bounces": 1},
    "first bounce of light": {"diffuse_bounces": 0, "glossy_bounces": 0},
}
# Items that can be added to any kind of image without changing a bit, and by kind all that can.
EVERY_PICTURE = (
    "materials of no triangle",
    "cameras and lamps of the file",
    "pixels around what is drawn",
    "samples of mask and depth",
    "paths of more than 6 bounces",
)
OMITTED_ITEMS = {
    UNOCCLUDED: ("hand", "render for every grasp", *EVERY_PICTURE),
    OCCLUDED: ("hand's meshes for every object", *EVERY_PICTURE),
    VIEW: ("scene for every view", *EVERY_PICTURE),
}


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
        self._kind = UNOCCLUDED
        if (OCCLUDED, "hand's meshes for every object") in self.changes:
            self._hand = None
        return super().render(scene)

    def render_views(self, scene: Scene, cameras) -> list[Image]:
        self._kind = VIEW
        return super().render_views(scene, cameras)

    def _draw_unoccluded(self, scene: Scene, points: np.ndarray, suffix: str = ""):
        if self._changed("hand") and len(scene.link_pose):
            away = scene.link_pose[0].copy()
            away[:, :3, 3] += OUT_OF_SIGHT
            self._pose_hand(away)
        for _ in range(max(1, len(scene.link_pose)) if self._changed("render for every grasp") else 1):
            layers = super()._draw_unoccluded(scene, points)
        return layers

    def _draw_occluded(self, scene: Scene, points: np.ndarray, grasp: int, suffix: str = ""):
        self._kind = OCCLUDED
        if self._changed("hand"):
            return self._draw(scene.camera, points)
        return super()._draw_occluded(scene, points, grasp)

    def _import(self, path: Path, position) -> np.ndarray:
        before = set(bpy.data.objects)
        points = super()._import(path, position)
        if self._changed("cameras and lamps of the file"):
            for body in set(bpy.data.objects) - before:
                body.hide_render = False
        return points

    def _read_file(self, path: Path) -> None:
        # Blender's importer fails to read unused materials of a file that has no image.
        if not self._changed("materials of no triangle") or b'"images"' not in path.read_bytes():
            return super()._read_file(path)
        bpy.ops.import_scene.gltf(filepath=str(path), loglevel=50, import_unused_materials=True)

    def _draw(self, *arguments, **options):
        items = {**CYCLES_WITH, **CYCLES_WITHOUT}
        changed = [settings for item, settings in items.items() if self._changed(item)]
        self.cycles = {name: value for settings in changed for name, value in settings.items()}
        if self._changed("scene for every view"):
            self._scene.render.use_persistent_data = False
        return super()._draw(*arguments, **options)

    def _rectangle(self, camera, points: np.ndarray):
        if self._changed("pixels around what is drawn"):
            return np.zeros(2), np.full(2, camera.size)
        return super()._rectangle(camera, points)

    def _render_centres(self):
        if self._changed("samples of mask and depth"):
            return self._render(self.samples, POINT_FILTER)
        return super()._render_centres()


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
        return NaiveRenderer(self.settings["vision"]["samples"], self.settings["vision"]["device"])

    @cached_property
    def _folder(self) -> tempfile.TemporaryDirectory:
        return tempfile.TemporaryDirectory(prefix="palpate-")

    @cached_property
    def with_unused_material(self) -> Scene:
        """The scene, whose object's file has a further material that no triangle uses."""
        folder = Path(self._folder.name) / self.scene.name
        folder.mkdir()
        (folder / "visual.glb").write_bytes(rewrite_glb(self.scene.visual_file.read_bytes(), add_unused_texture))
        return replace(self.scene, object_folder=folder)

    @cached_property
    def exr_folder(self) -> Path:
        folder = Path(self._folder.name) / "exr"
        folder.mkdir()
        return folder

    def unoccluded(self, grasps: int = 0, scene: Scene | None = None) -> list[Image]:
        """The image of the object alone, for a number of grasps; as many times as it is rendered."""
        scene = replace(scene or self.scene, link_pose=self.scene.link_pose[:grasps])
        image, _ = self.renderer.render(scene)
        again = (UNOCCLUDED, "render for every grasp") in self.renderer.changes
        return [image] * (max(1, grasps) if again else 1)

    def occluded(self) -> list[Image]:
        return self.renderer.render(replace(self.scene, link_pose=self.scene.link_pose[:1]))[1]

    def views(self) -> list[Image]:
        """The first of the object's views."""
        size = self.settings["views"]["size"]
        at = views.viewpoints(generator(self.settings["seed"], self.subject.name, "views"), VIEWS)
        self.renderer.samples = self.settings["views"]["samples"]
        try:
            return self.renderer.render_views(self.scene, [views.camera(each, size) for each in at])
        finally:
            self.renderer.samples = self.settings["vision"]["samples"]

    def with_exr(self, write: bool) -> tuple[list[Image], int]:
        """The unoccluded image, and the bytes of its EXR file, if one is written."""
        for old in self.exr_folder.iterdir():
            old.unlink()
        self.renderer.exr = self.exr_folder if write else None
        try:
            return self.unoccluded(), sum(path.stat().st_size for path in self.exr_folder.iterdir())
        finally:
            self.renderer.exr = None

    def exact_omissions(self) -> Iterator[Omission]:
        """Items without which every bit is the same."""
        more, grasps = partial(self.unoccluded, scene=self.with_unused_material), min(2, len(self.scene.link_pose))
        images = {"size": lambda images: sum(array.nbytes for image in images for array in image)}
        always, of_all = "always", f"always; here of {grasps} grasps"
        for kind, item, when, make, options in (
            (UNOCCLUDED, "hand", always, partial(self.unoccluded, 1), {}),
            (UNOCCLUDED, "render for every grasp", of_all, partial(self.unoccluded, grasps), images),
            (UNOCCLUDED, "materials of no triangle", "where a file has some; here one added", more, {}),
            (UNOCCLUDED, "cameras and lamps of the file", always, self.unoccluded, {}),
            (UNOCCLUDED, "pixels around what is drawn", always, self.unoccluded, {}),
            (UNOCCLUDED, "samples of mask and depth", always, self.unoccluded, {}),
            (OCCLUDED, "hand's meshes for every object", "always but for the first", self.occluded, {}),
            (OCCLUDED, "pixels around what is drawn", always, self.occluded, {}),
            (OCCLUDED, "paths of more than 6 bounces", always, self.occluded, {}),
            (VIEW, "scene for every view", f"always; here of {VIEWS} views", self.views, {}),
        ):  # fmt: skip
            runs = partial(self._with_change, make, kind, item), make
            yield Omission(kind, item, when, self.subject.name, *runs, largest_difference, "grey levels", **options)
        made = [partial(self.with_exr, write) for write in (True, False)]
        what = UNOCCLUDED, "EXR master", "unless vision.exr", self.subject.name
        of_images = lambda one, other: largest_difference(one[0], other[0])  # noqa: E731
        yield Omission(*what, *made, of_images, "grey levels", size=lambda images: images[1])

    def light_omissions(self) -> Iterator[Omission]:
        """Items that change the paths of light: those within a bound are omitted, the others stay."""
        omitted = ("bounces of light after the fourth", "caustics", "tree of lights")
        for item in (*omitted, "first bounce of light", "second to fourth bounce of light", "hand"):
            made = partial(self._with_change, self.occluded, OCCLUDED, item), self.occluded
            when, state = ("always", OMITTED) if item in omitted else ("never: it stays", STAYS)
            made = made if item in omitted else made[::-1]
            unit = "grey levels (RMS)"
            yield Omission(OCCLUDED, item, when, self.subject.name, *made, foreground_rms, unit, BOUND, state=state)

    def _with_change(self, make: Callable[[], Any], kind: str, item: str) -> Any:
        """Call a function that renders, with one item changed."""
        self.renderer.changes = frozenset({(kind, item)})
        try:
            return make()
        finally:
            self.renderer.changes = frozenset()


def largest_difference(images: list[Image], others: list[Image]) -> float:
    """The largest difference of colours and masks, in grey levels; infinite if a depth differs in a bit.

    A single image is compared with each of the others.
    """
    count = max(len(images), len(others))
    images, others = (each * count if len(each) == 1 else each for each in (images, others))
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


def rewrite_glb(glb: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """A glb file whose JSON a function has changed in place."""
    length = struct.unpack_from("<I", glb, 12)[0]
    tree = json.loads(glb[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + length :]
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def add_unused_texture(tree: dict[str, Any]) -> None:
    """Add a material with a texture of noise, which no triangle uses, to a glTF's JSON."""
    noise = np.random.default_rng(0).integers(0, 256, (TEXTURE, TEXTURE, 3), dtype=np.uint8)
    data = io.BytesIO()
    PillowImage.fromarray(noise).save(data, "png", compress_level=1)
    uri = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
    images, textures = tree.setdefault("images", []), tree.setdefault("textures", [])
    images.append({"uri": uri, "name": "unused"})
    textures.append({"source": len(images) - 1})
    colour = {"baseColorTexture": {"index": len(textures) - 1}}
    tree.setdefault("materials", []).append({"name": "unused", "pbrMetallicRoughness": colour})
