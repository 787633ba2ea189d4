"""From a source file to the mesh files of one object."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from palpate.batch import UnusableObject
from palpate.camera import rotation_about
from palpate.mesh import DIAGONAL, LARGEST, SMALLEST, VERSION, topology
from palpate.mesh.decimate import decimate
from palpate.mesh.load import load
from palpate.mesh.repair import repair

# Rotations that turn the source's up axis to z. The front (-z for y up, as in glTF and ShapeNet) goes to +y.
UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
}
UNITS = (0.001, 0.01, 0.0254, 1.0)  # metres a unit, for messages: millimetre, centimetre, inch, metre
WRAP_MODES = {"repeat": 10497, "clamp": 33071, "mirror": 33648}  # of a glTF sampler
# Largest accepted rounding of a source's coordinates over its diagonal: 0.05 mm of 0.5 m, a third of a pixel of touch.
COARSEST = 1e-4


def build(
    source: Path, folder: Path, up: str, collision_faces: int, scale: str | float, root: Path | str | None, turn: float
) -> dict[str, Any]:
    """Make the mesh files of an object as `palpate.mesh.prepare` does, in this process, with its errors."""
    (parts, unit), problems = load(source, root)
    vertices, faces, part = joined(parts, source)
    rotation = rotation_about(2, np.radians(turn)) @ UP[up] if turn else UP[up]
    vertices = vertices @ rotation.T
    repaired = repair(vertices, faces, part)
    if not repaired.keep.any():
        raise UnusableObject(f"{source}: none of its {len(repaired.faces)} triangles has an area: export its surface")
    faces = repaired.faces[repaired.keep]
    box = repaired.vertices[faces].min(axis=(0, 1)), repaired.vertices[faces].max(axis=(0, 1))
    centre = (box[0] + box[1]) / 2
    diagonal, factor = size(source, float(np.linalg.norm(box[1] - box[0])), scale, unit)
    for number, mesh in enumerate(parts):
        own = part == number
        normals, flip = mesh.metadata.pop("vertex_normals", None), repaired.flip[own]
        turned = np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces)
        mesh.vertices = (mesh.vertices @ rotation.T - centre) * factor
        mesh.faces = turned
        mesh.update_faces(repaired.keep[own])
        used = np.isin(np.arange(len(mesh.vertices)), mesh.faces)
        mesh.update_vertices(used)
        if normals is not None and len(mesh.faces):
            normals = (normals @ rotation.T)[used]
            against = np.einsum("ij,ij->i", normals, mesh.vertex_normals) < 0
            # Of a cached property with a setter.
            mesh.vertex_normals = np.where(against[:, None], -normals, normals)  # type: ignore[method-assign]
    # What is measured is what is written: single precision.
    vertices = ((repaired.vertices - centre) * factor).astype(np.float32).astype(np.float64)
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)

    folder.mkdir(parents=True, exist_ok=True)
    shown = [mesh for mesh in parts if len(mesh.faces)]
    wraps = [mesh.metadata.pop("wrap", None) for mesh in shown]
    materials = [mesh.visual.material for mesh in shown]  # type: ignore[union-attr]  # of visuals of other kinds
    for material, wrap in zip(materials, wraps, strict=True):  # trimesh writes those whose data are the same as one
        material._data["wrap"] = wrap
    try:
        glb = trimesh.Scene(shown).export(file_type="glb", tree_postprocessor=lambda tree: _complete(tree, wraps))
    except (OSError, SyntaxError) as error:  # PIL's: textures are decoded here, nothing is written yet
        raise UnusableObject(
            f"{source}: a texture can't be read ({type(error).__name__}: {error}): replace it, or remove it "
            "from the material"
        ) from error
    (folder / "visual.glb").write_bytes(glb)
    see_through = any(material.alphaMode not in (None, "OPAQUE") for material in materials)
    record = {
        "version": VERSION,
        "source": {
            "file": source.name,
            "faces": len(repaired.faces),
            "parts": len(parts),
            "up": up,
            "turn": turn,
            "scale": scale,
            "problems": problems,
            "bounding_box": [corner.tolist() for corner in box],
        },
        "scale": float(factor),
        "diagonal": float(diagonal),
        "repairs": repaired.counts,
        "visual.glb": _describe(vertices, faces) | {"see_through": see_through},
    }
    level = decimate(vertices, faces, collision_faces)
    collision = trimesh.Trimesh(*level, process=False, validate=False)
    collision.export(folder / "collision.ply", file_type="ply", vertex_normal=False)
    record["collision.ply"] = {"asked": collision_faces} | _describe(*level)
    (folder / "mesh.json").write_text(json.dumps(record, indent=1) + "\n")
    return record


def measure(source: Path, scale: str | float, root: Path) -> tuple[float, int, dict[str, str], list[float]]:
    """Extent, faces, problems of files that it names, and shape (`palpate.mesh.facts`) of a source file. Raises
    UnusableObject, as `size` and `joined`."""
    (parts, unit), missing = load(source, root)
    vertices, faces, _ = joined(parts, source)
    sides = np.ptp(vertices[faces.ravel()], axis=0)
    extent, area = float(np.linalg.norm(sides)), np.linalg.norm(topology.cross(vertices[faces]), axis=1).sum() / 2
    if not area:
        raise UnusableObject(f"{source}: none of its {len(faces)} triangles has an area: export its surface")
    size(source, extent, scale, unit)
    return extent, len(faces), missing, [float(length) / extent for length in (*sides, area**0.5)]


def size(source: Path, extent: float, scale: str | float, unit: float) -> tuple[float, float]:
    """Diagonal (m) of an object's box of this extent in the file's unit, and the factor; scale: as for `prepare`.
    Raises UnusableObject for a diagonal that is not from `SMALLEST` to `LARGEST`."""
    if scale == "diagonal":
        return DIAGONAL, DIAGONAL / extent
    factor = unit if scale == "keep" else float(scale)
    diagonal = factor * extent
    if not SMALLEST <= diagonal <= LARGEST:
        fitting = [f"{unit:g}" for unit in UNITS if SMALLEST <= unit * extent <= LARGEST]
        raise UnusableObject(
            f"{source}: at scale {scale} it is {diagonal:.3g} m across, and objects that keep their size have "
            f"{SMALLEST:g} to {LARGEST:g} m: is its unit another? Give its metres a unit as `scale` (0.001 for "
            f"millimetres{'; here ' + ' or '.join(fitting) + ' would fit' if fitting else ''}), in the config's source "
            "or for this object in the file of source.objects, or `diagonal`"
        )
    return diagonal, factor


def joined(parts: Sequence[trimesh.Trimesh], source: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (n, 3), faces (f, 3), part's number (f,) of all parts; UnusableObject for NaN, or without an extent."""
    appended = trimesh.util.append_faces([mesh.vertices for mesh in parts], [mesh.faces for mesh in parts])
    vertices, faces = appended[0].astype(np.float64), appended[1].astype(np.int64)
    part = np.repeat(np.arange(len(parts)), [len(mesh.faces) for mesh in parts])
    used = np.unique(faces)
    bad = int((~np.isfinite(vertices[used]).all(axis=1)).sum())
    if bad:
        raise UnusableObject(
            f"{source}: {bad} of {len(used)} vertices are not finite (NaN or infinite): export it again"
        )
    with np.errstate(over="ignore"):
        diagonal = np.linalg.norm(np.ptp(vertices[used], axis=0))
    if not 1e-150 < diagonal < 1e150:  # so that areas and volumes neither vanish nor overflow
        raise UnusableObject(
            f"{source}: its bounding box has a diagonal of {diagonal:g}, so it has no size to scale: "
            "export an object that has an extent"
        )
    with np.errstate(over="ignore"):
        single = vertices[used].astype(np.float32)
    # Coordinates were rounded to single precision if each is a number of it, and some use its last digit.
    rounded = (single == vertices[used]).all() and (single.view(np.int32) & 1).any()
    rounding = float(np.spacing(np.abs(single).max())) / 2 if rounded else 0.0
    if rounding > COARSEST * diagonal:
        raise UnusableObject(
            f"{source}: {np.abs(vertices[used]).max():g} from the origin, its coordinates are rounded by up "
            f"to {rounding:g} (single precision), {rounding / diagonal:.2g} of its size: move it to the "
            "origin and export it again"
        )
    vertices[~np.isfinite(vertices).all(axis=1)] = vertices[used[0]]  # of stray vertices, which are dropped
    return vertices, faces, part


