"""Pictures with what their plans leave out put back in."""

import base64
from io import BytesIO

import bpy
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal
from PIL import Image as PillowImage

from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION
from palpate.scene import plan
from palpate.vision import Renderer, looking_at
from studies.omitted.renders import rewritten
from tests.vision.scenes import grasp_poses, painted

# These change a picture, but by less than its noise.
BOUNDED = {"bounces of light after the fourth", "caustics", "tree of lights"}
EXACT = [
    (kind, part)
    for kind in ("unoccluded image", "occluded image", "view")
    for part in plan(kind).left_out
    if part not in BOUNDED | {"EXR master"}
]


@pytest.fixture(scope="module")
def hand():
    return allegro()


@pytest.fixture(scope="module")
def torus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("torus")
    mesh = painted(trimesh.creation.torus(0.15, 0.05), (0.6, 0.1, 0.1), roughness=0.3)
    (folder / "visual.glb").write_bytes(trimesh.Scene([mesh]).export(file_type="glb"))
    return folder / "visual.glb"


def pictures(path, hand, *plans, **options):
    """Images of an object alone, in two grasps, and from two sides."""
    renderer = Renderer(**{"size": 64, "samples": 4, "device": "cpu", "plans": plans} | options)
    alone, held = renderer.render_object(path, hand, grasp_poses(hand))
    cameras = [looking_at(OBJECT_POSITION, at, 48) for at in ((1, 0.2, 1), (-0.3, 1, 0.9))]
    return [alone, *held, *renderer.render_views(path, cameras)]


def assert_same(some, others):
    for image, twin in zip(some, others, strict=True):
        for array, same in zip(image, twin, strict=True):
            assert_array_equal(array, same)


@pytest.fixture(scope="module")
def expected(torus, hand):
    return pictures(torus, hand)


def test_parts_put_back_in_change_no_bit(torus, hand, expected):
    """All that is left out and has no bound, together and in each kind of picture."""
    kinds = {kind for kind, _ in EXACT}
    back = [plan(kind).including(*[part for at, part in EXACT if at == kind]) for kind in kinds]
    assert all(each.needs(part) for each in back for kind, part in EXACT if each.scene == kind)
    assert_same(pictures(torus, hand, *back), expected)


@pytest.mark.parametrize("part", sorted(BOUNDED))
def test_parts_with_a_bound_change_little(torus, hand, expected, part):
    kinds = ("unoccluded image", "occluded image", "view")
    changed = pictures(torus, hand, *(plan(kind).including(part) for kind in kinds))
    for image, other in zip(changed, expected, strict=True):
        assert_array_equal(image.mask, other.mask)
        assert_array_equal(image.depth, other.depth)
        assert np.sqrt(np.mean((image.rgb.astype(float) - other.rgb) ** 2)) < 3


@pytest.mark.parametrize("part", ["lamp", "ambient light", "first bounce of light", "hand"])
def test_parts_that_stay_change_the_picture(torus, hand, expected, part):
    _, held, *_ = pictures(torus, hand, plan("occluded image").without(part))
    difference = np.abs(held.rgb.astype(int) - expected[1].rgb)
    assert difference.max() > 10
    if part == "hand":
        assert_array_equal(held.rgb, expected[0].rgb)


def counted(monkeypatch):
    """Every call of Blender's render as (resolution, samples, links of the hand in it)."""
    calls = []
    render = Renderer._render

    def count(self, samples, filter_width):
        calls.append((samples, sum(not body.hide_render for _, body, _ in self._links)))
        return render(self, samples, filter_width)

    monkeypatch.setattr(Renderer, "_render", count)
    return calls


