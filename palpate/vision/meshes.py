"""Meshes to draw besides an object's file: coloured triangles, as plain arrays."""

from typing import NamedTuple

import numpy as np

from palpate.vision.geom import sphere


class Mesh(NamedTuple):
    """Triangles with colours, in the world.

    vertices: (n, 3) metres. faces: (f, 3) int. colours: sRGB in 0..1, of the whole (3,), or of every vertex
    (n, 3) (blended over the faces), or of every face (f, 3). normals: (n, 3) for smooth shading, or none for
    smooth shading with edges sharper than 30 degrees kept.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray = (0.7, 0.7, 0.7)
    normals: np.ndarray | None = None


def spheres(points: np.ndarray, radius: float, colours=(0.8, 0.1, 0.1), segments: int = 4) -> Mesh:
    """Points (n, 3) as small spheres of a radius in metres; colours: sRGB (3,) or one a point (n, 3)."""
    points = np.asarray(points, dtype=float)
    vertices, faces, normals = sphere(radius, segments)
    count = len(points)
    colours = np.broadcast_to(colours, (count, 3))
    return Mesh(
        (points[:, None] + vertices).reshape(-1, 3),
        (np.arange(count)[:, None, None] * len(vertices) + faces).reshape(-1, 3),
        np.repeat(colours, len(vertices), axis=0),
        np.tile(normals, (count, 1)),
    )
