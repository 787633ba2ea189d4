"""What a reader makes of a file, in numbers, and what Blender's own import makes of it.

As a program, `python reading.py out.json files...`: Blender's numbers, so that its data are none of the renderer's.
"""

import json
import os
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
    with tempfile.NamedTemporaryFile() as file:
        command = [sys.executable, __file__, file.name, *map(str, paths)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.load(file)


def _import(path):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith(".dae"):
        bpy.ops.wm.collada_import(filepath=path, import_units=False)
    else:
        {".ply": bpy.ops.wm.ply_import, ".stl": bpy.ops.wm.stl_import}[path[-4:]](filepath=path)
    corners = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "MESH" and instance.show_self:
            mesh, pose = instance.object.to_mesh(), np.array(instance.matrix_world)
            mesh.calc_loop_triangles()
            points = np.array([vertex.co for vertex in mesh.vertices], float) @ pose[:3, :3].T + pose[:3, 3]
            faces = np.array([triangle.vertices for triangle in mesh.loop_triangles])
            corners.append(points[faces[:, ::-1] if np.linalg.det(pose[:3, :3]) < 0 else faces])
    return measured(np.concatenate(corners))


if __name__ == "__main__":
    with open(sys.argv[1], "w") as out:
        json.dump([_import(path) for path in sys.argv[2:]], out)
    os._exit(0)  # Blender's threads need not end
