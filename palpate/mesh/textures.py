"""Textures that a mesh file names and that can't be used are reported by name, and replaced by neutral grey.

trimesh omits them in silence, and the rest of the material may be black.
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
OUTSIDE = "it lies outside the source's folder: copy it there, or link it"
GREY = 0.5  # linear RGB
MADE_UP = np.asarray(color_image())
MARK = "palpate: neutral grey"  # in the comment of an image that stands for one that can't be used


class Resolver(FilePathResolver):
    """Reads the files that a mesh file names; an image that can't be used comes as a neutral grey one.

    root: as for `palpate.named_files.find`. Attributes: replaced, the problem of each such file, by its name.
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
        if not problem:
            return data
        self.replaced[name] = problem
        if not image:
            raise FileNotFoundError(f"{name}: {problem}")
        file = io.BytesIO()
        PIL.Image.new("RGB", (1, 1), (128, 128, 128)).save(file, "GIF", comment=MARK.encode())
        return file.getvalue()


def problem_of(data: bytes) -> str | None:
    """Why an image file's content can't be used as a texture, by its header; None if it can."""
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
    """Problems of images within a .glb file, by name, and the names of materials whose colour they are."""
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
        return {}, set()  # damaged: its reader raises


def make_neutral(mesh: trimesh.Trimesh, names: set[str]) -> None:
    """Give a part the neutral grey material if its image can't be used, or was made up by trimesh.

    names: of materials whose image is within the file and can't be used.
    """
    material = getattr(mesh.visual, "material", None)
    if material is None:
        return
    images = [getattr(material, name, None) for name in ("image", "baseColorTexture")]
    marks = (MARK, MARK.encode())
    replaced = any(image is not None and image.info.get("comment") in marks for image in images)
    # For texture coordinates alone trimesh makes up a material: one dark image, of no file.
    made_up = images[0] is not None and images[0].format is None and np.array_equal(np.asarray(images[0]), MADE_UP)
    name = getattr(material, "name", None)
    if replaced or made_up or (name in names and (name is not None or images == [None, None])):
        grey = PBRMaterial(
            name=material.name, baseColorFactor=[GREY, GREY, GREY, 1.0], metallicFactor=0.0, roughnessFactor=1.0
        )
        mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.visual.uv, material=grey)
