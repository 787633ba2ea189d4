"""Solids with materials become closed, textured meshes of a bounded number of faces, smoothly deformed as a whole.

Deformations move vertices only, so closed solids stay closed; bounds of the parameters keep neighbours in their order.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import trimesh
from manifold3d import Manifold
from scipy.spatial import cKDTree
from trimesh.visual import TextureVisuals

from palpate.shapes.materials import Material, across
from palpate.shapes.solids import union

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


@dataclass(frozen=True)
class Part:
    """A closed solid of one material. `uv` maps vertices (n, 3) to texture coordinates (n, 2); default: `across`."""

    solid: Manifold
    material: Material
    uv: Callable[[np.ndarray], np.ndarray] = across


def assemble(parts: Iterable[Part], p: SimpleNamespace, axes: tuple[int, int], seed: int) -> trimesh.Scene:
    """One closed mesh a material, in the order in which materials first appear; pictures are laid on, and then it is
    `deformed`, whose arguments the others are."""
    by_material: dict[str, list[Part]] = {}
    for part in parts:
        by_material.setdefault(part.material.name, []).append(part)
    solids = bounded_faces({name: union(part.solid for part in group) for name, group in by_material.items()})
    bounds = bounds_of(solids.values())
    scene = trimesh.Scene()
    for name, solid in solids.items():
        part = by_material[name][0]
        raw = solid.to_mesh64()
        faces = np.asarray(raw.tri_verts, dtype=np.int64)
        vertices = np.asarray(raw.vert_properties)[:, :3]
        uv = part.uv(vertices) if part.material.picture else np.zeros((len(vertices), 2))
        visual = TextureVisuals(uv=uv, material=part.material.to_pbr())
        moved = deformed(vertices, bounds, p, axes, seed)
        mesh = trimesh.Trimesh(apart(moved, faces), faces, visual=visual, process=False)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    return scene


def bounds_of(solids: Iterable[Manifold]) -> np.ndarray:
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


def bounded_faces(solids: dict[str, Manifold]) -> dict[str, Manifold]:
    """Simplify where there are too many faces, then cut long edges, so that facets can bend."""

    def count(solids: dict[str, Manifold]) -> int:
        return sum(solid.num_tri() for solid in solids.values())

    diagonal = float(np.linalg.norm(np.diff(bounds_of(solids.values()), axis=0)))
    tolerance = SLIVER * diagonal
    simple = {name: solid.simplify(tolerance) for name, solid in solids.items()}
    while count(simple) > SIMPLIFIED_FACES:
        tolerance *= 2
        simple = {name: solid.simplify(tolerance) for name, solid in simple.items()}
    edge = EDGE * diagonal
    refined = {name: solid.refine_to_length(edge) for name, solid in simple.items()}
    for too_few in (True, False):
        while count(refined) < FEWEST_FACES if too_few else count(refined) > MOST_FACES:
            edge *= SHORTER if too_few else LONGER
            refined = {name: solid.refine_to_length(edge) for name, solid in simple.items()}
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
