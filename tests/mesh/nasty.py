"""A folder of nasty meshes: every class of defect that is met in the wild, each as a file of some format.

`usable(folder)` and `unusable(folder)` write them; workflow tests use them too.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

Builder = Callable[[Path], object]  # writes a file, and what it names beside it
FORMATS = ("obj", "glb", "gltf", "stl", "ply", "off", "dae", "3mf")


def usable(folder: Path) -> dict[str, Path]:
    """Write the meshes that must come through; path by name."""
    return _write(USABLE, folder)


def unusable(folder: Path) -> dict[str, Path]:
    """Write the meshes that must be rejected; path by name. `missing` is not there at all."""
    return _write(UNUSABLE, folder)


def _write(builders: dict[str, Builder], folder: Path) -> dict[str, Path]:
    paths = {}
    for file, builder in builders.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        builder(path)
        paths[path.stem] = path
    return paths


def sphere(subdivisions=3, **keywords):
    return trimesh.creation.icosphere(subdivisions=subdivisions, **keywords)


def box(x=0.0):
    return trimesh.creation.box().apply_translation((x, 0, 0))


def of(vertices, faces) -> Builder:
    """A file of these vertices and faces, as they are; an OBJ is written here."""

    def build(path):
        if path.suffix == ".obj":
            lines = ["v {} {} {}".format(*vertex) for vertex in vertices]
            text(*lines, *("f " + " ".join(str(corner + 1) for corner in face) for face in faces))(path)
        else:
            exported(trimesh.Trimesh(vertices, faces, process=False, validate=False))(path)

    return build


def exported(*meshes) -> Builder:
    """A file of one mesh, or a scene of several, as trimesh writes it."""
    mesh = meshes[0] if len(meshes) == 1 else trimesh.Scene(meshes)
    return lambda path: path.write_bytes(_bytes(mesh.export(file_type=path.suffix[1:])))


def text(*lines: str, library: str = "") -> Builder:
    """A text file, and the material library beside it."""

    def build(path):
        path.write_text("\n".join(lines) + "\n")
        if library:
            path.with_suffix(".mtl").write_text(library)

    return build


def _bytes(data):
    return data.encode() if isinstance(data, str) else data


BALL = sphere()
V, F = np.array(BALL.vertices), np.array(BALL.faces)
BOX = trimesh.creation.box()
TUBE = trimesh.creation.cylinder(radius=1, height=3, sections=48)
SIDE = np.abs(TUBE.face_normals[:, 2]) < 0.5  # of its faces


def placed(*values) -> np.ndarray:
    """The ball's vertices, of which one has another place (row, column or all columns, value)."""
    *place, value = values
    vertices = V.copy()
    vertices[tuple(place)] = value
    return vertices


def flipped(faces, where) -> np.ndarray:
    return np.where(where[:, None], faces[:, ::-1], faces)


def hollow(*turned: trimesh.Trimesh) -> Builder:
    """A ball and a smaller one in it; those that are given are turned inside out."""
    return exported(trimesh.util.concatenate([mesh.copy() for mesh in turned]))


def inside_out(mesh):
    mesh.invert()
    return mesh


def inner_wall(path):
    """Two boxes side by side in one piece, with a single wall between them: its sides have three faces."""
    boxes = trimesh.util.concatenate([box(-0.5), box(0.5)])
    walls = np.flatnonzero((np.abs(boxes.triangles[:, :, 0]) < 1e-9).all(axis=1))
    boxes.update_faces(np.delete(np.arange(len(boxes.faces)), walls[:2]))
    exported(boxes)(path)


def moebius(path):
    n = 60
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    radius, height = 1 + 0.3 * np.outer((-1, 1), np.cos(turn / 2)), 0.3 * np.outer((-1, 1), np.sin(turn / 2))
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=2).reshape(-1, 3)
    this, after = np.arange(n), np.arange(1, n + 1)
    low, high = np.where(after == n, n, after), np.where(after == n, 0, after + n)
    of(ring, np.r_[np.c_[this, low, this + n], np.c_[low, high, this + n]])(path)


def zero_area(path):
    new = np.arange(5) + len(V)
    line, point = np.c_[F[:5, 0], F[:5, 1], new], np.repeat(F[:5, :1], 3, axis=1)
    of(np.r_[V, V[F[:5, :2]].mean(axis=1)], np.r_[F, line, point])(path)


def closing_sliver(path):
    """A box, closed only by a triangle without area: one face has a corner on its neighbour's side."""
    (a, b, c), *faces = [tuple(face) for face in BOX.faces]
    middle = len(BOX.vertices)
    vertices = np.r_[BOX.vertices, [(BOX.vertices[a] + BOX.vertices[b]) / 2]]
    of(vertices, [*faces, (a, middle, c), (middle, b, c), (a, b, middle)])(path)


