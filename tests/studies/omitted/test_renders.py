"""Pictures by the engine and with its needless work put in, one item at a time and all at once."""

import json
from dataclasses import replace

import bpy
import numpy as np
import pandas as pd
import pytest
import trimesh
from numpy.testing import assert_array_equal

from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION
from palpate.scene import LIGHTS
from palpate.vision import Renderer, looking_at
from studies.omitted.omission import DIFFERS, SAME, results
from studies.omitted.renders import (
    CYCLES_WITH,
    OCCLUDED,
    OMITTED_ITEMS,
    UNOCCLUDED,
    VIEW,
    NaiveRenderer,
    omissions,
)
from tests.vision.glb import add_unused_texture, rewrite_glb
from tests.vision.scenes import grasp_poses, painted, scene_of

SETTINGS = {"seed": 0, "vision": {"size": 64, "samples": 8, "device": "cpu"}, "views": {"size": 40, "samples": 2}}
# These change a picture, but by less than its noise.
BOUNDED = set(CYCLES_WITH) - {"paths of more than 6 bounces"}
EXACT = {(kind, item) for kind, items in OMITTED_ITEMS.items() for item in items}


@pytest.fixture(scope="module")
def table(pictured):
    run, subject = pictured
    return pd.DataFrame([results(each) for each in omissions(run, [subject], SETTINGS)])


def test_what_is_omitted_changes_nothing_beyond_its_bound(table):
    out = table[table["omitted"]]
    assert len(out) >= 12
    assert (out["verdict"] == SAME).all(), out[["stage", "item", "difference"]]
    exact = out[out["unit"] == "grey levels"]
    assert (exact["bound"] == 0).all() and (exact["difference"] == 0).all()


def test_what_changes_the_picture_stays_in(table):
    kept = table[~table["omitted"]].set_index("item")["verdict"]
    assert set(kept.index) == {"first bounce of light", "second to fourth bounce of light", "hand"}
    assert kept["first bounce of light"] == kept["hand"] == DIFFERS


def test_bytes_of_a_second_image(table):
    saved = table.set_index("item")["bytes_saved"]
    assert saved["render for every grasp"] == 64 * 64 * (3 + 1 + 2)


@pytest.fixture(scope="module")
def torus(tmp_path_factory):
    """A torus in two grasps."""
    folder, hand = tmp_path_factory.mktemp("torus"), allegro()
    mesh = painted(trimesh.creation.torus(0.15, 0.05), (0.6, 0.1, 0.1), roughness=0.3)
    (folder / "visual.glb").write_bytes(trimesh.Scene([mesh]).export(file_type="glb"))
    return scene_of(folder / "visual.glb", hand, grasp_poses(hand), 64)


def pictures(scene, changes=(), samples=4):
    """Images of an object alone, in its grasps, and from two sides."""
    renderer = NaiveRenderer(samples, "cpu")
    renderer.changes = frozenset(changes)
    alone, held = renderer.render(scene)
    cameras = [looking_at(OBJECT_POSITION, at, 48) for at in ((1, 0.2, 1), (-0.3, 1, 0.9))]
    return [alone, *held, *renderer.render_views(scene, cameras)]


def assert_same(images, others):
    for image, twin in zip(images, others, strict=True):
        for array, same in zip(image, twin, strict=True):
            assert_array_equal(array, same)


@pytest.fixture(scope="module")
def expected(torus):
    return pictures(torus)


def test_without_changes_the_naive_renderer_is_the_engine(torus, expected):
    alone, held = Renderer(4, "cpu").render(torus)
    assert_same([alone, *held], expected[:3])


def test_items_put_in_change_no_bit(torus, expected):
    """All that is omitted and has no bound, together and in each kind of picture."""
    assert_same(pictures(torus, EXACT), expected)


@pytest.mark.parametrize("item", sorted(BOUNDED))
def test_items_with_a_bound_change_little(torus, expected, item):
    changed = pictures(torus, {(kind, item) for kind in OMITTED_ITEMS})
    for image, other in zip(changed, expected, strict=True):
        assert_array_equal(image.mask, other.mask)
        assert_array_equal(image.depth, other.depth)
        assert np.sqrt(np.mean((image.rgb.astype(float) - other.rgb) ** 2)) < 3


