"""The writer of tables: the same cells in three forms."""

import numpy as np
import pandas as pd

from palpate.results.tables import display, latex, markdown, write_table


def cells(text: str, between: str, end: str = "") -> list[list[str]]:
    """The cells of each line, without the space that aligns them."""
    return [[cell.strip() for cell in line.removesuffix(end).strip("| ").split(between)] for line in text.splitlines()]


def test_latex_holds_the_same_cells(tmp_path):
    table = pd.DataFrame({"a_b": ["50 % & more", None, r"x_1^2 \{~"], "n": [1.5, np.nan, 2.0]})
    table.attrs["note"] = "A note."
    lines = latex(table).splitlines()
    assert lines[:2] == [r"\begin{tabular}{lr}", r"\toprule"] and lines[3] == r"\midrule"
    assert cells("\n".join([lines[2], *lines[4:7]]), " & ", r"\\") == [
        ["a b", "n"],
        [r"50 \% \& more", "1.5"],
        ["--", "--"],
        [r"x\_1\textasciicircum{}2 \textbackslash{}\{\textasciitilde{}", "2.0"],
    ]
    assert lines[7:] == [r"\bottomrule", r"\end{tabular}", "% A note."]
    write_table(table, tmp_path / "a.csv")
    assert (tmp_path / "a.tex").read_text() == latex(table)


def test_markdown_of_awkward_cells():
    text = markdown(pd.DataFrame({"a_b": ["x|y", None], "n": [1.5, np.nan]}))
    lines = text.splitlines()
    assert [lines[0], *lines[2:]] == ["| a b   |   n |", r"| x\|y  | 1.5 |", "| –     |   – |"]
    assert lines[1].startswith("|:--") and lines[1].endswith("-:|")


def test_a_table_with_decimals_shows_numbers_and_intervals_in_one_cell(tmp_path):
    table = pd.DataFrame(
        {
            "model": ["a", "b"],
            "error": [1.23456789, 2.0],
            "error_low": [1.0, np.nan],
            "error_high": [1.5, np.nan],
            "error_median": [0.5, np.nan],
            "error_paper": [np.nan, 0.5],
            "objects": [3, 4],
        }
    )
    table.attrs |= {"decimals": 3, "exact": {"error": 2}}
    shown = display(table)
    assert shown.to_numpy().tolist() == [["a", "1.23 [1.00, 1.50] (0.50)", "–", "3"], ["b", "2.00", "0.50", "4"]]
    table.attrs = {"decimals": None}
    assert display(table)["error"].tolist() == ["1.23 [1, 1.5] (0.5)", "2"]
    write_table(table, tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text().splitlines()[1] == "a,1.23457,1,1.5,0.5,,3"
    assert cells((tmp_path / "table.md").read_text(), "|")[2] == ["a", "1.23 [1, 1.5] (0.5)", "–", "3"]


def test_a_table_without_rows_is_written():
    table = pd.DataFrame(columns=["a", "b"])
    assert cells(markdown(table), "|")[0] == ["a", "b"] and r"\begin{tabular}{ll}" in latex(table)
