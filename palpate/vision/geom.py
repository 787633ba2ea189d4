"""What is drawn besides an object's file: coloured triangles, as plain arrays. Geoms of the hand have smooth normals;
their edges are rounded, inwards only."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.hand import Hand

# Radius of a box's or a cylinder's rounded edges: a share of the smallest half extent, at most so many metres.
BEVEL_SHARE, LARGEST_BEVEL = 0.5, 0.003
TOUCHING = 1e-6  # m
RECESS = 2e-4  # m that bridges stay below the boxes' sides: faces in one plane would shadow each other
EDGE_SEGMENTS = 3  # faces across a rounded edge, for each of the two sides that meet
ROUND_SEGMENTS = 10  # the same, for spheres, capsules and ellipsoids

Triangles = tuple[np.ndarray, np.ndarray, np.ndarray]


class Mesh(NamedTuple):
    """Triangles with colours, in the world."""

    vertices: np.ndarray  # (n, 3) metres
    faces: np.ndarray  # (f, 3) int
    # sRGB in 0..1: (3,), of vertices (n, 3) (blended over the faces), or of faces (f, 3).
    colours: np.ndarray | tuple[float, float, float] = (0.7, 0.7, 0.7)
    normals: np.ndarray | None = None  # (n, 3) for smooth shading; None keeps edges sharper than 30 degrees


def triangles(kind: str, size: ArrayLike, vertices: ArrayLike = (), faces: ArrayLike = ()) -> Triangles:
    """Vertices (n, 3), faces (f, 3) and unit normals (n, 3) of a geom in its own frame; kind and size as in
    `palpate.hand.Hand`; vertices (m, 3) and faces (k, 3): of a mesh."""
    size = np.asarray(size, dtype=float)
    if kind == "box":
        return rounded_box(size, bevel(size), EDGE_SEGMENTS)
    if kind in ("sphere", "capsule"):
        long = size[0] if kind == "sphere" else size[0] + size[1]
        return rounded_box(np.array([size[0], size[0], long]), size[0], ROUND_SEGMENTS)
    if kind == "ellipsoid":
        unit, sides, _ = rounded_box(np.ones(3), 1.0, ROUND_SEGMENTS)
        normals = unit / size
        return unit * size, sides, normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if kind == "cylinder":
        return rounded_cylinder(size[0], size[1], bevel(size[:2]), 48, EDGE_SEGMENTS)
    triples = np.asarray(faces)
    corners = np.asarray(vertices, dtype=float)[triples]  # every face flat, with its own vertices
    towards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), np.finfo(float).tiny)
    return corners.reshape(-1, 3), np.arange(triples.size).reshape(-1, 3), np.repeat(towards, 3, axis=0)


def bridges(sizes: np.ndarray, positions: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Boxes (half extents, position) that close the grooves between boxes which touch face to face, from the middle of
    one to that of the other, nearly as wide as both; sizes, positions: (n, 3) of n boxes with parallel axes."""
    made = []
    for pair in ([one, other] for one in range(len(sizes)) for other in range(one)):
        low, high = (positions[pair] - sizes[pair]).max(axis=0), (positions[pair] + sizes[pair]).min(axis=0)
        overlap = high - low
        touching = np.abs(overlap) < TOUCHING
        if touching.sum() == 1 and (overlap[~touching] > TOUCHING).all():
            ends = np.sort(positions[pair], axis=0)
            low = np.where(touching, ends[0], low + RECESS)
            high = np.where(touching, ends[1], high - RECESS)
            made.append(((high - low) / 2, (high + low) / 2))
    return made


def bevel(size: np.ndarray) -> float:
    """The radius of the rounded edges of a box or cylinder with these half extents."""
    return float(min(LARGEST_BEVEL, BEVEL_SHARE * size.min()))


