"""Published networks from a single image to a shape, to compare with: a point set, a deformed sphere, voxels.
`psg` is PSG (Fan et al. 2017, "A Point Set Generation Network"), `pixel2mesh` Pixel2Mesh (Wang et al. 2018), and `r2n2`
the encoder and decoder of 3D-R2N2 (Choy et al. 2016). They have the image encoder of `Reconstruction` and the published
losses; validation is by Chamfer distance. docs/single_image.md says what else differs."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from math import prod

import igl
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from palpate.architectures import ATLAS_RADIUS, Architecture, required
from palpate.charts.atlas import resized, sphere
from palpate.charts.chamfer import nearest, one_sided_distance
from palpate.charts.graph import Graph, mesh_edges
from palpate.charts.sample import sample_faces
from palpate.mesh import OBJECT_POSITION
from palpate.models.encoder import KERNEL, ImageEncoder
from palpate.models.gcn import GraphNetwork
from palpate.models.losses import CELL, GRID, Target, cloud_loss, subsample
from palpate.models.pooling import pool, relative_camera
from palpate.protocol import CHAMFER_SCALE, PIXEL2MESH_SCALE
from palpate.sensor import DIGIT

CODE_CELLS = 4  # an image becomes one vector from its last map, averaged onto 4 x 4 cells whatever its size
SLOPE = 0.1  # of 3D-R2N2's leaky ReLUs
BASE = 4  # cells along an edge of the voxel grid that the decoder begins with
# Weights of Pixel2Mesh's loss, relative to the Chamfer distance (Wang et al. 2018, section 4). Lengths squared are
# weighed alike whatever their unit; the normal term has none, and its weight is for lengths at the published scale.
LAPLACIAN, EDGE = 0.3, 0.1
NORMAL = 1.6e-4 / PIXEL2MESH_SCALE**2  # m^2


class SingleImageModel(nn.Module, ABC):
    """From one view to a shape. radius: m, of the sphere around all objects; relative_size: of it to the paper's."""

    hand_sensors, sensor = None, DIGIT  # of touches, which none takes

    def __init__(self, architecture: Architecture):
        super().__init__()
        self.encoder = ImageEncoder(required(architecture.encoder, "encoder"))
        self.architecture, self.radius = architecture, architecture.radius
        self.relative_size = self.radius / ATLAS_RADIUS
        self.centre = nn.Buffer(torch.tensor(OBJECT_POSITION, dtype=torch.float64), persistent=False)

    def forward(self, batch: Mapping[str, Tensor]) -> Tensor:
        """The prediction (B, ...), as `stages` describes it. batch: `image` (B, 3, S, S) in [0, 1], and `camera`
        (B, 3, 4) from the world (m) to homogeneous pixels. Raises ValueError for another shape, or a small image."""
        return self.stages(batch)[-1]

    def maps(self, batch: Mapping[str, Tensor]) -> list[Tensor]:
        """The encoder's maps of the images; raises what `forward` raises."""
        image, camera = (tuple(getattr(batch.get(key), "shape", ())) for key in ("image", "camera"))
        if len(image) != 4 or image[1] != 3 or image[2] != image[3]:
            raise ValueError(f"image has shape {image}, expected (B, 3, S, S)")
        if camera != (image[0], 3, 4):
            raise ValueError(f"camera has shape {camera}, expected ({image[0]}, 3, 4)")
        self.encoder.sizes(image[-1])
        return self.encoder(batch["image"])

    @abstractmethod
    def stages(self, batch: Mapping[str, Tensor]) -> list[Tensor]:
        """Every prediction (B, ...) that the training's loss looks at, the last being that of `forward`."""

    @abstractmethod
    def loss(self, stages: Sequence[Tensor], target: Target) -> Tensor:
        """The loss (B,) of a training step, of what `stages` gives."""

    @abstractmethod
    def mesh(self, prediction: Tensor) -> tuple[Tensor, Tensor]:
        """One sample's prediction as a mesh: vertices (V, 3) m, world frame, and faces (F, 3) int64."""

    def meshes(self, batch: Mapping[str, Tensor], closed: bool = False) -> list[tuple[Tensor, Tensor]]:
        """What is predicted of each sample, as a mesh. `closed` changes nothing: see `Reconstruction.meshes`."""
        return [self.mesh(prediction) for prediction in self(batch).float()]

    def sample(
        self, prediction: Tensor, batch: Mapping[str, Tensor], n: int, generator: torch.Generator | None = None
    ) -> Tensor:
        """Points (B, n, 3) m, world frame, of predictions (B, ...): uniform by area on the mesh of each. The batch
        changes nothing: see `Reconstruction.sample`."""
        meshes = [self.mesh(sample) for sample in prediction]
        return torch.cat([sample_faces(vertices[None], faces, n, generator) for vertices, faces in meshes])


