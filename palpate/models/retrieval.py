"""Retrieval: the training object that fits best, as the prediction. Nothing is trained. That it rivals trained networks
is known (Tatarchenko et al. 2019, "What do single-view 3D reconstruction networks learn?")."""

from collections.abc import Mapping
from functools import cache, cached_property

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from palpate.charts import build_tree
from palpate.experiments import Correction
from palpate.models.hull import inside
from palpate.models.kriging import displaced, touched_points
from palpate.sensor import DIGIT, Sensor

FARTHEST = 0.05  # m, at which the distance of a touched point is capped
TOUCH_WEIGHT = 200.0  # of the mean squared distance, m^2, beside the intersection over union
CELLS = 2e5  # of the grid of distances
PARTS = 4  # of the touched points: an object that can't be among the best after some of them is skipped
EXCLUDED = -1e6  # the fit of an object that is not to be taken. It is finite: the only object there is has a weight


class Retrieval:
    """The object of a collection that fits a sample best; ties go to the first. A fit is the intersection over union of
    the silhouettes, less TOUCH_WEIGHT times the mean squared distance of the touched points to the object, each capped.
    What was not seen or touched counts 0. correction: the last step, or None."""

    hand_sensors = None

    def __init__(self, objects: "Objects", correction: Correction | None = None, sensor: Sensor = DIGIT):
        self.objects, self.correction, self.sensor = objects, correction, sensor

    def __call__(self, batch: Mapping[str, Tensor]) -> Tensor:
        """The points (B, n, 3) m of the objects that fit best, corrected at touched points. batch, of what there is:
        `mask` and `hand`, (B, p, p) bool, where the object and the hand are seen, and `camera_number` (B,) int64;
        `success` (B, t) and `charts` (B, t, 81, 3) m."""
        fitting = self.objects.points[self.objects.best(batch)[0][:, 0]]
        if not self.correction or "charts" not in batch:
            return fitting
        samples = zip(fitting, touched_points(batch), strict=True)
        return torch.stack([displaced(points, None, touched, self.correction) for points, touched in samples])

    def meshes(self, batch: Mapping[str, Tensor], closed: bool = False) -> list[tuple[Tensor, Tensor]]:
        """The points of each sample, without those that its `mask` shows to be empty space unless `closed`; no
        faces."""
        clouds, no_faces = list(self(batch)), torch.empty(0, 3, dtype=torch.int64)
        if "mask" in batch and not closed:
            clouds = [cloud[inside(cloud[:, None], batch, n)] for n, cloud in enumerate(clouds)]
        return [(cloud, no_faces) for cloud in clouds]


