"""The procedural classes; objects by class and index, as scenes and as files: GLB, or OBJ with MTL and textures. Solids
with materials become closed, textured meshes of a bounded number of faces, smoothly deformed as a whole: closed solids
stay closed, and bounds of the parameters keep neighbours in their order."""

import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import trimesh
from manifold3d import Manifold
from scipy.spatial import cKDTree
from trimesh.exchange.obj import export_obj
from trimesh.visual import TextureVisuals

from palpate.shapes import CLASSES, bottle, cellphone, draw, knife, read, rifle, style_and_rng, suffix
from palpate.shapes.materials import Part
from palpate.shapes.solids import union

# A module has AXES (the long one, that towards which objects bend) and build(parameters, rng).
FAMILIES = dict(zip(CLASSES, (bottle, knife, cellphone, rifle), strict=True))
# Faces of one object: a facet is a few millimetres of a touch sensor's 16 mm, at the size that the sensor touches.
FEWEST_FACES, MOST_FACES = 5_000, 50_000
# Solids are simplified to so many; what is left is for the facets that deformation bends.
SIMPLIFIED_FACES = 46_000
# Longest edge over the object's diagonal, and what it is multiplied by where faces are too few or too many.
EDGE, SHORTER, LONGER = 0.05, 0.7, 1.5
# Over the diagonal. Vertices nearer than this to a simpler surface go: CSG leaves slivers where surfaces almost meet.
SLIVER = 3e-6
# Metres. Vertices as near as this may become equal in a file; then they are moved this far into the solid.
TOUCH, GAP = 5e-7, 1e-5
# Waves of the smooth random warp, and the most periods of one across the object's box.
WAVES, PERIODS = 4, 0.8


def make(class_name: str, index: int, seed: int = 0) -> trimesh.Scene:
    """Build object `index` of a class: a scene of closed meshes, one a material, of 5,000 to 50,000 faces; metres, z
    up. The same arguments give the same object. Raises ValueError for an unknown class or a negative index."""
    name, rng = style_and_rng(class_name, index, seed)
    family, p = FAMILIES[class_name], draw(rng, name, **read(class_name))
    waves = int(rng.integers(2**32))
    by_material: dict[str, list[Part]] = {}  # in the order in which they first appear
    for part in family.build(p, rng):
        by_material.setdefault(part.material.name, []).append(part)
    solids = bounded_faces([union(part.solid for part in group) for group in by_material.values()])
    bounds, scene = bounds_of(solids), trimesh.Scene()
    for (material, (part, *_)), solid in zip(by_material.items(), solids, strict=True):
        raw = solid.to_mesh64()
        faces, vertices = np.asarray(raw.tri_verts, dtype=np.int64), np.asarray(raw.vert_properties)[:, :3]
        uv = part.uv(vertices) if part.material.picture else np.zeros((len(vertices), 2))
        visual = TextureVisuals(uv=uv, material=part.material.to_pbr())
        moved = apart(deformed(vertices, bounds, p, family.AXES, waves), faces)
        mesh = trimesh.Trimesh(moved, faces, visual=visual, process=False)
        scene.add_geometry(mesh, node_name=material, geom_name=material)
    return scene


def write(class_name: str, index: int, path: Path | str, seed: int = 0) -> Path:
    """Write object `index` of a class and return its path: .glb or .obj (else ValueError), by default as `suffix`
    chooses. Errors as `make`."""
    path = Path(path)
    if not path.suffix:
        path = path.with_name(path.name + suffix(index))
    if path.suffix not in (".glb", ".obj"):
        raise ValueError(f"{path}: procedural objects are written as .glb or .obj")
    scene, also = make(class_name, index, seed), {}
    if path.suffix == ".glb":
        path.write_bytes(scene.export(file_type="glb"))
        return path
    for mesh in scene.geometry.values():
        material = mesh.visual.material
        material.name = f"{path.stem}-{material.name}"
        # What trimesh does not write.
        also[material.name] = f"\nPm {material.metallicFactor:g}\nPr {material.roughnessFactor:g}".encode()
    options = {"include_normals": False, "return_texture": True, "mtl_name": f"{path.stem}.mtl", "header": None}
    text, files = export_obj(scene, **options)
    for name, data in files.items():
        if name.endswith(".mtl"):
            data = re.sub(rb"(?m)^newmtl (.+)$", lambda line: line[0] + also[line[1].decode()], data)
        (path.parent / name).write_bytes(data)
    path.write_text(text)
    return path


