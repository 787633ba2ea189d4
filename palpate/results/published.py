"""The paper's numbers, typed from its tables; each row names its table. It needs no pandas but for `paper_values`.

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
| grasp_selection | strategy | share of the first error left after five chosen grasps, not of the paper |
| abc | experiment | m^2 x 9000, of the authors' released models on their released ABC objects |
"""

import csv
from collections.abc import Collection, Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.results.methods import COMMUNICATION, METHODS, exchanged, strategy_of

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path(__file__).parent / "paper"

# The tables whose rows are experiments of config/experiments.yaml; claims compare nothing else.
OF_EXPERIMENTS = ("model_selection", "input_modalities", "grasps", "extrapolation")


def published_experiments(*tables: str) -> list[str]:
    """The experiments that the paper has numbers of in these tables (if none: `OF_EXPERIMENTS`)."""
    return list(dict.fromkeys(row["experiment"] for table in tables or OF_EXPERIMENTS for row in paper_rows(table)))


def claims(known: Collection[str] = ()) -> list[dict[str, Any]]:
    """The rows of `paper/claims.csv` for the paper's method, and for each of ours whose experiments are among those
    known; `experiments` are those of the method."""
    judged = [method for method in METHODS if method != "mean"]
    rows = [(method, row, row["experiments"].split("; ")) for method in judged for row in paper_rows("claims")]
    found = [(method, row, exchanged(names, method, known)) for method, row, names in rows]
    return [row | {"method": method, "experiments": names} for method, row, names in found if names]


def claimed_experiments(known: Collection[str], *tables: str) -> list[str]:
    """The experiments, of all methods, that claims about these tables (if none: all) compare."""
    named = [name for row in claims(known) if not tables or row["table"] in tables for name in row["experiments"]]
    return list(dict.fromkeys(name.split(" x")[0] for name in named if strategy_of(name)))


def effects(experiments: Iterable[str]) -> list[dict[str, str]]:
    """The rows of `paper/effects.csv`, for each of `METHODS`, whose two experiments are among those given."""
    known, found = set(experiments), []
    for method in METHODS:
        for row in paper_rows("effects"):
            pair = exchanged((row["experiment"], row["compared_with"]), method, known)
            if pair and known.issuperset(pair):
                effect = row["effect"].format(communication=COMMUNICATION.get(method))
                found.append(row | {"effect": effect, "experiment": pair[0], "compared_with": pair[1]})
    return found


def has_papers_classes(classes: Iterable[str]) -> bool:
    """Whether a run has any of the paper's classes; the tables of one without leave the paper's columns out."""
    return bool({*classes} & {row["class"] for row in paper_rows("dataset_statistics")} - {"total"})


def without_paper(table: "pd.DataFrame", classes: Iterable[str]) -> "pd.DataFrame":
    """A table without the paper's columns (`*_paper`, `paper_agrees`), if none of its run's classes is the paper's."""
    papers = [name for name in table if name.endswith("_paper") or name == "paper_agrees"]
    return table if has_papers_classes(classes) else table.drop(columns=papers)


def stated(table: str, group: str = "average") -> dict[str, float]:
    """The numbers of a table by experiment, of a class or the average; of rings by `<experiment> x<ring>`."""
    rows = [row for row in paper_rows(table) if row.get("class", "average") == group]
    return {row["experiment"] + (f" x{row['ring']}" if "ring" in row else ""): float(row["value"]) for row in rows}


def paper_values(table: str) -> "pd.DataFrame":
    """The rows of one of the module's files, in its order."""
    import pandas as pd

    return pd.read_csv(FOLDER / f"{table}.csv")


@cache
def paper_rows(table: str) -> tuple[dict[str, str], ...]:
    """The rows of one of the module's files as text, an empty cell as ""."""
    with open(FOLDER / f"{table}.csv", encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))
