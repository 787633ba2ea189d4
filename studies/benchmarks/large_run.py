"""Processor time and memory of a dry run of many objects.

    python -m studies.benchmarks.large_run [--objects 100000]

The objects are copies of one small mesh, in 20 classes, in a temporary folder.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import trimesh
import yaml

PROJECT = Path(__file__).parents[2]
CLASSES = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=int, default=100_000)
    objects = parser.parse_args().objects
    with tempfile.TemporaryDirectory() as name:
        folder, mesh = Path(name), trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="stl")
        for number in range(objects):
            path = folder / f"meshes/class-{number % CLASSES:02d}/object-{number:06d}.stl"
            if number < CLASSES:
                path.parent.mkdir(parents=True)
            path.write_bytes(mesh)
        config = {"run": "large", "results": name, "source": {"kind": "folder", "path": f"{name}/meshes"}}
        (folder / "config.yaml").write_text(yaml.safe_dump(config | {"classes": "all"}))
        command = [sys.executable, "-m", "snakemake", "dataset", "--dry-run", "--quiet", "rules"]
        subprocess.run([*command, "--configfile", f"{name}/config.yaml"], cwd=PROJECT, check=True, capture_output=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{objects} objects: {used.ru_utime + used.ru_stime:.0f} s of processor time, {used.ru_maxrss / 1000:.0f} MB")


if __name__ == "__main__":
    main()