def materials(path):
    """A box whose sides have one of two materials: neither half is closed alone."""
    lines = [f"mtllib {path.stem}.mtl"] + ["v {} {} {}".format(*vertex) for vertex in BOX.vertices]
    for name, faces in (("red", BOX.faces[:6]), ("blue", BOX.faces[6:])):
        lines += [f"usemtl {name}"] + ["f {} {} {}".format(*(face + 1)) for face in faces]
    text(*lines, library="newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")(path)


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


def texture_gltf(path):
    for name, data in trimesh.Scene(textured()).export(file_type="gltf").items():
        (path if name.endswith(".gltf") else path.parent / name).write_bytes(data)


def texture_obj(path):
    ball = textured()
    ball.visual.material = ball.visual.material.to_simple()
    lines, files = trimesh.exchange.obj.export_obj(ball, return_texture=True, mtl_name="texture_obj.mtl")
    path.write_text(lines)
    for name, data in files.items():
        (path.parent / name).write_bytes(data)


def missing_material(path):
    of(V, F)(path)
    path.write_text("mtllib gone.mtl\nusemtl nothing\n" + path.read_text())


def missing_texture(path):
    ball = sphere(2)
    lines = ["mtllib missing_texture.mtl"] + ["v {} {} {}".format(*vertex) for vertex in ball.vertices]
    lines += ["vt 0 0", "usemtl picture"] + ["f {}/1 {}/1 {}/1".format(*(face + 1)) for face in ball.faces]
    text(*lines, library="newmtl picture\nKd 1 1 1\nmap_Kd gone.png\n")(path)


def vertex_colours(path):
    ball = sphere(2)
    ball.visual.vertex_colors = np.c_[np.uint8((ball.vertices + 1) * 127), np.full(len(ball.vertices), 255)]
    exported(ball)(path)


def face_colours(path):
    ball = sphere(1)
    ball.visual.face_colors = np.c_[np.arange(80) * 3, np.zeros((80, 2)), np.full(80, 255)].astype(np.uint8)
    exported(ball)(path)


def scene(path):
    """One geometry shown four times: moved, turned, stretched and mirrored."""
    shown = trimesh.Scene()
    mirrored, stretched = np.diag([-1.0, 1, 1, 1]), np.diag([1.0, 1, 2, 1])
    mirrored[0, 3], stretched[:3, 3] = 9, (3, 0, 0)
    turned = trimesh.transformations.rotation_matrix(1, (0, 1, 0), point=(3, 0, 0))
    shown.add_geometry(sphere(2), geom_name="ball", node_name="plain")
    for name, transform in (("stretched", stretched), ("turned", turned), ("mirrored", mirrored)):
        shown.graph.update(name, "world", matrix=transform, geometry="ball")
    path.write_bytes(shown.export(file_type="glb"))


def polygons(path):
    """A prism with polygons of eight corners and indices that count from the end."""
    turn = np.arange(8) * np.pi / 4
    ring = np.c_[np.cos(turn), np.sin(turn)]
    vertices = np.r_[np.c_[ring, np.zeros(8)], np.c_[ring, np.ones(8)]]
    sides = [f"f {i + 1} {(i + 1) % 8 + 1} {(i + 1) % 8 + 9} {i + 9}" for i in range(8)]
    caps = ["f 8 7 6 5 4 3 2 1", "f -8 -7 -6 -5 -4 -3 -2 -1"]
    text(*("v {} {} {}".format(*vertex) for vertex in vertices), *caps, *sides)(path)


def points_too(path):
    """Faces, and lines and points beside them."""
    of(V, F)(path)
    path.write_text(path.read_text() + "v 0 0 0\np 1\nl 1 2\n")


