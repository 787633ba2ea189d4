"""Fits of touch charts to depth maps: distance of the chart from the true surface, against time.

Charts are fitted to true depth maps, so that the error is the fit's and not the U-Net's.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from palpate.charts import build_tree, chamfer_distance, fit_direct, sample_faces, touch_chart
from palpate.charts.fit import placed
from palpate.dataset import Dataset
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.mesh.distance import Surface
from palpate.protocol import CHAMFER_SCALE
from palpate.touch import PIXEL_CENTRES, RESOLUTION, SENSOR_WIDTH, local_points
from studies.error_vs_runtime.study import Method, Study
from studies.exact_depth import exact_depth
from studies.subjects import Subject
from studies.surface_distance import sample

TOUCHES = 2  # of each object
RAYS_PER_PIXEL = 4  # along each side of a pixel, to sample the true surface
CHART_POINTS = 20_000  # points on a chart
MAX_STEPS = 100  # steps of the paper's optimisation
STOP = 0.0006 / CHAMFER_SCALE  # square metres: the supplement's loss to stop at, in the tables' unit
# What differs from the fit with `fit_adam`'s own options.
VARIANTS = {"samples": (500,), "rate": (0.01,)}


class Touches(NamedTuple):
    """k touches of one object.

    depth: (k, 100, 100) m, valid: (k, 100, 100), position: (k, 3) m and rotation: (k, 3, 3) in the world: what
    `fit_direct` takes. clouds: k local clouds, what `fit_adam` takes. truth: k times points (n, 3) of the true surface,
    dense, and a tree of them.
    """

    depth: Tensor
    valid: Tensor
    position: Tensor
    rotation: Tensor
    clouds: list[Tensor]
    truth: list[tuple[np.ndarray, cKDTree]]


def visible_surface(triangles: np.ndarray, position: np.ndarray, rotation: np.ndarray, per_pixel: int) -> np.ndarray:
    """Points (n, 3) where parallel rays of a sensor, `per_pixel`^2 a pixel, first meet the surface within its range.

    triangles: (f, 3, 3) m, in the frame of the pose.
    """
    side = RESOLUTION * per_pixel
    centres = ((np.arange(side) + 0.5) / side - 0.5) * SENSOR_WIDTH
    y, z = (grid.ravel() for grid in np.meshgrid(centres, centres))
    points = np.stack([exact_depth(triangles, position, rotation, np.stack([y, z], axis=1)), y, z], axis=1)
    return points[np.isfinite(points[:, 0])] @ rotation.T + position


def distances(chart: np.ndarray, truth: np.ndarray, tree: cKDTree) -> tuple[np.ndarray, np.ndarray]:
    """Distances between a chart (81, 3) and true points, metres.

    Returns: exact distances (n,) of the true points to the chart's faces, and distances (m,) of points spread evenly
    on the chart to the nearest true point. For a chart without area its vertices are used.
    """
    faces = touch_chart().faces.numpy()
    corners = chart[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = faces[area > 0]
    if not len(faces):
        return cKDTree(chart).query(truth)[0], tree.query(chart)[0]
    to_chart, _ = Surface(chart, faces).closest(truth)
    return to_chart, tree.query(sample(chart, faces, CHART_POINTS))[0]


def fit_adam(
    points: Sequence[Tensor],
    position: Tensor,
    rotation: Tensor,
    steps: int = 300,
    rate: float = 0.003,
    stop: float = STOP,
    samples: int = 2000,
    generator: torch.Generator | None = None,
) -> Tensor:
    """Touch charts (k, 81, 3) by the paper's optimisation (supplement, "Converting Point Clouds to Charts").

    For all sensors at once: Adam moves the vertices of a plane in place of the sensor, to lower the Chamfer distance
    between the cloud and points sampled on the chart. A chart is that of the step with the lowest loss.

    Args:
        points: k local clouds (n_i, 3) metres, in the frame of the poses, one point or more each.
        position: (k, 3) and rotation: (k, 3, 3) of the sensors.
        steps: at most. rate: Adam's, in metres. stop: a chart is done when its loss falls below this, in square metres.
        samples: points on each chart a step, from `generator` (None: the default one). With 1,000 their own spacing
            exceeds the supplement's `stop`, which is then never reached (docs/charts.md).
    """
    chart, trees = touch_chart(), [build_tree(cloud) for cloud in points]
    plane = torch.cat([torch.zeros(len(chart.grid), 1), chart.grid], dim=1)
    vertices = placed(plane.expand(len(position), -1, -1), position, rotation).requires_grad_()
    best, lowest = vertices.detach().clone(), torch.full((len(vertices),), torch.inf)
    adam = torch.optim.Adam([vertices], lr=rate)
    for _ in range(steps):
        active = (lowest >= stop).nonzero()[:, 0]
        if not len(active):
            break
        sampled = sample_faces(vertices[active], chart.faces, samples, generator)
        loss = chamfer_distance(sampled, [points[i] for i in active], b_trees=[trees[i] for i in active])
        better = active[loss.detach() < lowest[active]]
        lowest[active] = torch.minimum(lowest[active], loss.detach())
        best[better] = vertices.detach()[better]
        adam.zero_grad()
        loss.sum().backward()
        adam.step()
    return best


def fit_to_nearest(depth: Tensor, valid: Tensor, position: Tensor, rotation: Tensor) -> Tensor:
    """Another direct fit: each vertex of the sensor's grid is moved to the nearest pixel in contact."""
    z, y = torch.meshgrid(*2 * [torch.from_numpy(PIXEL_CENTRES).float()], indexing="ij")
    pixels = torch.stack([y, z], dim=2).reshape(-1, 2)
    pixel_distance = torch.cdist(touch_chart().grid, pixels).expand(len(depth), -1, -1)
    at = pixel_distance.masked_fill(~valid.flatten(1)[:, None], torch.inf).argmin(dim=2)
    return placed(torch.cat([depth.flatten(1).gather(1, at)[..., None], pixels[at]], dim=2), position, rotation)


