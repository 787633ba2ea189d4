"""Tables as files: CSV with all numbers in columns of their own; Markdown and LaTeX for reading.

Three entries of a DataFrame's `attrs` say how it is written: `note`, what stands under it in Markdown and LaTeX;
`decimals` of the numbers there, where a number then shares a cell with its interval, in brackets, and the median, in
parentheses (None: three significant digits; without this entry numbers are shown as the frame has them); and `exact`,
column -> decimals, where a column has its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pandas import DataFrame

from palpate.atomic import atomic_write
from palpate.seal import MadeFrom

MISSING = "–"
ENDINGS = ("_low", "_high", "_median")  # of columns that share a cell with their number


def write_table(table: DataFrame, path: Path | str, made_from: MadeFrom | None = None) -> None:
    """Write `path` (.csv) and, beside it, the same table as Markdown (.md) and LaTeX (.tex), with their seals."""
    path = Path(path)
    float_format = "%.6g" if "decimals" in table.attrs else None
    forms = {
        ".md": markdown(table),
        ".tex": latex(table),
        ".csv": table.to_csv(index=False, lineterminator="\n", float_format=float_format),
    }
    for suffix, text in forms.items():
        with atomic_write(path.with_suffix(suffix), made_from) as partial:
            partial.write_text(text, encoding="utf-8")


def markdown(table: DataFrame) -> str:
    """The table in Markdown: numbers to the right, missing values as a dash; then its note."""
    text = _tabulated(table, "pipe", lambda cell: cell.replace("|", r"\|"))
    note = table.attrs.get("note")
    return text + (f"\n\n{note}\n" if note else "\n")


def latex(table: DataFrame) -> str:
    """The table as a LaTeX tabular with the rules of package booktabs; then its note, as a comment."""
    text = _tabulated(table, "latex_booktabs", lambda cell: cell.replace(MISSING, "--"))
    text, note = text.replace(r"\^{}", r"\textasciicircum{}"), table.attrs.get("note")
    return text + (f"\n% {note}\n" if note else "\n")


def display(table: DataFrame) -> DataFrame:
    """The table as it is read: every cell as text; with `decimals`, each number with its interval and its median."""
    import pandas as pd

    shown, joined = {}, "decimals" in table.attrs
    for name in table:
        if joined and name.endswith(ENDINGS) and name.rsplit("_", 1)[0] in table:
            continue
        columns = [f"{name}{ending}" for ending in ("", *ENDINGS)]
        if joined and table[name].dtype.kind == "f":
            cells = zip(*(table.get(column, [math.nan] * len(table)) for column in columns), strict=True)
            shown[name] = [_number(table, name, *numbers) for numbers in cells]
        else:
            shown[name] = [MISSING if pd.isna(value) else str(value) for value in table[name]]
    return pd.DataFrame(shown, dtype=object)


def _tabulated(table: DataFrame, form: str, changed: Callable[[str], str]) -> str:
    from tabulate import tabulate

    cells, plain = display(table).map(changed), "decimals" not in table.attrs
    sides = ["right" if plain and table[name].dtype.kind in "biuf" else "left" for name in cells]
    header = [str(name).replace("_", " ") for name in cells]
    # Without rows tabulate has no columns to align.
    rows = cells.to_numpy().tolist() or [[""] * len(header)]
    return tabulate(rows, header, tablefmt=form, colalign=sides, disable_numparse=True)


def _number(table: DataFrame, name: str, *numbers: float) -> str:
    """numbers: value, low, high, median; what is nan is left out."""
    decimals = table.attrs.get("exact", {}).get(name.removesuffix("_paper"), table.attrs["decimals"])
    form = ".3g" if decimals is None else f".{decimals}f"
    value, low, high, median = (MISSING if math.isnan(number) else format(number, form) for number in numbers)
    interval = "" if MISSING in (low, high) else f" [{low}, {high}]"
    return value + interval + ("" if median == MISSING else f" ({median})")
