"""Summaries of the reports as small tables: fronts and chosen methods, cases, savings."""

import pandas as pd

from studies.error_vs_runtime.study import over_objects, setting
from studies.omitted.omission import SAME, verdict_text
from studies.stability.cases import FAILS, HOLDS, REJECTED

DIGITS = 3


def _number(value: float) -> str:
    return "–" if pd.isna(value) else f"{float(value):.{DIGITS}g}"


def fronts(table: pd.DataFrame) -> pd.DataFrame:
    """Methods of every stage that are on the front or chosen, means over all objects, sorted by time.

    `ms` has the quartiles of the rounds; a `?` marks a method whose time does not differ significantly from a
    neighbour's. The note names the reference of each stage's errors.
    """
    references = table.groupby("stage", sort=False)["reference"].first()
    rows = over_objects(table)
    rows = rows[rows["drawn"] & rows["error"].notna() & (rows["front"] | rows["chosen"])]
    rows = pd.concat([group.sort_values("seconds") for _, group in rows.groupby(["stage", "measure"], sort=False)])
    middle, low, high = ((1e3 * rows[key]).map(_number) for key in ("seconds", "seconds_low", "seconds_high"))
    columns = {
        "stage": rows["stage"],
        "measure": rows["measure"] + ", " + rows["unit"],
        "method": rows["method"],
        "knob": [setting(*knob) for knob in zip(rows["knob"], rows["value"], strict=True)],
        "error": rows["error"].map(_number),
        "ms": middle + " (" + low + " to " + high + ")" + rows["noisy"].map({True: "?", False: ""}),
        **{key: rows[key].map({True: key, False: ""}) for key in ("front", "chosen")},
    }
    summary = pd.DataFrame(columns).reset_index(drop=True)
    lines = "\n".join(f"- {stage}: {reference}" for stage, reference in references.items())
    summary.attrs["note"] = f"Errors are against:\n\n{lines}"
    return summary


def verdicts(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each case: numbers of findings that hold, are rejected, fail; the first failed, or else the first."""
    rows = []
    for (suite, case), findings in table.groupby(["suite", "case"], sort=False):
        count = findings["verdict"].value_counts()
        row = findings.sort_values("verdict", key=lambda verdict: verdict != FAILS, kind="stable").iloc[0]
        value, unit = pd.to_numeric(row["value"], errors="coerce"), row["unit"] if pd.notna(row["unit"]) else ""
        shown = str(row["value"] if pd.isna(value) else f"{_number(value)} {unit}").strip()
        counts = {verdict: int(count.get(verdict, 0)) for verdict in (HOLDS, REJECTED, FAILS)}
        example = f"{row['quantity']}: {shown} ({row['bound']})"
        rows.append({"suite": suite, "case": case, **counts, "for example": example})
    return pd.DataFrame(rows)


def savings(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each item: time and bytes with and without it, means over objects, and the largest difference."""
    rows = []
    for (stage, item), of in table.groupby(["stage", "item"], sort=False):
        same = set(of["verdict"]) == {SAME}
        rows.append(
            {
                "stage": stage,
                "item": item,
                "when": of["when"].iloc[0],
                "ms with": _number(1e3 * of["seconds_with"].mean()),
                "ms without": _number(1e3 * of["seconds_without"].mean()) + ("?" if of["noisy"].all() else ""),
                "KiB with": _number(of["bytes_with"].mean() / 1024),
                "KiB without": _number(of["bytes_without"].mean() / 1024),
                "largest difference": f"{_number(of['difference'].max())} {of['unit'].iloc[0]}",
                "verdict": verdict_text(same, of["state"].iloc[0]),
            }
        )
    return pd.DataFrame(rows)
