"""What pictures omit: a naive renderer, and each item of its needless work compared with the engine.

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
from studies.omitted.omission import OMITTED, STAYS, Omission  # noqa: E402
from studies.pictures import rms  # noqa: E402
from studies.scenes import scene_of  # noqa: E402
from studies.subjects import Subject  # noqa: E402

ALONE, HELD, VIEW = "unoccluded image", "occluded image", "view"
# Grey levels (RMS of the pixels that show something) by which a picture may be another one without an item,
# mostly by other random numbers. A picture of 16 samples is off by 4.
BOUND = 1.5
VIEWS = 8  # that are rendered
TEXTURE = 1024  # pixels, the side of the texture that is added and used by nothing
OUT_OF_SIGHT = (0.0, 0.0, -1000.0)  # m: where a hand is that a picture doesn't show

# Settings of Cycles with an item put in that the engine omits, and with one taken out that it has.
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
# What any kind of picture can have put in without a change of a bit, and what only one of them has.
EVERY_PICTURE = (
    "materials of no triangle",
    "cameras and lamps of the file",
    "pixels around what is drawn",
    "samples of mask and depth",
    "paths of more than 6 bounces",
)
OMITTED_ITEMS = {
    ALONE: ("hand", "render for every grasp", *EVERY_PICTURE),
    HELD: ("hand's meshes for every object", *EVERY_PICTURE),
    VIEW: ("scene for every view", *EVERY_PICTURE),
}


class NaiveRenderer(Renderer):
    """The engine with needless work put in, or with light or the hand taken out.

    Attributes:
        changes: pairs of a kind of picture and an item of it: of `OMITTED_ITEMS` and `CYCLES_WITH` to put it in, of
            `CYCLES_WITHOUT`, or the hand of an occluded image, to take it out.
    """

    changes: frozenset[tuple[str, str]] = frozenset()
    _kind = ALONE  # of the picture that is being made

    def _changed(self, item: str) -> bool:
        return (self._kind, item) in self.changes

    def render(self, scene: Scene) -> tuple[Image, list[Image]]:
        self._kind = ALONE
        if (HELD, "hand's meshes for every object") in self.changes:
            self._hand = None
        return super().render(scene)

    def render_views(self, scene: Scene, cameras) -> list[Image]:
        self._kind = VIEW
        return super().render_views(scene, cameras)

    def _draw_alone(self, scene: Scene, points: np.ndarray):
        if self._changed("hand") and len(scene.link_pose):
            away = scene.link_pose[0].copy()
            away[:, :3, 3] += OUT_OF_SIGHT
            self._pose_hand(away)
        for _ in range(max(1, len(scene.link_pose)) if self._changed("render for every grasp") else 1):
            layers = super()._draw_alone(scene, points)
        return layers

    def _draw_held(self, scene: Scene, points: np.ndarray, grasp: int):
        self._kind = HELD
        if self._changed("hand"):
            return self._draw(scene.camera, points)
        return super()._draw_held(scene, points, grasp)

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
    """Of the first object: alone, in the hand of its first grasps, and from all around.

    settings: sections `vision`, `views` and `seed`.
    """
    pictures = _Pictures(Path(run), subjects[0], settings)
    yield from pictures.of_items()
    yield from pictures.of_light()


class _Pictures:
    """Pictures of one object, by the engine and by naive variants of it."""

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
    def with_more_material(self) -> Scene:
        """The scene with a material more in the object's file, which no triangle uses."""
        folder = Path(self._folder.name) / self.scene.name
        folder.mkdir()
        (folder / "visual.glb").write_bytes(rewritten(self.scene.visual_file.read_bytes(), add_unused_texture))
        return replace(self.scene, object_folder=folder)

    @cached_property
    def masters(self) -> Path:
        folder = Path(self._folder.name) / "exr"
        folder.mkdir()
        return folder

    def alone(self, grasps: int = 0, scene: Scene | None = None) -> list[Image]:
        """The image of the object alone, for so many grasps; as many images as are rendered."""
        scene = replace(scene or self.scene, link_pose=self.scene.link_pose[:grasps])
        image, _ = self.renderer.render(scene)
        again = (ALONE, "render for every grasp") in self.renderer.changes
        return [image] * (max(1, grasps) if again else 1)

    def in_the_hand(self) -> list[Image]:
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

    def with_master(self, kept: bool) -> tuple[list[Image], int]:
        """The image alone, and the bytes of its EXR master, if it is kept."""
        for old in self.masters.iterdir():
            old.unlink()
        self.renderer.exr = self.masters if kept else None
        try:
            return self.alone(), sum(path.stat().st_size for path in self.masters.iterdir())
        finally:
            self.renderer.exr = None

    def of_items(self) -> Iterator[Omission]:
        """Parts without which every bit is the same."""
        more, grasps = partial(self.alone, scene=self.with_more_material), min(2, len(self.scene.link_pose))
        images = {"size": lambda found: sum(array.nbytes for image in found for array in image)}
        always, of_all = "always", f"always; here of {grasps} grasps"
        for kind, item, when, make, options in (
            (ALONE, "hand", always, partial(self.alone, 1), {}),
            (ALONE, "render for every grasp", of_all, partial(self.alone, grasps), images),
            (ALONE, "materials of no triangle", "where a file has some; here one added", more, {}),
            (ALONE, "cameras and lamps of the file", always, self.alone, {}),
            (ALONE, "pixels around what is drawn", always, self.alone, {}),
            (ALONE, "samples of mask and depth", always, self.alone, {}),
            (HELD, "hand's meshes for every object", "always but for the first", self.in_the_hand, {}),
            (HELD, "pixels around what is drawn", always, self.in_the_hand, {}),
            (HELD, "paths of more than 6 bounces", always, self.in_the_hand, {}),
            (VIEW, "scene for every view", f"always; here of {VIEWS} views", self.views, {}),
        ):  # fmt: skip
            made = partial(self._made, make, kind, item)
            yield self._row(kind, item, when, made, make, difference=largest, unit="grey levels", **options)
        yield self._row(
            ALONE,
            "EXR master",
            "unless vision.exr",
            *(partial(self.with_master, kept) for kept in (True, False)),
            difference=lambda one, other: largest(one[0], other[0]),
            unit="grey levels",
            size=lambda found: found[1],
        )

    def of_light(self) -> Iterator[Omission]:
        """Parts that change the paths of light: those within a bound are omitted, the others stay."""
        for item, omitted in (
            ("bounces of light after the fourth", True),
            ("caustics", True),
            ("tree of lights", True),
            ("first bounce of light", False),
            ("second to fourth bounce of light", False),
            ("hand", False),
        ):
            changed, engine = partial(self._made, self.in_the_hand, HELD, item), self.in_the_hand
            yield self._row(
                HELD,
                item,
                "always" if omitted else "never: it stays",
                *((changed, engine) if omitted else (engine, changed)),
                difference=drawn_rms,
                unit="grey levels (RMS)",
                bound=BOUND,
                state=OMITTED if omitted else STAYS,
            )

    def _made(self, make: Callable[[], Any], kind: str, item: str) -> Any:
        """What a function makes of pictures with an item changed."""
        self.renderer.changes = frozenset({(kind, item)})
        try:
            return make()
        finally:
            self.renderer.changes = frozenset()

    def _row(
        self, kind: str, item: str, when: str, with_it: Callable[[], Any], without: Callable[[], Any], **options: Any
    ) -> Omission:
        return Omission(kind, item, when, self.subject.name, with_it, without, **options)


def largest(images: list[Image], others: list[Image]) -> float:
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


def drawn_rms(images: list[Image], others: list[Image]) -> float:
    """RMS difference of colours, in grey levels, over the pixels that show something in one of the two."""
    pairs = list(zip(images, others, strict=True))
    drawn = [np.isfinite(image.depth) | np.isfinite(other.depth) for image, other in pairs]
    return rms(*(np.concatenate([pair[k].rgb[at] for pair, at in zip(pairs, drawn, strict=True)]) for k in (0, 1)))


def rewritten(glb: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """A glb file whose JSON is changed in place by a function."""
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
