"""Strategy `implicit`: a signed distance decoded at any point from the image, its code and touch, and its surface.

In the manner of Park et al. 2019 (DeepSDF) and of Saito et al. 2019 (PIFu): image features where the point projects.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import igl
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from palpate.architectures import Architecture
from palpate.experiments import Correction, Experiment
from palpate.models.kriging import Kriging, touched_points
from palpate.models.layers import LinearBlock
from palpate.models.pooling import ImageProducts, map_products, pool_products, relative_camera
from palpate.models.single_image import SingleImageModel, grid_surface
from palpate.models.touch import Touches, TouchPooling, touches_of
from palpate.sensor import DIGIT, Sensor

CLAMP = 0.05  # m, for objects of one size: farther from the surface distances are not told apart
OCTAVES = 4  # of sines and cosines of a point's position
LEVEL = 1e-3  # m: where the surface is drawn. Thin blades are lost at 0.
COARSE, DOUBLINGS = 16, 2  # cells along an edge of the first grid, and how often it is refined near the surface
LEAST = 1e-6  # m, by which a value inside differs from the level
LOOSE = 0.02  # of the largest component's area: smaller ones are left out. More would cut thin blades.
MARGIN = 1.25  # cells of the finer grid, from the surface by the coarser one: there the finer is computed
MOST = 150_000  # points that a grid is refined at: twice what objects take
CHUNK = 8192  # points that are decoded together: their features stay in the cache
MASK = 64  # pixels along an edge of the masks that the encoder learns beside


class Field(NamedTuple):
    """What the distance of one sample depends on.

    products: maps times weights, of one image, seen by the camera (1, 3, 4). code: (width,).
    """

    products: ImageProducts
    camera: Tensor
    code: Tensor
    touches: Touches | None


class Implicit(SingleImageModel):
    """The signed distance (m, negative inside) of points, from one image and any number of touches.

    The first layer's inputs are image features at a point's projection, a code of the whole image (mean and greatest
    of the last map), the point's position with four octaves of sines, and features of the nearest touches
    (`TouchPooling`). `decoder.layers` residual layers of `decoder.hidden` follow.
    """

    def __init__(self, experiment: Experiment, architecture: Architecture, hand_sensors: int, sensor: Sensor = DIGIT):
        super().__init__(architecture)
        self.experiment, self.hand_sensors, self.sensor = experiment, hand_sensors, sensor
        self.sensors = hand_sensors * experiment.grasps if experiment.touch else 0
        self.shows_touch = False
        options, width = architecture.decoder, architecture.decoder.hidden
        features = sum(self.encoder.channels)
        self.image_weight = nn.Parameter(torch.randn(features, width) * (2 / features) ** 0.5)
        self.code = nn.Sequential(LinearBlock(2 * self.encoder.channels[-1], width), nn.Linear(width, width))
        self.place = nn.Linear(3 + 6 * OCTAVES, width)
        if experiment.touch:
            self.touch_pooling = TouchPooling(width, sensor)
        self.layers = nn.ModuleList(nn.Linear(width, width) for _ in range(options.layers))
        self.distance = nn.Linear(width, 1)
        nn.init.normal_(self.distance.weight, std=0.01)  # so that it begins near 0, where the loss has a gradient
        # Which pixels show the object, and which would if the hand were not there.
        self.masks = nn.ModuleList(nn.Conv2d(channels, 2, 1) for channels in self.encoder.channels)

    def fields(self, batch: Mapping[str, Tensor], maps: list[Tensor]) -> list[Field]:
        """Of each sample of a batch as `Reconstruction` takes it; touches may be fewer than the model's, or none."""
        camera = relative_camera(batch["camera"].to(batch["image"].dtype), batch["image"].shape[-1])
        code = self.code(torch.cat([maps[-1].mean(dim=(2, 3)), maps[-1].amax(dim=(2, 3))], dim=1))
        touches = touches_of(batch) if self.experiment.touch else [None] * len(code)
        products = [map_products([each[k : k + 1] for each in maps], self.image_weight) for k in range(len(code))]
        return [Field(products[k], camera[k : k + 1], code[k], touches[k]) for k in range(len(code))]

    def decode(self, field: Field, points: Tensor) -> Tensor:
        """Signed distances (V,) m of points (V, 3), world frame."""
        place = (points - self.centre.to(points.dtype)) / self.radius
        angles = torch.cat([place * (torch.pi * 2**octave) for octave in range(OCTAVES)], dim=1)
        x = self.place(torch.cat([place, angles.sin(), angles.cos()], dim=1)) + field.code
        x = x + pool_products(field.products, points[:, None], field.camera)[:, 0]
        if field.touches is not None:
            x = x + self.touch_pooling([field.touches], points[:, None])[:, 0]
        for layer in self.layers:
            x = x + layer(torch.relu(x))
        return self.clamp * self.distance(torch.relu(x))[:, 0]

    @property
    def clamp(self) -> float:
        """m, the distance that those of training are clamped to."""
        return CLAMP * self.relative_size

    def supervised(self, batch: Mapping[str, Tensor], points: Tensor) -> tuple[Tensor, Tensor]:
        """What a training step looks at: distances (B, n) m of points (B, n, 3), and log-odds of the two masks
        (B, 2, 64, 64): the object as if it were alone, and what is seen of it."""
        maps = self.maps(batch)
        distances = [self.decode(field, each) for field, each in zip(self.fields(batch, maps), points, strict=True)]
        odds = [
            functional.interpolate(head(features), (MASK, MASK), mode="bilinear")
            for head, features in zip(self.masks, maps, strict=True)
        ]
        return torch.stack(distances), torch.stack(odds).sum(dim=0)

    def stages(self, batch):
        """(B, n, n, n) signed distances (m) along x, y, z on a grid around the object, exact near the surface.

        With a correction, the surface passes through the touched points but for its noise: there it has `LEVEL`.
        """
        fields, correction = self.fields(batch, self.maps(batch)), self.experiment.correction
        level = LEVEL * self.relative_size
        touched = touched_points(batch) if correction and self.experiment.touch else [()] * len(fields)
        grids = []
        for field, points in zip(fields, touched, strict=True):
            decode = partial(self.decode, field)
            distance = corrected(decode, points, correction, level) if len(points) else decode
            grids.append(self._grid(distance, field.code))
        return [torch.stack(grids)]

    def _grid(self, distance: Callable[[Tensor], Tensor], like: Tensor) -> Tensor:
        """From a coarse grid to a fine one: computed where the coarser says that the surface may be, interpolated
        elsewhere."""
        values = like.new_zeros((COARSE + 1,) * 3)
        near = torch.ones_like(values, dtype=torch.bool)
        for doubling in range(DOUBLINGS + 1):
            cells = COARSE << doubling
            if doubling:
                size = (cells + 1,) * 3
                values = functional.interpolate(values[None, None], size, mode="trilinear", align_corners=True)[0, 0]
                distances = values.abs()
                near = distances < MARGIN * self.edge / cells
                if near.sum() > MOST:  # of a model that knows nothing yet
                    near = distances < distances.flatten().kthvalue(MOST).values
            for index in near.nonzero().split(CHUNK) if near.any() else ():
                places = (index.to(values.dtype) / cells - 0.5) * self.edge + self.centre.to(values.dtype)
                # Objects lie in the sphere, and nothing outside of it is learnt.
                beyond = (places - self.centre.to(values.dtype)).norm(dim=1) - self.radius
                values[index.unbind(1)] = torch.maximum(distance(places), beyond)
        return values

    @property
    def edge(self) -> float:
        """m, of the grid."""
        return 2 * self.radius

    def mesh(self, prediction):
        """The surface at `LEVEL`, without loose pieces; where all is outside, that of the lowest values."""
        values, level = -prediction.detach().cpu().double().numpy(), -LEVEL * self.relative_size
        if not values.max() > level:
            few = len(values) ** 2 // 8  # a thousandth of the grid
            level = min(np.partition(values.ravel(), -few)[-few], values.max() - LEAST)
        outside = min(values.min(), level) - self.clamp
        vertices, faces = grid_surface(values, level, self.edge / (len(values) - 1), outside)
        _, component = igl.facet_components(faces)
        area = np.bincount(component, igl.doublearea(vertices, faces))
        faces = faces[(area >= LOOSE * area.max())[component]]
        used, faces = np.unique(faces, return_inverse=True)
        faces = faces.reshape(-1, 3)
        return torch.from_numpy(vertices[used]).to(prediction), torch.from_numpy(faces).to(prediction.device)


def corrected(
    distance: Callable[[Tensor], Tensor], touched: Tensor, correction: Correction, level: float = LEVEL
) -> Callable[[Tensor], Tensor]:
    """A signed distance (n,) m of points (n, 3), with the residual at touched points interpolated.

    level: m, of the surface that is drawn, and so of the touched points, which lie on it.
    """
    residual = Kriging(touched, level - distance(touched)[:, None], correction)
    return lambda points: distance(points) + residual(points)[:, 0]
