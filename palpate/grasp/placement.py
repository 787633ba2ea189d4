"""Placement of the palm: tangent to a random point of the object's exterior surface."""

from typing import NamedTuple

import igl
import numpy as np
import trimesh

from palpate.hand import Hand

GAP = (0.005, 0.060)  # metres between the palm's face and the surface


class Surface(NamedTuple):
    """Exterior surface points and their outward unit normals, both (N, 3)."""

    points: np.ndarray
    normals: np.ndarray


def with_normals(points: np.ndarray, mesh: trimesh.Trimesh) -> Surface:
    """Surface points (N, 3) with the normals of the faces of `mesh` that they are on."""
    points = np.ascontiguousarray(points, dtype=float)
    vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    _, face, _ = igl.point_mesh_squared_distance(points, vertices, faces)
    corners = vertices[faces[face]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    good = length > 0
    return Surface(points[good], normals[good] / length[good, None])


def palm_pose(hand: Hand, surface: Surface, rng: np.random.Generator) -> np.ndarray:
    """A palm pose (4, 4): at a random point, the palm's normal into the surface, random turn and gap."""
    chosen = rng.integers(len(surface.points))
    turn, gap = rng.uniform(0, 2 * np.pi), rng.uniform(*GAP)
    face, inward = np.eye(4), -surface.normals[chosen]
    first = np.cross(inward, np.eye(3)[np.abs(inward).argmin()])
    first /= np.linalg.norm(first)
    along = np.cos(turn) * first + np.sin(turn) * np.cross(inward, first)
    face[:3, :3] = np.column_stack([inward, np.cross(along, inward), along])
    face[:3, 3] = surface.points[chosen] - gap * inward
    return face @ np.linalg.inv(hand.palm_anchor)
