"""Every class of defect comes through repaired, or is rejected with its reason: no crash, no silent
garbage."""

import json

import numpy as np
import pytest
import trimesh
from trimesh.visual.color import linear_to_srgb, srgb_to_linear

from palpate import mesh
from palpate.batch import UnusableObject
from tests.mesh import nasty

FACES = 300


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Folder of the outputs of every usable mesh, by name."""
    root = tmp_path_factory.mktemp("nasty")
    folders = {}
    for name, path in nasty.usable(root / "in").items():
        folders[name] = root / "out" / name
        mesh.prepare(path, folders[name], collision_faces=FACES)
    return folders


def record(folder):
    return json.loads((folder / "mesh.json").read_text())


@pytest.mark.parametrize("file", nasty.USABLE)
def test_usable_meshes_come_out_normalised(prepared, file):
    folder = prepared[file.rsplit("/")[-1].rsplit(".")[0]]
    visual, collision = mesh.load_visual(folder), mesh.load_collision(folder)
    for loaded in (visual, collision):
        assert np.isfinite(loaded.vertices).all()
        assert len(loaded.faces) > 0
        assert loaded.area > 0
    low, high = visual.vertices[visual.faces].min(axis=(0, 1)), visual.vertices[visual.faces].max(axis=(0, 1))
    assert np.linalg.norm(high - low) == pytest.approx(mesh.DIAGONAL, rel=1e-6)
    assert np.allclose(low + high, 0, atol=1e-6)
    facts = record(folder)
    assert facts["visual.glb"]["faces"] == len(visual.faces)
    assert facts["collision.ply"]["faces"] == len(collision.faces)
    assert len(collision.faces) <= max(FACES, len(visual.faces))
    if facts["visual.glb"]["closed"]:
        assert collision.is_watertight
        assert collision.is_winding_consistent
        assert collision.volume > 0


def ball_volume(subdivisions=3):
    """Of an icosphere whose bounding box has the diagonal 0.5: computed from trimesh's own sphere."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return ball.volume * (mesh.DIAGONAL / np.linalg.norm(ball.extents)) ** 3


@pytest.mark.parametrize(
    "name",
    [
        "flipped", "mixed_winding", "duplicate_faces", "duplicate_vertices", "zero_area", "stray_vertices",
        "missing_material", "millimetres", "tiny", "units", "far_away", "points_too", "with space & ümläut",
    ],
)  # fmt: skip
def test_a_damaged_ball_becomes_the_ball(prepared, name):
    facts = record(prepared[name])["visual.glb"]
    assert facts["closed"]
    assert facts["faces"] == 1280
    assert facts["shells"] == 1
    assert facts["volume"] == pytest.approx(ball_volume(), rel=1e-4)


@pytest.mark.parametrize(
    ("name", "repair", "count"),
    [
        ("flipped", "faces_turned", 1280),
        ("mixed_winding", "faces_turned", 427),
        ("mixed_open", "faces_turned", 64),
        ("duplicate_faces", "duplicate_faces_removed", 100),
        ("duplicate_vertices", "vertices_merged", 3 * 1280 - 642),
        ("zero_area", "zero_area_faces_removed", 10),
        ("stray_vertices", "stray_vertices_removed", 3),
        ("flipped_void", "faces_turned", 2560),
        ("void", "faces_turned", 0),
        ("scene", "faces_turned", 0),
        ("interior", "duplicate_faces_removed", 0),
        ("touching", "duplicate_faces_removed", 0),
    ],
)
def test_what_was_repaired_is_recorded(prepared, name, repair, count):
    assert record(prepared[name])["repairs"][repair] == count


def test_voids_stay_voids(prepared):
    """Outer ball minus inner ball of half the radius: 7/8 of the volume, however turned."""
    for name in ("void", "flipped_void"):
        assert record(prepared[name])["visual.glb"]["volume"] == pytest.approx(ball_volume() * 7 / 8, rel=1e-4)


def test_open_surfaces_face_outwards(prepared):
    for name in ("open", "mixed_open"):
        tube = mesh.load_visual(prepared[name])
        radial = tube.triangles_center * (1, 1, 0)
        assert (np.einsum("ij,ij->i", radial, tube.face_normals) > 0).all()


