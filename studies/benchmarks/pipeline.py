"""Run time, memory and size of a run by stage, from Snakemake's benchmark files; and of 100,000 objects.

    python -m studies.benchmarks.pipeline results/small

CPU seconds are those of all processes of a job; wall seconds are a job's own, two of which run at a time on
two cores. `an object` divides by the objects in the catalogue. The second table takes what an object takes 100,000
times: the hours of one core are the jobs' wall seconds, their terabytes the sizes of the files.
"""

import argparse
from pathlib import Path

import pandas as pd

from palpate.catalogue import read_catalogue

STAGES = ("shapes", "catalogue", "meshes", "surface", "grasps", "touch", "vision", "validate_batch")
FOLDERS = {"shapes": "sources"}  # of stages that are not called as theirs
OBJECTS, CORES = 100_000, 64


def main() -> None:
    """Print the tables of a run's stages, and of what many objects would take."""
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
    print()
    print(
        many_objects(run, table.loc[first, "wall s an object"], objects).to_markdown(floatfmt=("", ".1f", ".2f", ".3f"))
    )


def many_objects(run: Path, seconds: pd.Series, objects: int) -> pd.DataFrame:
    """Time and space that stages take of 100,000 objects.

    seconds: of wall time an object, by stage. objects: how many the run has.
    """
    table = pd.DataFrame({"hours of one core": seconds * OBJECTS / 3600})
    table[f"hours on {CORES} cores"] = table["hours of one core"] / CORES
    files = {stage: run.joinpath(FOLDERS.get(stage, stage)).rglob("*") for stage in table.index}
    sizes = {stage: sum(file.stat().st_size for file in paths if file.is_file()) for stage, paths in files.items()}
    table["TB"] = pd.Series(sizes) * OBJECTS / objects / 1e12
    table.loc["all"] = table.sum()
    return table


if __name__ == "__main__":
    main()
