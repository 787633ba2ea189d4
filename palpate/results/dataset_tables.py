"""The dataset's tables: each is one DataFrame, written as CSV, as Markdown and as LaTeX.

The statistics work on three plain frames, which `dataset_frames` reads from a run:

| frame | one row a | columns |
|---|---|---|
| objects | catalogued object | object, class, split |
| rejected | rejected object | object, stage, reason |
| grasps | grasp | object, class, successful_touches (0..4), touches (4), attempts, penetration (m) |
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from palpate.catalogue import SPLITS, read_catalogue
from palpate.hand import SENSORS
from palpate.results.published import paper_values
from palpate.results.statistics import ratio, ratio_interval
from palpate.dataset import Dataset

TOTAL = "total"
MILLIMETRES = 1000.0


class Frames(NamedTuple):
    """What the tables are counted from; see the module's table."""

    objects: pd.DataFrame
    rejected: pd.DataFrame
    grasps: pd.DataFrame


def dataset_frames(run: Path | str) -> Frames:
    """The frames of a run's folder: from its catalogue, its grasps and touch stores, and the rejections up to
    touch, so that the tables are the same whether images have been rendered or not."""
    run = Path(run)
    objects = pd.DataFrame(read_catalogue(run / "catalogue.csv")).rename(columns={"class_name": "class"})
    dataset = Dataset(run, stages=("released", "meshes", "surface", "grasps", "touch"))
    grasped = "grasps" in dataset.stages  # a released dataset comes without: nobody knows the attempts
    rejected = pd.DataFrame(dataset.rejections(), columns=["object", "stage", "reason"])
    if not len(dataset):
        return Frames(objects, rejected, _grasp_frame([], [], np.zeros((0, SENSORS), bool), [], []))
    success = dataset.array("touch", "success")[:]
    each = dataset.grasps_per_object
    penetration = dataset.array("grasps", "penetration")[:] if grasped else np.full(success.shape[:2], np.nan)
    grasps = _grasp_frame(
        np.repeat(dataset.objects, each),
        np.repeat([record.class_name for record in dataset], each),
        success.reshape(-1, SENSORS),
        np.repeat(dataset.array("grasps", "attempts")[:] if grasped else np.full(len(dataset), np.nan), each),
        penetration.ravel(),
    )
    return Frames(objects, rejected, grasps)


def _grasp_frame(names, classes, success: np.ndarray, attempts, penetration) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "object": np.asarray(names, dtype=object),
            "class": np.asarray(classes, dtype=object),
            "successful_touches": success.sum(axis=1),
            "touches": np.full(len(success), SENSORS),
            "attempts": np.asarray(attempts, dtype=float),
            "penetration": np.asarray(penetration, dtype=float),
        }
    )


def dataset_statistics(objects: pd.DataFrame, rejected: pd.DataFrame, grasps: pd.DataFrame) -> pd.DataFrame:
    """Size of the dataset by class and in total, the paper's values beside (`*_paper`).

    `objects` counts those with grasps, `attempted` all of the catalogue, `rejected` those that some stage
    could not use; `successful_percent` is the share of touches that met the object, with its bootstrap
    interval over objects (`_low`, `_high`); `attempts` is the mean number of grasps tried an object.
    A class without grasps has zeros, and no percentage.
    """
    published = paper_values("dataset_statistics").set_index(["class", "quantity"])["value"]
    rows = []
    for name, members, of_class in _classes(objects, grasps):
        kept = members[members["object"].isin(of_class["object"])]
        by_object = _by_object(of_class)
        counts = {
            "objects": len(kept),
            "grasps": len(of_class),
            "touches": int(of_class["touches"].sum()),
            "successful_percent": 100 * ratio(of_class["successful_touches"], of_class["touches"]),
        }
        low, high = ratio_interval(
            by_object["successful_touches"], by_object["touches"], strata=by_object["class"]
        )
        row = {"class": name}
        for quantity, value in counts.items():
            row[quantity] = value
            if quantity == "successful_percent":
                row |= {"successful_low": 100 * low, "successful_high": 100 * high}
            row[f"{quantity}_paper"] = published.get((name, quantity), np.nan)
        for split in SPLITS:
            row[split] = int((kept["split"] == split).sum())
            row[f"{split}_paper"] = published.get((name, split), np.nan)
        row["attempted"] = len(members)
        row["rejected"] = int(members["object"].isin(rejected["object"]).sum())
        row["attempts"] = by_object["attempts"].mean() if len(by_object) else np.nan
        rows.append(row)
    table = _round(pd.DataFrame(rows), percent="successful", other={"attempts": 1})
    table.attrs["note"] = (
        f"{_size_note(objects, grasps)} The paper counts 1731 objects in its supplement (text, table and "
        "splits) and 1732 in its main text; its 62.4 % is the main text's, while its table's classes average "
        "62.7 % by touches, and its shares of grasps with 1 to 4 successful touches imply 66.4 %."
    )
    return table


def grasp_success(objects: pd.DataFrame, grasps: pd.DataFrame) -> pd.DataFrame:
    """Share of grasps with 0 to 4 successful touches, by class and in total, the paper's shares beside.

    The paper states the shares over all classes only, and promises none with 0.
    """
    published = paper_values("grasp_success").set_index(["class", "successful_touches"])["value"]
    rows = []
    for name, _, of_class in _classes(objects, grasps):
        for touches in range(SENSORS + 1):
            by_object = _by_object(of_class.assign(hit=of_class["successful_touches"] == touches, one=1))
            low, high = ratio_interval(by_object["hit"], by_object["one"], strata=by_object["class"])
            rows.append(
                {
                    "class": name,
                    "objects": len(by_object),
                    "grasps": len(of_class),
                    "successful_touches": touches,
                    "percent": 100 * ratio(by_object["hit"], by_object["one"]),
                    "percent_low": 100 * low,
                    "percent_high": 100 * high,
                    "percent_paper": published.get((name, touches), np.nan),
                }
            )
    table = _round(pd.DataFrame(rows), percent="percent")
    table.attrs["note"] = _size_note(objects, grasps)
    return table


