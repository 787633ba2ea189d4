"""Textures that can't be used: named in mesh.json, and neutral grey in their place."""

import io
import json

import numpy as np
import PIL.Image
import pytest
import trimesh

from palpate import mesh
from palpate.batch import UnusableObject
from palpate.catalogue import CatalogueError, Source, scan
from palpate.mesh import load
from palpate.mesh.formats import obj
from palpate.mesh.part import GREY
from palpate.named_files import LARGEST_SIDE as LARGEST
from palpate.scene import Scene
from palpate.vision import Renderer

TETRAHEDRON = (
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
    "f 1/1 3/2 2/3\nf 1/1 2/2 4/3\nf 1/1 4/2 3/3\nf 2/1 3/2 4/3\n"
)


def png(width: int, height: int, mode: str = "1") -> bytes:
    file = io.BytesIO()
    PIL.Image.new(mode, (width, height), 1 if mode == "1" else (250, 10, 10)).save(file, "PNG", compress_level=1)
    return file.getvalue()


def write_obj(folder, library: str | None, **files: bytes):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "a.obj").write_text("mtllib x.mtl\nusemtl m\n" + TETRAHEDRON)
    if library is not None:
        (folder / "x.mtl").write_text(f"newmtl m\n{library}")
    for name, data in files.items():
        (folder / f"{name}.png").write_bytes(data)
    return folder / "a.obj"


def write_glb(folder, image: bytes):
    """A .glb whose image is exchanged for another's bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    ball = trimesh.creation.icosphere(subdivisions=1)
    uv = np.zeros((len(ball.vertices), 2))
    material = trimesh.visual.material.PBRMaterial(name="skin", baseColorTexture=PIL.Image.new("RGB", (4, 4)))
    ball.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    data = ball.export(file_type="glb")
    length = int.from_bytes(data[12:16], "little")
    tree, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    view = tree["bufferViews"][tree["images"][0]["bufferView"]]
    view |= {"byteOffset": len(binary), "byteLength": len(image)}
    binary += image + bytes(-len(image) % 4)
    tree["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text + len(binary).to_bytes(4, "little") + b"BIN\0" + binary
    (folder / "a.glb").write_bytes(
        b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks
    )
    return folder / "a.glb"


CASES = {
    "missing": (lambda folder: write_obj(folder, "map_Kd gone.png\n"), "gone.png", "there is no such file"),
    "missing, black": (lambda f: write_obj(f, "Kd 0 0 0\nmap_Kd gone.png\n"), "gone.png", "there is no such file"),
    "no library": (lambda folder: write_obj(folder, None), "x.mtl", "there is no such file"),
    "no image": (lambda f: write_obj(f, "map_Kd t.png\n", t=b"text"), "t.png", "it is no image that can be read"),
    "too large": (
        lambda folder: write_obj(folder, "map_Kd t.png\n", t=png(LARGEST + 1, 8)), "t.png", f"{LARGEST + 1} x 8 pixels"
    ),
    "too large within": (lambda f: write_glb(f, png(LARGEST + 1, 8)), "image 0", f"{LARGEST + 1} x 8 pixels"),
    "no image within": (lambda f: write_glb(f, b"text" * 4), "image 0", "it is no image that can be read"),
}  # fmt: skip


def prepared(path, folder):
    record = mesh.prepare(path, folder, up="z", collision_faces=100)
    data = (folder / "visual.glb").read_bytes()
    return record, json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


@pytest.mark.parametrize("case", CASES)
def test_a_texture_that_cannot_be_used_is_named_and_grey(tmp_path, case):
    write, name, problem = CASES[case]
    record, glb = prepared(write(tmp_path / "source"), tmp_path / "out")
    assert list(record["source"]["problems"]) == [name]
    assert problem in record["source"]["problems"][name]
    assert json.loads((tmp_path / "out/mesh.json").read_text())["source"] == record["source"]
    (material,) = (material["pbrMetallicRoughness"] for material in glb["materials"])
    np.testing.assert_allclose(material["baseColorFactor"], [GREY] * 3 + [1], atol=0.5 / 255)
    assert material["metallicFactor"] == 0 and "baseColorTexture" not in material and not glb.get("images")


def test_it_is_in_the_log(tmp_path, caplog):
    load.load(write_obj(tmp_path, "map_Kd gone.png\n"))
    assert "a.obj: gone.png: there is no such file: drawn in neutral grey" in caplog.text


def test_it_is_drawn_in_grey_and_not_black(tmp_path):
    for name, write in {"missing": CASES["missing, black"][0], "coordinates": lambda f: write_obj(f, None)}.items():
        prepared(write(tmp_path / name), tmp_path / f"{name}-out")
        (image,) = Renderer(samples=4, device="cpu").render(Scene(tmp_path / f"{name}-out"))[:1]
        pixels = image.rgb[image.mask == 255].astype(int)
        assert len(pixels) > 100
        assert 60 < np.median(pixels) < 220 and np.abs(pixels - pixels.mean(axis=1, keepdims=True)).mean() < 12


def test_a_texture_beside_the_folder_and_one_with_backslashes_are_read(tmp_path):
    for place, name in (("../t.png", tmp_path / "t.png"), ("maps\\t.png", tmp_path / "source/maps/t.png")):
        path = write_obj(tmp_path / "source", f"map_Kd {place}\n")
        name.parent.mkdir(exist_ok=True)
        name.write_bytes(png(4, 4, "RGB"))
        record, glb = prepared(path, tmp_path / "out")
        assert record["source"]["problems"] == {} and len(glb["images"]) == 1


def test_a_texture_of_16k_loads(tmp_path):
    path = write_obj(tmp_path, "map_Kd t.png\n", t=png(LARGEST, LARGEST))
    ((part,), _), problems = load.load(path)
    assert problems == {} and part.visual.material.baseColorTexture.size == (LARGEST, LARGEST)
    part.visual.material.baseColorTexture.load()


def test_too_little_memory_is_no_fault_of_the_object_and_names_the_file(tmp_path, monkeypatch):
    def exhausted(*arguments, **keywords):
        raise MemoryError("Unable to allocate 9 TiB")

    monkeypatch.setattr(obj, "triangulate", exhausted)
    with pytest.raises(MemoryError, match="while loading .*a.obj, .*Unable to allocate"):
        load.load(write_obj(tmp_path, None))


def test_a_link_that_leads_nowhere_is_said_at_the_start(tmp_path):
    (tmp_path / "mug").mkdir()
    (tmp_path / "mug/a.stl").symlink_to(tmp_path / "moved/a.stl")
    with pytest.raises(CatalogueError, match="mug/a.stl: a link to .*moved/a.stl, where there is no file: correct"):
        scan(Source("folder", tmp_path), {"mug": "all"})
    with pytest.raises(UnusableObject, match="no such file"):
        load.load(tmp_path / "mug/a.stl")
