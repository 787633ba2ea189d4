"""The graph of charts, and the sum over neighbourhoods that its layers are made of.
The normalised adjacency is never formed: a sparse part, and the block between the touch charts' reference vertices and
all boundary vertices of vision charts, of rank two. docs/evidence/models.md has the times of other ways."""

from typing import Any, Literal, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from palpate.charts.atlas import TOUCH_VERTICES, chart_faces, sphere, touch_chart, vision_atlas

Kind = Literal["charts", "sphere"]


def mesh_edges(faces: Tensor) -> Tensor:
    """Sides (3 f, 2) of the faces (f, 3), those of two faces twice."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


class Graph(nn.Module):
    """Vertices of all charts and their neighbourhoods (paper, section 3): `vertices` of them, with `faces` (F, 3)
    int64.
    Vision charts are vertices 0 to 1823 as in `vision_atlas()`, touch chart t begins at 1824 + 81 t. Neighbours are the
    ends of a mesh edge within a chart, joined boundary vertices, and each touch chart's reference vertex with all 1152
    boundary vertices of vision charts. kind: `charts`; or `sphere`, the mesh `sphere()`. normalisation: `symmetric`,
    the paper's equation 1, or `mean`, as in the published code. Raises ValueError for others, or a negative number."""

    def __init__(self, touch_charts: int = 0, kind: Kind = "charts", normalisation: str = "symmetric"):
        super().__init__()
        if normalisation not in ("symmetric", "mean"):
            raise ValueError(f"normalisation {normalisation!r}; must be symmetric or mean")
        if kind not in ("charts", "sphere"):
            raise ValueError(f"graph of kind {kind!r}; must be charts or sphere")
        if touch_charts < 0:
            raise ValueError(f"{touch_charts} touch charts; must be 0 or more")
        self.kind, self.normalisation = kind, normalisation
        self.touch_charts = touch_charts if kind == "charts" else 0
        atlas = vision_atlas()
        if kind == "sphere":
            faces, edges = sphere()[1], mesh_edges(sphere()[1])
            self.vertices = len(sphere()[0])
        else:
            faces = chart_faces(self.touch_charts)
            edges = torch.cat([mesh_edges(faces), atlas.joined])
            self.vertices = len(atlas.vertices) + TOUCH_VERTICES * self.touch_charts
        reference = len(atlas.vertices) + touch_chart().centre + TOUCH_VERTICES * torch.arange(self.touch_charts)
        self.faces = nn.Buffer(faces, persistent=False)
        self.reference = nn.Buffer(reference, persistent=False)
        self.build_operator(edges, atlas.boundary)

    def build_operator(self, edges: Tensor, boundary: Tensor) -> None:
        """Buffers of the normalised adjacency: sorted rows of the sparse part, factors of the rest."""
        itself = torch.arange(self.vertices)[:, None].expand(-1, 2)
        keys = torch.cat([edges, edges.flip(1), itself]) @ torch.tensor([self.vertices, 1])
        row, neighbour = (keys := keys.unique()) // self.vertices, keys % self.vertices
        near = torch.bincount(row, minlength=self.vertices)  # Neighbours but for those by touch, and itself.
        start = torch.cat([torch.zeros(1, dtype=torch.int64), near.cumsum(0)])
        count = near.clone()  # |N_u| + 1
        if self.touch_charts:
            count[boundary] += self.touch_charts
            count[self.reference] += len(boundary)
        # Vertex v weighs out_u into_v in the sum of u.
        out = count.double().rsqrt() if self.normalisation == "symmetric" else count.double().reciprocal()
        into = out if self.normalisation == "symmetric" else torch.ones_like(out)
        weight, transposed = out[row] * into[neighbour], into[row] * out[neighbour]
        ends = torch.zeros(2 if self.touch_charts else 0, self.vertices, dtype=torch.float64)
        if self.touch_charts:
            ends[0, boundary] = ends[1, self.reference] = 1
        self._converted: dict[torch.dtype, tuple[Tensor, ...]] = {}
        self.neighbour = nn.Buffer(neighbour.int(), persistent=False)
        self.start = nn.Buffer(start.int(), persistent=False)
        self.weight = nn.Buffer(weight, persistent=False)
        self.transposed = nn.Buffer(transposed, persistent=False)
        self.left = nn.Buffer(ends * out, persistent=False)
        self.right = nn.Buffer(ends * into, persistent=False)

    def aggregate(self, x: Tensor, transpose: bool = False) -> Tensor:
        """The normalised sum over each vertex and its neighbours: `symmetric`, y_u = sum_v x_v / sqrt((|N_u| + 1)
        (|N_v| + 1)), or `mean`, y_u = sum_v x_v / (|N_u| + 1). x: (V, B, C) or (V, C), of any strides and floating
        type; so is the result. transpose: as for gradients. Raises ValueError if x does not have V rows."""
        if x.ndim < 2 or len(x) != self.vertices:
            raise ValueError(f"features of shape {tuple(x.shape)}; must be ({self.vertices}, ..., channels)")
        rows = x.reshape(self.vertices, -1).contiguous()
        weight, transposed, left, right = self._factors_as(x.dtype)
        if transpose:  # Neighbourhoods are mutual: the same neighbours.
            weight, left, right = transposed, right, left
        with torch.autocast(x.device.type, enabled=False):
            # Weighted sums of rows; on a CPU twice as fast as a product with a sparse CSR tensor.
            y = functional.embedding_bag(
                self.neighbour, rows, self.start, mode="sum", per_sample_weights=weight, include_last_offset=True
            )
            if len(left):
                y.addmm_(left.T, right.flip(0) @ rows)
        return y.view(x.shape)

    def _factors_as(self, dtype: torch.dtype) -> tuple[Tensor, ...]:
        """The factors of the sum in the type of the features, converted once."""
        if dtype not in self._converted:
            factors = self.weight, self.transposed, self.left, self.right
            with torch.inference_mode(False):  # kept for training, whatever the first use
                self._converted[dtype] = tuple(factor.to(dtype) for factor in factors)
        return self._converted[dtype]

    def _apply(self, *arguments: Any) -> Self:
        """Called where the module goes to another device or type."""
        self._converted.clear()
        return super()._apply(*arguments)