class PointSet(SingleImageModel):
    """PSG with two branches (its section 4.1): a fully connected one, and one of deconvolutions, from the encoder's
    last pooled map back to its first, each adding the pooled map of its size. Every cell of the last one gives a point.
    Points are in the view's frame. The decoder has the connected layer's width, `hidden`, and `points`."""

    def __init__(self, architecture: Architecture):
        super().__init__(architecture)
        steps = [prod(self.encoder.strides[:number]) for number in self.encoder.pool]
        if self.encoder.padding != 1 or any(after != 2 * before for before, after in pairwise(steps)):
            raise ValueError(
                "psg: each pooled map must be half as wide as the one before: set the encoder's padding to 1, and pool "
                "to one layer of each of its last blocks"
            )
        decoder, widths = required(architecture.decoder, "decoder"), self.encoder.channels[::-1]
        self.code = image_code(widths[0], decoder.hidden)
        self.points = nn.Linear(decoder.hidden, 3 * required(decoder.points, "decoder.points"))
        pairs = list(pairwise(widths))
        self.up = nn.ModuleList(nn.ConvTranspose2d(deep, flat, KERNEL, stride=2, padding=1) for deep, flat in pairs)
        self.skip = nn.ModuleList(nn.Conv2d(flat, flat, KERNEL, padding=1) for _, flat in pairs)
        self.mix = nn.ModuleList(nn.Conv2d(flat, flat, KERNEL, padding=1) for _, flat in pairs)
        self.cells = nn.Conv2d(widths[-1], 3, KERNEL, padding=1)

    def stages(self, batch: Mapping[str, Tensor]) -> list[Tensor]:
        """The points (B, N, 3) m, world frame."""
        *maps, x = self.maps(batch)
        code_points = self.points(self.code(x)).unflatten(1, (-1, 3))
        for up, skip, mix, features in zip(self.up, self.skip, self.mix, maps[::-1], strict=True):
            x = torch.relu(up(x, output_size=features.shape[2:]) + skip(features))
            x = torch.relu(mix(x))
        cell_points = self.cells(x).flatten(2).transpose(1, 2)
        seen = torch.cat([code_points, cell_points], dim=1).to(batch["camera"].dtype)
        return [self.radius * seen @ view_axes(batch["camera"]) + self.centre.to(seen.dtype)]

    def loss(self, stages: Sequence[Tensor], target: Target) -> Tensor:
        return cloud_loss(stages[-1], target)

    def mesh(self, prediction: Tensor) -> tuple[Tensor, Tensor]:
        return prediction, torch.empty(0, 3, dtype=torch.int64, device=prediction.device)

    def sample(
        self, prediction: Tensor, batch: Mapping[str, Tensor], n: int, generator: torch.Generator | None = None
    ) -> Tensor:
        """The predicted points as they are, whatever n: there is no surface to sample."""
        return prediction


