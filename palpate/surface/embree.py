"""Embree's ray casting on the faces of one mesh. `bpy` must be imported before this module, if at all.
trimesh's wrapper copies, scales and normalises every ray, which costs more than tracing the rays of a sensor."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from palpate.mesh import Mesh


class RayMesh:
    """The faces of a mesh that have an area, in Embree's tree; no ray leaks between two faces that share vertices.
    Embree's single precision, about 1e-7 of the mesh's size, names the face that is hit; the caller computes where.
    triangles: (f, 3, 3) float64, corners of the faces kept, in the mesh's own coordinates. normals: (f, 3) float64,
    twice as long as the area. face: (f,) index of each into `mesh.faces`. low, high: (3,) corners of the box around."""

    def __init__(self, mesh: Mesh):
        """Raises ValueError if none of the mesh's faces has an area."""
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        triangles = vertices[np.asarray(mesh.faces).reshape(-1, 3)]
        with np.errstate(invalid="ignore"):
            normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            area = np.einsum("fi,fi->f", normals, normals)
        # Written so that it is false for NaN and infinity too.
        self.face = np.flatnonzero((area > 0) & (area < np.inf))
        if not len(self.face):
            raise ValueError(f"expected a mesh with at least one face of non-zero area, got {len(area)} faces, none")
        self.triangles = triangles[self.face]
        self.normals = normals[self.face]
        self._scene = EmbreeScene(robust=True)
        # Of vertices only those that faces use: a stray one may be NaN, or so far off that it costs precision.
        faces, used = np.asarray(mesh.faces)[self.face], np.zeros(len(vertices), dtype=bool)
        used[faces] = True
        self.low, self.high = vertices[used].min(axis=0), vertices[used].max(axis=0)
        self._centre = (self.low + self.high) / 2
        index = (np.cumsum(used) - 1)[faces].astype(np.int32)
        TriangleMesh(self._scene, (vertices[used] - self._centre).astype(np.float32), index)

    def first_face(self, origins: np.ndarray, directions: np.ndarray, reach: float | None = None) -> np.ndarray:
        """The face that each ray meets first, from either side: (n,) int32 index into `triangles`, -1 for none.
        origins: (n, 3) in the mesh's coordinates; directions: (n, 3), or (1, 3) for parallel rays; reach: longest
        distance, in units of the directions' length."""
        return self._query(origins, directions, reach, "INTERSECT")

    def blocked(self, origins: np.ndarray, directions: np.ndarray, reach: float | None = None) -> np.ndarray:
        """Whether each ray meets any face at all: (n,) bool. Cheaper than `first_face`."""
        return self._query(origins, directions, reach, "OCCLUDED") != -1

    def normals_at(self, points: np.ndarray) -> np.ndarray:
        """Unit normals (n, 3) of the faces that are nearest to points (n, 3) float64, in the mesh's coordinates."""
        import igl

        corners = self.triangles.reshape(-1, 3)
        _, face, _ = igl.point_mesh_squared_distance(points, corners, np.arange(len(corners)).reshape(-1, 3))
        return self.normals[face] / np.linalg.norm(self.normals[face], axis=1, keepdims=True)

    def _query(self, origins: np.ndarray, directions: np.ndarray, reach: float | None, query: str) -> np.ndarray:
        """What Embree answers to a query for each ray: the face that it meets, -1 for none."""
        origins = np.subtract(origins, self._centre).astype(np.float32)
        return self._scene.run(origins, np.asarray(directions, dtype=np.float32), dists=reach, query=query)