def bounds_of(solids: Sequence[Manifold]) -> np.ndarray:
    """Lowest and highest corner (2, 3) of all solids."""
    boxes = np.array([solid.bounding_box() for solid in solids])
    return np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


def apart(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertices (n, 3), those that touch another moved inwards by `GAP`: solids that touch along an edge are closed, but
    a loader merges equal vertices, and an edge of four faces is closed no more."""
    pairs = cKDTree(vertices).query_pairs(TOUCH, output_type="ndarray")
    if len(pairs) == 0:
        return vertices
    # Of k vertices at one point the first stays, the next moves once, the next twice.
    moves = np.bincount(pairs.max(axis=1), minlength=len(vertices))
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    return vertices - GAP * moves[:, None] * normals


def bounded_faces(solids: Sequence[Manifold]) -> list[Manifold]:
    """Simplify where there are too many faces, then cut long edges, so that facets can bend."""

    def count(solids: Sequence[Manifold]) -> int:
        return sum(solid.num_tri() for solid in solids)

    diagonal = float(np.linalg.norm(np.diff(bounds_of(solids), axis=0)))
    tolerance, edge = SLIVER * diagonal, EDGE * diagonal
    simple = [solid.simplify(tolerance) for solid in solids]
    while count(simple) > SIMPLIFIED_FACES:
        tolerance *= 2
        simple = [solid.simplify(tolerance) for solid in simple]
    refined = [solid.refine_to_length(edge) for solid in simple]
    for too_few in (True, False):
        while count(refined) < FEWEST_FACES if too_few else count(refined) > MOST_FACES:
            edge *= SHORTER if too_few else LONGER
            refined = [solid.refine_to_length(edge) for solid in simple]
    return refined


def deformed(
    vertices: np.ndarray, bounds: np.ndarray, p: SimpleNamespace, axes: tuple[int, int], seed: int
) -> np.ndarray:
    """Vertices (n, 3), moved. bounds: (2, 3) of the whole object; p: has the parameters of the group `form`; axes: of
    0, 1, 2 the one from end to end, and that towards which it bends; seed: of phases and directions of the waves."""
    rng, (long_axis, bend_axis) = np.random.default_rng(seed), axes
    low, extent = bounds[0], np.maximum(bounds[1] - bounds[0], 1e-9)
    unit = (vertices - low) / extent
    phase = rng.uniform(0, 2 * np.pi, 3)
    stretch = np.array([p.stretch_x, p.stretch_y, p.stretch_z])
    unit = unit + stretch / (2 * np.pi) * (np.sin(2 * np.pi * unit + phase) - np.sin(phase))
    waves = rng.uniform(-PERIODS, PERIODS, (WAVES, 3)), rng.uniform(0, 2 * np.pi, WAVES), rng.normal(size=(WAVES, 3))
    warp = np.sin(2 * np.pi * unit @ waves[0].T + waves[1]) @ waves[2]
    # The end at the bottom of a long axis z stays flat: that axis does not move by the waves.
    warp[:, long_axis] = 0
    unit = unit + p.warp * warp / np.abs(waves[2]).sum(axis=0)
    side_axis = 3 - long_axis - bend_axis
    place, middle = low + unit * extent, low + extent / 2
    along, across, aside = (place[:, axis] - middle[axis] for axis in (*axes, side_axis))
    length = extent[long_axis]
    share = along / length
    across, aside = across * (1 + 2 * (p.taper + p.flare) * share), aside * (1 + 2 * p.taper * share)
    angle = np.radians(p.twist) * share
    across, aside = across * np.cos(angle) - aside * np.sin(angle), across * np.sin(angle) + aside * np.cos(angle)
    if abs(p.bend) > 0.1:
        turn = np.radians(p.bend)
        radius = length / turn
        along, across = (radius - across) * np.sin(turn * share), radius - (radius - across) * np.cos(turn * share)
    across = across + p.lean * length * (share + 0.5) ** 2
    result = np.empty_like(vertices)
    result[:, [*axes, side_axis]] = np.column_stack([along, across, aside])
    return result + middle
