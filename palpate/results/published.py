"""The paper's numbers (`paper/*.csv`), typed from its tables; each row names its table and unit.

`contradictions` says what in `architectures` contradicts itself, and what is meant; `claims` and `effects` what decides
each claim of the text (`palpate.results.claims`). Not of the paper are `grasp_selection`, the share of the
first error left after five chosen grasps, and `abc`, of the authors' released models on their released ABC objects.
"""

import csv
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from palpate.experiments import METHODS, Method

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path(__file__).parent / "paper"
PAPER_CLASSES = ("bottle", "knife", "cellphone", "rifle")  # in its tables' order


def published_experiments(*tables: str) -> list[str]:
    """The experiments that the paper has numbers of in these tables; by default in those whose rows are experiments of
    config/experiments.yaml. Claims compare nothing else."""
    tables = tables or ("model_selection", "input_modalities", "grasps", "extrapolation")
    return list(dict.fromkeys(row["experiment"] for table in tables for row in paper_rows(table)))


class Term(NamedTuple):
    """What a claim or a difference takes an average of, in their files with spaces between: a method and its inputs, as
    in names of experiments, and a ring around touches; or `cloud`, the predicted local cloud."""

    method: str
    inputs: str = ""
    ring: str = ""

    @property
    def experiment(self) -> str:  # empty for the cloud
        return f"{self.method}_{self.inputs}" if self.inputs else ""

    @property
    def key(self) -> str:
        """What its errors are called: `charts_occluded x1`."""
        return " ".join(filter(None, (self.experiment or self.method, self.ring)))


def terms(cell: str) -> tuple[Term, ...]:
    return tuple(Term(*term.split()) for term in cell.split("; "))


def exchanged(papers: Sequence[Term], method: Method, known: Collection[str]) -> tuple[Term, ...] | None:
    """Terms with a method in place of the paper's that it is stated as; None if it changes none, lacks one, or has no
    experiment, among those `known`, for one. Vision alone stays where a method has no model of its own for it."""
    if method.lacks is None or any(term.method in method.lacks for term in papers):
        return None
    if not method.stated_as:
        return tuple(papers)
    own = []
    for term in papers:
        mine = term._replace(method=method.name) if term.method == method.stated_as else term
        missing = mine != term and mine.experiment not in known
        if missing and "touch" in term.inputs:
            return None
        own.append(term if missing else mine)
    return tuple(own) if own != [*papers] else None


def _of_methods(table: str, known: Collection[str], *columns: str) -> Iterator[tuple[Method, dict, Sequence, Sequence]]:
    """For each method, the rows of a file whose experiments it has, with their terms as stated and as its own."""
    for method in METHODS.values():
        for row in paper_rows(table):
            papers = [term for column in columns for term in terms(row[column])]
            if own := exchanged(papers, method, known):
                yield method, row, papers, own


def claims(known: Collection[str] = ()) -> list[dict[str, Any]]:
    """The rows of `paper/claims.csv` for the paper's method, and for each of ours whose experiments are among those
    known: `terms` are those of the method, `stated` the paper's."""
    return [
        row | {"method": method.name, "stated": papers, "terms": own}
        for method, row, papers, own in _of_methods("claims", known, "experiments")
        if method.claims
    ]


def claimed_experiments(known: Collection[str], *tables: str) -> list[str]:
    """The experiments, of all methods, that claims about these tables (if none: all) compare."""
    named = [term.experiment for row in claims(known) if not tables or row["table"] in tables for term in row["terms"]]
    return list(dict.fromkeys(filter(None, named)))


def effects(experiments: Iterable[str]) -> list[dict[str, Any]]:
    """The rows of `paper/effects.csv`, for each method, whose two experiments are among those given; with the `method`
    of the first, and as `stated` the paper's two."""
    known, rows = set(experiments), []
    for _, row, papers, own in _of_methods("effects", known, "experiment", "compared_with"):
        one, other = (term.key for term in own)
        if {one, other} <= known:
            named = {"method": own[0].method, "experiment": one, "compared_with": other}
            rows.append({"effect": row["effect"], "stated": [term.key for term in papers], **named})
    return rows


def has_papers_classes(classes: Iterable[str]) -> bool:
    """Whether a run has any of the paper's classes; the tables of one without leave the paper's columns out."""
    return not {*classes}.isdisjoint(PAPER_CLASSES)


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