def rounded_box(half_extents: np.ndarray, radius: float, segments: int) -> Triangles:
    """A box with edges and corners rounded with a radius; `segments` faces from a side to a corner's middle. Every side
    is a grid, dense over the roundings; the surface is the inner box, pushed outwards by the radius."""
    inner = np.asarray(half_extents, dtype=float) - radius
    angles = np.linspace(0, np.pi / 4, segments + 1)  # equal, across the rounding
    spread = np.array([math.tan(angle) for angle in angles])
    ticks = np.concatenate([-spread[::-1], spread])
    signs = np.repeat([-1.0, 1.0], segments + 1)
    first, second = (grid.ravel() for grid in np.meshgrid(ticks, ticks, indexing="ij"))
    sign_first, sign_second = (grid.ravel() for grid in np.meshgrid(signs, signs, indexing="ij"))
    ones = np.ones_like(first)
    towards, corner = np.stack([ones, first, second], 1), np.stack([ones, sign_first, sign_second], 1)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    square = _grid_faces(len(ticks), len(ticks))

    vertices: list[np.ndarray] = []
    normals, faces = [], []
    for axis in range(3):
        order = np.argsort([axis, (axis + 1) % 3, (axis + 2) % 3])
        for side in (1.0, -1.0):
            flip = np.array([side, 1.0, 1.0])
            normal, anchor = (towards * flip)[:, order], (corner * flip)[:, order]
            faces.append((square if side > 0 else square[:, ::-1]) + len(vertices) * len(towards))
            vertices.append(anchor * inner + radius * normal)
            normals.append(normal)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals)


def rounded_cylinder(radius: float, half_length: float, edge: float, sectors: int, segments: int) -> Triangles:
    """A cylinder about z whose two rims are rounded with radius `edge`."""
    angle = np.linspace(0, np.pi / 2, 2 * segments + 1)
    # The profile from the middle of the bottom to that of the top: distance from the axis, height, normal.
    out, up = np.cos(angle[::-1]), np.sin(angle[::-1])
    rim = np.stack([radius - edge + edge * out, half_length - edge + edge * up, out, up], axis=1)[::-1]
    top = np.concatenate([rim, [[0, half_length, 0, 1]]])
    profile = np.concatenate([top[::-1] * [1, -1, 1, -1], top])
    turn = np.linspace(0, 2 * np.pi, sectors + 1)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    distance, height, outwards, upwards = profile.T
    ones = np.ones_like(cosine)
    vertices = np.stack([cosine * distance, sine * distance, ones * height], axis=-1).reshape(-1, 3)
    normals = np.stack([cosine * outwards, sine * outwards, ones * upwards], axis=-1).reshape(-1, 3)
    return vertices, _grid_faces(len(turn), len(profile)), normals


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles (f, 3) of a grid of vertices stored row by row."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.stack([corner, corner + columns, corner + columns + 1, corner + 1], axis=1)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def spheres(points: np.ndarray, radius: float, colours: ArrayLike = (0.8, 0.1, 0.1), segments: int = 4) -> Mesh:
    """Points (n, 3) as small spheres of a radius in metres; colours: sRGB (3,) or one a point (n, 3)."""
    points = np.asarray(points, dtype=float)
    vertices, faces, normals = rounded_box(np.full(3, radius), radius, segments)
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
        shape = triangles(hand.geom_kind[g], hand.geom_size[g], hand.geom_vertices[g], hand.geom_faces[g])
        parts.append((shape, hand.geom_position[g], hand.geom_rotation[g], hand.geom_rgba[g]))
    boxes = [g for g in mine if hand.geom_kind[g] == "box" and np.array_equal(hand.geom_rotation[g], np.eye(3))]
    for colour in np.unique(hand.geom_rgba[boxes], axis=0):
        same = [g for g in boxes if np.array_equal(hand.geom_rgba[g], colour)]
        for size, position in bridges(hand.geom_size[same], hand.geom_position[same]):
            parts.append((triangles("box", size), position, np.eye(3), colour))
    starts = np.cumsum([0] + [len(vertices) for (vertices, _, _), *_ in parts])
    return Mesh(
        np.concatenate([v @ turn.T + position for (v, _, _), position, turn, _ in parts]),
        np.concatenate([f + start for ((_, f, _), *_), start in zip(parts, starts, strict=False)]),
        np.concatenate([np.tile(colour[:3], (len(v), 1)) for (v, _, _), _, _, colour in parts]),
        np.concatenate([n @ turn.T for (_, _, n), _, turn, _ in parts]),
    )