@pytest.mark.parametrize("item", ["lamp", "ambient light", "first bounce of light", "hand"])
def test_items_that_stay_change_the_picture(torus, expected, item):
    lights = {"lamp": LIGHTS[1:], "ambient light": LIGHTS[:1]}.get(item, LIGHTS)
    _, held, *_ = pictures(replace(torus, lights=lights), {(OCCLUDED, item)})
    difference = np.abs(held.rgb.astype(int) - expected[1].rgb)
    assert difference.max() > 10
    if item == "hand":
        assert_array_equal(held.rgb, expected[0].rgb)


def test_the_engine_renders_what_is_needed_and_the_naive_one_more(torus, monkeypatch):
    """Every call of Blender's render as (samples, links of the hand in it)."""
    calls = []
    render = Renderer.render_layers

    def count(self, samples, filter_width):
        calls.append((samples, sum(not body.hide_render for _, body, _ in self._links)))
        return render(self, samples, filter_width)

    monkeypatch.setattr(Renderer, "render_layers", count)
    links = len(np.unique(torus.hand.geom_link))
    Renderer(4, "cpu").render(torus)
    assert calls == [(4, 0), (1, 0)] + 2 * [(4, links), (1, links)]
    calls.clear()
    renderer = NaiveRenderer(4, "cpu")
    items = ("hand", "render for every grasp", "samples of mask and depth")
    renderer.changes = frozenset((UNOCCLUDED, item) for item in items)
    renderer.render(torus)
    assert calls == 4 * [(4, links)] + 2 * [(4, links), (1, links)]


def changed_file(scene, folder, change):
    """The scene with a file whose JSON is changed."""
    (folder / "visual.glb").write_bytes(rewrite_glb(scene.visual_file.read_bytes(), change))
    return replace(scene, object_folder=folder, link_pose=())


def test_textures_of_no_triangle_are_not_read(torus, tmp_path, monkeypatch):
    seen = []
    render = Renderer.render_layers

    def look(self, *arguments):
        seen.append(({image.name for image in bpy.data.images}, {each.name for each in bpy.data.materials}))
        return render(self, *arguments)

    monkeypatch.setattr(Renderer, "render_layers", look)
    scene = changed_file(torus, tmp_path, add_unused_texture)
    without, with_it = (pictures(scene, changes)[:1] for changes in ((), {(UNOCCLUDED, "materials of no triangle")}))
    assert_same(without, with_it)
    renders = len(seen) // 2
    assert "unused" not in seen[0][1] and "unused" in seen[renders][1]
    assert not any("unused" in name for name in seen[0][0])
    assert any("unused" in name for name in seen[renders][0])


def test_a_lamp_of_the_file_shines_only_if_asked_to(torus, tmp_path):
    def add_lamp(tree):
        tree["extensionsUsed"] = ["KHR_lights_punctual"]
        lamp = {"type": "point", "intensity": 1000.0}
        tree["extensions"] = {"KHR_lights_punctual": {"lights": [lamp]}}
        tree["nodes"].append({"translation": [0.5, 0, 0.5], "extensions": {"KHR_lights_punctual": {"light": 0}}})
        tree["scenes"][0]["nodes"].append(len(tree["nodes"]) - 1)

    scene = changed_file(torus, tmp_path, add_lamp)
    lit = {(kind, "cameras and lamps of the file") for kind in (UNOCCLUDED, VIEW)}
    plain, dark, bright = (pictures(each, changes) for each, changes in ((torus, ()), (scene, ()), (scene, lit)))
    assert_same([plain[0], *plain[3:]], dark)
    for image, other in zip(bright, dark, strict=True):
        assert image.rgb[image.mask > 0].mean() > other.rgb[other.mask > 0].mean() + 5


def test_rewriting_nothing_keeps_the_rest_of_a_file(tmp_path):
    glb = trimesh.Scene([trimesh.creation.box()]).export(file_type="glb")
    path = tmp_path / "box.glb"
    path.write_bytes(rewrite_glb(glb, lambda tree: tree["asset"].update(extras=json.dumps("more" * 5))))
    assert len(path.read_bytes()) > len(glb)
    assert trimesh.load_scene(path).triangles.tolist() == trimesh.creation.box().triangles.tolist()