def _complete(tree: dict[str, Any], wraps: Sequence[tuple[str, str] | None]) -> None:
    """Write into the JSON of visual.glb what trimesh does not: how textures wrap, of each mesh, and light above 1."""
    materials = tree.get("materials", [])
    for material in materials:
        if (strength := max(material.get("emissiveFactor", [0]))) > 1:
            material["emissiveFactor"] = [light / strength for light in material["emissiveFactor"]]
            material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            tree["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    for mesh, wrap in zip(tree["meshes"], wraps, strict=True):
        if wrap is not None:
            sampler = {key: WRAP_MODES[mode] for key, mode in zip(("wrapS", "wrapT"), wrap, strict=True)}
            samplers = tree.setdefault("samplers", [])
            samplers += [sampler] if sampler not in samplers else []
            material = materials[mesh["primitives"][0]["material"]]
            for info in (*material.values(), *material["pbrMetallicRoughness"].values()):
                if isinstance(info, dict) and "index" in info:  # trimesh has no texture of two materials
                    tree["textures"][info["index"]]["sampler"] = samplers.index(sampler)


def _describe(vertices: np.ndarray, faces: np.ndarray) -> dict[str, Any]:
    """Facts about a surface: faces, area (m2), box (m), shells, whether it is closed, its volume (m3)."""
    corner = vertices[faces]
    cross = topology.cross(corner)
    closed, counts = topology.is_closed(faces), topology.edge_counts(faces)
    return {
        "faces": len(faces),
        "shells": int(topology.shells(faces, len(vertices)).max()) + 1,
        "closed": closed,
        "open_edges": int((counts == 1).sum()),
        "non_manifold_edges": round((1 / counts[counts > 2]).sum()),
        "area": float(np.linalg.norm(cross, axis=1).sum() / 2),
        "volume": float(np.einsum("ij,ij->", corner[:, 0], cross) / 6) if closed else None,
        "bounding_box": [corner.min(axis=(0, 1)).tolist(), corner.max(axis=(0, 1)).tolist()],
    }
