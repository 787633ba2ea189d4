"""One training step of the fast model, compared with a straightforward implementation.

    python -m studies.benchmarks.training_step

The straightforward one is `straightforward.py`: dense adjacency, the image encoded at each deformation, all pairs of
points. Both use the same weights, batch and sampled points. Loss, gradients and the weights after a step of Adam are
compared; then both are timed alternately in one process, as a whole and by component.

Occluded vision and touch, one grasp. `--size paper` is the supplement's network with 2 samples and 10,000 points;
`fast` is that of config/recipes.yaml. Times are the least of the runs: wall time, and processor time, which other load
on the machine hardly changes.
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path

import pandas as pd
import torch
import yaml
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from palpate.camera import IMAGE_SIZE, paper_camera
from palpate.charts import chamfer_distance, sample_faces
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.mesh import OBJECT_POSITION
from palpate.models import PAPER_ARCHITECTURES, Reconstruction
from palpate.models.pooling import relative_camera
from palpate.models.reconstruction import DEFORMATIONS
from palpate.protocol import CHAMFER_SCALE
from studies.benchmarks import straightforward

# The paper's layers, with initial weights that keep the charts near their start, as after some training.
STABLE = {"normalise_positions": True, "init": "he", "last_layer_scale": 0.01}
RECIPES = Path(__file__).parents[2] / "config" / "recipes.yaml"
FAST = yaml.safe_load(RECIPES.read_text())["fast"]["reconstruction"]
SIZES = {
    "paper": (PAPER_ARCHITECTURES["occluded_touch"] | STABLE, 2, 10_000),
    "fast": (FAST["architecture"], FAST["batch"], FAST["loss_points"]),
}


def synthetic_batch(samples: int, points: int) -> tuple[dict[str, Tensor], Tensor]:
    """A batch of random images and touches on an ellipsoid, and points (B, n, 3) on it."""
    random = torch.Generator().manual_seed(0)
    axes, centre = torch.tensor([0.08, 0.1, 0.21]), torch.tensor(OBJECT_POSITION)

    def surface(count: int) -> Tensor:
        return axes * torch.nn.functional.normalize(torch.randn(samples, count, 3, generator=random), dim=2) + centre

    position = surface(4)
    sheet = 0.008 * torch.randn(samples, 4, TOUCH_VERTICES, 3, generator=random)
    batch = {
        # In memory as a store has it: pixel by pixel.
        "image": torch.rand(samples, IMAGE_SIZE, IMAGE_SIZE, 3, generator=random).movedim(-1, 1),
        "camera": torch.from_numpy(paper_camera().matrix()).float().expand(samples, 3, 4),
        "charts": position[:, :, None] + sheet,
        "position": position,
        "rotation": torch.eye(3).expand(samples, 4, 3, 3),
        "success": torch.rand(samples, 4, generator=random) < 0.62,
    }
    return batch, surface(points)


def milliseconds(functions: Sequence[Callable], runs: int) -> list[float]:
    """Least wall time of each function, then least processor time of each.

    They run alternately, so that other load on the machine affects all of them.
    """
    wall, processor = ([float("inf")] * len(functions) for _ in range(2))
    for _ in range(runs):
        for k, function in enumerate(functions):
            start, start_processor = time.perf_counter(), time.process_time()
            function()
            wall[k] = min(wall[k], 1e3 * (time.perf_counter() - start))
            processor[k] = min(processor[k], 1e3 * (time.process_time() - start_processor))
    return wall + processor


def difference(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    """Norm of the difference over the norm, of all tensors together."""
    squared = sum((a - b).double().square().sum() for a, b in zip(one, other, strict=True))
    return float((squared / sum(b.double().square().sum() for b in other)).detach().sqrt())


def with_gradients(function: Callable[..., Sequence[Tensor]], inputs: Sequence[Tensor]) -> tuple[list, list]:
    """The function's outputs, and the gradients of a fixed weighted sum of them by the inputs."""
    outputs = function()
    random = torch.Generator().manual_seed(0)
    weights = [torch.randn(output.shape, generator=random) for output in outputs]
    return list(outputs), list(torch.autograd.grad(outputs, inputs, weights))