USABLE: dict[str, Builder] = {
    "open.obj": of(TUBE.vertices, TUBE.faces[SIDE]),
    "flat.obj": of([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)]),
    "non_manifold.off": of(
        np.r_[BOX.vertices, [(1.5, 0.0, 0.0)]], np.r_[BOX.faces, [(*BOX.faces[0][:2], len(BOX.vertices))]]
    ),
    "inner_wall.stl": inner_wall,
    "flipped.stl": of(V, F[:, ::-1]),
    "mixed_winding.ply": of(V, flipped(F, np.arange(len(F)) % 3 == 0)),
    # A tube without caps whose winding is more often wrong than right.
    "mixed_open.ply": of(TUBE.vertices, flipped(TUBE.faces[SIDE], np.arange(SIDE.sum()) % 3 != 0)),
    "moebius.ply": moebius,
    "duplicate_faces.off": of(V, np.r_[F, F[:40], F[40:100, ::-1]]),
    "duplicate_vertices.ply": of(V[F].reshape(-1, 3), np.arange(3 * len(F)).reshape(-1, 3)),
    "zero_area.off": zero_area,
    "closing_sliver.off": closing_sliver,
    "stray_vertices.ply": of(np.r_[V, [(1e6, 0, 0), (0, -1e6, 5), (np.nan, 0, 0)]], F),
    "interior.glb": exported(sphere(radius=1), trimesh.creation.box(extents=(0.5, 0.5, 0.5))),
    # A hollow ball: the inner shell faces its hollow, as it should.
    "void.stl": hollow(sphere(), inside_out(sphere(radius=0.5))),
    "flipped_void.stl": hollow(inside_out(sphere()), sphere(radius=0.5)),
    "shells.dae": hollow(*(sphere(2, radius=0.4).apply_translation((x, 0, 0)) for x in range(5))),
    "touching.glb": exported(box(0), box(1)),  # two closed solids that share a whole side: each must stay closed
    "materials.obj": materials,
    "texture.glb": exported(textured()),
    "separate/texture_gltf.gltf": texture_gltf,
    "texture_obj/texture_obj.obj": texture_obj,
    "missing_material.obj": missing_material,
    "missing_texture.obj": missing_texture,
    "vertex_colours.ply": vertex_colours,
    "face_colours.ply": face_colours,
    "millimetres.stl": of(V * 1000, F),
    "tiny.ply": of(V * 1e-6, F),
    "units.3mf": exported(sphere().apply_scale(1000)),
    "far_away.obj": of(V + (1e5, -2e5, 3e5), F),
    "scene.glb": scene,
    # Triangles that have nothing to do with each other.
    "soup.stl": of(np.random.default_rng(0).random((600, 3)), np.arange(600).reshape(-1, 3)),
    "thin_blade.off": exported(trimesh.creation.box(extents=(1, 0.2, 1e-4)).subdivide().subdivide()),
    "polygons.obj": polygons,
    "with space & ümläut.obj": of(V, F),
    "tetrahedron.off": of([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]),
    "points_too.obj": points_too,
}


def cut(path):
    whole = _bytes(sphere().export(file_type=path.suffix[1:]))
    path.write_bytes(whole[: len(whole) // 2])


def no_buffer(path):
    tree = json.loads(trimesh.Scene(sphere()).export(file_type="gltf")["model.gltf"])
    tree["buffers"][0]["uri"] = "gone.bin"
    path.write_text(json.dumps(tree))


def cut_texture(path):
    picture = path.with_suffix(".png")
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32, 3), dtype=np.uint8)).save(picture)
    picture.write_bytes(picture.read_bytes()[:2000])
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 0 1", "f 1/1 2/2 3/3"]
    library = "newmtl picture\nmap_Kd cut_texture.png\n"
    text("mtllib cut_texture.mtl", "usemtl picture", *lines, library=library)(path)


PLY = ["ply", "format ascii 1.0", "element vertex 3", "property float x", "property float y", "property float z",
       "element face 1", "property list uchar int vertex_indices", "end_header"]  # fmt: skip
UNUSABLE: dict[str, Builder] = {
    **{f"empty_{suffix}.{suffix}": lambda path: path.write_bytes(b"") for suffix in FORMATS},
    **{
        f"garbage_{suffix}.{suffix}": lambda path: path.write_bytes(np.random.default_rng(0).bytes(3000))
        for suffix in FORMATS
    },
    **{f"page_{suffix}.{suffix}": text(*["<html><body>404: not found</body></html>"] * 20) for suffix in FORMATS},
    **{f"cut_{suffix}.{suffix}": cut for suffix in ("glb", "stl", "ply", "off", "dae", "3mf")},
    "nan.obj": of(placed(5, 1, np.nan), F),
    "nan_stl.stl": of(placed(5, np.nan), F),
    "infinite.ply": of(placed(5, 2, np.inf), F),
    # So far from the origin that single precision has rounded its shape away, by 1 % of its size.
    "far_single.ply": of(V + (1e6, 0, 0), F),
    "overflowing.obj": of(V * 1e200, F),
    "points.ply": exported(trimesh.PointCloud(V)),
    "points_obj.obj": of(V, []),
    "lines.obj": text("v 0 0 0", "v 1 0 0", "v 1 1 0", "l 1 2", "l 2 3"),
    "one_point.off": of(np.zeros((3, 3)), [(0, 1, 2)]),
    "on_a_line.obj": of(np.outer(np.arange(6), (1.0, 2.0, 3.0)), [(0, 1, 2), (2, 3, 4), (3, 4, 5)]),
    "bad_index.off": text("OFF", "3 1 0", "0 0 0", "1 0 0", "0 1 0", "3 0 1 7"),
    "bad_index_ply.ply": text(*PLY, "0 0 0", "1 0 0", "0 1 0", "3 0 1 7"),
    "no_faces.off": text("OFF", "0 0 0"),
    "no_buffer.gltf": no_buffer,
    "cut_texture.obj": cut_texture,
    "unknown.blend": lambda path: path.write_bytes(b"BLENDER-v300"),
    "folder.obj": lambda path: path.mkdir(),
    "missing.obj": lambda path: None,
}