class Objects:
    """Objects to retrieve: points (T, n, 3) m, and masks (T, k, p, p) bool as k cameras see them, or None."""

    def __init__(self, points: Tensor, masks: Tensor | None = None):
        self.points = points
        self._tree = cache(lambda index: build_tree(points[index]))
        # By camera (k, p p, T), as numbers: for sums over pixels as products of matrices, which are exact.
        if masks is not None:
            self._masks = masks.flatten(2).permute(1, 2, 0).float().contiguous()
            self._areas = self._masks.sum(dim=1)

    def best(self, batch: Mapping[str, Tensor], count: int = 1) -> tuple[Tensor, Tensor]:
        """The `count` objects (B, count) int64 that fit best, the best first, and their fits (B, count) float64. batch:
        as `Retrieval` takes it; with `excluded` (B,) int64, the number of an object that comes last, or -1."""
        samples = len(next(iter(batch.values())))
        overlap = self.overlap(batch) if "mask" in batch else torch.zeros(samples, len(self.points))
        for row, number in enumerate(batch.get("excluded", ())):
            if number >= 0:
                overlap[row, number] = EXCLUDED
        touched = touched_points(batch) if "charts" in batch else [self.points[0, :0]] * samples
        best = [self._best(*sample, count) for sample in zip(overlap.double().numpy(), touched, strict=True)]
        fits, numbers = zip(*(zip(*of_sample, strict=True) for of_sample in best), strict=True)
        return torch.tensor(numbers), torch.tensor(fits, dtype=torch.float64)

    def _best(self, overlap: np.ndarray, touched: Tensor, count: int) -> list[tuple[float, int]]:
        """The best fits with their objects, by the objects' overlap (T,) and the touched points (n, 3). Objects come in
        the order of what their fit can be at most, and are measured part by part of the points, until none can be
        better."""
        places = touched.double().numpy()
        least = self.least_squares(places) if len(places) else np.zeros((len(overlap), 1))
        most = overlap - TOUCH_WEIGHT * least.mean(axis=1)
        best: list[tuple[float, int]] = []
        for index in map(int, np.argsort(-most, kind="stable")):
            worst = best[-1][0] if len(best) == count else -np.inf
            if most[index] < worst:
                break
            fit, squares = most[index], least[index]
            for part in range(PARTS if len(places) else 0):
                squares[part::PARTS] = self.squares(index, places[part::PARTS])
                fit = overlap[index] - TOUCH_WEIGHT * squares.mean()
                if fit < worst:
                    break
            best = sorted([*best, (float(fit), index)], key=lambda fit: (-fit[0], fit[1]))[:count]
        return best

    def overlap(self, batch: Mapping[str, Tensor]) -> Tensor:
        """The intersection over union (B, T) of the samples' silhouettes with the objects', outside the hand."""
        seen, overlap = batch["mask"].flatten(1).float(), torch.empty(len(batch["mask"]), len(self.points))
        for number in batch["camera_number"].unique():
            of_camera = batch["camera_number"] == number
            both = seen[of_camera] @ self._masks[number]
            union = seen[of_camera].sum(dim=1, keepdim=True) + self._areas[number] - both
            if "hand" in batch:
                union -= batch["hand"][of_camera].flatten(1).float() @ self._masks[number]
            overlap[of_camera] = both / union.clamp(min=1)
        return overlap

    def squares(self, index: int, places: np.ndarray) -> np.ndarray:
        """The squared distances (n,) m^2 of places (n, 3) to an object, each capped."""
        distance, _ = self._tree(index).query(places, distance_upper_bound=FARTHEST)
        return np.square(np.minimum(distance, FARTHEST))

    def least_squares(self, places: np.ndarray) -> np.ndarray:
        """What `squares` are at least, (T, n) m^2: for a few of the objects they then have to be measured."""
        low, cell, grid, step = self._grid
        index = np.floor((places - low) / cell).astype(int)
        outside = ((index < 0) | (index >= grid.shape[1:])).any(axis=1)
        off_centre = np.linalg.norm(places - low - cell * (index + 0.5), axis=1)
        least = grid[(slice(None), *np.where(outside[:, None], 0, index).T)] * step - off_centre
        return np.square(np.where(outside, FARTHEST, np.clip(least, 0, FARTHEST)))

    @cached_property
    def _grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """The least distances to each object from the centres of the cells of a grid, (T, x, y, z) uint8, and the
        metres of a step of them, after the grid's corner and the cells' size, m."""
        clouds = self.points.numpy()
        low = clouds.min(axis=(0, 1)) - FARTHEST
        extent = clouds.max(axis=(0, 1)) + FARTHEST - low
        shape = np.ceil(extent * np.cbrt(CELLS / extent.prod())).astype(int)
        cell = extent / shape
        half = np.linalg.norm(cell) / 2
        step = float(FARTHEST + half) / 255
        grid = np.empty((len(clouds), *shape), np.uint8)
        for least, cloud in zip(grid, clouds, strict=True):
            empty = np.ones(shape, bool)
            empty[tuple(np.floor((cloud - low) / cell).astype(int).T)] = False
            # Between the centres of two cells. A point is up to half a diagonal off its own.
            least[:] = np.clip((distance_transform_edt(empty, sampling=cell) - half) / step, 0, 255)
        return low, cell, grid, step
