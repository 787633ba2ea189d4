"""Corners of faces whose position, normal and texture coordinate have indices of their own."""

import numpy as np


def distinct(*columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each distinct row of columns (n,) of non-negative integers first stands (m,), and the number among these
    of each row (n,): vertices are written once, however many corners are at them."""
    key = np.asarray(columns[0], dtype=np.int64)
    for column in columns[1:]:
        key = np.unique(key, return_inverse=True)[1] * (int(column.max(initial=0)) + 1) + column
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number


def usable_normals(normals: np.ndarray | None) -> np.ndarray | None:
    """Normals (n, 3) at length 1; None if one of them has no direction."""
    if normals is None:
        return None
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / length if np.isfinite(length).all() and (length > 0).all() else None
