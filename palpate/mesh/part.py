"""What readers share: the files that a mesh file names, read once; parts of an object, triangles with one explicit
material (glTF's defaults are metal)."""

import io
import logging
import warnings
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import PIL.Image
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.color import srgb_to_linear
from trimesh.visual.material import PBRMaterial

from palpate import named_files
from palpate.named_files import LARGEST_SIDE

PIL.Image.MAX_IMAGE_PIXELS = None  # sides are looked at instead; by itself PIL refuses textures of 16k
log = logging.getLogger(__name__)
OUTSIDE = "it lies outside the source's folder: copy it there, or link it"
DRAWN_GREY = "drawn in neutral grey"
PLAIN = 0.8  # linear RGB, of a file without any colour: Blender's own default
GREY = 0.5  # linear RGB, in place of a texture that can't be used


class Files:
    """Reads what a mesh file names. root: the folder that it has to be in, as for `palpate.named_files.find`."""

    def __init__(self, path: Path, root: Path | str | None = None):
        self.path, self.root = path, root
        self.problems: dict[str, str] = {}  # by the name of a file or a part: what is wrong with it, and what follows

    def note(self, name: str, problem: str) -> None:
        """Record, and log once, what is wrong with a file or a part that the mesh file names, and what follows."""
        if name not in self.problems:
            log.warning("%s: %s: %s", self.path, name, problem)
        self.problems[name] = problem

    def read(self, name: str) -> bytes:
        """The content of a named file. Raises FileNotFoundError, with the reason."""
        place = named_files.find(self.path, name, self.root)
        if place is None:
            outside = named_files.is_outside(self.path, name, self.root)
            raise FileNotFoundError(f"{name}: {OUTSIDE if outside else 'there is no such file'}")
        return (self.path.parent / place).read_bytes()

    def picture(self, name: str, data: bytes | None = None, follows: str = DRAWN_GREY) -> PIL.Image.Image | None:
        """A named texture, or the one whose bytes are given; None, and a note of its name, if it can't be used. Raises
        ValueError for one that is cut off, if it is decoded here; else its export raises PIL's error."""
        problem = ""
        try:
            image = PIL.Image.open(io.BytesIO(self.read(name) if data is None else data))
            if max(image.size) > LARGEST_SIDE:
                problem = "it has {} x {} pixels, and at most {} a side can be used".format(*image.size, LARGEST_SIDE)
        except FileNotFoundError as error:
            problem = str(error).removeprefix(f"{name}: ")
        except Exception as error:  # whatever a broken file makes a reader trip over
            problem = f"it is no image that can be read ({type(error).__name__})"
        if problem:
            self.note(name, f"{problem}: {follows}")
            return None
        try:
            return _as_gltf_picture(image)
        except (OSError, SyntaxError, ValueError) as error:  # PIL's
            raise ValueError(f"a texture can't be read, {name} ({type(error).__name__}: {error})") from None


def _as_gltf_picture(image: PIL.Image.Image) -> PIL.Image.Image:
    """A picture as glTF can have it: 8 bits of L, RGB or RGBA. A JPEG of these is written as it was."""
    if image.mode in ("L", "RGB", "RGBA") and "transparency" not in image.info:
        if image.format == "JPEG":
            # Its own quantisation, not the writer's lower default.
            image.save = partial(image.save, quality="keep")  # type: ignore[method-assign]
        return image
    if image.mode[0] in "IF":
        values = np.nan_to_num(np.asarray(image, dtype=float))
        largest = 65535 if "16" in image.mode or values.max() <= 65535 else 2**31 - 1
        values = np.clip(values / (1 if image.mode == "F" else largest), 0, 1)
        return PIL.Image.fromarray(np.rint(255 * values).astype(np.uint8))
    return image.convert("RGBA" if image.has_transparency_data else "L" if image.mode == "1" else "RGB")


class Loaded(NamedTuple):
    """A mesh file: its parts, in its own frame and unit; unit: metres of that unit, 1 where the format states none."""

    parts: list[trimesh.Trimesh]
    unit: float = 1.0


def make_part(
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    material: PBRMaterial | None = None,
    *,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    colours: np.ndarray | None = None,
    wrap: tuple[str, str] | None = None,
) -> trimesh.Trimesh:
    """A part of an object; nothing is merged or dropped. vertices (n, 3); faces (f, 3); normals (n, 3) of the file; uv
    (n, 2), v upwards; colours (n, 4) uint8, linear light, times the material's, by default white under colours, else
    `PLAIN`. wrap: of the texture across and up, if not both "repeat": "clamp" or "mirror"."""
    material = plain(PLAIN if colours is None else 1.0) if material is None else material
    part = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    part.visual = TextureVisuals(uv=uv, material=material)
    if colours is not None:
        part.visual.vertex_attributes["color"] = colours
    more = {"name": name, "vertex_normals": normals, "wrap": wrap}
    part.metadata |= {key: value for key, value in more.items() if value is not None}
    return part


def plain(colour: float = PLAIN, name: str | None = None) -> PBRMaterial:
    """A rough material of one grey, linear light."""
    return PBRMaterial(name=name, baseColorFactor=[colour] * 3 + [1.0], metallicFactor=0.0, roughnessFactor=1.0)


def textured(image: PIL.Image.Image | None, name: str | None) -> PBRMaterial:
    """A rough material with a texture; `GREY` for one that can't be used."""
    material = plain(GREY if image is None else 1.0, name)
    material.baseColorTexture = image
    return material


def eight_bit(shares: np.ndarray) -> np.ndarray:
    """Shares of 1 as uint8; NaN as 0."""
    return np.round(255 * np.clip(np.nan_to_num(shares), 0, 1)).astype(np.uint8)


def linear(colours: np.ndarray) -> np.ndarray:
    """Colours (n, 3 or 4) uint8 in sRGB as (n, 4) uint8 in linear light."""
    alpha = colours[:, 3] if colours.shape[1] > 3 else np.full(len(colours), 255, np.uint8)
    return np.column_stack([eight_bit(srgb_to_linear(colours[:, :3])), alpha])


def numbers(text: bytes) -> np.ndarray:
    """Numbers (n,) of a text that are separated by white space. Raises ValueError if one is none."""
    with warnings.catch_warnings(action="error", category=DeprecationWarning):
        try:
            return np.fromstring(text, sep=" ")
        except DeprecationWarning:
            raise ValueError("a word in it is not a number") from None


def distinct(*columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each distinct row of columns (n,) of non-negative integers first stands (m,), and the number among these
    of each row (n,): vertices are written once, however many corners are at them."""
    key = np.asarray(columns[0], dtype=np.int64)
    for column in columns[1:]:
        key = np.unique(key, return_inverse=True)[1] * (int(column.max(initial=0)) + 1) + column
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number


def usable_normals(normals: np.ndarray | None) -> np.ndarray | None:
    """Normals (n, 3) at length 1, or 0 where they have no direction (Blender computes these); None if none has one."""
    if normals is None or not np.isfinite(normals).all() or not normals.any():
        return None
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1)
