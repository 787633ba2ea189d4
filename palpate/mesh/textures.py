"""Textures that a mesh file names and that can't be used: said by name, and neutral grey in their place.

Without this a reader leaves them out without a word, and what is left of the material may be black.
"""

import io
from pathlib import Path

import numpy as np
import PIL.Image
import trimesh
from trimesh.resolvers import FilePathResolver
from trimesh.visual.material import PBRMaterial, color_image

from palpate.mesh.integrity import gltf_tree

LARGEST = 16384  # pixels a side: the largest that common GPUs take as a texture
# PIL warns above this number of pixels and refuses twice as many; by itself it refuses 16k textures.
PIL.Image.MAX_IMAGE_PIXELS = LARGEST**2
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".tga", ".gif", ".webp")
# Seen from the mesh file's folder: beside it, and where Gazebo's models have them, as Google's scanned objects.
FOLDERS = (".", "../materials/textures")
GREY = 0.5  # linear RGB
MADE_UP = np.asarray(color_image())
MARK = "palpate: neutral grey"  # in the comment of an image that stands for one that can't be used


class Resolver(FilePathResolver):
    """Reads the files that a mesh file names; an image that can't be used comes as a neutral grey one.

    Attributes: replaced, what is wrong with each such file, by the name that the mesh file has for it.
    """

    def __init__(self, path: Path | str):
        super().__init__(str(path), allow_anywhere=True)  # scans have their textures in a folder beside
        self.replaced: dict[str, str] = {}

    def get(self, name: str) -> bytes:
        """The content of a file; raises what reading it raises, but for images."""
        image = str(name).strip().lower().endswith(IMAGES)
        try:
            place = str(name).strip().replace("\\", "/")
            data = super().get(self._place(place) if image else place)
        except Exception:
            if not image:
                self.replaced[str(name)] = "there is no such file"
                raise
            return self._instead(name, "there is no such file")
        problem = problem_of(data) if image else None
        return self._instead(name, problem) if problem else data

    def _place(self, name: str) -> str:
        """The first of `FOLDERS` that has an image, with its name; the name alone if none has it."""
        places = [Path(folder, name).as_posix() for folder in FOLDERS]
        return next((place for place in places if Path(self.parent, place).is_file()), name)

    def _instead(self, name: str, problem: str) -> bytes:
        self.replaced[str(name)] = problem
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
        tree, start_of_binary = gltf_tree(path)
        binary = path.read_bytes()[start_of_binary:]
        replaced, bad = {}, set()
        for number, image in enumerate(tree.get("images", [])):
            if "bufferView" not in image:
                continue
            view = tree["bufferViews"][image["bufferView"]]
            start = view.get("byteOffset", 0)
            problem = problem_of(binary[start : start + view["byteLength"]])
            if problem:
                replaced[image.get("name") or f"image {number}"] = problem
                bad.add(number)
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