def penetration(objects: pd.DataFrame, grasps: pd.DataFrame) -> pd.DataFrame:
    """How deep the hand is inside the object (or itself) at the end of a grasp, in millimetres.

    A grasp's penetration is its worst one, as measured independently of the physics engine. Mean with its
    bootstrap interval over objects, 95th percentile and maximum over grasps. The paper reports none.
    """
    rows = []
    for name, _, of_class in _classes(objects, grasps):
        depth = MILLIMETRES * of_class["penetration"].to_numpy(float)
        by_object = _by_object(of_class.assign(depth=depth, one=1))
        low, high = ratio_interval(by_object["depth"], by_object["one"], strata=by_object["class"])
        rows.append(
            {
                "class": name,
                "objects": len(by_object),
                "grasps": len(of_class),
                "mean_mm": ratio(by_object["depth"], by_object["one"]),
                "mean_low_mm": low,
                "mean_high_mm": high,
                "percentile_95_mm": np.quantile(depth, 0.95) if len(depth) else np.nan,
                "max_mm": depth.max(initial=-np.inf) if len(depth) else np.nan,
            }
        )
    table = pd.DataFrame(rows).round(4)
    table.attrs["note"] = _size_note(objects, grasps)
    return table


def write_table(frame: pd.DataFrame, path: Path | str) -> None:
    """Write `path` (.csv) and, beside it, the same table as Markdown (.md) and LaTeX (.tex).

    The frame's `attrs["note"]`, if any, stands under these two; the CSV holds numbers only.
    Raises ValueError if the path does not end in .csv.
    """
    path = table_path(path)
    frame.to_csv(path, index=False, lineterminator="\n")
    path.with_suffix(".md").write_text(markdown(frame), encoding="utf-8")
    path.with_suffix(".tex").write_text(latex(frame), encoding="utf-8")


def table_path(path: Path | str) -> Path:
    """The path, its folder made; ValueError if it does not end in .csv."""
    path = Path(path)
    if path.suffix != ".csv":
        raise ValueError(f"{path}: a table's path ends in .csv (Markdown and LaTeX are written beside it)")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def markdown(frame: pd.DataFrame) -> str:
    """The frame as a Markdown table, numbers to the right, missing values as a dash; then its note."""
    numeric = [pd.api.types.is_numeric_dtype(frame[column]) for column in frame.columns]
    lines = [
        [str(column).replace("_", " ") for column in frame.columns],
        ["---:" if right else ":---" for right in numeric],
        *([_cell(value) for value in row] for row in frame.itertuples(index=False)),
    ]
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    note = frame.attrs.get("note")
    return f"{table}\n{note}\n" if note else table


def _cell(value) -> str:
    return "–" if pd.isna(value) else str(value).replace("|", r"\|")


LATEX = {
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "–": "--",
}


def latex(frame: pd.DataFrame) -> str:
    """The frame as a LaTeX tabular with the rules of package booktabs, numbers to the right, missing values
    as a dash; then its note, as a comment."""
    columns = "".join("r" if pd.api.types.is_numeric_dtype(frame[name]) else "l" for name in frame.columns)
    header = [str(name).replace("_", " ") for name in frame.columns]
    rows = [["–" if pd.isna(value) else value for value in row] for row in frame.itertuples(index=False)]
    lines = [
        " & ".join("".join(LATEX.get(letter, letter) for letter in str(value)) for value in row) + r" \\"
        for row in (header, *rows)
    ]
    note = frame.attrs.get("note")
    return "\n".join(
        [
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            lines[0],
            r"\midrule",
            *lines[1:],
            r"\bottomrule",
            r"\end{tabular}",
            *([f"% {note}"] if note else []),
            "",
        ]
    )


def _classes(objects: pd.DataFrame, grasps: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """(class, its objects, its grasps) in the catalogue's order, then all of them as the total."""
    for name in pd.unique(objects["class"]):
        yield name, objects[objects["class"] == name], grasps[grasps["class"] == name]
    yield TOTAL, objects, grasps


def _by_object(grasps: pd.DataFrame) -> pd.DataFrame:
    """Numbers summed over each object's grasps; `attempts`, which belongs to the object, is not summed."""
    numbers = grasps.select_dtypes(["number", "bool"]).columns
    how = {column: "first" if column == "attempts" else "sum" for column in numbers}
    return grasps.groupby("object", sort=False).agg({"class": "first", **how})


def _round(table: pd.DataFrame, percent: str, other: dict[str, int] | None = None) -> pd.DataFrame:
    """Columns that start with `percent` to two decimals; counts as integers that may be missing."""
    decimals = {column: 2 for column in table.columns if column.startswith(percent)} | (other or {})
    counts = [column for column in table.columns if column != "class" and column not in decimals]
    return table.round(decimals).astype(dict.fromkeys(counts, "Int64"))


def _size_note(objects: pd.DataFrame, grasps: pd.DataFrame) -> str:
    """What this run's numbers stand on, so that a small run is not taken for the paper's."""
    number = grasps["object"].nunique()
    return (
        f"This run: {number} objects, {len(grasps)} grasps, {objects['class'].nunique()} classes "
        "(the paper: 1731 objects, 8655 grasps, 4 classes). Intervals: 95 %, bootstrap over objects, within "
        "classes for the total; none where no class has two objects that differ."
    )