class DeformedSphere(SingleImageModel):
    """Pixel2Mesh without unpooling: a sphere deformed in `deformations` blocks with weights of their own. Each moves
    vertices by the image's features at them and their positions. faces: (2304, 3) int64; edges: (E, 2), each once."""

    def __init__(self, architecture: Architecture):
        super().__init__(architecture)
        vertices, faces = sphere()
        self.start = nn.Buffer(resized(vertices, self.radius), persistent=False)
        self.faces = nn.Buffer(faces.clone(), persistent=False)
        self.edges = nn.Buffer(mesh_edges(faces).sort(dim=1).values.unique(dim=0), persistent=False)
        self.graph = Graph(0, "sphere")
        features, gcn = sum(self.encoder.channels) + 3, required(architecture.gcn, "gcn")
        self.blocks = nn.ModuleList(
            GraphNetwork(features, gcn, architecture.init, architecture.last_layer_scale)
            for _ in range(architecture.deformations)
        )

    def stages(self, batch: Mapping[str, Tensor]) -> list[Tensor]:
        """The vertices (B, V, 3) m, world frame, after each block."""
        maps, image = self.maps(batch), batch["image"]
        camera = relative_camera(batch["camera"].to(image.dtype), image.shape[-1])
        positions = self.start[:, None].expand(-1, len(image), -1)
        stages = []
        for block in self.blocks:
            pooled = pool(maps, positions, camera)
            places = (positions - self.centre.to(positions.dtype)) / self.radius
            positions = positions + self.radius * block(torch.cat([pooled, places], dim=-1), self.graph)
            stages.append(positions.transpose(0, 1))
        return stages

    def loss(self, stages: Sequence[Tensor], target: Target) -> Tensor:
        """Pixel2Mesh's loss, the mean over its blocks (the publication: the sum), each of means, as in the published
        code: the Chamfer distance between vertices and true points, the edges' squared length, the change of Laplacian
        coordinates, and how far edges are from tangential at the nearest true point."""
        truth, objects, n, generator = target
        clouds = [truth.points[number] for number in objects]
        trees, normals = truth.trees(objects), [truth.normals(number) for number in objects]
        before = self.start.to(truth.points.dtype).expand(len(objects), -1, -1)
        total = truth.points.new_zeros(len(objects))
        for vertices in stages:
            vertices = vertices.to(truth.points.dtype)
            index = list(map(nearest, vertices, clouds, trees or [None] * len(clouds)))
            met = torch.stack([cloud[rows] for cloud, rows in zip(clouds, index, strict=True)])
            there = (vertices - met).square().sum(dim=2).mean(dim=1)
            back = one_sided_distance([subsample(cloud, n, generator) for cloud in clouds], vertices)
            edges = vertices[:, self.edges[:, 0]] - vertices[:, self.edges[:, 1]]
            change = laplacian(vertices - before, self.edges)  # the coordinates are linear in the vertices
            normal = torch.stack([of_cloud[rows] for of_cloud, rows in zip(normals, index, strict=True)])
            total = (
                total
                + (there + back)
                + EDGE * edges.square().sum(dim=2).mean(dim=1)
                + LAPLACIAN * change.square().sum(dim=2).mean(dim=1)
                + NORMAL * mean_cosine(edges, normal, self.edges)
            )
            before = vertices
        return CHAMFER_SCALE * total / len(stages)

    def mesh(self, prediction: Tensor) -> tuple[Tensor, Tensor]:
        return prediction, self.faces


class Voxels(SingleImageModel):
    """3D-R2N2's encoder and decoder on one view: the image as a vector, a grid of 4^3 cells, deconvolutions to 32^3.
    The grid is a cube around the object, along the world's axes. The decoder has `hidden`, the vector's length,
    `channels` of the grids of 4, 8, 16 and 32 cells an edge, and `level`, the surface's probability."""

    def __init__(self, architecture: Architecture):
        super().__init__(architecture)
        decoder = required(architecture.decoder, "decoder")
        channels, self.level = required(decoder.channels, "decoder.channels"), required(decoder.level, "decoder.level")
        if BASE << (len(channels) - 1) != GRID:
            raise ValueError(f"decoder: channels {list(channels)} must be of grids of 4, 8, 16 and 32 cells an edge")
        self.code = image_code(self.encoder.channels[-1], decoder.hidden)
        self.base = nn.Linear(decoder.hidden, channels[0] * BASE**3)
        self.up = nn.ModuleList(
            nn.ConvTranspose3d(coarse, fine, 4, stride=2, padding=1) for coarse, fine in pairwise(channels)
        )
        # With stride 1 the transposed convolution is a convolution, and on a processor 20 times as fast as torch's.
        self.cells = nn.ConvTranspose3d(channels[-1], 1, KERNEL, padding=1)

    def stages(self, batch: Mapping[str, Tensor]) -> list[Tensor]:
        """(B, 32, 32, 32), along x, y, z: log-odds that a cell is occupied."""
        x = self.base(self.code(self.maps(batch)[-1])).unflatten(1, (-1, BASE, BASE, BASE))
        for up in self.up:
            x = functional.leaky_relu(up(functional.leaky_relu(x, SLOPE)), SLOPE)
        return [self.cells(x)[:, 0]]

    def loss(self, stages: Sequence[Tensor], target: Target) -> Tensor:
        """Mean cross entropy of the cells, in nats; the true cells are those of all surface points."""
        odds = stages[-1].to(target.truth.points.dtype)
        cells = [target.truth.occupied(number, self.relative_size) for number in target.objects]
        there = torch.stack(cells).to(odds.dtype)
        return functional.binary_cross_entropy_with_logits(odds, there, reduction="none").mean(dim=(1, 2, 3))

    def mesh(self, prediction: Tensor) -> tuple[Tensor, Tensor]:
        """The surface at `level`; at half the greatest probability if no cell reaches it."""
        probability = prediction.detach().double().sigmoid().cpu().numpy()
        greatest = probability.max()
        level = self.level if greatest > self.level else greatest / 2
        vertices, faces = grid_surface(probability, level, CELL * self.relative_size)
        return torch.from_numpy(vertices).to(prediction), torch.from_numpy(faces).to(prediction.device)


