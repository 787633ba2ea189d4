"""A straightforward implementation of the model: the reference that the fast one is compared with.

Layout (sample, vertex, channel); a dense adjacency matrix; the image encoded again at each deformation; pooling from
the four cells around each vertex; all pairs of points for the Chamfer distance. It uses the weights of a
`palpate.models.Reconstruction`, and of its code only the convolutions, and the start that is made of templates, which
test_templates.py compares with brute force.
"""

from functools import cache

import numpy as np
import torch

from palpate.charts import ATLAS_RADIUS, sphere, vision_atlas
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.charts.graph import Graph
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction
from palpate.models.gcn import GraphNetwork
from palpate.models.touch import TouchAttention


def dense_adjacency(graph: Graph) -> torch.Tensor:
    """The matrix (V, V) float64 that `graph.aggregate` multiplies by, built edge by edge."""
    atlas = vision_atlas()
    adjacent = np.eye(graph.vertices)  # NumPy writes single elements faster than torch
    for a, b, c in graph.faces.tolist():
        for u, v in ((a, b), (b, c), (c, a)):
            adjacent[u, v] = adjacent[v, u] = 1
    if graph.kind != "sphere":
        where: dict[tuple[float, ...], list[int]] = {}
        for vertex in atlas.boundary.tolist():
            where.setdefault(tuple(atlas.vertices[vertex].tolist()), []).append(vertex)
        for together in where.values():
            for u in together:
                adjacent[u, together] = 1
        for u in graph.reference.tolist():
            adjacent[u, atlas.boundary] = adjacent[atlas.boundary, u] = 1
    adjacent = torch.from_numpy(adjacent)
    degree = adjacent.sum(dim=1)
    if graph.normalisation == "mean":
        return adjacent / degree[:, None]
    return adjacent / (degree[:, None] * degree[None]).sqrt()


def pixels(positions: torch.Tensor, batch: dict) -> torch.Tensor:
    """(B, V, 3) in the world -> (B, V, 2) column and row in the batch's images, over their size."""
    places = []
    for points, camera in zip(positions, batch["camera"], strict=True):
        column, row, depth = (points @ line[:3] + line[3] for line in camera)
        places.append(torch.stack([column / depth, row / depth], dim=-1))
    return torch.stack(places) / batch["image"].shape[-1]


