"""From solids with materials to a scene of closed, textured meshes of a bounded number of faces."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import trimesh
from manifold3d import Manifold
from trimesh.visual import TextureVisuals

from palpate.shapes.materials import Material
from palpate.shapes.solids import union

# Faces of one object: enough that a flat facet is smaller than a touch sensor, few enough to stay quick.
FEWEST_FACES, MOST_FACES = 5_000, 20_000
# Vertices nearer than this to a simpler surface go, metres: CSG leaves slivers where surfaces nearly coincide.
SLIVER = 2e-6


@dataclass(frozen=True)
class Part:
    """A closed solid of one material. `uv` maps vertices (n, 3) to texture coordinates (n, 2)."""

    solid: Manifold
    material: Material
    uv: Callable[[np.ndarray], np.ndarray] | None = None


def assemble(parts: Iterable[Part]) -> trimesh.Scene:
    """One closed mesh a material, in the order in which materials first appear."""
    by_material: dict[str, list[Part]] = {}
    for part in parts:
        by_material.setdefault(part.material.name, []).append(part)
    solids = {name: union(part.solid for part in group) for name, group in by_material.items()}
    scene = trimesh.Scene()
    for name, solid in bounded_faces(solids).items():
        part = by_material[name][0]
        raw = solid.to_mesh64()
        vertices = np.asarray(raw.vert_properties)[:, :3]
        uv = np.zeros((len(vertices), 2)) if part.uv is None else part.uv(vertices)
        mesh = trimesh.Trimesh(
            vertices,
            np.asarray(raw.tri_verts, dtype=np.int64),
            visual=TextureVisuals(uv=uv, material=part.material.to_pbr()),
            process=False,
        )
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    return scene


def bounded_faces(solids: dict[str, Manifold]) -> dict[str, Manifold]:
    """Refine large flat facets until the object has its fewest faces; simplify it if it has too many."""
    solids = {name: solid.simplify(SLIVER) for name, solid in solids.items()}
    refined, length = solids, 0.05
    while faces(refined) < FEWEST_FACES:
        refined = {name: solid.refine_to_length(length) for name, solid in solids.items()}
        length *= 0.65
    tolerance = 2 * SLIVER
    while faces(refined) > MOST_FACES:
        refined = {name: solid.simplify(tolerance) for name, solid in refined.items()}
        tolerance *= 2
    return refined


def faces(solids: dict[str, Manifold]) -> int:
    """Number of faces of all solids."""
    return sum(solid.num_tri() for solid in solids.values())