def step_components(model: Reconstruction, batch: dict[str, Tensor], truth: Tensor, adjacency: Tensor) -> dict:
    """Name -> (fast, straightforward) functions of each component of a step, which return (outputs, gradients)."""
    size = batch["image"].shape[-1]
    samples = len(truth)
    random = torch.Generator().manual_seed(1)
    around = 0.1 * torch.randn(samples, model.graph.vertices, 3, generator=random)
    positions = (around + torch.tensor(OBJECT_POSITION)).requires_grad_()
    positions_vbc = positions.detach().transpose(0, 1).contiguous().requires_grad_()
    maps = [each.detach().requires_grad_() for each in model.encoder(batch["image"])]
    camera = relative_camera(batch["camera"], size)
    own, width = model.gcn.layers[0].weight.shape
    features, products = (
        torch.randn(samples, model.graph.vertices, count, generator=random, requires_grad=True)
        for count in (own, width)
    )
    features_vbc, products_vbc = (
        tensor.detach().transpose(0, 1).contiguous().requires_grad_() for tensor in (features, products)
    )
    # The first layer of the straightforward one takes the products as features with weights 1.
    first = torch.cat([model.gcn.layers[0].weight, torch.eye(width)])
    cloud = (0.1 * torch.randn(truth.shape, generator=random) + torch.tensor(OBJECT_POSITION)).requires_grad_()
    encoder_weights, gcn_weights = list(model.encoder.parameters()), list(model.gcn.parameters())

    def sums(tensors: list[list[Tensor]]) -> list[Tensor]:
        return [sum(same[1:], start=same[0]) for same in zip(*tensors, strict=True)]

    def repeated(once: Callable[[], Sequence[Tensor]]) -> list[Tensor]:
        return sums([list(once()) for _ in range(DEFORMATIONS)])

    def pool_fast():
        weighted = model.map_products(maps, model.image_weight)
        pooled = [model.pooling.products(weighted, positions_vbc, camera, size) for _ in range(DEFORMATIONS)]
        return sums([[each.transpose(0, 1)] for each in pooled])

    def pool_plainly():
        place = straightforward.pixels(positions, batch)
        return [torch.cat([straightforward.pool(each, place) for each in maps], dim=-1) @ model.image_weight]

    return {
        "encoder": (
            # Its maps serve three deformations.
            lambda: with_gradients(lambda: sums([model.encoder(batch["image"])] * 3), encoder_weights),
            lambda: with_gradients(lambda: repeated(lambda: model.encoder(batch["image"])), encoder_weights),
        ),
        "pooling and its weights, 3 times": (
            lambda: with_gradients(pool_fast, [*maps, model.image_weight, positions_vbc]),
            lambda: with_gradients(lambda: repeated(pool_plainly), [*maps, model.image_weight, positions]),
        ),
        "graph network, 3 times": (
            lambda: with_gradients(
                lambda: repeated(lambda: [model.gcn(features_vbc, model.graph, products_vbc).transpose(0, 1)]),
                [*gcn_weights, features_vbc, products_vbc],
            ),
            lambda: with_gradients(
                lambda: repeated(
                    lambda: [
                        straightforward.graph_network(model, torch.cat([features, products], dim=2), first, adjacency)
                    ]
                ),
                [*gcn_weights, features, products],
            ),
        ),
        "Chamfer distance": (
            lambda: with_gradients(lambda: [chamfer_distance(cloud, truth)], [cloud]),
            lambda: with_gradients(lambda: [straightforward.chamfer_distance(cloud, truth)], [cloud]),
        ),
    }


