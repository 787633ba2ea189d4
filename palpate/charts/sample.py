"""Points on meshes, uniform by area and differentiable in the vertices."""

import torch
from torch import Tensor

ROUNDING = 8 * torch.finfo(torch.float64).eps  # of a product of two sides, in shares of it


def face_areas(corners: Tensor) -> Tensor:
    """Areas (...) of faces with corners (..., 3, 3), in double precision; 0 for lines and points. Products of single
    precision are lost on a mesh below 1e-19 m, and on long slivers."""
    first, second, third = corners.double().unbind(dim=-2)
    one, other = second - first, third - first
    areas = torch.linalg.cross(one, other).norm(dim=-1)
    # What rounding leaves of the product of parallel sides is no area.
    areas[areas <= ROUNDING * one.norm(dim=-1) * other.norm(dim=-1)] = 0
    return areas / 2


def sample_faces(
    vertices: Tensor,
    faces: Tensor,
    n: int,
    generator: torch.Generator | None = None,
    shown: Tensor | None = None,
) -> Tensor:
    """Random points (B, n, 3) on each mesh of a batch, uniform by area (Osada et al. 2002, "Shape Distributions"). They
    move with the corners of their faces (Smith et al. 2019, GEOMetrics). A face without area is never chosen. vertices:
    (B, V, 3). faces: (F, 3), of all meshes. generator: on the CPU or the vertices' device; None: the default one.
    shown: (B, F) bool, the faces that each mesh has; None: all. Raises ValueError if a vertex is NaN or infinite, or a
    mesh has no area."""
    corners = vertices[:, faces]  # (B, F, 3, 3)
    with torch.no_grad():
        areas = face_areas(corners.detach())
        if shown is not None:
            areas = areas * shown
        reached = areas.cumsum(dim=1)
        total = reached[:, -1:]
        if not torch.isfinite(total).all():
            raise ValueError("vertices are NaN or infinite: no points can be sampled on their faces")
        if not (total > 0).all():
            raise ValueError("all faces of a mesh have zero area: no points can be sampled on it")
        device = generator.device if generator is not None else vertices.device
        draw = torch.rand(3, len(vertices), n, dtype=torch.float64, device=device, generator=generator)
        draw = draw.to(vertices.device)
        # The first face at which the areas so far exceed the draw; rounding must not lead past the last one.
        face = torch.searchsorted(reached, draw[0] * total, right=True)
        face = torch.minimum(face, (reached < total).sum(dim=1, keepdim=True))
        root = draw[1].sqrt()
        weights = torch.stack([1 - root, root * (1 - draw[2]), root * draw[2]], dim=2).to(vertices.dtype)
    chosen = faces[face]  # (B, n, 3)
    picked = vertices.gather(1, chosen.flatten(1)[..., None].expand(-1, -1, 3)).unflatten(1, (n, 3))
    return (picked * weights[..., None]).sum(dim=2)
