"""Train a network of one's own on a run: depth in the gel from the reading's colours.

python examples/train_on_a_run.py [results/smoke]
"""

# %% The grasps of a split are a map-style dataset of dictionaries, for a DataLoader as it is.
import sys
from pathlib import Path

import matplotlib
import torch
from torch import nn
from torch.utils.data import DataLoader

import palpate

matplotlib.use("Agg")
import matplotlib.pyplot as plt

OUTPUT = Path("results/examples")
OUTPUT.mkdir(parents=True, exist_ok=True)
run = Path(sys.argv[1] if len(sys.argv) > 1 else "results/smoke")
if not (run / "catalogue.csv").is_file():
    sys.exit(f"{run} is not a run's folder; the smoke run is made with: snakemake --cores 2 smoke")
dataset = palpate.Dataset(run)
print(dataset.table().groupby("split").size())
wanted = ["reading", "depth", "success"]
torch.manual_seed(0)
loader = DataLoader(dataset.grasps("train", wanted), batch_size=2, shuffle=True)


# %% Readings and depths of the sensors that touch the object; depth in mm, the sensor's range where nothing is.
def touches(batch: dict) -> tuple[torch.Tensor, torch.Tensor]:
    """Readings (n, 3, r, c) in [0, 1] and depths (n, r, c), mm, of successful touches."""
    readings = batch["reading"][batch["success"]].permute(0, 3, 1, 2).float() / 255
    return readings, (1000 * batch["depth"][batch["success"]]).clamp(max=25)


network = nn.Sequential(
    nn.Conv2d(3, 16, 5, padding=2),
    nn.ReLU(),
    nn.Conv2d(16, 16, 9, padding=16, dilation=4),
    nn.ReLU(),
    nn.Conv2d(16, 1, 5, padding=2),
)
optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
for epoch in range(20):
    for batch in loader:
        readings, depths = touches(batch)
        if not len(readings):
            continue
        loss = (25 * network(readings)[:, 0].sigmoid() - depths).abs().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    if epoch % 5 == 4:
        print(f"epoch {epoch + 1}: {loss.item():.2f} mm of training")

# %% On an object that it was not trained on.
readings, depths = touches(next(iter(DataLoader(dataset.grasps("validation", wanted), batch_size=5))))
with torch.inference_mode():
    predicted = 25 * network(readings)[:, 0].sigmoid()
print(f"validation: {(predicted - depths).abs().mean():.2f} mm")
figure, axes = plt.subplots(3, min(len(readings), 4), figsize=(8, 6), squeeze=False)
for column, line in enumerate(axes.T):
    line[0].imshow(readings[column].permute(1, 2, 0))
    line[1].imshow(depths[column], vmin=0, vmax=25)
    line[2].imshow(predicted[column], vmin=0, vmax=25)
for axis, name in zip(axes[:, 0], ("reading", "depth", "predicted"), strict=True):
    axis.set_ylabel(name)
for axis in axes.flat:
    axis.set_xticks([])
    axis.set_yticks([])
figure.tight_layout()
figure.savefig(OUTPUT / "train_on_a_run.png", dpi=100)
