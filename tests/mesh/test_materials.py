"""The picture is the object: rendered from any format as from glTF with the right material."""

import json

import numpy as np
import pytest

from palpate import mesh
from palpate.scene import Scene
from palpate.vision import Renderer, paper_camera
from tests.mesh.written import FORMATS, RED, WHITE, write

# What a format can express: of a colour by which means, and a texture.
COLOURED = {"obj": ("material", "vertex"), "glb": ("material",), "gltf": ("material",), "ply": ("vertex", "face"),
            "off": ("vertex", "face"), "dae": ("material",)}  # fmt: skip
TEXTURED = ("obj", "glb", "gltf", "ply", "dae")
CASES = [
    *((suffix, name, by) for suffix in COLOURED for name in ("red", "white") for by in COLOURED[suffix]),
    *((suffix, "texture", "material") for suffix in TEXTURED),
    *((suffix, "plain", "material") for suffix in ("stl", "3mf", "ply", "off")),
]
LOOKS = {"red": {"colour": RED}, "white": {"colour": WHITE}, "plain": {"colour": (0.8, 0.8, 0.8)},
         "texture": {"texture": True}}  # fmt: skip


def rendered(path, folder):
    """The image of what is made of a file, and the materials that are written."""
    mesh.prepare(path, folder, up="z", collision_faces=100)
    data = (folder / "visual.glb").read_bytes()
    materials = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])["materials"]
    (image,) = Renderer(samples=4, device="cpu").render(Scene(folder, camera=paper_camera(128)))[:1]
    return image, materials


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    """The images of the body as glTF with the right material."""
    place = tmp_path_factory.mktemp("right")
    return {
        name: rendered(write(place / f"{name}-source", "glb", **look), place / name)[0] for name, look in LOOKS.items()
    }


@pytest.mark.parametrize(("suffix", "name", "by"), CASES)
def test_it_looks_as_the_same_object_in_gltf(tmp_path, right, suffix, name, by):
    look = {} if name == "plain" else LOOKS[name]
    image, materials = rendered(write(tmp_path / "source", suffix, by=by, **look), tmp_path / "out")
    (material,) = (each["pbrMetallicRoughness"] for each in materials)
    assert {"metallicFactor", "roughnessFactor", "baseColorFactor"} <= set(material)
    assert material["metallicFactor"] == 0
    mask = (image.mask == 255) & (right[name].mask == 255)
    assert mask.sum() > 1000
    difference = np.abs(image.rgb[mask].astype(int) - right[name].rgb[mask].astype(int))
    assert difference.mean() < 1.5 and np.median(difference) <= 2 and np.percentile(difference, 99) <= 8


def test_each_format_is_tried():
    assert {suffix for suffix, *_ in CASES} == set(FORMATS) == set(mesh.FORMATS)
