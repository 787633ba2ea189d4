"""The mesh files of an object: the decimated mesh and its stated error, up axes, determinism, protection."""

import faulthandler
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import cKDTree

from palpate import mesh, seal
from palpate.batch import UnusableObject
from palpate.mesh import topology
from palpate.mesh.decimate import decimate
from palpate.mesh.distance import Surface
from palpate.mesh.isolation import isolated
from palpate.seal import DamagedFile
from tests.mesh import nasty

NAMES = ["visual.glb", "collision.ply", "mesh.json"]


def digests(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def knotted(tmp_path_factory):
    """A torus with a bumpy surface, and its mesh files."""
    root = tmp_path_factory.mktemp("torus")
    torus = trimesh.creation.torus(0.3, 0.1, major_sections=80, minor_sections=40)
    torus.vertices *= 1 + 0.02 * np.sin(30 * torus.vertices)
    torus.export(root / "torus.ply")
    return root, mesh.prepare(root / "torus.ply", root / "out", collision_faces=2000)


def test_the_decimated_mesh_has_the_faces_asked_for_and_stays_closed(knotted):
    root, record = knotted
    level, stated = mesh.load_collision(root / "out"), record["collision.ply"]
    assert len(level.faces) == stated["faces"] <= 2000
    assert level.is_watertight
    assert level.is_winding_consistent
    assert level.euler_number == 0  # still a torus
    assert level.volume == pytest.approx(stated["volume"], rel=1e-5)
    assert level.volume == pytest.approx(record["visual.glb"]["volume"], rel=0.02)
    points, _ = trimesh.sample.sample_surface(mesh.load_visual(root / "out"), 10_000, seed=1)
    apart, _ = Surface(level.vertices, level.faces).closest(points)
    assert apart.mean() < 0.0003 and apart.max() < 0.001  # of 0.5 m


def test_a_turned_object_is_turned_about_the_vertical_before_it_is_scaled(tmp_path):
    """Against trimesh's rotation of the source, y up; without a turn nothing changes."""
    path = tmp_path / "box.stl"
    source = trimesh.creation.box((0.1, 0.2, 0.4)).apply_translation((1, 2, 3))
    source.export(path)
    for name, options in {"plain": {}, "none": {"turn": 0.0}, "turned": {"turn": 30.0}}.items():
        mesh.prepare(path, tmp_path / name, up="y", **options)
    assert digests(tmp_path / "plain") == digests(tmp_path / "none")
    source.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    source.apply_transform(trimesh.transformations.rotation_matrix(np.radians(30), [0, 0, 1]))
    source.apply_translation(-source.bounds.mean(axis=0)).apply_scale(0.5 / np.linalg.norm(source.extents))
    found = mesh.load_collision(tmp_path / "turned").vertices
    assert cKDTree(found).query(source.vertices)[0].max() < 1e-6
    assert np.linalg.norm(np.ptp(found, axis=0)) == pytest.approx(0.5)


def test_a_small_mesh_is_not_decimated(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box().export(path)
    record = mesh.prepare(path, tmp_path / "out")
    assert record["collision.ply"]["faces"] == 12
    collision, visual = mesh.load_collision(tmp_path / "out"), mesh.load_visual(tmp_path / "out")
    assert np.array_equal(collision.triangles, visual.triangles)


def test_borders_are_preserved():
    """A bumpy sheet: its border, a square, is the same after the inside has lost most of its faces."""
    sheet = trimesh.creation.box(extents=(1, 1, 0))
    sheet.update_faces(sheet.face_normals[:, 2] > 0.5)
    for _ in range(5):
        sheet = sheet.subdivide()
    sheet.vertices[:, 2] += 0.02 * np.prod(np.sin(3 * np.pi * sheet.vertices[:, :2]), axis=1)
    sheet.merge_vertices()
    faces = np.array(sheet.faces)
    vertices, level = decimate(np.array(sheet.vertices), faces, len(faces) // 4)
    assert len(level) < len(faces) / 2

    def border(vertices, faces):
        lone = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)[topology.edge_counts(faces) == 1]
        return np.linalg.norm(np.diff(vertices[lone], axis=1), axis=2).sum(), np.unique(lone)

    before, _ = border(np.array(sheet.vertices), faces)
    after, kept = border(vertices, level)
    assert after == pytest.approx(before, rel=1e-3)
    assert np.allclose(np.abs(vertices[kept, :2]).max(axis=1), 0.5, atol=1e-3)


def test_pose_is_kept_and_the_up_axis_turned_once(tmp_path):
    """A box with three different sides, its longest along the declared up axis, comes out standing on z."""
    for up, extents in (("z", (1, 2, 4)), ("y", (1, 4, 2)), ("x", (4, 2, 1))):
        path = tmp_path / f"{up}.obj"
        box = trimesh.creation.box(extents=extents).apply_translation((10, 20, 30))
        box.export(path)
        mesh.prepare(path, tmp_path / up, up=up)
        visual = mesh.load_visual(tmp_path / up)
        size = np.array([1, 2, 4]) * mesh.DIAGONAL / np.linalg.norm((1, 2, 4))
        assert np.allclose(visual.extents, size, atol=1e-6)
        assert visual.volume == pytest.approx(np.prod(size), rel=1e-5)  # turned, not mirrored
        assert np.allclose(mesh.load_collision(tmp_path / up).extents, size, atol=1e-6)


def test_y_up_fronts_face_as_in_blender(tmp_path):
    """The point (x, y, z) of a y-up file is (x, -z, y) in the object's frame, as Blender turns it."""
    path = tmp_path / "tetrahedron.off"
    trimesh.Trimesh([(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 4)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]).export(
        path
    )
    record = mesh.prepare(path, tmp_path / "out", up="y")
    visual = mesh.load_visual(tmp_path / "out")
    corners = np.unique(np.round((visual.vertices - visual.vertices.min(axis=0)) / record["scale"], 4), axis=0)
    assert {tuple(corner) for corner in corners} == {(0, 4, 0), (1, 4, 0), (0, 4, 2), (0, 0, 0)}


@pytest.mark.parametrize("file", ["texture.glb", "materials.obj", "scene.glb", "shells.dae"])
def test_the_same_file_gives_the_same_bytes(file, tmp_path):
    nasty.USABLE[file](tmp_path / file)
    for run in ("first", "second"):
        mesh.prepare(tmp_path / file, tmp_path / run, collision_faces=200)
    assert digests(tmp_path / "first") == digests(tmp_path / "second")
    assert len(digests(tmp_path / "first")) == 3


def test_mesh_json_is_what_prepare_returns(knotted):
    root, record = knotted
    assert json.loads((root / "out/mesh.json").read_text()) == json.loads(json.dumps(record))
    assert set(NAMES) <= set(digests(root / "out"))


def test_normals_of_the_source_survive(tmp_path):
    """A ball whose normals lean towards x comes out with these normals, turned as the ball is."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    leaning = ball.vertices + (0.5, 0, 0)
    leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
    ball = trimesh.Trimesh(ball.vertices, ball.faces, vertex_normals=leaning, process=False)
    path = tmp_path / "ball.glb"
    path.write_bytes(trimesh.Scene(ball).export(file_type="glb", include_normals=True))
    mesh.prepare(path, tmp_path / "out", up="y")
    (part,) = trimesh.load_scene(tmp_path / "out/visual.glb", process=False).geometry.values()
    x, y, z = leaning.T
    assert np.allclose(part.vertex_normals, np.c_[x, -z, y], atol=1e-5)


def test_jpeg_textures_keep_their_quality(tmp_path):
    """A picture stored at quality 98 comes out as JPEG, several times nearer to it than at the usual 75."""
    rng = np.random.default_rng(0)
    picture = Image.fromarray(rng.integers(0, 255, (16, 16, 3), dtype=np.uint8)).resize((128, 128))
    picture.save(tmp_path / "picture.jpg", quality=98, subsampling=0)
    picture = Image.open(tmp_path / "picture.jpg")
    ball = nasty.textured()
    ball.visual.material.baseColorTexture = picture
    (tmp_path / "ball.glb").write_bytes(ball.export(file_type="glb"))
    usual = _texture_of(tmp_path / "ball.glb")  # trimesh writes it at the usual quality
    (tmp_path / "ball.obj").write_text(
        "mtllib ball.mtl\nusemtl picture\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "ball.mtl").write_text("newmtl picture\nmap_Kd picture.jpg\n")
    mesh.prepare(tmp_path / "ball.obj", tmp_path / "out")
    kept = _texture_of(tmp_path / "out/visual.glb")
    assert kept.format == "JPEG"
    error = [np.abs(np.asarray(image, float) - np.asarray(picture, float)).mean() for image in (kept, usual)]
    assert error[0] < error[1] / 3


def _texture_of(path):
    (part,) = trimesh.load_scene(path, process=False).geometry.values()
    return part.visual.material.baseColorTexture


def crash():
    faulthandler.disable()  # pytest's, which would print where
    os.kill(os.getpid(), signal.SIGSEGV)


def refuse():
    raise UnusableObject("not this one")


def fail():
    raise KeyError("a fault of ours")


def test_a_crash_costs_only_its_object():
    with pytest.raises(UnusableObject, match="SIGSEGV"):
        isolated(crash, seconds=20)


def kill():
    os.kill(os.getpid(), signal.SIGKILL)


def fill_disk():
    with open("/dev/full", "w") as file:
        file.write("x")


def fill_memory():
    np.zeros(2**62, dtype=np.uint8)


@pytest.mark.parametrize(("failure", "error"), [(kill, MemoryError), (fill_memory, MemoryError), (fill_disk, OSError)])
def test_what_the_machine_lacks_is_no_fault_of_the_mesh(failure, error):
    with pytest.raises(error):
        isolated(failure, seconds=20)


def test_a_hang_ends():
    start = time.monotonic()
    with pytest.raises(UnusableObject, match="more than 0.2 s"):
        isolated(time.sleep, 60, seconds=0.2)
    assert time.monotonic() - start < 30


PAUSED = """
import time
from pathlib import Path
from palpate.mesh.isolation import isolated

def work():
    Path("begun").touch()
    while not Path("end").exists():
        time.sleep(0.01)
    return "finished"

print(isolated(work, seconds=4))
"""


def test_a_pause_of_both_processes_is_no_hang(tmp_path):
    """As by Ctrl-Z, for longer than the limit."""
    with subprocess.Popen(
        [sys.executable, "-c", PAUSED], cwd=tmp_path, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as both:
        while not (tmp_path / "begun").exists() and both.poll() is None:
            time.sleep(0.01)
        os.killpg(both.pid, signal.SIGSTOP)
        time.sleep(4.5)
        (tmp_path / "end").touch()
        os.killpg(both.pid, signal.SIGCONT)
        assert both.communicate(timeout=60)[0] == "finished\n"


def test_errors_come_back_from_the_child():
    assert isolated(divmod, 7, 3, seconds=20) == (2, 1)
    with pytest.raises(UnusableObject, match="not this one"):
        isolated(refuse, seconds=20)
    with pytest.raises(RuntimeError, match="a fault of ours"):
        isolated(fail, seconds=20)


@pytest.mark.parametrize(("suffix", "away", "usable"), [("ply", 1e5, False), ("off", 1e6, True)])
def test_an_object_far_from_the_origin_keeps_its_shape_or_is_refused(tmp_path, suffix, away, usable):
    """Text has all digits, binary formats single precision: 1e5 diameters out that is off by 0.4 %."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    far = trimesh.Trimesh(ball.vertices + (away, -away, 0), ball.faces, process=False)
    path = tmp_path / f"far.{suffix}"
    exported = far.export(file_type=suffix, **({"digits": 12} if suffix == "off" else {}))
    path.write_bytes(exported.encode() if isinstance(exported, str) else exported)
    if usable:
        mesh.prepare(path, tmp_path / "out")
        radius = np.linalg.norm(mesh.load_visual(tmp_path / "out").vertices, axis=1)
        expected = mesh.DIAGONAL / np.linalg.norm(ball.extents)
        assert np.abs(radius - expected).max() < 1e-5
    else:
        with pytest.raises(UnusableObject, match=r"rounded by up to .* \(single precision\)"):
            mesh.prepare(path, tmp_path / "out")


def test_geometry_is_what_trimesh_reads(tmp_path):
    lid = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    lid.apply_translation((0, 0, 2))
    trimesh.Scene({"pot": trimesh.creation.box(), "lid": lid}).export(tmp_path / "pot.glb")
    mesh.prepare(tmp_path / "pot.glb", tmp_path / "out")
    parts = trimesh.load_scene(tmp_path / "out/visual.glb", process=False).geometry.values()
    vertices, faces = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
    found = mesh.load_geometry(tmp_path / "out")
    assert len(parts) == 2
    np.testing.assert_array_equal(found.vertices, vertices)
    np.testing.assert_array_equal(found.faces, faces)


def test_meshes_of_a_batch_that_are_lost_or_changed_are_an_error(knotted, tmp_path):
    batch = tmp_path / "meshes/batch-0000"
    shutil.copytree(knotted[0] / "out", batch / "mug-0001")
    before = mesh.load_visual(batch / "mug-0001")  # of an object alone, without a seal
    seal.write(batch)
    assert mesh.usable(batch, contents=True) == ["mug-0001"]
    np.testing.assert_array_equal(mesh.load_visual(batch / "mug-0001").vertices, before.vertices)
    loads = {"visual.glb": mesh.load_visual, "collision.ply": mesh.load_collision}
    for name, load in loads.items():
        path = batch / "mug-0001" / name
        content = path.read_bytes()
        path.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])
        with pytest.raises(DamagedFile, match=f"{name} has changed .*snakemake meshes/batch-0000"):
            load(batch / "mug-0001")
        path.unlink()
        with pytest.raises(DamagedFile, match=f"mug-0001/{name} is missing.*snakemake meshes/batch-0000"):
            mesh.usable(batch)
        path.write_bytes(content)
