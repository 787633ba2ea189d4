"""Textures that a mesh file names and that can't be used: said by name, and neutral grey in their place.

Without this a reader leaves them out without a word, and what is left of the material may be black.
"""

import io
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import PIL.Image
import trimesh
from trimesh.resolvers import FilePathResolver
from trimesh.visual.material import PBRMaterial, color_image

from palpate import named_files
from palpate.named_files import IMAGES, gltf_tree, held_pictures

LARGEST = named_files.LARGEST_SIDE
# PIL warns above this number of pixels and refuses twice as many; by itself it refuses 16k textures.
PIL.Image.MAX_IMAGE_PIXELS = LARGEST**2
OUTSIDE = "it lies outside the source's folder: set source.outside to true to read it"
GREY = 0.5  # linear RGB
MADE_UP = np.asarray(color_image())
MARK = "palpate: neutral grey"  # in the comment of an image that stands for one that can't be used


class Resolver(FilePathResolver):
    """Reads the files that a mesh file names; an image that can't be used comes as a neutral grey one.

    root: the folder that they have to be in, as for `palpate.named_files.find`.
    Attributes: replaced, what is wrong with each such file, by the name that the mesh file has for it.
    """

    def __init__(self, path: Path, root: Path | str | None = None):
        super().__init__(str(path))
        self.path, self.root = path, root
        self.replaced: dict[str, str] = {}

    def get(self, name: str) -> bytes:
        """The content of a file; raises FileNotFoundError, but for images."""
        name = str(name)
        image = unquote(name.strip()).lower().endswith(IMAGES)
        place, data = named_files.find(self.path, name, self.root), b""
        if place is None:
            problem = OUTSIDE if named_files.is_outside(self.path, name, self.root) else "there is no such file"
        else:
            data = (self.path.parent / place).read_bytes()
            problem = problem_of(data) if image else None
        if problem and image:
            return self._instead(name, problem)
        if problem:
            self.replaced[name] = problem
            raise FileNotFoundError(f"{name}: {problem}")
        return data

    def _instead(self, name: str, problem: str) -> bytes:
        self.replaced[name] = problem
        file = io.BytesIO()
        image = PIL.Image.new("RGB", (1, 1), (128, 128, 128))
        image.save(file, "GIF", comment=MARK.encode())
        return file.getvalue()


def problem_of(data: bytes) -> str | None:
    """Why an image file's content can't be used as a texture; None if it can, as far as its head tells."""
    try:
        with PIL.Image.open(io.BytesIO(data)) as image:
            width, height = image.size
    except PIL.Image.DecompressionBombError:
        return f"it has more than {LARGEST} x {LARGEST} pixels"
    except Exception as error:  # whatever a broken file makes a reader trip over
        return f"it is no image that can be read ({type(error).__name__})"
    if max(width, height) > LARGEST:
        return f"it has {width} x {height} pixels, and at most {LARGEST} a side can be used"
    return None


def within(path: Path) -> tuple[dict[str, str], set[str]]:
    """What is wrong with images within a .glb file, by name, and the names of materials whose colour they are."""
    if path.suffix.lower() != ".glb":
        return {}, set()
    try:
        tree, start = gltf_tree(path)
        problems = {number: problem_of(head) for number, head in held_pictures(path, tree, start)}
        bad = {number for number, problem in problems.items() if problem}
        replaced = {tree["images"][number].get("name") or f"image {number}": problems[number] for number in sorted(bad)}
        names = set()
        for material in tree.get("materials", []):
            texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
            if texture and tree["textures"][texture["index"]].get("source") in bad:
                names.add(material.get("name"))
        return replaced, names
    except (ValueError, KeyError, IndexError, TypeError, AttributeError):
        return {}, set()  # damaged: its reader says so


def make_neutral(mesh: trimesh.Trimesh, names: set[str]) -> None:
    """Give a part the neutral grey material if its colour is from an image that can't be used, or from none at all.

    names: of materials whose image is within the file and can't be used.
    """
    material = getattr(mesh.visual, "material", None)
    if material is None:
        return
    images = [getattr(material, name, None) for name in ("image", "baseColorTexture")]
    replaced = any(image is not None and _comment(image) == MARK for image in images)
    name = getattr(material, "name", None)
    lost = name in names and (name is not None or images == [None, None])
    if replaced or lost or _is_empty(material):
        grey = PBRMaterial(
            name=material.name, baseColorFactor=[GREY, GREY, GREY, 1.0], metallicFactor=0.0, roughnessFactor=1.0
        )
        mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.visual.uv, material=grey)


def _comment(image: PIL.Image.Image) -> str:
    comment = image.info.get("comment", b"")
    return comment.decode(errors="replace") if isinstance(comment, bytes) else str(comment)


def _is_empty(material) -> bool:
    """Whether it is the material that the reader makes up for texture coordinates alone: one dark image, of no file."""
    image = getattr(material, "image", None)
    return image is not None and image.format is None and np.array_equal(np.asarray(image), MADE_UP)
