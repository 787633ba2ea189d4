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


def cost_by_stage(run: Path) -> pd.DataFrame:
    """Jobs, wall and CPU seconds in total and an object, and the largest memory, of every rule of a run."""
    objects = len(read_catalogue(run / "catalogue.csv"))
    rows = []
    for path in sorted((run / "benchmarks").iterdir()):
        files = sorted(path.glob("*.tsv")) if path.is_dir() else [path]
        if not files:  # Jobs that have begun and not ended.
            continue
        jobs = pd.concat([pd.read_csv(file, sep="\t", na_values="-") for file in files])
        rows.append(
            {
                "stage": path.stem,
                "jobs": len(jobs),
                "wall s": jobs["s"].sum(),
                "CPU s": jobs["cpu_time"].sum(),
                "wall s an object": jobs["s"].sum() / objects,
                "CPU s an object": jobs["cpu_time"].sum() / objects,
                "memory MiB": jobs["max_rss"].max(),
            }
        )
    table = pd.DataFrame(rows).set_index("stage")
    first = [stage for stage in STAGES if stage in table.index]
    return table.loc[[*first, *(stage for stage in table.index if stage not in first)]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a run's folder, results/<run>")
    table = cost_by_stage(parser.parse_args().run)
    table.loc["all"] = [table["jobs"].sum(), *table.iloc[:, 1:5].sum(), table["memory MiB"].max()]
    print(table.to_markdown(floatfmt=("", ".0f", ".1f", ".1f", ".3f", ".3f", ".0f")))


if __name__ == "__main__":
    main()