def test_parts_are_kept_apart_or_joined_as_they_should(prepared):
    facts = {name: record(prepared[name])["visual.glb"] for name in prepared}
    shells = {"interior": 2, "void": 2, "shells": 5, "touching": 2, "materials": 1, "scene": 4, "soup": 200}
    assert {name: facts[name]["shells"] for name in shells} == shells
    assert facts["touching"]["closed"]
    assert facts["materials"]["closed"]
    assert facts["closing_sliver"]["closed"]
    assert facts["inner_wall"]["non_manifold_edges"] == 4
    assert facts["non_manifold"]["non_manifold_edges"] == 1
    open_ones = {"open", "flat", "mixed_open", "moebius", "soup", "inner_wall", "non_manifold"}
    assert {name for name in facts if not facts[name]["closed"]} == open_ones


def test_scene_graph_places_every_instance(prepared):
    """Volumes of a ball shown as it is, turned, mirrored, and stretched to twice the height."""
    facts = record(prepared["scene"])
    ball = trimesh.creation.icosphere(subdivisions=2).volume
    assert facts["visual.glb"]["volume"] / facts["scale"] ** 3 == pytest.approx(5 * ball, rel=1e-5)


@pytest.mark.parametrize("name", ["texture", "texture_gltf", "texture_obj"])
def test_textures_are_kept(prepared, name):
    """The colour at each vertex of the ball is what its position says, wherever the mesh came from."""
    scene = trimesh.load_scene(prepared[name] / "visual.glb", process=False)
    (part,) = scene.geometry.values()
    expected = np.asarray(nasty.textured().visual.material.baseColorTexture.convert("RGB"))
    assert np.array_equal(np.asarray(part.visual.material.baseColorTexture.convert("RGB")), expected)
    radius = record(prepared[name])["scale"]
    assert np.allclose(part.visual.uv, part.vertices[:, :2] / radius / 2 + 0.5, atol=1e-5)


def test_materials_and_colours_are_kept(prepared):
    scene = trimesh.load_scene(prepared["materials"] / "visual.glb", process=False)
    colours = {tuple(part.visual.material.main_color[:3]): len(part.faces) for part in scene.geometry.values()}
    assert colours == {(255, 0, 0): 6, (0, 0, 255): 6}
    (part,) = trimesh.load_scene(prepared["vertex_colours"] / "visual.glb").geometry.values()
    unit = part.vertices / np.linalg.norm(part.vertices, axis=1, keepdims=True)
    colours = linear_to_srgb(part.visual.vertex_attributes["color"][:, :3] / 255)  # those of a PLY are sRGB
    light = colours > 0.2
    assert np.abs(255 * colours - (unit + 1) * 127)[light].max() <= 4


def test_face_colours_are_kept(prepared):
    (part,) = trimesh.load_scene(prepared["face_colours"] / "visual.glb", process=False).geometry.values()
    red = part.visual.vertex_attributes["color"][part.faces][:, :, 0].astype(int)
    assert (red == red[:, :1]).all()
    expected = [round(255 * float(srgb_to_linear(np.array([i * 3 / 255]))[0])) for i in range(80)]
    assert sorted(red[:, 0]) == expected


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    return nasty.unusable(tmp_path_factory.mktemp("broken"))


UNREADABLE = r"can't be read as \.|holds no triangles"
# What is wrong with them, in the error's words; with all others, that they can't be read or that nothing is in them.
SAID = {
    **dict.fromkeys(("nan", "nan_stl", "infinite"), "not finite"),
    **dict.fromkeys(("points", "points_obj", "lines"), "points or lines only"),
    **{"overflowing": "diagonal", "one_point": "diagonal of 0", "on_a_line": "area", "far_single": "are rounded"},
    **{"bad_index": "vertex 7 of 3", "bad_index_ply": "vertex 7 of 3", "no_buffer": "gone.bin"},
    **{"cut_texture": "a texture can't be read", "cut_glb": "can't be read", "unknown": "Blender: not read"},
    **{"missing": "no such file", "folder": "not a regular file"},
}


@pytest.mark.parametrize("file", nasty.UNUSABLE)
def test_unusable_meshes_are_rejected_with_the_file_and_a_reason(broken, file, tmp_path):
    name = file.rsplit(".", 1)[0]
    assert set(SAID) <= set(broken)
    with pytest.raises(UnusableObject, match=SAID.get(name, UNREADABLE)) as caught:
        mesh.prepare(broken[name], tmp_path / "out")
    assert str(broken[name]) in str(caught.value)
    assert not (tmp_path / "out" / "mesh.json").exists()
