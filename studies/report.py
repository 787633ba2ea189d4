"""Makes the tables of a report's items and joins them, without Snakemake.

    from studies.threads import one_thread
    one_thread()                                      # before anything that computes is imported
    from studies import report
    report.measure("stability", "rays", "results/default")

Each item is a module `studies.<report>.<item>`, loaded when it is measured: it loads the engines of its own stage only.
"""

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from palpate.atomic import atomic_write
from studies import figures, subjects, summaries, tables
from studies.error_vs_runtime import study
from studies.omitted import omission
from studies.stability import cases
from studies.timing import ROUNDS


class Joined(NamedTuple):
    """How the tables of a report's items become one: a summary, a figure, columns that only the items' tables have."""

    summarise: Callable[[pd.DataFrame], pd.DataFrame]
    draw: Callable[[pd.DataFrame, Path], None]
    dropped: tuple[str, ...] = ()


JOINED = {
    "error_vs_runtime": Joined(summaries.fronts, figures.fronts, dropped=("reference",)),
    "stability": Joined(summaries.verdicts, figures.margins),
    "omitted": Joined(summaries.savings, figures.savings),
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
    """The table of one item of a report, measured on objects of a run.

    Args:
        report, item: keys of `studies.items.REPORTS`.
        run: the run's folder.
        settings: the sections of the config that the item depends on.
        objects: how many of the run's objects; `stability` takes one.
        rounds: in each of which every method is timed once.
        batches: those to take objects from; all if None.

    Raises ValueError if no object of the run is usable.
    """
    module = importlib.import_module(f"studies.{report}.{item}")
    picked = subjects.pick(run, objects, batches)
    if report == "stability":
        return cases.report(item, module.CASES, picked[0])
    if report == "omitted":
        return omission.report(module.omissions(Path(run), picked, settings or {}), rounds)
    return study.measure(module.study(Path(run), picked, settings or {}), rounds)


def join(report: str, items: Iterable[Path | str], table: Path | str, text: Path | str, figure: Path | str) -> None:
    """Join the tables of a report's items: all rows as CSV, a summary as Markdown, a figure as PNG."""
    joined = JOINED[report]
    rows = tables.read(items)
    tables.write(rows.drop(columns=list(joined.dropped)), table)
    tables.write_text(joined.summarise(rows), text)
    with atomic_write(figure) as path:
        joined.draw(rows, path)
