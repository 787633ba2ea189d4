"""One training step of the model, compared with the straightforward implementation of `straightforward.py`.

    python -m studies.benchmarks.training_step [--size paper | fast] [--runs 3] [--threads 2]

That one has a dense adjacency, encodes the image at each deformation, and compares all pairs of points. Both use the
same weights, batch and sampled points: occluded vision and touch of one grasp. Loss, gradients and the weights after a
step of Adam are compared, then both are timed in turns: wall time, and processor time, which other load on the machine
hardly changes. Size `paper` is the supplement's network, `fast` that of config/recipes.yaml.
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import torch
import yaml
from tabulate import tabulate
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from palpate.architectures import PAPER_ARCHITECTURES, Architecture
from palpate.camera import IMAGE_SIZE, paper_camera
from palpate.charts import chamfer_distance, sample_faces
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.experiments import Experiment
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction
from palpate.protocol import CHAMFER_SCALE
from studies.benchmarks import straightforward
from studies.timing import interleaved

# The paper's layers, with initial weights that keep the charts near their start, as after some training.
STABLE = {"normalise_positions": True, "init": "he", "last_layer_scale": 0.01}
FAST = yaml.safe_load((Path(__file__).parents[2] / "config/recipes.yaml").read_text())["fast"]["reconstruction"]
SIZES = {  # layers, samples, points
    "paper": (replace(PAPER_ARCHITECTURES["occluded_touch"], **STABLE), 2, 10_000),
    "fast": (Architecture.from_row(FAST["architecture"]), FAST["batch"], FAST["loss_points"]),
}


def synthetic_batch(samples: int, points: int) -> tuple[dict[str, Tensor], Tensor]:
    """A batch of random images and touches on an ellipsoid, and points (B, n, 3) on it."""
    random = torch.Generator().manual_seed(0)
    axes, centre = torch.tensor([0.08, 0.1, 0.21]), torch.tensor(OBJECT_POSITION)

    def surface(count: int) -> Tensor:
        return axes * torch.nn.functional.normalize(torch.randn(samples, count, 3, generator=random), dim=2) + centre

    position = surface(4)
    offsets = 0.008 * torch.randn(samples, 4, TOUCH_VERTICES, 3, generator=random)
    batch = {
        # In memory as a store has it: pixel by pixel.
        "image": torch.rand(samples, IMAGE_SIZE, IMAGE_SIZE, 3, generator=random).movedim(-1, 1),
        "camera": torch.from_numpy(paper_camera().matrix()).float().expand(samples, 3, 4),
        "charts": position[:, :, None] + offsets,
        "position": position,
        "rotation": torch.eye(3).expand(samples, 4, 3, 3),
        "success": torch.rand(samples, 4, generator=random) < 0.62,
    }
    return batch, surface(points)


def difference(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    """Norm of the difference over the norm, of all tensors together."""
    squared = sum((a - b).double().square().sum() for a, b in zip(one, other, strict=True))
    return float((squared / sum(b.double().square().sum() for b in other)).detach().sqrt())


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


def compare(name: str, runs: int) -> list:
    """A row of the table: milliseconds by both clocks, ratios, and differences of loss and gradients."""
    architecture, samples, points = SIZES[name]
    torch.manual_seed(0)
    model = Reconstruction(Experiment("model", "charts", "occluded", True, 1), architecture)
    (batch, truth), dense = synthetic_batch(samples, points), straightforward.dense_adjacency(model.graph).float()
    plain = lambda m: straightforward.reconstruct(m, batch, dense)  # noqa: E731
    fast = Step(deepcopy(model), lambda m: m(batch), chamfer_distance, truth)
    naive = Step(deepcopy(model), plain, straightforward.chamfer_distance, truth)
    differences = [difference(*pair) for pair in zip(fast(), naive(), strict=True)]
    with FlopCounterMode(display=False) as counter:
        fast()
    spent = []
    for clock in (time.perf_counter, time.process_time):
        times = interleaved({"fast": fast, "straightforward": naive}, runs, warm=True, clock=clock)
        spent += [1e3 * times["fast"].rounds.min(), 1e3 * times["straightforward"].rounds.min()]
    ratios = spent[1] / spent[0], spent[3] / spent[2]
    numbers = [*spent, *ratios, *differences, counter.get_total_flops() / 1e9]
    return [name, samples, points, *(f"{number:.3g}" for number in numbers)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", choices=[*SIZES, "all"], default="all")
    parser.add_argument("--runs", type=int, default=3, help="of each, the fastest counts")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    print(f"{torch.get_num_threads()} threads, load {os.getloadavg()[0]:.1f}, torch {torch.__version__}\n")
    columns = ["size", "samples", "points", "ms", "straightforward, ms", "processor ms", "straightforward, processor"]
    columns += ["times faster", "times less work", "loss differs", "gradients differ", "weights differ", "GFLOP"]
    sizes = SIZES if args.size == "all" else [args.size]
    rows = zip(columns, *(compare(each, args.runs) for each in sizes), strict=True)
    print(tabulate(rows, tablefmt="github", disable_numparse=True))


if __name__ == "__main__":
    main()
