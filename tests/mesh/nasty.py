"""A folder of nasty meshes: every class of defect that is met in the wild, each as a file of some format.

`usable(folder)` and `unusable(folder)` write them; workflow tests use them too.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

USABLE: dict[str, Callable[[Path], None]] = {}
UNUSABLE: dict[str, Callable[[Path], None]] = {}


def usable(folder: Path) -> dict[str, Path]:
    """Write the meshes that must come through; path by name."""
    return _write(USABLE, folder)


def unusable(folder: Path) -> dict[str, Path]:
    """Write the meshes that must be rejected; path by name. `missing` is not there at all."""
    return _write(UNUSABLE, folder)


def _write(builders, folder):
    paths = {}
    for file, builder in builders.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        builder(path)
        paths[path.stem] = path
    return paths


def _in(register, file):
    def decorate(builder):
        register[file] = builder
        return builder

    return decorate


def sphere(subdivisions=3, **keywords):
    return trimesh.creation.icosphere(subdivisions=subdivisions, **keywords)


def _save(path, vertices, faces):
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    path.write_bytes(_bytes(mesh.export(file_type=path.suffix[1:])))


def _bytes(data):
    return data.encode() if isinstance(data, str) else data


def _obj(path, vertices, faces):
    lines = ["v {} {} {}".format(*vertex) for vertex in vertices]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


@_in(USABLE, "open.obj")
def _(path):
    tube = trimesh.creation.cylinder(radius=1, height=3, sections=48)
    side = np.abs(tube.face_normals[:, 2]) < 0.5
    _obj(path, tube.vertices, tube.faces[side])


@_in(USABLE, "flat.obj")
def _(path):
    _obj(path, [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])


@_in(USABLE, "non_manifold.off")
def _(path):
    box = trimesh.creation.box()
    fin = len(box.vertices)
    _save(path, np.r_[box.vertices, [(1.5, 0.0, 0.0)]], np.r_[box.faces, [(*box.faces[0][:2], fin)]])


@_in(USABLE, "inner_wall.stl")
def _(path):
    """Two boxes side by side in one piece, with a single wall between them: its sides have three faces."""
    boxes = trimesh.util.concatenate([trimesh.creation.box().apply_translation((x, 0, 0)) for x in (-0.5, 0.5)])
    walls = np.flatnonzero((np.abs(boxes.triangles[:, :, 0]) < 1e-9).all(axis=1))
    boxes.update_faces(np.delete(np.arange(len(boxes.faces)), walls[:2]))
    path.write_bytes(boxes.export(file_type="stl"))


@_in(USABLE, "flipped.stl")
def _(path):
    ball = sphere()
    _save(path, ball.vertices, ball.faces[:, ::-1])


@_in(USABLE, "mixed_winding.ply")
def _(path):
    ball = sphere()
    flip = np.arange(len(ball.faces)) % 3 == 0
    _save(path, ball.vertices, np.where(flip[:, None], ball.faces[:, ::-1], ball.faces))


@_in(USABLE, "mixed_open.ply")
def _(path):
    """A tube without caps whose winding is mixed, and more often wrong than right."""
    tube = trimesh.creation.cylinder(radius=1, height=3, sections=48)
    faces = tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5]
    flip = np.arange(len(faces)) % 3 != 0
    _save(path, tube.vertices, np.where(flip[:, None], faces[:, ::-1], faces))


@_in(USABLE, "moebius.ply")
def _(path):
    n = 60
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    radius, height = 1 + 0.3 * np.outer((-1, 1), np.cos(turn / 2)), 0.3 * np.outer((-1, 1), np.sin(turn / 2))
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=2).reshape(-1, 3)
    this, after = np.arange(n), np.arange(1, n + 1)
    low, high = np.where(after == n, n, after), np.where(after == n, 0, after + n)
    _save(path, ring, np.r_[np.c_[this, low, this + n], np.c_[low, high, this + n]])


@_in(USABLE, "duplicate_faces.off")
def _(path):
    ball = sphere()
    _save(path, ball.vertices, np.r_[ball.faces, ball.faces[:40], ball.faces[40:100, ::-1]])


@_in(USABLE, "duplicate_vertices.ply")
def _(path):
    ball = sphere()
    _save(path, ball.vertices[ball.faces].reshape(-1, 3), np.arange(3 * len(ball.faces)).reshape(-1, 3))


@_in(USABLE, "zero_area.off")
def _(path):
    ball = sphere()
    middle = ball.vertices[ball.faces[:5, :2]].mean(axis=1)
    new = np.arange(5) + len(ball.vertices)
    line = np.c_[ball.faces[:5, 0], ball.faces[:5, 1], new]
    point = np.repeat(ball.faces[:5, :1], 3, axis=1)
    _save(path, np.r_[ball.vertices, middle], np.r_[ball.faces, line, point])


@_in(USABLE, "closing_sliver.off")
def _(path):
    """A box, closed only by a triangle without area: one face has a corner on its neighbour's side."""
    box = trimesh.creation.box()
    vertices, faces = np.array(box.vertices), [tuple(face) for face in box.faces]
    a, b, c = faces.pop(0)
    middle = len(vertices)
    vertices = np.r_[vertices, [(vertices[a] + vertices[b]) / 2]]
    _save(path, vertices, [*faces, (a, middle, c), (middle, b, c), (a, b, middle)])


