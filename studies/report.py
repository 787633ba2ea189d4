"""Makes the tables of a report's items and joins them, without Snakemake.

from studies.threads import one_thread
one_thread()                                      # before anything that computes is imported
from studies import report
report.measure("stability", "rays", "results/default")
"""

import importlib
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from palpate import seal
from palpate.atomic import atomic_write
from palpate.results.tables import markdown
from palpate.text_files import read_text
from studies import figures, subjects, summaries
from studies.error_vs_runtime import study
from studies.omitted import omission
from studies.stability import cases
from studies.timing import ROUNDS

# How to join the tables of a report's items: summary, figure, and columns dropped from the joined table.
JOINS = {
    "error_vs_runtime": (summaries.fronts, figures.fronts, ["reference"]),
    "stability": (summaries.verdicts, figures.margins, []),
    "omitted": (summaries.savings, figures.savings, []),
}


def measure(
    report: str,
    item: str,
    run: Path | str,
    settings: Mapping[str, Any] | None = None,
    objects: int = 1,
    rounds: int = ROUNDS,
    batches: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The table of one item of a report (keys of `studies.items.REPORTS`), measured on objects of a run.

    settings: the sections of the config that the item depends on. objects: how many; `stability` uses one. rounds: of
    timing; each method is timed once a round. batches: to select objects from; all if None.

    Raises ValueError if no object of the run is usable.
    """
    module = importlib.import_module(f"studies.{report}.{item}")
    selected = subjects.pick(run, objects, batches)
    if report == "stability":
        return cases.report(item, module.CASES, selected[0])
    if report == "omitted":
        return omission.report(module.omissions(Path(run), selected, settings or {}), rounds)
    return study.measure(module.study(Path(run), selected, settings or {}), rounds)


def join(report: str, items: Iterable[Path | str], table: Path | str, text: Path | str, figure: Path | str) -> None:
    """Join the tables of a report's items: all rows as CSV, a summary as Markdown, a figure as PNG; atomically."""
    (summarise, draw, dropped), rows = JOINS[report], read(items := list(items))
    made_from = seal.made_of(items)
    write(rows.drop(columns=dropped), table, made_from)
    with atomic_write(text, made_from) as path:
        path.write_text(markdown(summarise(rows)))
    with atomic_write(figure, made_from) as path:
        draw(rows, path)


def write(table: pd.DataFrame, path: Path | str, made_from: seal.MadeFrom | None = None) -> None:
    """Write a table as CSV with six digits, atomically; made_from: as for `atomic_write`."""
    with atomic_write(path, made_from) as partial:
        table.to_csv(partial, index=False, float_format="%.6g")


def read(paths: Iterable[Path | str]) -> pd.DataFrame:
    """Read and concatenate the tables of a report's items; only an empty field is a missing value.

    The column `value` stays text: it holds numbers or words, depending on the knob.
    """
    how = {"keep_default_na": False, "na_values": [""], "dtype": {"value": str}}
    return pd.concat([pd.read_csv(io.StringIO(read_text(path)), **how) for path in paths], ignore_index=True)
