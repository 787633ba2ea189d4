"""Run time and memory of a run by stage, from Snakemake's benchmark files.

    python -m studies.benchmarks.pipeline results/small

CPU seconds are those of all processes of a job; wall seconds are a job's own, two of which run at a time on
two cores. `an object` divides by the objects in the catalogue.
"""

import argparse
from pathlib import Path

import pandas as pd

from palpate.catalogue import read_catalogue

STAGES = ("shapes", "catalogue", "meshes", "surface", "grasps", "touch", "vision", "validate_batch")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a run's folder, results/<run>")
    run = parser.parse_args().run
    objects, rows = len(read_catalogue(run / "catalogue.csv")), {}
    for path in sorted((run / "benchmarks").iterdir()):
        files = sorted(path.glob("*.tsv")) if path.is_dir() else [path]
        if not files:  # Jobs that have begun and not ended.
            continue
        jobs = pd.concat([pd.read_csv(file, sep="\t", na_values="-") for file in files])
        wall, cpu = jobs["s"].sum(), jobs["cpu_time"].sum()
        rows[path.stem] = (len(jobs), wall, cpu, wall / objects, cpu / objects, jobs["max_rss"].max())
    columns = ["jobs", "wall s", "CPU s", "wall s an object", "CPU s an object", "memory MiB"]
    table = pd.DataFrame.from_dict(rows, "index", columns=columns).rename_axis("stage")
    first = [stage for stage in STAGES if stage in table.index]
    table = table.loc[[*first, *table.index.difference(first)]]
    table.loc["all"] = [*table.iloc[:, :5].sum(), table["memory MiB"].max()]
    print(table.to_markdown(floatfmt=("", ".0f", ".1f", ".1f", ".3f", ".3f", ".0f")))


if __name__ == "__main__":
    main()