class TouchCharts(Study):
    """Two touches of each of at most two objects: the paper's optimisation is slow."""

    stage = "touch charts"
    units = {"Chamfer distance, root mean square": "mm", "largest distance": "mm"}
    reference = (
        f"the object's faces that the sensor sees, {RAYS_PER_PIXEL} x {RAYS_PER_PIXEL} exact rays a pixel in double "
        f"precision; distances both ways, to the chart's triangles exact. Seconds are for {TOUCHES} touches"
    )
    objects = 2

    def cases(self) -> Iterable[tuple[str, Touches]]:
        """Objects without a successful touch are left out."""
        dataset = Dataset(self.run, ("meshes", "touch"))
        cases = ((subject.name, self._touches(subject, dataset)) for subject in self.subjects)
        return ((name, touches) for name, touches in cases if touches is not None)

    def _touches(self, subject: Subject, dataset: Dataset) -> Touches | None:
        """`TOUCHES` of the object's successful touches, evenly spaced in their order; None if it has none."""
        touches = [
            (grasp, sensor) for grasp in dataset[subject.name].grasps for sensor in np.flatnonzero(grasp.success)
        ]
        chosen = [touches[k * len(touches) // TOUCHES] for k in range(min(TOUCHES, len(touches)))]
        if not chosen:
            return None
        triangles = load_visual(subject.folder).triangles.astype(np.float64) + OBJECT_POSITION
        names = ("depth", "position", "rotation")
        arrays = [np.stack([getattr(grasp, name)[sensor] for grasp, sensor in chosen]) for name in names]
        points = [visible_surface(triangles, *pose, RAYS_PER_PIXEL) for pose in zip(*arrays[1:], strict=True)]
        depth, position, rotation = (torch.from_numpy(array).float() for array in arrays)
        clouds = [torch.from_numpy(local_points(*touch)) for touch in zip(*arrays, strict=True)]
        return Touches(depth, torch.isfinite(depth), position, rotation, clouds, [(p, cKDTree(p)) for p in points])

    def methods(self) -> list[Method]:
        """Two direct fits, and the paper's optimisation with several options."""
        fits = {"over the contact": fit_direct, "to the nearest contact": fit_to_nearest}
        methods = [
            Method("direct", "rows", name, lambda case, fit=fit: fit(*case[:4]), fit is fit_direct)
            for name, fit in fits.items()
        ]
        for knob, values in {"steps": (MAX_STEPS, 50), **VARIANTS}.items():
            for value in values:
                methods.append(Method("Adam", knob, value, partial(_adam, {"steps": MAX_STEPS, knob: value}), False))
        return methods

    def errors(self, case: Touches, result: Tensor) -> dict[str, float]:
        """Distances of charts and true surfaces both ways: root mean square, and the largest."""
        both_ways = [distances(chart, *truth) for chart, truth in zip(result.double().numpy(), case.truth, strict=True)]
        square = [(np.mean(to_chart**2) + np.mean(from_chart**2)) / 2 for to_chart, from_chart in both_ways]
        largest = [max(to_chart.max(), from_chart.max()) for to_chart, from_chart in both_ways]
        values = 1e3 * np.sqrt(np.mean(square)), 1e3 * np.max(largest)
        return dict(zip(self.units, map(float, values), strict=True))


def _adam(options: Mapping[str, Any], case: Touches) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    return fit_adam(case.clouds, case.position, case.rotation, generator=generator, **options)


study = TouchCharts
