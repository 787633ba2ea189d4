"""The dataset's tables. They are computed from three plain frames, which `dataset_frames` reads from a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.catalogue import SPLITS, read_catalogue
from palpate.results import products
from palpate.results.bootstrap import Estimate, ratio_interval
from palpate.results.published import has_papers_classes, paper_values, without_paper

if TYPE_CHECKING:
    from pandas import DataFrame

    from palpate.dataset import Dataset

TOTAL = "total"


class Frames(NamedTuple):
    """The data of the tables. s: number of the hand's sensors."""

    objects: DataFrame  # a row a catalogued object: object, class, split
    rejected: DataFrame  # a row a rejected object: object, stage, reason
    grasps: DataFrame  # a row a grasp: object, class, successful_touches (0..s), touches (s), attempts


def dataset_frames(run: Path | str) -> Frames:
    """The frames of a run's folder: from its catalogue, its grasps and touch stores, and the rejections up to
    touch, so that the tables are the same whether images have been rendered or not."""
    import pandas as pd

    from palpate.dataset import Dataset

    run = Path(run)
    objects = pd.DataFrame(read_catalogue(run / "catalogue.csv")).rename(columns={"class_name": "class"})
    dataset = Dataset(run, stages=("released", "meshes", "surface", "grasps", "touch"))
    rejected = pd.DataFrame(dataset.rejections(), columns=["object", "stage", "reason"])
    grasps = dataset.table().rename(columns={"touches": "successful_touches"})
    grasps = grasps.reindex(columns=["object", "class", "successful_touches", "row"])
    grasps["touches"] = dataset.array("touch", "success").shape[2] if len(dataset) else 0
    has_grasps = len(dataset) and "grasps" in dataset.stages  # a released dataset has none
    grasps["attempts"] = dataset.array("grasps", "attempts")[:][grasps.pop("row")] if has_grasps else np.nan
    return Frames(objects, rejected, grasps.astype({"successful_touches": int, "attempts": float}))


@products.table(stores=("meshes", "surface", "grasps", "touch"), category="Dataset")
def dataset_statistics(frames: Frames) -> DataFrame:
    """Size of the dataset by class and in total, how many objects each split has, and the share of touches that met the
    object, with a 95 % bootstrap interval over objects (`successful_low`, `successful_high`). Columns that end in
    `_paper` hold the paper's values, if the run has any of its classes. `attempted` counts the catalogue's objects,
    `rejected` those that some stage could not use (`rejected.csv` has the reasons), `attempts` the mean number of
    grasps tried an object.

    `objects` counts those with grasps. A class without grasps has zeros, and no percentage."""
    objects, rejected, grasps = frames
    published = paper_values("dataset_statistics").set_index(["class", "quantity"])["value"]
    rows = []
    for name, members, class_grasps in _classes(objects, grasps):
        kept = members[members["object"].isin(class_grasps["object"])]
        by_object = _by_object(class_grasps)
        percent, low, high = (100 * each for each in _share(by_object, "successful_touches", "touches"))
        quantities: dict[str, float] = {"objects": len(kept), "grasps": len(class_grasps)}
        quantities |= {"touches": int(class_grasps["touches"].sum()), "successful_percent": percent}
        quantities |= {split: int((kept["split"] == split).sum()) for split in SPLITS}
        row: dict[str, Any] = {"class": name}
        for quantity, value in quantities.items():
            row |= {quantity: value}
            row |= {"successful_low": low, "successful_high": high} if quantity == "successful_percent" else {}
            row |= {f"{quantity}_paper": published.get((name, quantity), np.nan)}
        out = int(members["object"].isin(rejected["object"]).sum())
        attempts = by_object["attempts"].mean() if len(by_object) else np.nan
        rows.append(row | {"attempted": len(members), "rejected": out, "attempts": attempts})
    table = _table(rows, frames, percent="successful", other={"attempts": 1})
    if has_papers_classes(objects["class"]):
        table.attrs["note"] += (
            " The paper counts 1731 objects in its supplement (text, table and "
            "splits) and 1732 in its main text; its 62.4 % is the main text's, while its table's classes average "
            "62.7 % by touches, and its shares of grasps with 1 to 4 successful touches imply 66.4 %."
        )
    return table


@products.table(stores=("meshes", "surface", "grasps", "touch"), category="Dataset")
def grasp_success(frames: Frames) -> DataFrame:
    """Share of grasps with 0 to 4 successful touches, with a 95 % bootstrap interval over objects, and the paper's
    shares over all classes (if the run has any of its classes). No grasp should have 0."""
    from palpate.store.contract import SENSOR_NAMES

    objects, _, grasps = frames
    sensors = int(grasps["touches"].max()) if len(grasps) else len(SENSOR_NAMES)
    published = paper_values("grasp_success").set_index(["class", "successful_touches"])["value"]
    rows = []
    for name, _, class_grasps in _classes(objects, grasps):
        for touches in range(sensors + 1):
            by_object = _by_object(class_grasps.assign(hit=class_grasps["successful_touches"] == touches, one=1))
            share = _share(by_object, "hit", "one")
            row: dict[str, Any] = {"class": name, "objects": len(by_object), "grasps": len(class_grasps)}
            row |= {"successful_touches": touches, **share.columns("percent", 100)}
            rows.append(row | {"percent_paper": published.get((name, touches), np.nan)})
    return _table(rows, frames, percent="percent")


