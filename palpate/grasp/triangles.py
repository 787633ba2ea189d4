"""Triangles cut small: what patches and the penetration check are made of."""

import numpy as np


def edge_lengths(triangles: np.ndarray) -> np.ndarray:
    """Lengths (T, 3) of the edges of triangles (T, 3, 3); edge i goes from corner i to the next."""
    return np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)


def halved(triangles: np.ndarray) -> np.ndarray:
    """Triangles (T, 3, 3) cut in two at the middle of their longest edges: (2 T, 3, 3), winding kept."""
    at, rows = edge_lengths(triangles).argmax(axis=1), np.arange(len(triangles))
    start, end, tip = (triangles[rows, (at + shift) % 3] for shift in range(3))
    middle = (start + end) / 2
    return np.concatenate([np.stack([start, middle, tip], axis=1), np.stack([middle, end, tip], axis=1)])


def split_long_edges(triangles: np.ndarray, longest: float) -> np.ndarray:
    """Halve triangles (T, 3, 3) until no edge exceeds `longest`. Returns (S, 3, 3).

    The pieces cover the same surface; neighbours need not share vertices.
    """
    done = []
    while len(triangles):
        fits = edge_lengths(triangles).max(axis=1) <= longest
        done.append(triangles[fits])
        triangles = halved(triangles[~fits])
    return np.concatenate(done) if done else triangles
