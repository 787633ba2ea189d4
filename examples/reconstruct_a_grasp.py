"""Reconstruct an object from one image and one grasp, by a trained model of strategy `template`.

    python examples/reconstruct_a_grasp.py [results/smoke]

The smoke run's models were trained for a few steps: their meshes mean nothing. Those of results/default do.
"""

# %% A grasp of a test object.
import sys
from pathlib import Path

import matplotlib
import numpy as np

import palpate

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

OUTPUT = Path("results/examples")
OUTPUT.mkdir(parents=True, exist_ok=True)
run = Path(sys.argv[1] if len(sys.argv) > 1 else "results/smoke")
if not (run / "catalogue.csv").is_file():
    sys.exit(f"{run} is not a run's folder; the smoke run is made with: snakemake --cores 2 smoke")
item = palpate.Dataset(run).split("test")[0]

# %% The mesh that a model predicts: metres, world frame, charts of touches in orange.
model = palpate.Reconstructor(run / "models/template_occluded_any/seed-0")
mesh = model.predict(item, grasps=[0]).mesh()
mesh.export(OUTPUT / f"{item.name}.ply")
print(f"{item.name}: {len(mesh.faces)} faces in {OUTPUT / f'{item.name}.ply'}")

# %% Beside what it was made from, and the true surface.
figure = plt.figure(figsize=(9, 3))
axis = figure.add_subplot(131)
axis.imshow(item.grasps[0].occluded)
axis.set_axis_off()
for place, title in ((132, "predicted"), (133, "true")):
    axis = figure.add_subplot(place, projection="3d")
    if title == "predicted":
        colours = mesh.visual.face_colors / 255
        axis.add_collection3d(Poly3DCollection(mesh.triangles, facecolors=colours, shade=True))
    else:
        axis.scatter(*item.points[::10].T, s=0.5)
    low, high = item.points.min(axis=0), item.points.max(axis=0)
    centre, half = (low + high) / 2, np.max(high - low) / 2
    for side, middle in zip("xyz", centre, strict=True):
        getattr(axis, f"set_{side}lim")(middle - half, middle + half)
    axis.set_title(title)
    axis.set_axis_off()
figure.tight_layout()
figure.savefig(OUTPUT / "reconstruct_a_grasp.png", dpi=100)