@products.table(stores=("meshes", "surface", "grasps", "touch", "hold"), category="Dataset", simulated=True)
def hold(dataset: Dataset) -> DataFrame:
    """Share of grasps whose hand keeps the object when it is let go, by class and by how many sensors touch: along all
    six directions of gravity, along some, and of all directions, with 95 % bootstrap intervals over objects. Grasps
    that the engine could not simulate are in `not_simulated` only."""
    import pandas as pd

    grasps = dataset.table()
    names = ("held", "held_along")
    held, along = (dataset.array("hold", name)[:] if len(dataset) else np.zeros((0, 6)) for name in names)
    kept = along.reshape(-1, 6) == 1
    shares = {"all": kept.all(axis=1), "some": kept.any(axis=1), "directions": kept.mean(axis=1)}
    grasps = grasps.assign(simulated=held.ravel() >= 0, **shares)
    rows = []
    for name, _, members in _classes(grasps.sort_values("class"), grasps):
        by_touches = [(str(number), members[members["touches"] == number]) for number in sorted(set(grasps["touches"]))]
        for touches, chosen in [*by_touches, ("any", members)]:
            of_objects = chosen[chosen["simulated"]].assign(one=1)[["object", "class", "one", *shares]]
            by_object = _by_object(of_objects)
            row = {"class": name, "touches": touches, "objects": len(by_object), "grasps": len(of_objects)}
            for share in shares:
                row |= _share(by_object, share, "one").columns(f"{share}_percent", 100)
            rows.append(row | {"not_simulated": int((~chosen["simulated"]).sum())})
    return pd.DataFrame(rows).round(2)


@products.table(stores=("surface", "press"), category="Dataset", simulated=True)
def presses(dataset: Dataset) -> DataFrame:
    """Presses by class and force (N), means over presses with 95 % bootstrap intervals over objects: area of contact
    within the image (mm²), how far the sensor goes on from its first touch (`depth`, mm), and the percentage of the
    force that is within the image. `pressure` is the mean of each press's largest (kPa), `strain` the largest of all.
    """
    import pandas as pd

    rows = []
    for record in dataset:
        for press in record.presses:
            area = (press.pressure > 0).sum(axis=(1, 2)) * np.prod(press.sensor.pixel)
            pressure = press.pressure.max(axis=(1, 2)).astype(float) / 1e3
            values = {"force": press.force, "area": 1e6 * area, "depth": 1e3 * press.approach, "one": 1}
            values |= {"inside_percent": 100 * press.inside, "pressure": pressure, "strain": press.strain}
            rows.append(pd.DataFrame({"object": record.name, "class": record.class_name} | values))
    if not rows:
        return pd.DataFrame({"class": [], "force": []})
    measured, table = pd.concat(rows), []
    for name, _, members in _classes(measured, measured):
        for force, chosen in members.groupby("force"):
            sums = _by_object(chosen)
            row: dict[str, Any] = {"class": name, "force": force, "objects": len(sums), "presses": len(chosen)}
            for column, most in {"area": np.inf, "depth": np.inf, "inside_percent": 100}.items():
                row |= ratio_interval(sums[column], sums["one"], sums["class"]).within(0, most).columns(column)
            table.append(row | {"pressure": chosen["pressure"].mean(), "strain": chosen["strain"].max()})
    return pd.DataFrame(table).round(3)


def _classes(objects: DataFrame, grasps: DataFrame) -> Iterator[tuple[str, DataFrame, DataFrame]]:
    """(class, its objects, its grasps) in the catalogue's order, then all of them as the total."""
    for name in objects["class"].unique():
        yield name, objects[objects["class"] == name], grasps[grasps["class"] == name]
    yield TOTAL, objects, grasps


def _by_object(grasps: DataFrame) -> DataFrame:
    """Numbers summed over each object's grasps; `attempts`, which belongs to the object, is not summed."""
    how = {name: "first" if name == "attempts" else "sum" for name in grasps.select_dtypes(["number", "bool"])}
    return grasps.groupby("object", sort=False).agg({"class": "first", **how})


def _share(by_object: DataFrame, hits: str, of: str) -> Estimate:
    """A share over all grasps or touches, between 0 and 1."""
    return ratio_interval(by_object[hits], by_object[of], by_object["class"]).within(0, 1)


def _table(rows: list[dict[str, Any]], frames: Frames, percent: str, other: dict[str, int] | None = None) -> DataFrame:
    """The rows as a table, with its note: columns that start with `percent` to two decimals, those of `other` to so
    many; counts as integers that may be missing."""
    import pandas as pd

    table = without_paper(pd.DataFrame(rows), frames.objects["class"])
    decimals = {column: 2 for column in table.columns if column.startswith(percent)} | (other or {})
    counts = [column for column in table.columns if column != "class" and column not in decimals]
    table = table.round(decimals).astype(dict.fromkeys(counts, "Int64"))
    objects, classes = frames.grasps["object"].nunique(), frames.objects["class"].unique()
    papers = " (the paper: 1731 objects, 8655 grasps, 4 classes)" if has_papers_classes(classes) else ""
    table.attrs["note"] = (
        f"This run: {objects} objects, {len(frames.grasps)} grasps, {len(classes)} classes{papers}. Intervals: 95 %, "
        "bootstrap over objects, within classes for the total; none where a class has one object, or where no object "
        "differs."
    )
    return table
