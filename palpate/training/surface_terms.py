"""Terms of the loss, beside the Chamfer distance, that keep a predicted surface smooth and whole.

They are the usual ones of mesh reconstruction. `edge_length` is the mean squared length of edges (Wang et al. 2018,
Pixel2Mesh, section 4). `normal_consistency` is the mean of 1 - cos of the angle between adjacent faces, 0 for a flat
sheet and 2 for a folded one (as PyTorch3D's `mesh_normal_consistency`). `joined` is the mean squared distance between
vertices of different charts that were one point of the initial sphere.
"""

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from palpate.charts import vision_atlas
from palpate.charts.graph import mesh_edges
from palpate.protocol import CHAMFER_SCALE


class SurfaceTerms:
    """The weighted sum of the terms, for the faces of one model.

    faces: (F, 3), of the charts that move. charts: whether they begin with the vision charts of the atlas, some of
    whose vertices are joined. weights: of the terms by name; lengths squared are multiplied by `CHAMFER_SCALE` as the
    Chamfer distance is, so that their weights have no unit.
    """

    def __init__(self, faces: Tensor, charts: bool, weights: Mapping[str, float]):
        from trimesh.graph import face_adjacency  # here: bpy must be imported before trimesh

        self.weights = {name: weight for name, weight in weights.items() if weight}
        self.faces = faces
        self.edges = torch.unique(mesh_edges(faces).sort(dim=1).values, dim=0)
        self.adjacent = torch.from_numpy(face_adjacency(faces.cpu().numpy()).copy()).to(faces.device)
        self.joined = vision_atlas().joined.to(faces.device) if charts else faces.new_zeros((0, 2))

    def __call__(self, vertices: Tensor) -> Tensor:
        """(B,) the sum for predicted vertices (B, V, 3), metres; in the unit of the Chamfer distance."""
        terms = {"edge_length": self.edge_length, "normal_consistency": self.normal_consistency, "joined": self.apart}
        return sum(weight * terms[name](vertices) for name, weight in self.weights.items())

    def edge_length(self, vertices: Tensor) -> Tensor:
        return CHAMFER_SCALE * _squared(vertices, self.edges).mean(dim=1)

    def apart(self, vertices: Tensor) -> Tensor:
        return CHAMFER_SCALE * _squared(vertices, self.joined).mean(dim=1) if len(self.joined) else 0.0

    def normal_consistency(self, vertices: Tensor) -> Tensor:
        corners = vertices[:, self.faces]
        normals = functional.normalize(
            torch.linalg.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]), dim=2
        )
        first, second = (normals[:, side] for side in self.adjacent.T)
        return (1 - (first * second).sum(dim=2)).mean(dim=1)


def _squared(vertices: Tensor, pairs: Tensor) -> Tensor:
    """(B, P) squared distances between the vertices of pairs (P, 2)."""
    return (vertices[:, pairs[:, 0]] - vertices[:, pairs[:, 1]]).square().sum(dim=2)
