"""Objects as files: what is written is what a loader reads back."""

import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from palpate.mesh import prepare
from palpate.shapes import CLASSES, make, suffix, write

AVX512 = "AVX512F AVX512CD AVX512_KNL AVX512_KNM AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL"  # as NumPy names them


def by_colour(scene: trimesh.Scene) -> dict:
    """Faces, volume and picture size by the material's name."""
    result = {}
    for mesh in scene.geometry.values():
        material = mesh.visual.material
        pbr = material.to_pbr() if hasattr(material, "to_pbr") else material
        picture = pbr.baseColorTexture
        result[material.name] = (
            len(mesh.faces),
            mesh.volume * 1e6,
            tuple(pbr.baseColorFactor[:3]),
            None if picture is None else picture.size,
        )
    return result


@pytest.mark.parametrize("class_name", CLASSES)
@pytest.mark.parametrize("index", [0, 1, 2, 5])
def test_round_trip(class_name, index, tmp_path):
    path = write(class_name, index, tmp_path / f"{class_name}-{index:04d}")
    assert path.suffix == suffix(index)
    made, read = make(class_name, index), trimesh.load_scene(path)
    expected, found = by_colour(made), by_colour(read)
    assert all(mesh.is_watertight and mesh.is_winding_consistent for mesh in read.geometry.values())
    assert np.allclose(read.bounds, made.bounds, atol=1e-6)
    assert len(found) == len(expected)
    for name, (faces, volume, colour, picture) in expected.items():
        name = name if path.suffix == ".glb" else f"{path.stem}-{name}"
        assert found[name][0] == faces
        assert found[name][1] == pytest.approx(volume, rel=1e-3)
        assert found[name][3] == picture
        if picture is None:
            assert np.allclose(found[name][2], colour, atol=1)


@pytest.mark.parametrize("class_name", CLASSES)
def test_materials_are_those_of_the_glb(class_name, tmp_path):
    """As they are drawn: metallic, roughness and colour of each material, whichever format an object comes in."""
    found = {}
    for end in ("glb", "obj"):
        source = write(class_name, 2, tmp_path / f"it.{end}")
        prepare(source, tmp_path / end, collision_faces=10**6)  # no need to decimate it
        parts = trimesh.load_scene(tmp_path / end / "visual.glb", process=False).geometry.values()
        materials = [part.visual.material for part in parts]
        found[end] = {each.name.removeprefix("it-"): each for each in materials}
    assert found["obj"].keys() == found["glb"].keys()
    for name, right in found["glb"].items():
        each = found["obj"][name]
        assert each.metallicFactor == pytest.approx(right.metallicFactor, abs=1e-5)
        assert each.roughnessFactor == pytest.approx(right.roughnessFactor, abs=1e-5)
        assert np.abs(each.baseColorFactor.astype(int) - right.baseColorFactor.astype(int)).max() <= 1


def test_texture_coordinates_survive(tmp_path):
    """The picture lies on the same points: texture coordinates by position, before and after."""
    for name in ("cellphone.glb", "cellphone.obj"):
        read = trimesh.load_scene(write("cellphone", 2, tmp_path / name))
        screen = next(m for m in read.geometry.values() if m.visual.material.name.endswith("screen"))
        made = make("cellphone", 2).geometry["screen"]
        nearest = np.argmin(((made.vertices[None] - screen.vertices[:, None]) ** 2).sum(-1), axis=1)
        assert np.allclose(made.visual.uv[nearest], screen.visual.uv, atol=1e-5)


def test_same_bytes_in_another_process_and_as_on_an_older_processor(tmp_path):
    """There NumPy has no functions of its own for AVX2 and AVX-512, which round otherwise."""
    code = "import bpy\nfrom palpate.shapes import write\n"
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    for each in ("bottle-0000", "bottle-0001", "cellphone-0000", "cellphone-0002", "knife-0004", "rifle-0005"):
        name, index = each.split("-")
        write(name, int(index), tmp_path / "a" / each, 0)
        code += f"write({name!r}, {int(index)}, {str(tmp_path / 'b' / each)!r}, 0)\n"
    older = os.environ | {"NPY_DISABLE_CPU_FEATURES": f"AVX2 FMA3 {AVX512}"}
    subprocess.run([sys.executable, "-c", code], check=True, env=older)
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert {"bottle-0000.glb", "rifle-0005.mtl", "rifle-0005.obj"} <= set(files)
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_objects_share_a_folder_without_overwriting_each_other(tmp_path):
    first = [write("bottle", index, tmp_path / f"bottle-{index:04d}.obj") for index in (0, 1, 2)]
    text = [path.read_text() for path in first]
    assert all(f"mtllib {path.stem}.mtl" in content for path, content in zip(first, text, strict=True))
    assert all(p.name.startswith("bottle-000") for p in tmp_path.iterdir())


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"\.glb or \.obj"):
        write("bottle", 0, tmp_path / "bottle.stl")
