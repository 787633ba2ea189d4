"""From solids with materials to a scene of closed, textured meshes of a bounded number of faces."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import trimesh
from manifold3d import Manifold
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from palpate.shapes.solids import union

# Faces of one object: enough that a flat facet is smaller than a touch sensor, few enough to stay quick.
FEWEST_FACES, MOST_FACES = 5_000, 20_000
# Refinement aims here: it splits whole edges, so the count it ends at differs from the estimate.
AIM_FACES = 7_000


@dataclass(frozen=True)
class Material:
    """A physically based material: sRGB colour 0-255, metallic and roughness 0-1, and perhaps a picture."""

    name: str
    colour: tuple[int, int, int]
    metallic: float = 0.0
    roughness: float = 0.5
    image: Callable[[], Image.Image] | None = None

    def to_pbr(self) -> PBRMaterial:
        picture = None if self.image is None else self.image()
        return PBRMaterial(
            name=self.name,
            baseColorFactor=np.array([*self.colour, 255], dtype=np.uint8),
            metallicFactor=float(self.metallic),
            roughnessFactor=float(self.roughness),
            baseColorTexture=picture,
        )


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
    solids = {name: solid for name, solid in bounded_faces(solids).items()}
    scene = trimesh.Scene()
    for name, solid in solids.items():
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
    """Refine flat areas until the object has its fewest faces; simplify it if it has too many."""
    total = sum(solid.num_tri() for solid in solids.values())
    area = sum(solid.surface_area() for solid in solids.values())
    length = np.sqrt(area / AIM_FACES * 4 / np.sqrt(3))
    while total < FEWEST_FACES:
        refined = {name: solid.refine_to_length(length) for name, solid in solids.items()}
        total = sum(solid.num_tri() for solid in refined.values())
        if total >= FEWEST_FACES:
            solids = refined
        length *= 0.85
    tolerance = 1e-6
    while total > MOST_FACES:
        solids = {name: solid.simplify(tolerance) for name, solid in solids.items()}
        total = sum(solid.num_tri() for solid in solids.values())
        tolerance *= 2
    return solids
