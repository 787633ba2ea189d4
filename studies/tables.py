"""The files of reports."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from palpate.atomic import atomic_write
from palpate.results.tables import markdown


def write(table: pd.DataFrame, path: Path | str) -> None:
    """Write a report as CSV with six digits, atomically."""
    with atomic_write(path) as partial:
        table.to_csv(partial, index=False, float_format="%.6g")


def write_text(summary: pd.DataFrame, path: Path | str) -> None:
    """Write a summary as Markdown, atomically."""
    with atomic_write(path) as partial:
        partial.write_text(markdown(summary))


def read(paths: Iterable[Path | str]) -> pd.DataFrame:
    """Read and concatenate the tables of a report's items; only an empty field is a missing value.

    The column `value` stays text: it holds numbers or words, depending on the knob.
    """
    how = {"keep_default_na": False, "na_values": [""], "dtype": {"value": str}}
    items = [pd.read_csv(path, **how) for path in paths]
    return pd.concat(items, ignore_index=True)
