"""Each mesh of a folder as Palpate reads it, beside Blender's own import of the same file.

    python -m studies.readers ~/meshes [--csv readers.csv] [--pictures pairs.png]

Prints a line for each file that differs, or that only one of the two can read, and a count at the end; exits with 1 if
a shape differs. `--pictures` draws the pairs that differ most, Palpate's above Blender's. What Blender has no importer
for (OFF, 3MF) is not compared.
"""

import argparse
import csv
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from palpate.batch import UnusableObject
from palpate.mesh import DIAGONAL, FORMATS

COMPARED = (".obj", ".glb", ".gltf", ".stl", ".ply", ".dae")
SHAPE = 0.002  # difference from which two shapes are not the same: of boxes in diagonals, of areas and volumes relative
SIZE, SAMPLES = 128, 16  # of the renders
SHOWN = 24  # pairs of pictures


class Shape(NamedTuple):
    """A surface without its place, turn and size: sides of the box in rising order, area and volume, in diagonals."""

    sides: np.ndarray
    area: float
    volume: float  # 0 of an open surface


class Comparison(NamedTuple):
    """A file as both readers have it. ours, theirs: why a reader can't read it, else empty. shape: the largest
    difference, as for `SHAPE`. colour: of the renders' pixels, mean absolute difference in grey levels, over the pixels
    that show the object. pictures: (2, SIZE, SIZE, 3) uint8, Palpate's and Blender's."""

    ours: str = ""
    theirs: str = ""
    shape: float = 0.0
    colour: float = 0.0
    pictures: np.ndarray | None = None

    @property
    def differs(self) -> bool:
        """Whether both can read it and have another shape."""
        return not self.ours and not self.theirs and self.shape > SHAPE


def shape_of(vertices: np.ndarray, faces: np.ndarray) -> Shape:
    """The shape of triangles: vertices (n, 3), faces (f, 3)."""
    from palpate.mesh import topology

    corner = vertices[faces] - vertices[faces].min(axis=(0, 1))
    sides = corner.max(axis=(0, 1))
    corner = corner / np.linalg.norm(sides)
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    volume = float(np.einsum("ij,ij->", corner[:, 0], cross) / 6) if topology.is_closed(faces) else 0.0
    return Shape(np.sort(sides) / np.linalg.norm(sides), float(np.linalg.norm(cross, axis=1).sum() / 2), volume)


def difference(one: Shape, other: Shape) -> float:
    """The largest difference of two shapes, as for `SHAPE`; volumes count where both are closed."""
    differences = [np.abs(one.sides - other.sides).max(), abs(one.area / other.area - 1)]
    if one.volume and other.volume:
        differences.append(abs(one.volume / other.volume - 1))
    return float(max(differences))