@_in(USABLE, "stray_vertices.ply")
def _(path):
    ball = sphere()
    stray = np.array([(1e6, 0, 0), (0, -1e6, 5), (np.nan, 0, 0)])
    _save(path, np.r_[ball.vertices, stray], ball.faces)


@_in(USABLE, "interior.glb")
def _(path):
    scene = trimesh.Scene([sphere(radius=1), trimesh.creation.box(extents=(0.5, 0.5, 0.5))])
    path.write_bytes(scene.export(file_type="glb"))


@_in(USABLE, "void.stl")
def _(path):
    """A hollow ball: the inner shell faces its hollow, as it should."""
    outer, inner = sphere(), sphere(radius=0.5)
    inner.invert()
    path.write_bytes(trimesh.util.concatenate([outer, inner]).export(file_type="stl"))


@_in(USABLE, "flipped_void.stl")
def _(path):
    outer, inner = sphere(), sphere(radius=0.5)
    outer.invert()
    path.write_bytes(trimesh.util.concatenate([outer, inner]).export(file_type="stl"))


@_in(USABLE, "shells.dae")
def _(path):
    balls = [sphere(2, radius=0.4).apply_translation((x, 0, 0)) for x in range(5)]
    path.write_bytes(trimesh.util.concatenate(balls).export(file_type="dae"))


@_in(USABLE, "touching.glb")
def _(path):
    """Two closed solids that share a whole side: each must stay closed."""
    boxes = [trimesh.creation.box().apply_translation((x, 0, 0)) for x in (0, 1)]
    path.write_bytes(trimesh.Scene(boxes).export(file_type="glb"))