class Step:
    """A model with its optimiser; a call makes one step and returns loss, gradients and weights."""

    def __init__(self, model: Reconstruction, vertices: Callable, distance: Callable, truth: Tensor):
        self.model, self.vertices, self.distance, self.truth = model, vertices, distance, truth
        self.optimiser = torch.optim.Adam(model.parameters(), 3e-5)

    def __call__(self) -> list[list[Tensor]]:
        self.optimiser.zero_grad()
        random = torch.Generator().manual_seed(0)
        points = sample_faces(self.vertices(self.model), self.model.faces, self.truth.shape[1], generator=random)
        loss = CHAMFER_SCALE * self.distance(points, self.truth).mean()
        loss.backward()
        self.optimiser.step()
        weights = list(self.model.parameters())
        return [[loss.detach()], [weight.grad for weight in weights], [weight.detach() for weight in weights]]


def product_speed(size: int = 3000, runs: int = 5) -> float:
    """GFLOP a second of a product of two matrices (size, size), the fastest of the runs."""
    matrix = torch.randn(size, size)
    (fastest, _) = milliseconds([lambda: matrix @ matrix], runs)
    return 2 * size**3 / (1e6 * fastest)


def compare(name: str, runs: int) -> pd.DataFrame:
    architecture, samples, points = SIZES[name]
    torch.manual_seed(0)
    model = Reconstruction("charts", True, True, 1, architecture)
    batch, truth = synthetic_batch(samples, points)
    adjacency = model.graph.dense().float()
    fast = Step(deepcopy(model), lambda m: m(batch), chamfer_distance, truth)
    plain = Step(
        deepcopy(model),
        lambda m: straightforward.reconstruct(m, batch, adjacency),
        straightforward.chamfer_distance,
        truth,
    )
    loss, gradients, weights = (difference(*pair) for pair in zip(fast(), plain(), strict=True))
    with FlopCounterMode(display=False) as counter:
        fast()
    operations = counter.get_total_flops() / 1e9
    print(
        f"{name}: {samples} samples, {points} points. One step of both from the same weights, relative "
        f"difference: loss {loss:.1e}, gradients {gradients:.1e}, weights after it {weights:.1e}\n"
        f"Products and convolutions of a fast step are {operations:.1f} GFLOP; at the speed of a large matrix product "
        f"they would take {1e3 * operations / product_speed():.0f} ms.\n"
    )
    rows = []
    for part, (one, other) in step_components(model, batch, truth, adjacency).items():
        found = [difference(a, _matching_layout(b, a)) for a, b in zip(other(), one(), strict=True)]
        rows.append([part, *milliseconds([one, other], runs), *found])
    rows.append(["whole step", *milliseconds([fast, plain], runs), loss, gradients])
    clocks = ["ms", "straightforward, ms", "processor ms", "straightforward, processor ms"]
    table = pd.DataFrame(rows, columns=[f"{name} size", *clocks, "output differs", "gradient differs"])
    table.insert(3, "times faster", table[clocks[1]] / table[clocks[0]])
    table.insert(6, "times less work", table[clocks[3]] / table[clocks[2]])
    return table


def _matching_layout(tensors: Sequence[Tensor], like: Sequence[Tensor]) -> list[Tensor]:
    """Those of layout (V, B, C) as (B, V, C)."""
    return [a if a.shape == b.shape else a.transpose(0, 1) for a, b in zip(tensors, like, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", choices=[*SIZES, "all"], default="all")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    print(f"{torch.get_num_threads()} threads, load {os.getloadavg()[0]:.1f}, torch {torch.__version__}\n")
    for name in SIZES if arguments.size == "all" else [arguments.size]:
        table = compare(name, arguments.runs)
        formats = {k: ("{:.1e}" if "differs" in k else "{:.1f}").format for k in table.columns[1:]}
        print(table.to_string(index=False, formatters=formats), "\n")


if __name__ == "__main__":
    main()
