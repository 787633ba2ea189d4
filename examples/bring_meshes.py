"""Bring meshes: a folder of files becomes a dataset.

    python examples/bring_meshes.py [folder of meshes]

Without a folder it makes one of two classes: a mug and a brick, whose file is in millimetres.
"""

# %% A folder of meshes: <folder>/<class>/<object>.obj, or any other layout (docs/objects.md).
import subprocess
import sys
from pathlib import Path

import trimesh
import yaml

OUTPUT = Path("results/examples")
OUTPUT.mkdir(parents=True, exist_ok=True)
meshes = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else (OUTPUT / "meshes").resolve()
if len(sys.argv) == 1:
    for name in ("mug", "brick"):
        (meshes / name).mkdir(parents=True, exist_ok=True)
    cup = trimesh.creation.annulus(r_min=0.036, r_max=0.040, height=0.095, sections=64)
    floor = trimesh.creation.cylinder(radius=0.038, height=0.004, sections=64)
    floor.apply_translation([0, 0, -0.0455])
    handle = trimesh.creation.torus(0.028, 0.005)
    handle.apply_transform(trimesh.transformations.rotation_matrix(1.5708, [1, 0, 0], [0, 0, 0]))
    handle.apply_translation([0.045, 0, 0])
    trimesh.util.concatenate([cup, floor, handle]).export(meshes / "mug/mine.ply")
    trimesh.creation.box((65, 112, 240)).export(meshes / "brick/millimetres.stl")

# %% A config: what differs from config/config.yaml. Then Snakemake builds the dataset and checks every array.
config = OUTPUT / "mine.yaml"
config.write_text(
    yaml.safe_dump(
        {
            "run": "mine",
            "results": str(OUTPUT.resolve()),
            "source": {"kind": "folder", "path": str(meshes)},
            "classes": "all",
            "grasps": {"per_object": 2, "attempts": 2},
        }
    )
)
command = [sys.executable, "-m", "snakemake", "--cores", "2", "rejected.csv", "validate", "--configfile", str(config)]
subprocess.run(command, check=True)

# %% Look at it. What could not be used is in results/examples/mine/rejected.csv, with the reason.
import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

import palpate  # noqa: E402

dataset = palpate.Dataset(OUTPUT / "mine")
print(dataset.table())
rows = [(item, grasp) for item in dataset for grasp in item.grasps]
sensors = rows[0][1].reading.shape[0]
figure, axes = plt.subplots(len(rows), 1 + sensors, figsize=(2 * (1 + sensors), 2 * len(rows)), squeeze=False)
for line, (item, grasp) in zip(axes, rows, strict=True):
    line[0].imshow(grasp.occluded)
    line[0].set_title(item.name, fontsize=8)
    for axis, reading, touches in zip(line[1:], grasp.reading, grasp.success, strict=True):
        axis.imshow(reading)
        axis.set_title("touches" if touches else "touches nothing", fontsize=8)
for axis in axes.flat:
    axis.axis("off")
figure.tight_layout()
figure.savefig(OUTPUT / "bring_meshes.png", dpi=100)
