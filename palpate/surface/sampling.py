"""Points on the exterior surface of a mesh, by either of two methods."""

import numpy as np
import trimesh

from palpate.surface.depth_maps import sample_by_depth_maps
from palpate.surface.embree import RayMesh
from palpate.surface.rays import sample_by_rays

METHODS = {"rays": sample_by_rays, "depth_maps": sample_by_depth_maps}


def sample(mesh: trimesh.Trimesh, count: int, rng: np.random.Generator, method: str = "rays") -> np.ndarray:
    """Points uniform by area on the exterior surface: what is seen from outside in a straight line.

    Parts hidden inside, sealed cavities and the touching faces of adjoining shells get none; the inside of an
    open vessel gets points as far as it is seen through the opening. Open, non-manifold and flipped meshes
    are fine.

    Args:
        mesh: in any frame.
        count: number of points.
        rng: the only source of randomness.
        method: "rays" tests each point for visibility; "depth_maps" is the paper's (Smith et al. 2018), six
            orthographic depth maps. docs/surface.md compares the two.

    Returns:
        (count, 3) float64, in the mesh's frame, in random order.

    Raises ValueError for an unknown method, a mesh without area, or one that is hidden nearly everywhere.
    """
    if method not in METHODS:
        expected = ", ".join(METHODS)
        raise ValueError(f"unknown method {method!r} of sampling a surface: expected one of {expected}")
    return METHODS[method](RayMesh(mesh), count, rng)
