"""What pictures leave out: each part put back in, and the picture compared.

Import it before anything that loads embree, because it loads Blender.
"""

import base64
import io
import json
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from palpate.vision import Image, Renderer, blender, views

blender.load()

import numpy as np  # noqa: E402  (Blender comes before what loads embree)
from PIL import Image as PillowImage  # noqa: E402

from palpate.batch import generator  # noqa: E402
from palpate.scene import plan  # noqa: E402
from studies.omitted.omission import Leaving  # noqa: E402
from studies.pictures import held, rms  # noqa: E402
from studies.subjects import Subject  # noqa: E402

ALONE, HELD, VIEW = "unoccluded image", "occluded image", "view"
# Grey levels (RMS of the pixels that show something) by which a picture may be another one without a part,
# mostly by other random numbers. A picture of 16 samples is off by 4.
BOUND = 1.5
VIEWS = 8  # that are rendered
TEXTURE = 1024  # pixels, the side of the texture that is added and used by nothing


def leavings(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> Iterable[Leaving]:
    """Of the first object: alone, in the hand of its first grasps, and from all around.

    settings: sections `vision`, `views` and `seed`.
    """
    pictures = _Pictures(Path(run), subjects[0], settings)
    yield from pictures.of_parts()
    yield from pictures.of_light()


class _Pictures:
    """Pictures of one object, made by plans."""

    def __init__(self, run: Path, subject: Subject, settings: Mapping[str, Any]):
        self.subject, self.settings = subject, settings
        self.hand, self.poses = held(run, subject)
        self.file = subject.folder / "visual.glb"

    @cached_property
    def renderer(self) -> Renderer:
        vision = self.settings["vision"]
        return Renderer(vision["size"], vision["samples"], vision["device"])

    @cached_property
    def _folder(self) -> tempfile.TemporaryDirectory:
        return tempfile.TemporaryDirectory(prefix="palpate-")

    @cached_property
    def more_material(self) -> Path:
        """The object's file with a material more, which no triangle uses."""
        path = Path(self._folder.name) / "more.glb"
        path.write_bytes(rewritten(self.file.read_bytes(), add_unused_texture))
        return path

    @cached_property
    def masters(self) -> Path:
        folder = Path(self._folder.name) / "exr"
        folder.mkdir()
        return folder

    def alone(self, grasps: int = 0, file: Path | None = None) -> list[Image]:
        """The image of the object alone, for so many grasps; as many images as are rendered."""
        renderer = self.renderer
        image, _ = renderer.render_object(file or self.file, self.hand, self.poses[:grasps])
        again = renderer.plans[ALONE].needs("render for every grasp")
        return [image] * (max(1, grasps) if again else 1)

    def in_the_hand(self) -> list[Image]:
        return self.renderer.render_object(self.file, self.hand, self.poses[:1])[1]

    def views(self) -> list[Image]:
        """The first of the object's views."""
        size = self.settings["views"]["size"]
        at = views.viewpoints(generator(self.settings["seed"], self.subject.name, "views"), VIEWS)
        self.renderer.samples = self.settings["views"]["samples"]
        try:
            return self.renderer.render_views(self.file, [views.camera(each, size) for each in at])
        finally:
            self.renderer.samples = self.settings["vision"]["samples"]

    def with_master(self) -> tuple[list[Image], int]:
        """The image alone, and the bytes of the masters, if the plan keeps them."""
        for old in self.masters.iterdir():
            old.unlink()
        self.renderer.exr = self.masters
        try:
            return self.alone(), sum(path.stat().st_size for path in self.masters.iterdir())
        finally:
            self.renderer.exr = None

    def of_parts(self) -> Iterator[Leaving]:
        """Parts without which every bit is the same."""
        more, grasps = lambda: self.alone(file=self.more_material), min(2, len(self.poses))
        images = {"size": lambda found: sum(array.nbytes for image in found for array in image)}
        files = {"size": lambda found: found[1], "difference": lambda one, other: largest(one[0], other[0])}
        always, of_all = "always", f"always; here of {grasps} grasps"
        for kind, part, when, make, options in (
            (ALONE, "hand", always, lambda: self.alone(1), {}),
            (ALONE, "render for every grasp", of_all, lambda: self.alone(grasps), images),
            (ALONE, "EXR master", "unless vision.exr", self.with_master, files),
            (ALONE, "materials of no triangle", "where a file has some; here one added", more, {}),
            (ALONE, "cameras and lamps of the file", always, self.alone, {}),
            (ALONE, "pixels around what is drawn", always, self.alone, {}),
            (ALONE, "samples of mask and depth", always, self.alone, {}),
            (HELD, "hand's meshes for every object", "always but for the first", self.in_the_hand, {}),
            (HELD, "pixels around what is drawn", always, self.in_the_hand, {}),
            (HELD, "paths of more than 6 bounces", always, self.in_the_hand, {}),
            (VIEW, "scene for every view", f"always; here of {VIEWS} views", self.views, {}),
        ):  # fmt: skip
            same = {"difference": largest, "unit": "grey levels"}
            yield self._leaving(kind, part, when, make, **same | options)

    def of_light(self) -> Iterator[Leaving]:
        """Parts that change the paths of light: those within a bound are left out, the others stay."""
        for part, bound, left_out in (
            ("bounces of light after the fourth", BOUND, True),
            ("caustics", BOUND, True),
            ("tree of lights", BOUND, True),
            ("first bounce of light", BOUND, False),
            ("second to fourth bounce of light", BOUND, False),
            ("hand", BOUND, False),
        ):
            yield self._leaving(
                HELD,
                part,
                "always" if left_out else "never: it stays",
                self.in_the_hand,
                difference=drawn_rms,
                unit="grey levels (RMS)",
                bound=bound,
                left_out=left_out,
            )

    def _leaving(
        self,
        kind: str,
        part: str,
        when: str,
        make: Callable[[], Any],
        **options: Any,
    ) -> Leaving:
        """make: pictures by the renderer's plans. options: what else a `Leaving` takes."""

        def made(needed: bool) -> Any:
            usual = plan(kind)
            self.renderer.plans[kind] = usual.including(part) if needed else usual.without(part)
            try:
                return make()
            finally:
                self.renderer.plans[kind] = usual

        return Leaving(
            scene=kind,
            part=part,
            when=when,
            object=self.subject.name,
            with_it=lambda: made(True),
            without=lambda: made(False),
            **options,
        )


def largest(some: list[Image], others: list[Image]) -> float:
    """The largest difference of colours and masks, in grey levels; infinite if a depth differs in a bit.

    A single image is compared with each of the others.
    """
    count = max(len(some), len(others))
    some, others = (images * count if len(images) == 1 else images for images in (some, others))
    worst = 0.0
    for image, other in zip(some, others, strict=True):
        if not np.array_equal(image.depth, other.depth):
            return float("inf")
        for array, same in ((image.rgb, other.rgb), (image.mask, other.mask)):
            worst = max(worst, float(np.abs(array.astype(int) - same).max()))
    return worst


def drawn_rms(some: list[Image], others: list[Image]) -> float:
    """RMS difference of colours, in grey levels, over the pixels that show something in one of the two."""
    pairs = list(zip(some, others, strict=True))
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