def pool(features: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
    """(B, C, n, n) map, (B, V, 2) place in [0, 1] over it -> (B, V, C), by bilinear interpolation."""
    samples, _, size, _ = features.shape
    cell = (place * size - 0.5).clamp(0, size - 1)
    low = cell.detach().floor().long().clamp(max=size - 2)
    share = cell - low
    which = torch.arange(samples)[:, None]
    pooled = 0
    for down in (0, 1):
        for right in (0, 1):
            weight = torch.ones_like(share[..., 0])
            weight = weight * (share[..., 0] if right else 1 - share[..., 0])
            weight = weight * (share[..., 1] if down else 1 - share[..., 1])
            pooled = pooled + weight[..., None] * features[which, :, low[..., 1] + down, low[..., 0] + right]
    return pooled


def empty_space(positions: torch.Tensor, batch: dict) -> torch.Tensor:
    """(B, V, 3) -> (B, V, 5): the second half of what `palpate.models.touch.TouchPooling` describes, by all pairs."""
    pooled = []
    for place, *poses, success in zip(positions, batch["position"], batch["rotation"], batch["success"], strict=True):
        features = torch.zeros(len(place), 5, dtype=place.dtype)
        least = torch.full((len(place), 1), torch.inf, dtype=place.dtype)
        for position, rotation, touched in zip(*poses, success.tolist(), strict=True):
            if touched:
                continue
            x, y, z = ((place - position) @ axis for axis in rotation.T)
            sides = [(-x, x - 0.025), (y.abs() - 0.01641 / 2,), (z.abs() - 0.01641 / 2,)]
            squares = [torch.stack([*side, torch.zeros_like(x)]).amax(0).square() for side in sides]
            # The root's gradient at 0 is not a number; inside there is none.
            inside = sum(squares) == 0
            distance = torch.where(inside, 0.0, torch.where(inside, 1.0, sum(squares)).sqrt())[:, None]
            empty = (-distance / 0.01).exp()
            found = torch.cat([empty, rotation[:, 0] * empty, x[:, None] / 0.025 * empty], dim=1)
            features = torch.where(distance < least, found, features)
            least = torch.minimum(distance, least)
        pooled.append(features)
    return torch.stack(pooled)


def nearest_touch(positions: torch.Tensor, charts: torch.Tensor, success: torch.Tensor) -> torch.Tensor:
    """(B, V, 3), (B, T, 81, 3), (B, T) -> (B, V, 14): what `TouchPooling` says of the touched surface, by all pairs.

    The normal is the sum of the directions across the four quarters around a chart's vertex.
    """
    pooled = []
    for place, sheets, touched in zip(positions, charts, success, strict=True):
        features = torch.zeros(len(place), 14, dtype=place.dtype)
        if touched.any():
            grid = sheets[touched].unflatten(1, (9, 9))
            steps = []
            for axis in (1, 2):
                ahead, behind = (grid.roll(shift, axis) for shift in (-1, 1))
                count = torch.full((9,), 2.0, dtype=place.dtype)
                count[[0, -1]] = 1.0
                last, first = (torch.arange(9) == 8), (torch.arange(9) == 0)
                shape = [1, 1, 1, 1]
                shape[axis] = 9
                ahead = torch.where(last.view(shape), grid, ahead)
                behind = torch.where(first.view(shape), grid, behind)
                steps.append((ahead - behind) / count.view(shape))
            normals = torch.linalg.cross(*steps)
            normals = (normals / normals.norm(dim=-1, keepdim=True)).flatten(0, 2)
            points = grid.flatten(0, 2)
            nearest = (place.detach()[:, None] - points.detach()[None]).square().sum(2).argmin(1)
            offset = points[nearest] - place
            distance = offset.square().sum(1, keepdim=True).sqrt()
            near = (-distance / 0.05).exp()
            far = (-distance / 0.15).exp()
            across = (offset * normals[nearest]).sum(1, keepdim=True)
            columns = [offset * near / 0.05, near, (-distance / 0.015).exp(), across * near / 0.02]
            columns += [normals[nearest] * near, offset * far / 0.15, far, torch.ones_like(near)]
            features = torch.cat(columns, dim=1)
        pooled.append(features)
    return torch.stack(pooled)


def attended_touches(
    attention: TouchAttention, places: torch.Tensor, batch: dict, centre: torch.Tensor, scale: torch.Tensor
) -> torch.Tensor:
    """What vertices at relative places (B, V, 3) take from all touches, one touch after the other: (B, V, channels)."""
    query, scores, taken = attention.query(places), [], []
    for touch in range(batch["success"].shape[1]):
        rows = []
        for sample, success in enumerate(batch["success"][:, touch].tolist()):
            at = batch["position"][sample, touch]
            shape = torch.zeros(9, 3, dtype=places.dtype)
            if success:
                vertices = batch["charts"][sample, touch][[0, 4, 8, 36, 40, 44, 72, 76, 80]]
                at, shape = vertices[4], (vertices - vertices[4]) / 0.02
            direction = batch["rotation"][sample, touch, :, 0]
            said = torch.tensor([float(success)], dtype=places.dtype)
            rows.append(torch.cat([(at - centre) / scale, direction, said, shape.flatten()]))
        taken.append(attention.touch(torch.stack(rows)))
        key = attention.key(taken[-1])
        scores.append((query * key[:, None]).sum(2) / key.shape[1] ** 0.5)
    share = torch.stack(scores).softmax(dim=0)
    return sum(weight[..., None] * value[:, None] for weight, value in zip(share, taken, strict=True))


def known(model: Reconstruction, batch: dict) -> torch.Tensor:
    """(B,) whether the silhouette of a template has an intersection over union of `least_fit` with a sample's, beside
    its hand: the second one if the sample has touched points. Pixels are shares that are covered, of 64 along an edge.
    Without an image, whether the touched points are as near to a template."""
    found = []
    if "mask" not in batch:
        charts = batch["charts"].unflatten(2, (9, 9))[:, :, ::4, ::4].flatten(2, 3)
        for sample, success in zip(charts, batch["success"].bool(), strict=True):
            places = sample[success].flatten(0, 1).double()
            clouds = model.templates.objects.points.double()
            nearest = [torch.cdist(places, cloud).amin(dim=1).clamp(max=0.05) for cloud in clouds]
            least = min(each.square().mean().sqrt() for each in nearest) if len(places) else 0.0
            found.append(1 - torch.as_tensor(least) / 0.05 >= model.templates.least_fit[int(success.any())])
        return torch.stack(found)
    touched = batch["success"].any(dim=1) if "success" in batch else [False] * len(batch["mask"])
    each_sample = zip(batch["mask"], batch["hand"], batch["camera_number"], touched, strict=True)
    for mask, hand, camera, is_touched in each_sample:
        seen, free = (each.double().reshape(64, len(each) // 64, 64, -1).mean(dim=(1, 3)) for each in (mask, ~hand))
        others = [template / 255 * free for template in model.templates.masks[:, camera].double()]
        both = [(seen * other).sum() for other in others]
        alike = [one / (seen.sum() + other.sum() - one) for one, other in zip(both, others, strict=True)]
        found.append(max(alike) >= model.templates.least_fit[int(is_touched)])
    return torch.stack(found)


@cache
def smoothing() -> torch.Tensor:
    """The matrix (1824, 1824) float64 that charts are closed and smoothed by: vertices at the same place of the sphere
    to their mean, 0.5 of the way to that of their neighbours, 1 / 1.9 of it back, and each where its place is."""
    place, faces = vision_atlas().position.tolist(), sphere()[1].tolist()
    join, around = np.zeros((1154, 1824)), np.zeros((1154, 1154))
    for vertex, at in enumerate(place):
        join[at, vertex] = 1
    for a, b, c in faces:
        for u, v in ((a, b), (b, c), (c, a)):
            around[u, v] = around[v, u] = 1
    towards = around / around.sum(axis=1, keepdims=True) - np.eye(1154)
    closed = join / join.sum(axis=1, keepdims=True)
    for step in (0.5, -1 / 1.9):
        closed = closed + step * towards @ closed
    return torch.from_numpy(closed[place])


def graph_network(
    network: GraphNetwork, features: torch.Tensor, weight: torch.Tensor, adjacency: torch.Tensor
) -> torch.Tensor:
    """(B, V, C) -> (B, V, 3), every neighbourhood a row of the dense adjacency. weight: of the first layer, whole."""
    for k, layer in enumerate(network.layers):
        features = features @ (layer.weight if k else weight)
        last = k == len(network.layers) - 1
        shared = features.shape[-1] if last else features.shape[-1] // 3
        summed = torch.einsum("uv,bvc->buc", adjacency, features[..., :shared])
        features = torch.cat([summed, features[..., shared:]], dim=-1) + layer.bias
        if not last:
            features = torch.relu(features)
    return features


def reconstruct(model: Reconstruction, batch: dict, adjacency: torch.Tensor, closed: bool = False) -> torch.Tensor:
    """What `model(batch, closed)` computes: (B, V, 3) vertices. adjacency: `dense_adjacency(model.graph)`."""
    samples = len(next(iter(batch.values())))
    dtype = next(model.parameters()).dtype
    start = sphere()[0] if model.experiment.strategy == "sphere" else vision_atlas().vertices
    positions = start.to(dtype).expand(samples, -1, -1)
    touch = None
    if model.experiment.touch and model.experiment.strategy != "sphere":
        touch = batch["charts"].clone()
        for sample in range(samples):
            for sensor in range(model.sensors):
                if not batch["success"][sample, sensor]:
                    touch[sample, sensor] = batch["position"][sample, sensor]
        touch = touch.flatten(1, 2)
    if model.templates is None:
        positions = deformed(model, model.gcn, positions, touch, batch, adjacency)
    else:
        alike = deformed(model, model.gcn, model.templates(batch).transpose(0, 1), touch, batch, adjacency)
        other = deformed(model, model.sphere_gcn, positions, touch, batch, adjacency)
        positions = torch.where(known(model, batch)[:, None, None], alike, other)
        if closed:
            positions = smoothing().to(dtype) @ positions
    if model.copies_touch:
        positions = torch.cat([positions, touch], dim=1)
    return positions


def deformed(
    model: Reconstruction,
    network: GraphNetwork,
    positions: torch.Tensor,
    touch: torch.Tensor | None,
    batch: dict,
    adjacency: torch.Tensor,
) -> torch.Tensor:
    """Positions (B, V, 3) after three deformations by a graph network. touch: (B, 81 T, 3), the charts."""
    (samples, count, _), dtype, fixed, mask = positions.shape, positions.dtype, None, None
    if model.graph.touch_charts:
        success = batch["success"].to(dtype).repeat_interleave(TOUCH_VERTICES, dim=1)
        vision = torch.zeros(samples, count, dtype=dtype)
        mask = torch.cat([vision, 2 * success - 1], dim=1)[..., None]
        stays = torch.ones_like(success) if model.architecture.failed_charts == "fixed" else success
        fixed = torch.cat([vision, stays], dim=1)[..., None] == 1
        positions = torch.cat([positions, touch], dim=1)
    scale = torch.tensor(model.scale, dtype=dtype)
    centre = torch.tensor(OBJECT_POSITION if model.scale == ATLAS_RADIUS else (0.0, 0.0, 0.0), dtype=dtype)
    for _ in range(3):
        features, weights = [], []
        if model.experiment.has_vision:
            pooled = [pool(each, pixels(positions, batch)) for each in model.encoder(batch["image"])]
            features.append(torch.cat(pooled, dim=-1))
            if model.project:
                features[0] = model.project(features[0])
            weights.append(model.image_weight)
        features.append((positions - centre) / scale)
        weights.append(network.layers[0].weight)
        if mask is not None:
            features.append(mask)
        if model.experiment.strategy == "sphere" and model.experiment.touch:
            touches = []
            for sensor in range(model.sensors):
                success = batch["success"][:, sensor].to(dtype)[:, None]
                place = (batch["position"][:, sensor] - centre) / scale
                touches.append((sensor, success, place, batch["rotation"][:, sensor].flatten(1)))
            shown = model.reading_encoder(batch["reading"].flatten(0, 1)).unflatten(0, (samples, -1))
            rows = [torch.cat([shown[:, k] * s, p, r, s], dim=1) for k, s, p, r in touches]
            features.append(torch.cat(rows, dim=1)[:, None].expand(-1, positions.shape[1], -1))
            weights.append(model.reading_weight)
        if model.touch_input == "pooled":
            features.append(nearest_touch(positions, batch["charts"], batch["success"]))
            features.append(empty_space(positions, batch))
            weights.append(model.touch_pooling.weight)
            if model.touch_attention:
                features.append(attended_touches(model.touch_attention, features[0], batch, centre, scale))
                weights.append(model.touch_attention.weight)
        residual = graph_network(network, torch.cat(features, dim=-1), torch.cat(weights), adjacency)
        moved = positions + scale * residual
        if fixed is not None and model.experiment.strategy == "charts":
            moved = torch.where(fixed, positions, moved)
        positions = moved
    return positions
