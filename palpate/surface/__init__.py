"""Surface: points spread uniformly over the exterior of an object."""

import numpy as np
import trimesh

from palpate.surface.depth_maps import sample_by_depth_maps
from palpate.surface.embree import RayMesh
from palpate.surface.rays import sample_by_rays

METHODS = {"rays": sample_by_rays, "depth_maps": sample_by_depth_maps}


def sample(mesh: trimesh.Trimesh, count: int, rng: np.random.Generator, method: str = "rays") -> np.ndarray:
    """Points (count, 3) float64, in the mesh's frame and in random order, uniform by area on its exterior surface.

    Exterior is what a straight line reaches from outside, through openings too; the mesh may be open, non-manifold or
    flipped. Method "rays" tests each point for visibility; "depth_maps" is the paper's (Smith et al. 2018), six
    orthographic depth maps (docs/evidence/error_vs_runtime.md).

    Raises ValueError for an unknown method, a mesh without area, or one that is hidden nearly everywhere.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r} of sampling a surface: expected one of {', '.join(METHODS)}")
    return METHODS[method](RayMesh(mesh), count, rng)
