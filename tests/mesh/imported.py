"""What Blender's own import makes of glTF files, at rest: box, area, signed volume, in the frame of the file.

A program of its own, so that Blender's data here are none of the renderer's: `python imported.py out.json files...`.
"""

import json
import os
import sys

import bpy
import numpy as np


def measured(path: str) -> dict:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path, loglevel=50)
    corners = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "MESH" and instance.show_self:
            mesh, pose = instance.object.to_mesh(), np.array(instance.matrix_world)
            mesh.calc_loop_triangles()
            vertices = np.empty(3 * len(mesh.vertices), np.float32)
            faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
            mesh.vertices.foreach_get("co", vertices)
            mesh.loop_triangles.foreach_get("vertices", faces)
            points = vertices.reshape(-1, 3).astype(float) @ pose[:3, :3].T + pose[:3, 3]
            faces = faces.reshape(-1, 3)
            corners.append(points[faces[:, ::-1] if np.linalg.det(pose[:3, :3]) < 0 else faces])
    corner = np.concatenate(corners)[..., [0, 2, 1]] * [1, 1, -1]  # it turns glTF's y axis up
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return {
        "box": [corner.min(axis=(0, 1)).tolist(), corner.max(axis=(0, 1)).tolist()],
        "area": float(np.linalg.norm(cross, axis=1).sum() / 2),
        "volume": float(np.einsum("ij,ij->", corner[:, 0], cross) / 6),
    }


if __name__ == "__main__":
    with open(sys.argv[1], "w") as file:
        json.dump({path: measured(path) for path in sys.argv[2:]}, file)
    os._exit(0)  # Blender's threads need not end