def image_code(channels: int, hidden: int) -> nn.Sequential:
    """(B, channels, h, w) to (B, hidden)."""
    layer = nn.Sequential(nn.Linear(channels * CODE_CELLS**2, hidden), nn.ReLU())
    return nn.Sequential(nn.AdaptiveAvgPool2d(CODE_CELLS), nn.Flatten(), layer)


def view_axes(camera: Tensor) -> Tensor:
    """The axes of views in the world, right, down and forward: rows of (B, 3, 3). camera: (B, 3, 4) to pixels."""
    forward = functional.normalize(camera[:, 2, :3], dim=1)
    across = camera[:, 0, :3]
    right = functional.normalize(across - (across * forward).sum(dim=1, keepdim=True) * forward, dim=1)
    return torch.stack([right, torch.linalg.cross(forward, right), forward], dim=1)


def laplacian(vertices: Tensor, edges: Tensor) -> Tensor:
    """Laplacian coordinates (B, V, 3): each vertex less the mean of its neighbours. edges: (E, 2), each once."""
    ends, others = torch.cat([edges, edges.flip(1)]).T
    count = torch.bincount(ends, minlength=vertices.shape[1]).to(vertices.dtype)
    return vertices - torch.zeros_like(vertices).index_add(1, ends, vertices[:, others]) / count[:, None]


def mean_cosine(edges: Tensor, normals: Tensor, ends: Tensor) -> Tensor:
    """(B,) mean absolute cosine between each edge (B, E, 3) and the normals (B, V, 3) at its two ends (E, 2)."""
    unit = functional.normalize(edges, dim=2)
    return torch.stack([(unit * normals[:, end]).sum(dim=2).abs() for end in ends.T]).mean(dim=(0, 2))


def grid_surface(values: np.ndarray, level: float, cell: float = CELL) -> tuple[np.ndarray, np.ndarray]:
    """The surface where values (n, n, n), on a grid around the object, equal a level, by marching cubes; beyond the
    grid values are 0. cell: m, from value to value. Returns vertices (V, 3) float64 m, world frame, and faces (F, 3),
    counterclockwise from outside."""
    padded = np.pad(values.astype(np.float64), 1)
    count = len(padded)
    vertices, faces, _ = igl.marching_cubes(
        padded.transpose(2, 1, 0).ravel(), _grid(count, cell), count, count, count, level
    )
    return vertices, faces[:, ::-1].copy()


@lru_cache(maxsize=1)
def _grid(count: int, cell: float) -> np.ndarray:
    """Places (count^3, 3) m, world frame, of a grid of so many values along an edge, in libigl's order: x fastest."""
    line = (np.arange(count) - (count - 1) / 2) * cell
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3) + OBJECT_POSITION


SINGLE_IMAGE_MODELS: dict[str, type[SingleImageModel]] = {"psg": PointSet, "pixel2mesh": DeformedSphere, "r2n2": Voxels}
