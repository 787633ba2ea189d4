"""Terms of a training step's loss, beside the Chamfer distance, that keep a predicted surface smooth and whole.

    ReconstructionLearner(data, experiment, settings, seed, extra_loss=SurfaceTerms(normal_consistency=0.1))

They are the usual ones of mesh reconstruction, of the charts (or the sphere) that move. What they change:
docs/evidence/training.md.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from palpate.charts import vision_atlas
from palpate.charts.graph import mesh_edges
from palpate.models import Reconstruction
from palpate.protocol import CHAMFER_SCALE


@dataclass(frozen=True)
class SurfaceTerms:
    """The weighted sum of the terms. Lengths squared are multiplied by `CHAMFER_SCALE`, as the Chamfer distance is.

    Attributes, weights without unit:
        edge_length: of the mean squared length of edges (Wang et al. 2018, Pixel2Mesh, section 4).
        normal_consistency: of the mean of 1 - cos of the angle between adjacent faces, 0 for a flat sheet and 2 for a
            folded one (as PyTorch3D's `mesh_normal_consistency`).
        joined: of the mean squared distance between vertices of different charts that were one point of the initial
            sphere; not for strategy `sphere`.
    """

    edge_length: float = 0.0
    normal_consistency: float = 0.0
    joined: float = 0.0

    def __call__(self, model: Reconstruction, vertices: Tensor) -> Tensor:
        """(B,) the sum for a model's predicted vertices (B, V, 3), metres; in the unit of the Chamfer distance."""
        sphere = model.experiment.strategy == "sphere"
        joined = None if sphere else vision_atlas().joined.to(vertices.device)
        return self.of_faces(vertices, model.moving_faces, joined)

    def of_faces(self, vertices: Tensor, faces: Tensor, joined: Tensor | None = None) -> Tensor:
        """The same for faces (F, 3), and pairs (J, 2) of vertices that were one point, if there are any."""
        total = vertices.new_zeros(len(vertices))
        if self.edge_length:
            edges = mesh_edges(faces).sort(dim=1).values.unique(dim=0)
            total = total + self.edge_length * CHAMFER_SCALE * _squared(vertices, edges).mean(dim=1)
        if self.normal_consistency:
            total = total + self.normal_consistency * normal_consistency(vertices, faces)
        if self.joined and joined is not None:
            total = total + self.joined * CHAMFER_SCALE * _squared(vertices, joined).mean(dim=1)
        return total


def normal_consistency(vertices: Tensor, faces: Tensor) -> Tensor:
    """(B,) mean of 1 - cos of the angle between faces (F, 3) that share an edge."""
    from trimesh.graph import face_adjacency  # here: bpy must be imported before trimesh

    adjacent = torch.from_numpy(face_adjacency(faces.cpu().numpy()).copy()).to(faces.device)
    corners = vertices[:, faces]
    sides = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    normals = functional.normalize(torch.linalg.cross(*sides), dim=2)
    one, other = (normals[:, side] for side in adjacent.T)
    return (1 - (one * other).sum(dim=2)).mean(dim=1)


def _squared(vertices: Tensor, pairs: Tensor) -> Tensor:
    """(B, P) squared distances between the vertices of pairs (P, 2)."""
    return (vertices[:, pairs[:, 0]] - vertices[:, pairs[:, 1]]).square().sum(dim=2)