def test_the_renderer_does_what_the_plan_says(torus, hand, monkeypatch):
    calls = counted(monkeypatch)
    poses = grasp_poses(hand)
    links = len(np.unique(hand.geom_link))
    Renderer(size=16, samples=4, device="cpu").render_object(torus, hand, poses)
    assert calls == [(4, 0), (1, 0)] + 2 * [(4, links), (1, links)]
    calls.clear()
    back = plan("unoccluded image").including("hand", "render for every grasp", "samples of mask and depth")
    Renderer(size=16, samples=4, device="cpu", plans=[back]).render_object(torus, hand, poses)
    assert calls == 4 * [(4, links)] + 2 * [(4, links), (1, links)]


def test_masters_are_kept_as_asked(torus, tmp_path):
    assert plan("unoccluded image", exr=True).needs("EXR master")
    keeping = plan("unoccluded image").including("EXR master")
    with pytest.raises(ValueError, match="give the Renderer a folder"):
        Renderer(size=16, samples=1, device="cpu", plans=[keeping]).render_object(torus)
    dropping = plan("unoccluded image", exr=True).without("EXR master")
    Renderer(size=16, samples=1, device="cpu", exr=tmp_path, plans=[dropping]).render_object(torus)
    assert not any(tmp_path.iterdir())


def blocks_seen(monkeypatch):
    """Names of images and materials in Blender at every render."""
    seen = []
    render = Renderer._render

    def look(self, *arguments):
        seen.append(({image.name for image in bpy.data.images}, {each.name for each in bpy.data.materials}))
        return render(self, *arguments)

    monkeypatch.setattr(Renderer, "_render", look)
    return seen


def test_textures_of_no_triangle_are_not_read(torus, tmp_path, monkeypatch, hand):
    def more(tree):
        data = BytesIO()
        PillowImage.new("RGB", (8, 8), (255, 0, 0)).save(data, "png")
        uri = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
        tree.setdefault("images", []).append({"uri": uri, "name": "unused"})
        tree.setdefault("textures", []).append({"source": len(tree["images"]) - 1})
        texture = {"index": len(tree["textures"]) - 1}
        tree["materials"].append({"name": "unused", "pbrMetallicRoughness": {"baseColorTexture": texture}})

    seen = blocks_seen(monkeypatch)
    path = tmp_path / "more.glb"
    path.write_bytes(rewritten(torus.read_bytes(), more))
    back = plan("unoccluded image").including("materials of no triangle")
    without = Renderer(size=32, samples=2, device="cpu").render_object(path)[0]
    with_it = Renderer(size=32, samples=2, device="cpu", plans=[back]).render_object(path)[0]
    assert_same([without], [with_it])
    assert "unused" not in seen[0][1] and "unused" in seen[-1][1]
    assert not any("unused" in name for name in seen[0][0])
    assert any("unused" in name for name in seen[-1][0])


def test_a_lamp_of_the_file_shines_only_if_asked_to(torus, tmp_path):
    def more(tree):
        tree["extensionsUsed"] = ["KHR_lights_punctual"]
        lamp = {"type": "point", "intensity": 1000.0}
        tree["extensions"] = {"KHR_lights_punctual": {"lights": [lamp]}}
        tree["nodes"].append({"translation": [0.5, 0, 0.5], "extensions": {"KHR_lights_punctual": {"light": 0}}})
        tree["scenes"][0]["nodes"].append(len(tree["nodes"]) - 1)

    path = tmp_path / "lamp.glb"
    path.write_bytes(rewritten(torus.read_bytes(), more))
    back = plan("unoccluded image").including("cameras and lamps of the file")
    plain, lit, dark = (
        Renderer(size=32, samples=2, device="cpu", plans=plans).render_object(file)[0]
        for file, plans in ((torus, []), (path, [back]), (path, []))
    )
    assert_same([plain], [dark])
    assert lit.rgb[lit.mask > 0].mean() > plain.rgb[plain.mask > 0].mean() + 5


def test_the_plan_of_an_image_without_a_hand_names_it():
    text = str(plan("unoccluded image"))
    assert "left out: hand (the object is seen alone)" in text
    assert "kept: hand" in str(plan("occluded image"))
