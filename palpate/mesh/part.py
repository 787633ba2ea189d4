"""A part of an object: triangles with one explicit material. What readers of mesh files return.

Every material states metallic, roughness and base colour; glTF's defaults would make it metal.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.color import srgb_to_linear
from trimesh.visual.material import PBRMaterial

PLAIN = 0.8  # linear RGB, of a file without any colour: Blender's own default
GREY = 0.5  # linear RGB, in place of a texture that can't be used


class Loaded(NamedTuple):
    """A mesh file: its parts, in its own frame and unit; unit: metres of that unit, 1 where the format states none."""

    parts: list[trimesh.Trimesh]
    unit: float = 1.0


def make_part(
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    material: PBRMaterial | None = None,
    *,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    colours: np.ndarray | None = None,
    wrap: tuple[str, str] | None = None,
) -> trimesh.Trimesh:
    """A part of an object; nothing is merged, and vertices that no face uses are kept.

    vertices (n, 3); faces (f, 3); normals (n, 3) if the file has them; uv (n, 2), v upwards as in OBJ; colours (n, 4)
    uint8, linear light, multiplied with the material's; material: by default white under colours, else `PLAIN`.
    wrap: of the texture across and up, if not both "repeat": "clamp" or "mirror".
    """
    if material is None:
        material = plain(1.0 if colours is not None else PLAIN)
    part = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    part.visual = TextureVisuals(uv=uv, material=material)
    if colours is not None:
        part.visual.vertex_attributes["color"] = colours
    if normals is not None:
        part.metadata["vertex_normals"] = normals
    if wrap is not None:
        part.metadata["wrap"] = wrap
    part.metadata["name"] = name
    return part


def material_of(part: trimesh.Trimesh) -> PBRMaterial:
    """The material of a part that `make_part` made."""
    return part.visual.material  # type: ignore[union-attr]  # trimesh allows meshes of other kinds of visuals


def plain(colour: float = PLAIN, name: str | None = None) -> PBRMaterial:
    """A rough material of one grey, linear light. `GREY` stands for a texture that can't be used."""
    return PBRMaterial(name=name, baseColorFactor=[colour] * 3 + [1.0], metallicFactor=0.0, roughnessFactor=1.0)


def linear(colours: np.ndarray) -> np.ndarray:
    """Colours (n, 3 or 4) uint8 in sRGB as (n, 4) uint8 in linear light."""
    alpha = colours[:, 3] if colours.shape[1] > 3 else np.full(len(colours), 255, np.uint8)
    light = np.round(255 * np.clip(srgb_to_linear(colours[:, :3]), 0, 1)).astype(np.uint8)
    return np.column_stack([light, alpha])