def repaired(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces after Palpate's repairs, as one part: readers may cut a file into parts in different ways."""
    from palpate.mesh.repair import repair

    made = repair(vertices, faces, np.zeros(len(faces), dtype=int))
    return made.vertices, made.faces[made.keep]


def import_with_blender(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and faces (f, 3) of what Blender makes of a file at rest, with modifiers, shape keys and
    instances applied. They are in the file's unit, COLLADA's in metres; glTF's y axis is turned up to z. The scene of
    the process is replaced by it.

    Raises RuntimeError if Blender can't read it; ValueError for a format that it has no importer for.
    """
    import bpy

    from palpate.vision import blender

    bpy.ops.wm.read_factory_settings(use_empty=True)
    from io_scene_gltf2.blender.imp.scene import BlenderScene  # found once Blender has set up its add-ons

    BlenderScene.create_animations = lambda gltf: None  # which would pose the object as in their first frame
    axes = {"forward_axis": "Y", "up_axis": "Z"}  # as the file has them
    importers = {
        ".obj": lambda name: bpy.ops.wm.obj_import(filepath=name, validate_meshes=False, **axes),
        ".stl": lambda name: bpy.ops.wm.stl_import(filepath=name, **axes),
        ".ply": lambda name: bpy.ops.wm.ply_import(filepath=name, **axes),
        ".dae": lambda name: bpy.ops.wm.collada_import(filepath=name, import_units=False),
        ".glb": lambda name: bpy.ops.import_scene.gltf(filepath=name, loglevel=50),
        ".gltf": lambda name: bpy.ops.import_scene.gltf(filepath=name, loglevel=50),
    }
    if path.suffix.lower() not in importers:
        raise ValueError(f"{path}: Blender has no importer for {path.suffix.lower()}")
    with blender.quiet():
        importers[path.suffix.lower()](str(path))
    vertices, faces, first = [np.zeros((0, 3))], [np.zeros((0, 3), int)], 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type != "MESH" or not instance.show_self:
            continue
        mesh, pose = instance.object.to_mesh(), np.array(instance.matrix_world)
        mesh.calc_loop_triangles()
        place, corner = np.empty(3 * len(mesh.vertices)), np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
        mesh.vertices.foreach_get("co", place)
        mesh.loop_triangles.foreach_get("vertices", corner)
        vertices.append(place.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3])
        faces.append(corner.reshape(-1, 3)[:, :: -1 if np.linalg.det(pose[:3, :3]) < 0 else 1] + first)
        first += len(mesh.vertices)
        instance.object.to_mesh_clear()
    vertices, faces = np.concatenate(vertices), np.concatenate(faces)
    if not len(faces) or not np.ptp(vertices[faces], axis=(0, 1)).any():
        raise RuntimeError("Blender reads no triangles")
    return vertices, faces


def export_from_blender(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write what `import_with_blender` left in the scene as `visual.glb` is: centred, `DIAGONAL` across, z up."""
    import bpy
    from mathutils import Matrix

    from palpate.vision import blender

    for body in (objects := bpy.context.view_layer.objects):
        body.select_set(body.type == "MESH")
    objects.active = bpy.context.selected_objects[0]
    bpy.ops.object.convert(target="MESH")  # applies shape keys and armatures, which the export would write as such
    used = vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    scale = DIAGONAL / np.linalg.norm(high - low)
    frame = bpy.data.objects.new("frame", None)
    bpy.context.scene.collection.objects.link(frame)
    frame.matrix_world = Matrix.Scale(scale, 4) @ Matrix.Translation(-(low + high) / 2)
    for body in list(bpy.context.scene.objects):
        if body.parent is None and body is not frame:
            body.parent = frame
            body.matrix_parent_inverse = Matrix.Identity(4)
    path.parent.mkdir(parents=True, exist_ok=True)
    with blender.quiet():
        bpy.ops.export_scene.gltf(
            filepath=str(path), export_yup=False, export_apply=True, export_animations=False, export_lights=False
        )


def compare(path: Path, pictures: bool = True) -> Comparison:
    """A file by both readers, in this process, whose Blender scene is replaced."""
    from palpate.vision import Renderer, paper_camera  # Blender: before anything that loads embree

    import trimesh  # isort: skip

    from palpate import mesh  # isort: skip
    from palpate.catalogue.source import FORMAT_UP  # isort: skip
    from palpate.mesh.load import load  # isort: skip
    from palpate.scene import Scene  # isort: skip

    with tempfile.TemporaryDirectory() as scratch:
        ours = theirs = ""
        try:
            parts = load(path, root="/")[0].parts
            up = "y" if path.suffix.lower() == ".dae" and b"Z_UP" not in path.read_bytes()[:65536] else "z"
            mesh.prepare(path, Path(scratch, "ours"), up=FORMAT_UP.get(path.suffix.lower(), up), root="/")
        except UnusableObject as error:
            ours = str(error)
        try:
            imported = import_with_blender(path)
            export_from_blender(Path(scratch, "theirs", "visual.glb"), *imported)
        except (RuntimeError, ValueError, LookupError) as error:
            theirs = str(error).strip().splitlines()[-1]
        if ours or theirs:
            return Comparison(ours, theirs)
        read = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
        # As read, or else after repairs: Blender leaves out faces that are there twice or have no area.
        apart = difference(shape_of(*read), shape_of(*imported))
        if apart > SHAPE:
            apart = difference(shape_of(*repaired(*read)), shape_of(*repaired(*imported)))
        if not pictures:
            return Comparison(shape=apart)
        renderer, drawn, shown = Renderer(SAMPLES, "cpu"), [], np.zeros((SIZE, SIZE), bool)
        for reader in ("ours", "theirs"):
            try:
                image, _ = renderer.render(Scene(Path(scratch, reader), camera=paper_camera(SIZE)))
            except UnusableObject as error:
                return Comparison(**{reader: str(error)})
            drawn.append(image.rgb[..., :3])
            shown |= image.mask > 0
        apart_colour = np.abs(drawn[0].astype(float) - drawn[1]).mean(axis=2)[shown].mean()
        return Comparison(shape=apart, colour=float(apart_colour), pictures=np.stack(drawn))


def compare_all(paths: Sequence[Path]) -> Iterator[Comparison]:
    """Each file by both readers, in a process that is started again where Blender crashes."""
    pool = None
    for path in paths:
        pool = pool or ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _silence)
        try:
            yield pool.submit(compare, path).result()
        except BrokenProcessPool:
            pool = None
            yield Comparison(theirs="Blender crashed")
    if pool:
        pool.shutdown()


def _silence() -> None:
    """Send what Blender's importers print, also after they have returned, nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def sheet(pairs: Sequence[np.ndarray]) -> Image.Image:
    """Pairs of pictures side by side, eight a row."""
    columns = [np.concatenate(list(pair), axis=0) for pair in pairs]
    columns += [np.full_like(columns[0], 255)] * (-len(columns) % min(8, len(columns)))
    rows = [np.concatenate(columns[k : k + 8], axis=1) for k in range(0, len(columns), 8)]
    return Image.fromarray(np.concatenate(rows, axis=0))


def main() -> None:
    """Compare the meshes of a folder; exits with 1 if a shape differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--csv", type=Path, help="a row a file: what each reader says, the differences")
    parser.add_argument("--pictures", type=Path, help=f"a PNG of the {SHOWN} pairs that differ most")
    options = parser.parse_args()
    paths = sorted(path for path in options.folder.rglob("*") if path.suffix.lower().lstrip(".") in FORMATS)
    compared = [path for path in paths if path.suffix.lower() in COMPARED]
    rows = []
    for path, result in zip(compared, compare_all(compared), strict=True):
        rows.append((path, result))
        name = path.relative_to(options.folder)
        if result.differs:
            print(f"{name}: another shape, by {result.shape:.3g}", flush=True)
        elif bool(result.ours) != bool(result.theirs):
            print(f"{name}: {f'refused: {result.ours}' if result.ours else f'by Blender: {result.theirs}'}", flush=True)
    both = [(path, result) for path, result in rows if not result.ours and not result.theirs]
    apart = sum(result.differs for _, result in both)
    print(f"{len(paths)} meshes, {len(both)} read by both, {apart} of another shape", flush=True)
    if options.csv:
        with open(options.csv, "w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["file", "ours", "theirs", "shape", "colour"])
            writer.writerows([path.relative_to(options.folder), *result[:4]] for path, result in rows)
    if options.pictures and both:
        worst = sorted(both, key=lambda row: -max(row[1].shape / SHAPE, row[1].colour))[:SHOWN]
        sheet([result.pictures for _, result in worst]).save(options.pictures)
        print("pictures:", ", ".join(str(path.relative_to(options.folder)) for path, _ in worst))
    sys.exit(int(apart > 0))


if __name__ == "__main__":
    main()
