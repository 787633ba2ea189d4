"""A bumpy object, and sensors in front of it."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation


def lumpy() -> trimesh.Trimesh:
    """A bumpy closed surface about 0.1 m wide: 1280 faces."""
    made = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    x, y, z = 100 * made.vertices.T
    made.vertices *= 1 + 0.1 * (np.sin(3 * x) * np.sin(4 * y + 1) * np.cos(3 * z))[:, None]
    return made


def poses(made: trimesh.Trimesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Sensors whose planes are 15 mm in front of random spots, tilted at random."""
    points, face = trimesh.sample.sample_surface(made, count, seed=1)
    tilt = Rotation.from_rotvec(0.3 * np.random.default_rng(1).standard_normal((count, 3)))
    x = tilt.apply(-made.face_normals[face])
    z = np.cross(x, [0.3, 0.5, 0.8])
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return points - 0.015 * x, np.stack([x, np.cross(z, x), z], axis=2)
