"""The files of reports."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from palpate.atomic import atomic_write
from palpate.results.tables import markdown


def write(table: pd.DataFrame, path: Path | str) -> None:
    """Write a report as CSV, numbers to six digits, whole or not at all."""
    with atomic_write(path) as partial:
        table.to_csv(partial, index=False, float_format="%.6g")


def write_text(summary: pd.DataFrame, path: Path | str) -> None:
    """Write a summary as Markdown, whole or not at all."""
    with atomic_write(path) as partial:
        partial.write_text(markdown(summary))


def read(paths: Iterable[Path | str]) -> pd.DataFrame:
    """The tables of a report's items, one below the other; only an empty field is no value.

    The column `value` stays as it is written: numbers of one knob, words of another.
    """
    how = {"keep_default_na": False, "na_values": [""], "dtype": {"value": str}}
    items = [pd.read_csv(path, **how) for path in paths]
    return pd.concat(items, ignore_index=True)
