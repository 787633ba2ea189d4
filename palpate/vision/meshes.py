"""Meshes to draw besides an object's file: coloured triangles, as plain arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.hand import Hand
from palpate.vision import geom


class Mesh(NamedTuple):
    """Triangles with colours, in the world."""

    vertices: np.ndarray  # (n, 3) metres
    faces: np.ndarray  # (f, 3) int
    # sRGB in 0..1: (3,), of vertices (n, 3) (blended over the faces), or of faces (f, 3).
    colours: np.ndarray | tuple[float, float, float] = (0.7, 0.7, 0.7)
    normals: np.ndarray | None = None  # (n, 3) for smooth shading; None keeps edges sharper than 30 degrees


def spheres(points: np.ndarray, radius: float, colours: ArrayLike = (0.8, 0.1, 0.1), segments: int = 4) -> Mesh:
    """Points (n, 3) as small spheres of a radius in metres; colours: sRGB (3,) or one a point (n, 3)."""
    points = np.asarray(points, dtype=float)
    vertices, faces, normals = geom.sphere(radius, segments)
    count = len(points)
    colours = np.broadcast_to(colours, (count, 3))
    return Mesh(
        (points[:, None] + vertices).reshape(-1, 3),
        (np.arange(count)[:, None, None] * len(vertices) + faces).reshape(-1, 3),
        np.repeat(colours, len(vertices), axis=0),
        np.tile(normals, (count, 1)),
    )


def link_mesh(hand: Hand, link: int) -> Mesh:
    """A link's geoms, and the bridges between its boxes, as one mesh in the link's frame."""
    mine, parts = np.flatnonzero(hand.geom_link == link), []
    for g in mine:
        shape = geom.triangles(hand.geom_kind[g], hand.geom_size[g], hand.geom_vertices[g], hand.geom_faces[g])
        parts.append((shape, hand.geom_position[g], hand.geom_rotation[g], hand.geom_rgba[g]))
    boxes = [g for g in mine if hand.geom_kind[g] == "box" and np.array_equal(hand.geom_rotation[g], np.eye(3))]
    for colour in np.unique(hand.geom_rgba[boxes], axis=0):
        same = [g for g in boxes if np.array_equal(hand.geom_rgba[g], colour)]
        for size, position in geom.bridges(hand.geom_size[same], hand.geom_position[same]):
            parts.append((geom.triangles("box", size), position, np.eye(3), colour))
    starts = np.cumsum([0] + [len(vertices) for (vertices, _, _), *_ in parts])
    return Mesh(
        np.concatenate([v @ turn.T + position for (v, _, _), position, turn, _ in parts]),
        np.concatenate([f + start for ((_, f, _), *_), start in zip(parts, starts, strict=False)]),
        np.concatenate([np.tile(colour[:3], (len(v), 1)) for (v, _, _), _, _, colour in parts]),
        np.concatenate([n @ turn.T for (_, _, n), _, turn, _ in parts]),
    )
