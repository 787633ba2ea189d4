"""Transparent and thin objects, and too little memory: right pictures are valid, and wrong ones are not made."""

import subprocess
import sys

import bpy  # noqa: F401
import numpy as np
import pytest
import trimesh
from PIL import Image as PillowImage

from palpate.batch import UnusableObject
from palpate.camera import matrices, paper_camera
from palpate.dataset.checks import CHECKS, CheckedObject, check_vision
from palpate.mesh import prepare
from palpate.vision import Renderer
from tests.vision.scenes import painted, scene_of

SIZE = 96


def striped(mode, opacity):
    """A box, each of its triangles half opaque and half of another opacity (0..255)."""
    box = trimesh.creation.box((0.3, 0.3, 0.3))
    box.unmerge_vertices()
    uv = np.tile([(0, 0), (1, 0), (1, 1)], (len(box.faces), 1))
    pixels = np.full((64, 64, 4), (150, 60, 60, 255), dtype=np.uint8)
    pixels[16:48, :, 3] = opacity
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=PillowImage.fromarray(pixels), alphaMode=mode, metallicFactor=0.0, doubleSided=True
    )
    box.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return box


def failed(folder):
    """The checks of vision that the picture of the object alone doesn't pass, with what they measured."""
    image, _ = Renderer(samples=1, device="cpu").render(scene_of(folder / "visual.glb", size=SIZE))
    rows = {}
    for array, values in (("", image.rgb), ("_mask", image.mask), ("_depth", image.depth)):
        rows |= {f"unoccluded{array}": values[None], f"occluded{array}": values[None, None]}
    rows |= matrices([paper_camera(SIZE)])
    found = {check: np.max(value) for check, value in check_vision(CheckedObject({"vision": rows}, folder))}
    return {check: value for check, value in found.items() if not value <= CHECKS[check].limit}


@pytest.mark.parametrize(("mode", "opacity"), [("MASK", 0), ("BLEND", 0), ("BLEND", 120), ("OPAQUE", 0)])
def test_pictures_of_transparent_materials_are_valid(tmp_path, mode, opacity):
    (tmp_path / "box.glb").write_bytes(trimesh.Scene(striped(mode, opacity)).export(file_type="glb"))
    record = prepare(tmp_path / "box.glb", tmp_path / "out")
    assert record["visual.glb"]["see_through"] == (mode != "OPAQUE")
    assert failed(tmp_path / "out") == {}
    if (mode, opacity) == ("BLEND", 0):  # there are holes: the strict check would have failed
        (tmp_path / "out/mesh.json").unlink()
        assert set(failed(tmp_path / "out")) == {"picture of mesh"}


def test_a_pixel_on_the_outline_of_a_needle_is_no_failure(tmp_path):
    """The needle shows in 8 pixels; of one more, Blender and Embree disagree whether it does."""
    needle = trimesh.creation.cylinder(radius=0.0005, height=0.5)
    turns = np.random.default_rng(0).random((4, 3))
    needle.apply_transform(trimesh.transformations.random_rotation_matrix(turns[3]))
    needle.export(tmp_path / "needle.ply")
    prepare(tmp_path / "needle.ply", tmp_path / "out")
    assert failed(tmp_path / "out") == {}


def test_an_object_that_cannot_be_seen_is_unusable(write_glb):
    nothing = painted(trimesh.creation.box((0.3, 0.3, 0.3)), (0.5, 0.5, 0.5))
    nothing.visual.material.alphaMode = "BLEND"
    nothing.visual.material.baseColorFactor = [0.5, 0.5, 0.5, 0.0]
    with pytest.raises(UnusableObject, match="visual.glb: no pixel of 96 x 96 shows the object"):
        Renderer(samples=1, device="cpu").render(scene_of(write_glb("nothing", nothing), size=SIZE))


# A picture of a box with a texture of 4096 x 4096, which takes 64 MB in Blender and as much in Cycles, under a limit
# of memory (MB beyond what is in use; 0: none).
LIMITED = """
import os, resource, sys
import numpy as np
from pathlib import Path
from palpate.vision import Renderer, views
from palpate.batch import each_object
from palpate.camera import paper_camera
from palpate.scene import Scene
stage, folder, spare = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
renderer = Renderer(1, "cpu", 1)
np.eye(3) @ np.eye(3)  # OpenBLAS takes its memory at the first product, and tries for ever if it gets none
if spare:
    limit = int(open("/proc/self/statm").read().split()[0]) * os.sysconf("SC_PAGE_SIZE") + (spare << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
def draw(name):
    if stage == "views":
        return views.render(renderer, Scene(folder), views.viewpoints(np.random.default_rng(0), 1), 64).image
    return renderer.render(Scene(folder, camera=paper_camera(64)))[0].rgb
images, rejections = each_object(["box"], draw, stage)
print(rejections or images["box"].tolist(), flush=True)
os._exit(0)
"""


@pytest.mark.parametrize("stage", ["vision", "views"])
def test_too_little_memory_for_a_texture_stops_the_batch_and_draws_nothing_else(tmp_path, stage):
    """Blender goes on without a texture that it lacks the memory for."""
    box = striped("OPAQUE", 255)
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    box.visual.material.baseColorTexture = PillowImage.fromarray(pixels).resize((4096, 4096), PillowImage.NEAREST)
    (tmp_path / "box.glb").write_bytes(trimesh.Scene(box).export(file_type="glb"))
    prepare(tmp_path / "box.glb", tmp_path / "out")

    def run(spare):
        command = [sys.executable, "-c", LIMITED, stage, str(tmp_path / "out"), str(spare)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    drawn = run(0).stdout
    assert drawn.startswith("[[[")
    ends = set()
    for spare in (60, 90, 220):
        done = run(spare)
        stopped = "MemoryError" in done.stderr and done.returncode == 1
        assert stopped or done.returncode < 0 or done.stdout == drawn, (spare, done.stdout[:200], done.stderr[-2000:])
        ends.add("stopped" if stopped else "crashed" if done.returncode < 0 else "drawn")
    assert "stopped" in ends
