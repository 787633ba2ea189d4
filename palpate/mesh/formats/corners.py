"""What several formats need: numbers of texts, and corners whose position, normal and colour have their own indices."""

import warnings

import numpy as np


def numbers(text: bytes) -> np.ndarray:
    """Numbers (n,) of a text that are separated by white space. Raises ValueError if one is none."""
    with warnings.catch_warnings(action="error", category=DeprecationWarning):
        try:
            return np.fromstring(text, sep=" ")
        except DeprecationWarning:
            raise ValueError("a word in it is not a number") from None


def distinct(*columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each distinct row of columns (n,) of non-negative integers first stands (m,), and the number among these
    of each row (n,): vertices are written once, however many corners are at them."""
    key = np.asarray(columns[0], dtype=np.int64)
    for column in columns[1:]:
        key = np.unique(key, return_inverse=True)[1] * (int(column.max(initial=0)) + 1) + column
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number


def usable_normals(normals: np.ndarray | None) -> np.ndarray | None:
    """Normals (n, 3) at length 1, or 0 where they have no direction (Blender computes these); None if none has one."""
    if normals is None or not np.isfinite(normals).all() or not normals.any():
        return None
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1)