@_in(USABLE, "materials.obj")
def _(path):
    """A box whose sides have one of two materials: neither half is closed alone."""
    box = trimesh.creation.box()
    lines = [f"mtllib {path.stem}.mtl"] + ["v {} {} {}".format(*vertex) for vertex in box.vertices]
    for name, faces in (("red", box.faces[:6]), ("blue", box.faces[6:])):
        lines += [f"usemtl {name}"] + ["f {} {} {}".format(*(face + 1)) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")


def textured(suffix="PNG"):
    """A ball with a picture on it: 16 x 16 pixels, red grows with the column, green with the row."""
    ball = trimesh.creation.uv_sphere(count=(16, 16))
    pixels = np.zeros((16, 16, 3), dtype=np.uint8)
    pixels[..., 0], pixels[..., 1] = np.arange(16) * 16, np.arange(16)[:, None] * 16
    image = Image.fromarray(pixels)
    image.format = suffix
    uv = ball.vertices[:, :2] / 2 + 0.5
    ball.visual = trimesh.visual.TextureVisuals(
        uv=uv, material=trimesh.visual.material.PBRMaterial(baseColorTexture=image, name="picture")
    )
    return ball


@_in(USABLE, "texture.glb")
def _(path):
    path.write_bytes(textured().export(file_type="glb"))


@_in(USABLE, "separate/texture_gltf.gltf")
def _(path):
    for name, data in trimesh.Scene(textured()).export(file_type="gltf").items():
        (path if name.endswith(".gltf") else path.parent / name).write_bytes(data)


@_in(USABLE, "texture_obj/texture_obj.obj")
def _(path):
    ball = textured()
    ball.visual.material = ball.visual.material.to_simple()
    text, files = trimesh.exchange.obj.export_obj(ball, return_texture=True, mtl_name="texture_obj.mtl")
    path.write_text(text)
    for name, data in files.items():
        (path.parent / name).write_bytes(data)


@_in(USABLE, "missing_material.obj")
def _(path):
    ball = sphere()
    _obj(path, ball.vertices, ball.faces)
    path.write_text("mtllib gone.mtl\nusemtl nothing\n" + path.read_text())


@_in(USABLE, "missing_texture.obj")
def _(path):
    ball = sphere(2)
    lines = ["mtllib missing_texture.mtl"] + ["v {} {} {}".format(*vertex) for vertex in ball.vertices]
    lines += ["vt 0 0", "usemtl picture"] + ["f {}/1 {}/1 {}/1".format(*(face + 1)) for face in ball.faces]
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text("newmtl picture\nKd 1 1 1\nmap_Kd gone.png\n")


@_in(USABLE, "vertex_colours.ply")
def _(path):
    ball = sphere(2)
    ball.visual.vertex_colors = np.c_[np.uint8((ball.vertices + 1) * 127), np.full(len(ball.vertices), 255)]
    path.write_bytes(ball.export(file_type="ply"))


@_in(USABLE, "face_colours.ply")
def _(path):
    ball = sphere(1)
    ball.visual.face_colors = np.c_[np.arange(80) * 3, np.zeros((80, 2)), np.full(80, 255)].astype(np.uint8)
    path.write_bytes(ball.export(file_type="ply"))


@_in(USABLE, "millimetres.stl")
def _(path):
    _save(path, sphere().vertices * 1000, sphere().faces)


@_in(USABLE, "tiny.ply")
def _(path):
    _save(path, sphere().vertices * 1e-6, sphere().faces)


@_in(USABLE, "units.3mf")
def _(path):
    path.write_bytes(sphere().apply_scale(1000).export(file_type="3mf"))


@_in(USABLE, "far_away.obj")
def _(path):
    _obj(path, sphere().vertices + (1e5, -2e5, 3e5), sphere().faces)


@_in(USABLE, "scene.glb")
def _(path):
    """One geometry shown four times: moved, turned, stretched and mirrored."""
    scene = trimesh.Scene()
    ball = sphere(2)
    mirrored = np.diag([-1.0, 1, 1, 1])
    mirrored[0, 3] = 9
    stretched = np.diag([1.0, 1, 2, 1])
    stretched[:3, 3] = 3, 0, 0
    turned = trimesh.transformations.rotation_matrix(1, (0, 1, 0), point=(3, 0, 0))
    scene.add_geometry(ball, geom_name="ball", node_name="plain")
    for name, transform in (("stretched", stretched), ("turned", turned), ("mirrored", mirrored)):
        scene.graph.update(name, "world", matrix=transform, geometry="ball")
    path.write_bytes(scene.export(file_type="glb"))


@_in(USABLE, "soup.stl")
def _(path):
    """Triangles that have nothing to do with each other."""
    rng = np.random.default_rng(0)
    _save(path, rng.random((600, 3)), np.arange(600).reshape(-1, 3))


@_in(USABLE, "thin_blade.off")
def _(path):
    blade = trimesh.creation.box(extents=(1, 0.2, 1e-4)).subdivide().subdivide()
    _save(path, blade.vertices, blade.faces)


@_in(USABLE, "polygons.obj")
def _(path):
    """A prism with polygons of eight corners and indices that count from the end."""
    turn = np.arange(8) * np.pi / 4
    ring = np.c_[np.cos(turn), np.sin(turn)]
    vertices = np.r_[np.c_[ring, np.zeros(8)], np.c_[ring, np.ones(8)]]
    lines = ["v {} {} {}".format(*vertex) for vertex in vertices]
    lines += ["f 8 7 6 5 4 3 2 1", "f -8 -7 -6 -5 -4 -3 -2 -1"]
    lines += [f"f {i + 1} {(i + 1) % 8 + 1} {(i + 1) % 8 + 9} {i + 9}" for i in range(8)]
    path.write_text("\n".join(lines) + "\n")


@_in(USABLE, "with space & ümläut.obj")
def _(path):
    _obj(path, sphere().vertices, sphere().faces)


@_in(USABLE, "tetrahedron.off")
def _(path):
    _save(path, [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


@_in(USABLE, "points_too.obj")
def _(path):
    """Faces, and lines and points beside them."""
    _obj(path, sphere().vertices, sphere().faces)
    path.write_text(path.read_text() + "v 0 0 0\np 1\nl 1 2\n")


for _suffix in ("obj", "glb", "gltf", "stl", "ply", "off", "dae", "3mf"):

    @_in(UNUSABLE, f"empty_{_suffix}.{_suffix}")
    def _(path):
        path.write_bytes(b"")

    @_in(UNUSABLE, f"garbage_{_suffix}.{_suffix}")
    def _(path):
        path.write_bytes(np.random.default_rng(0).bytes(3000))

    @_in(UNUSABLE, f"page_{_suffix}.{_suffix}")
    def _(path):
        path.write_text("<html><body>404: not found</body></html>\n" * 20)


for _suffix in ("glb", "stl", "ply", "off", "dae", "3mf"):

    @_in(UNUSABLE, f"cut_{_suffix}.{_suffix}")
    def _(path):
        whole = _bytes(sphere().export(file_type=path.suffix[1:]))
        path.write_bytes(whole[: len(whole) // 2])


@_in(UNUSABLE, "nan.obj")
def _(path):
    vertices = np.array(sphere().vertices)
    vertices[5, 1] = np.nan
    _obj(path, vertices, sphere().faces)


@_in(UNUSABLE, "nan_stl.stl")
def _(path):
    vertices = np.array(sphere().vertices)
    vertices[5] = np.nan
    _save(path, vertices, sphere().faces)


@_in(UNUSABLE, "infinite.ply")
def _(path):
    vertices = np.array(sphere().vertices)
    vertices[5, 2] = np.inf
    _save(path, vertices, sphere().faces)


@_in(UNUSABLE, "far_single.ply")
def _(path):
    """So far from the origin that single precision has rounded its shape away, by 1 % of its size."""
    _save(path, sphere().vertices + (1e6, 0, 0), sphere().faces)


@_in(UNUSABLE, "overflowing.obj")
def _(path):
    _obj(path, sphere().vertices * 1e200, sphere().faces)


@_in(UNUSABLE, "points.ply")
def _(path):
    path.write_bytes(trimesh.PointCloud(sphere().vertices).export(file_type="ply"))


@_in(UNUSABLE, "points_obj.obj")
def _(path):
    _obj(path, sphere().vertices, [])


@_in(UNUSABLE, "lines.obj")
def _(path):
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2\nl 2 3\n")


@_in(UNUSABLE, "one_point.off")
def _(path):
    _save(path, np.zeros((3, 3)), [(0, 1, 2)])


@_in(UNUSABLE, "on_a_line.obj")
def _(path):
    _obj(path, np.outer(np.arange(6), (1.0, 2.0, 3.0)), [(0, 1, 2), (2, 3, 4), (3, 4, 5)])


@_in(UNUSABLE, "bad_index.off")
def _(path):
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")


@_in(UNUSABLE, "bad_index_ply.ply")
def _(path):
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"
    )


@_in(UNUSABLE, "no_faces.off")
def _(path):
    path.write_text("OFF\n0 0 0\n")


@_in(UNUSABLE, "no_buffer.gltf")
def _(path):
    files = trimesh.Scene(sphere()).export(file_type="gltf")
    tree = json.loads(files["model.gltf"])
    tree["buffers"][0]["uri"] = "gone.bin"
    path.write_text(json.dumps(tree))


@_in(UNUSABLE, "cut_texture.obj")
def _(path):
    rng = np.random.default_rng(0)
    picture = path.with_suffix(".png")
    Image.fromarray(rng.integers(0, 255, (32, 32, 3), dtype=np.uint8)).save(picture)
    picture.write_bytes(picture.read_bytes()[:2000])
    path.write_text(
        "mtllib cut_texture.mtl\nusemtl picture\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    path.with_suffix(".mtl").write_text("newmtl picture\nmap_Kd cut_texture.png\n")


@_in(UNUSABLE, "unknown.blend")
def _(path):
    path.write_bytes(b"BLENDER-v300")


@_in(UNUSABLE, "folder.obj")
def _(path):
    path.mkdir()


@_in(UNUSABLE, "missing.obj")
def _(path):
    pass
