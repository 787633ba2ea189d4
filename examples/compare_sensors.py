"""Compare sensors: the same grasps, read by each.

    python examples/compare_sensors.py [results/smoke]

A run has one sensor (`touch: {sensor: ...}`). Here the grasps of a run are read again by others, without simulating or
rendering anything.
"""

# %% A grasp of a run as a scene: the mesh, the sensors' poses.
import sys
from pathlib import Path

import matplotlib
import numpy as np

from palpate import store, touch
from palpate.catalogue import read_catalogue
from palpate.hand import Hand
from palpate.scene import GRASP_ARRAYS, Scene
from palpate.sensor import load

matplotlib.use("Agg")
import matplotlib.pyplot as plt

OUTPUT = Path("results/examples")
OUTPUT.mkdir(parents=True, exist_ok=True)
run = Path(sys.argv[1] if len(sys.argv) > 1 else "results/smoke")
if not (run / "catalogue.csv").is_file():
    sys.exit(f"{run} is not a run's folder; the smoke run is made with: snakemake --cores 2 smoke")
entry = read_catalogue(run / "catalogue.csv")[0]
grasps = store.read(run / f"grasps/{entry.batch}.h5")
row = grasps["object"].tolist().index(entry.object)
hand = Hand.from_arrays(grasps, prefix="hand/")
scene = Scene.from_grasps(
    run / "meshes" / entry.batch / entry.object, {name: grasps[name][row] for name in GRASP_ARRAYS}, hand
)

# %% Each sensor's readings. Yours is a YAML file like those in config/sensors.
sensed = {}
for name in ("digit", "gelsight_mini", "dome360"):
    sensor = load(name)
    sensed[name] = touch.sense_scene(scene, touch.scene_tracer(scene, sensor))
    touched = sensed[name].success
    size = f"{1000 * sensor.width:.1f} mm wide, {sensor.resolution[0]} x {sensor.resolution[1]} pixels"
    print(f"{name}: {size}, {touched.sum()} of {touched.size} sensors touch")

# %% The grasp in which most of the first one's sensors touch.
best = int(np.argmax(sensed["digit"].success.sum(axis=1)))
figure, axes = plt.subplots(len(sensed), len(hand.sensor_link), figsize=(8, 6), squeeze=False)
for line, (name, reading) in zip(axes, sensed.items(), strict=True):
    for axis, image in zip(line, reading.reading[best], strict=True):
        axis.imshow(image)
        axis.set_xticks([])
        axis.set_yticks([])
    line[0].set_ylabel(name)
figure.tight_layout()
figure.savefig(OUTPUT / "compare_sensors.png", dpi=100)
