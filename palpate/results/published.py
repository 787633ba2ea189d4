"""The paper's numbers, typed from its tables; each row names its table.

| file | key columns | unit |
|---|---|---|
| model_selection | experiment, class | m^2 x 9000 |
| input_modalities | experiment, class | m^2 x 9000 |
| local_touch_charts | class | m^2 x 9000 |
| grasps | experiment (setup, grasps) | m^2 x 9000 |
| extrapolation | experiment (setup), ring | m^2, one-directional |
| single_image | method | Pixel2Mesh's protocol: thousandths, and percent |
| dataset_statistics | class, quantity | counts, and percent |
| grasp_success | class, successful_touches | percent |
| architectures | model, index | words |
| contradictions | model, index | what in `architectures` contradicts itself, and what is meant |
| claims | claim, split | what decides each claim of the text: `palpate.results.claims` |
| effects | experiment, compared_with | the differences that the text is about: `palpate.results.effects` |
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from palpate.evaluation.rows import SPLITS
from palpate.experiments import Comparison

FOLDER = Path(__file__).parent / "paper"

# The tables whose rows are experiments of config/experiments.yaml; claims compare nothing else.
OF_EXPERIMENTS = ("model_selection", "input_modalities", "grasps", "extrapolation")


def published_experiments(*tables: str) -> list[str]:
    """The experiments that the paper has numbers of in these tables (if none: `OF_EXPERIMENTS`)."""
    names = (name for table in tables or OF_EXPERIMENTS for name in paper_values(table)["experiment"])
    return list(dict.fromkeys(names))


def effects(experiments: Iterable[str]) -> list[dict[str, str]]:
    """The rows of `paper/effects.csv` whose two experiments are among those given."""
    known, rows = set(experiments), paper_values("effects", text=True).to_dict("records")
    return [row for row in rows if {row["experiment"], row["compared_with"]} <= known]


def needed_splits(experiment: str, tables: Mapping[str, Comparison]) -> list[str]:
    """The splits of which a table, a claim or a difference takes an experiment's errors; all `SPLITS` if none does.

    tables: those of config/experiments.yaml.
    """
    needed = {table.split for table in tables.values() if experiment in table.by_name}
    claims = paper_values("claims", text=True)
    needed |= {row.split for row in claims.itertuples() if experiment in row.experiments.split("; ")}
    effects_of = paper_values("effects", text=True)
    if experiment in {*effects_of["experiment"], *effects_of["compared_with"]}:
        needed |= set(SPLITS)
    return [split for split in SPLITS if split in needed or not needed]


def has_papers_classes(classes: Iterable[str]) -> bool:
    """Whether a run has any of the paper's classes; the tables of one without leave the paper's columns out."""
    return bool({*classes} & {*paper_values("dataset_statistics")["class"]} - {"total"})


def without_paper(table: pd.DataFrame, classes: Iterable[str]) -> pd.DataFrame:
    """A table without the paper's columns (`*_paper`, `paper_agrees`), if none of its run's classes is the paper's."""
    theirs = [name for name in table if name.endswith("_paper") or name == "paper_agrees"]
    return table if has_papers_classes(classes) else table.drop(columns=theirs)


def paper_values(table: str, text: bool = False) -> pd.DataFrame:
    """The rows of one of the module's files, in its order.

    text: every cell as it is written, an empty one as "".
    Raises FileNotFoundError for a file that does not exist, and names those that do.
    """
    path = FOLDER / f"{table}.csv"
    if not path.exists():
        known = sorted(file.stem for file in FOLDER.glob("*.csv"))
        raise FileNotFoundError(f"{path}: the paper has numbers for the tables {known}, not for {table!r}")
    return pd.read_csv(path, dtype=str, keep_default_na=False) if text else pd.read_csv(path)
