"""What a reader makes of a file, in numbers, and what Blender's own import makes of it.

As a program, `python -m tests.mesh.reading out.pickle files...`: Blender's, apart from the renderer's data.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

CASES = Path(__file__).parents[1] / "cases"
# A unit box with its corner at the origin: corners in binary order of x, y, z, and its sides as polygons.
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def measured(corner) -> dict:
    """Box, area and signed volume of triangles (t, 3, 3)."""
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return {
        "box": [corner.min(axis=(0, 1)).tolist(), corner.max(axis=(0, 1)).tolist()],
        "area": float(np.linalg.norm(cross, axis=1).sum() / 2),
        "volume": float(np.einsum("ij,ij->", corner[:, 0], cross) / 6),
    }


def triangles(parts) -> np.ndarray:
    return np.concatenate([part.vertices[part.faces] for part in parts]).astype(float)


def assert_same(found: dict, expected: dict, tolerance=1e-5):
    size = np.linalg.norm(np.subtract(*expected["box"]))
    np.testing.assert_allclose(found["box"], expected["box"], atol=tolerance * size)
    np.testing.assert_allclose(found["area"], expected["area"], rtol=10 * tolerance)
    np.testing.assert_allclose(found["volume"], expected["volume"], atol=10 * tolerance * size**3)


def by_blender(*paths) -> list[dict]:
    """What Blender's import makes of files, in the frame of each: as `measured`, its triangles, and its materials."""
    with tempfile.NamedTemporaryFile() as file:
        command = [sys.executable, "-m", __name__, file.name, *(Path(path).absolute() for path in paths)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=CASES.parents[1])
        return pickle.load(file)


def _import(path: Path) -> dict:
    from studies.readers import import_with_blender

    vertices, faces = import_with_blender(path)
    if path.suffix in (".gltf", ".glb"):
        vertices = vertices[:, [0, 2, 1]] * [1, 1, -1]  # Blender turns glTF's y axis up
    return measured(vertices[faces]) | {"triangles": vertices[faces], "materials": _materials()}


def _materials() -> dict:
    """By name: the base colour, and the scale and offset of a texture."""
    import bpy

    looks = {}
    for material in bpy.data.materials:
        nodes = {node.type: node for node in material.node_tree.nodes}
        mapping = nodes["MAPPING"].inputs if "MAPPING" in nodes else {}
        looks[material.name] = {
            "colour": tuple(nodes["BSDF_PRINCIPLED"].inputs["Base Color"].default_value)[:3],
            "mapping": [tuple(mapping[key].default_value)[:2] for key in ("Scale", "Location") if mapping],
        }
    return looks


if __name__ == "__main__":
    made = [_import(Path(path)) for path in sys.argv[2:]]
    with open(sys.argv[1], "wb") as out:
        pickle.dump(made, out)
    os._exit(0)  # Blender's threads need not end
