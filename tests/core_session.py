"""Reads, validates, views and exports a run, as a user of the core of the package does: python core_session.py RUN OUT.

With --block nothing that only the extras bring can be imported. Prints numpy's version and sums of what was read.
"""

import importlib.abc
import importlib.util
import json
import sys
from pathlib import Path

EXTRAS = (
    *("bpy", "mathutils", "embreex", "igl", "lxml", "manifold3d", "mujoco", "networkx", "OpenEXR"),
    *("pymeshlab", "lightning_fabric", "matplotlib", "torch", "snakemake"),
)


class Blocker(importlib.abc.MetaPathFinder):
    """Makes modules look as if they were not installed."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def block():
    found = importlib.util.find_spec
    importlib.util.find_spec = lambda name, *rest: None if name.partition(".")[0] in EXTRAS else found(name, *rest)
    sys.meta_path.insert(0, Blocker())


def sums(run: Path) -> dict:
    """Sums of arrays of a run, by what they are of."""
    import numpy as np

    import palpate

    dataset, found = palpate.Dataset(run), {}
    for item in dataset:
        for grasp in item.grasps:
            clouds = sum(float(np.abs(cloud).sum()) for cloud in grasp.points)
            found[f"{item.name} {grasp.number}"] = [int(grasp.reading.sum()), int(grasp.occluded.sum()), clouds]
    found["surface"] = float(np.abs(dataset.load("surface", "points")).sum(dtype=np.float64))
    return found | {"table": int(dataset.table().touches.sum())}


def main(run: Path, out: Path) -> None:
    import numpy as np

    import palpate
    from palpate.command import main as command

    found = sums(run)
    assert "trimesh" not in sys.modules
    name = palpate.Dataset(run).objects[0]
    for arguments in (
        ["info", run],
        ["validate", run],
        ["export", run, out / "webdataset"],
        ["view", run, name, "--output", out / "pages"],
        ["view", run, "--output", out / "index"],
    ):
        assert command([str(each) for each in arguments]) == 0, arguments
    print(json.dumps({"numpy": np.__version__, "sums": found}))


if __name__ == "__main__":
    if "--block" in sys.argv:
        block()
    main(Path(sys.argv[1]), Path(sys.argv[2]))
