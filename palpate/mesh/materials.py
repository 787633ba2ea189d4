"""Materials: each part gets one with metallic, roughness and base colour; glTF's defaults would make it metal.

Formats mean what Blender takes them to mean:

- glTF: its own, with glTF's defaults (metallic 1). A part without a material is not metal here.
- MTL: `Kd` is linear light. Under a texture it does not count: many exporters leave a dark one there. `Pr` is the
  roughness, else sqrt(Ns / 1000) less than 1. `Pm` is metallic.
- PLY, OFF, OBJ: colours of vertices and faces are sRGB.
- else: metallic 0, roughness 1, white under a texture or colours, and `PLAIN` where a file has no colour at all.
"""

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.color import srgb_to_linear, to_float
from trimesh.visual.material import PBRMaterial, SimpleMaterial

PLAIN = 0.8  # linear RGB: Blender's own default
LINEAR = (".glb", ".gltf", ".dae", ".3mf")  # formats whose colours of vertices are linear light


def make_explicit(mesh: trimesh.Trimesh, suffix: str) -> None:
    """Give a part a `PBRMaterial` that leaves nothing out. suffix: of the file that it comes from."""
    visual = mesh.visual
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    if material is None:
        colours = visual.vertex_colors if visual.defined else None
        if colours is not None and suffix not in LINEAR:
            colours = np.column_stack([_bytes(srgb_to_linear(colours[:, :3])), colours[:, 3]])
        base = 1.0 if visual.defined else PLAIN
        made = PBRMaterial(baseColorFactor=[base, base, base, 1.0], metallicFactor=0.0)
    else:
        colours = visual.vertex_attributes.get("color")
        if colours is not None:
            colours = _bytes(to_float(colours))
        made = _from_simple(material, uv is not None) if isinstance(material, SimpleMaterial) else material
    if made.metallicFactor is None:
        made.metallicFactor = 1.0 if suffix in (".glb", ".gltf") else 0.0
    made.roughnessFactor = 1.0 if made.roughnessFactor is None else made.roughnessFactor
    if made.baseColorFactor is None:
        made.baseColorFactor = [1.0, 1.0, 1.0, 1.0]
    mesh.visual = TextureVisuals(uv=uv, material=made)
    if colours is not None:
        mesh.visual.vertex_attributes["color"] = colours


def _from_simple(material: SimpleMaterial, has_coordinates: bool) -> PBRMaterial:
    """The material of an OBJ's library, or of a PLY's texture."""
    given = {key: value for key in ("kd", "ns", "pm", "pr") if (value := _numbers(material.kwargs.get(key)))}
    image = material.image if has_coordinates else None
    shininess = np.clip(given.get("ns", [0.0])[0], 0, 1000)
    colour = given.get("kd", [PLAIN]) if image is None else [1.0]
    return PBRMaterial(
        name=material.name,
        baseColorTexture=image,
        baseColorFactor=[*np.clip(np.resize(colour, 3), 0, 1), 1.0],
        metallicFactor=np.clip(given.get("pm", [0.0])[0], 0, 1),
        roughnessFactor=np.clip(given.get("pr", [1 - np.sqrt(shininess / 1000)])[0], 0, 1),
    )


def _numbers(value) -> list[float]:
    """A key's finite numbers, one or several, as text or not; else empty."""
    try:
        found = [float(each) for each in np.ravel(value)]
    except (TypeError, ValueError):
        return []
    return found if np.isfinite(found).all() else []


def _bytes(colours: np.ndarray) -> np.ndarray:
    return np.round(255 * np.clip(colours, 0, 1)).astype(np.uint8)
