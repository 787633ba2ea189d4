"""The models' tables: measured averages with their intervals, the paper's values beside.

Each function gives a DataFrame of numbers. A measured column `x` is followed by `x_low` and `x_high`, its
95 % interval, and `x_paper` where the paper states it. `between_seeds` is how far two seeds of a row's model differ in
its average; with one seed it is left out. The frame's `attrs["note"]` describes the data behind its
numbers; `palpate.results.tables` writes it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from palpate.evaluation.rows import QUALITY, EvaluationError
from palpate.protocol import CHAMFER_SCALE, PIXEL2MESH_SCALE, RINGS, TAU, pixel2mesh_chamfer
from palpate.results.bootstrap import RESAMPLES, Estimate
from palpate.results.errors import AVERAGE, Errors, errors
from palpate.results.published import has_papers_classes, paper_values, without_paper
from palpate.training.tuning import summary

STRATEGY_NAMES = {
    "sphere": "sphere-based",
    "no_copy": "charts, no copying",
    "no_comm": "charts, no communication",
    "charts": "charts",
    "psg": "PSG",
    "pixel2mesh": "Pixel2Mesh",
    "r2n2": "3D-R2N2",
}
# Rows measured for the table of single images: ours, and the published networks that are built here.
SINGLE_IMAGE_NAMES = STRATEGY_NAMES | {"charts": "charts (ours)"}
VISION_NAMES = {"occluded": "occluded", "unoccluded": "unoccluded", "views": "views", "none": "–"}
PAPER_OBJECTS = {"validation": 258, "test": 175}  # supplement, Dataset Statistics
TOUCH_PARTS = {"cloud": "local point cloud", "chart": "touch chart"}
STEPS_NOTE = " The paper trained for at most 260 epochs in batches of 16."
QUALITY_LABELS = {"bend": "bend_degrees", "folded": "folded_percent", "gap": "gap_mm", "across": "across_degrees"}
QUALITY_NOTE = (
    " bend: mean angle between adjacent faces of a chart; folded: pairs of them bent by more than 90 degrees; gap: "
    "mean distance of boundary vertices that the initial sphere joins; across: mean angle between a face and the true "
    "surface. Vision charts only."
)

# Name -> strategy, vision, touch, grasps and what else, as in config/experiments.yaml.
Experiments = Mapping[str, Mapping[str, Any]]
SETUP = ("strategy", "vision", "touch", "grasps")  # what makes a row of the paper's tables
PAPERS_GRAPH = "paper's graph, equation 1"  # touch charts in the graph, `architecture: {touch: graph}`


def model_selection(
    evaluations: pd.DataFrame, experiments: Experiments, split: str = "validation", resamples: int = RESAMPLES
) -> pd.DataFrame:
    """Chamfer distance (m^2 x 9000) of each experiment, by class and on average (table "Model selection").

    evaluations: rows of `rows.read`; experiments: those of the table, in its order.
    Raises EvaluationError if one is missing.
    """
    found = errors(evaluations, list(experiments), split)
    published = paper_values("model_selection").set_index(["experiment", "class"])["value"]
    rows = []
    for number, (name, setup) in enumerate(experiments.items(), start=1):
        row = {
            "row": number,
            "experiment": name,
            **_inputs(setup),
        }
        rows.append(row | _by_class(found, name, name, published, resamples) | size_columns(found, name))
    return _finish(rows, split, found, STEPS_NOTE)


def input_modalities(
    evaluations: pd.DataFrame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> pd.DataFrame:
    """Chamfer distance (m^2 x 9000) with different inputs, by class and on average (table "Test set
    results"); the paper states averages only.

    A model with another architecture is a row of its own, labelled with it, beside the paper's value of the same
    set-up; the paper's claims are decided by the experiments of the paper's names alone.
    """
    found = errors(evaluations, list(experiments), split)
    published = paper_values("input_modalities").set_index(["experiment", "class"])["value"]
    stated = {_setup(experiments[name]): name for name, _ in published.index if name in experiments}
    rows = []
    for name, setup in experiments.items():
        row = {"experiment": name, **_inputs(setup)}
        by_class = _by_class(found, name, stated.get(_setup(setup), name), published, resamples)
        rows.append(row | by_class | size_columns(found, name))
    return _finish(rows, split, found, STEPS_NOTE)


def local_touch_charts(touches: pd.DataFrame, split: str = "test", resamples: int = RESAMPLES) -> pd.DataFrame:
    """Chamfer distance (m^2 x 9000) of local predictions to the true local cloud, by class and on average
    (table "Chamfer distance per class for local point cloud prediction"): the predicted cloud's, and that of
    the chart fitted to it, of which the paper states nothing.

    touches: rows of `rows.read` with `TOUCH_COLUMNS`.
    """
    found = touch_errors(touches, split)
    published = paper_values("local_touch_charts").assign(part="cloud").set_index(["part", "class"])["value"]
    rows = [
        {"prediction": label} | _by_class(found, part, part, published, resamples) | size_columns(found, part)
        for part, label in TOUCH_PARTS.items()
    ]
    counts = touches[touches["split"] == split]
    note = f" {len(counts)} successful touches; an object's error is the mean over its touches."
    return _finish(rows, split, found, note, decimals=5)


def touch_errors(touches: pd.DataFrame, split: str) -> Errors:
    """Errors of local predictions as of two experiments, `cloud` and `chart`."""
    long = touches.assign(seed=0).melt(
        [name for name in (*touches.columns, "seed") if name not in TOUCH_PARTS],
        list(TOUCH_PARTS),
        var_name="part",
        value_name="chamfer",
    )
    return errors(long, list(TOUCH_PARTS), split, key="part")


def grasps(
    evaluations: pd.DataFrame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> pd.DataFrame:
    """Chamfer distance (m^2 x 9000) against the number of grasps, a row a set-up (supplement, table "Chamfer
    distance when increasing the number of grasps").

    A set-up is what experiments share but for their number of grasps. Raises EvaluationError if one is
    missing.
    """
    found = errors(evaluations, list(experiments), split)
    published = paper_values("grasps").set_index("experiment")["value"]
    rows = []
    for label, members in setups(experiments).items():
        row: dict[str, Any] = {"input": label}
        for count, name in sorted(members.items()):
            row |= _columns(f"grasps_{count}", found.estimate([name], resamples=resamples))
            row[f"grasps_{count}_paper"] = published.get(name, np.nan)
        rows.append(row | size_columns(found, *members.values()))
    return _finish(rows, split, found, STEPS_NOTE)


def setups(experiments: Experiments) -> dict[str, dict[int, str]]:
    """Experiments by their inputs: label -> {number of grasps: name}, in the order given."""
    found: dict[str, dict[int, str]] = {}
    for name, setup in experiments.items():
        found.setdefault(input_label(setup), {})[setup["grasps"]] = name
    return found


def input_label(setup: Mapping[str, Any]) -> str:
    """An experiment's inputs as text: `unoccluded vision + touch`, and whether touch enters by the paper's graph."""
    names = {"none": [], "views": ["single view"]}
    vision = names.get(setup["vision"], [f"{setup['vision']} vision"])
    return _with_graph(" + ".join([*vision, *(["touch"] if setup["touch"] else [])]) or "nothing", setup)


def model_label(setup: Mapping[str, Any]) -> str:
    """An experiment's strategy as text, and whether touch enters by the paper's graph."""
    return _with_graph(STRATEGY_NAMES[setup["strategy"]], setup)


def _with_graph(label: str, setup: Mapping[str, Any]) -> str:
    in_graph = setup["touch"] and setup.get("architecture", {}).get("touch") == "graph"
    return f"{label} ({PAPERS_GRAPH})" if in_graph else label


def _inputs(setup: Mapping[str, Any]) -> dict[str, str]:
    """The columns that say what a row's model is and takes."""
    vision, touch = VISION_NAMES[setup["vision"]], "yes" if setup["touch"] else "no"
    return {"model": model_label(setup), "vision": vision, "touch": touch}


def _setup(experiment: Mapping[str, Any]) -> tuple:
    return tuple(experiment[key] for key in SETUP)


def extrapolation(
    rings: pd.DataFrame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> pd.DataFrame:
    """Mean squared distance from the true surface in square rings around each touch to the prediction
    (supplement, table "Local Chamfer distance in increasingly large square rings"): in m^2 as there, and
    multiplied by 9000 as everywhere else.

    rings: rows of `rows.read` with `RING_COLUMNS`.
    """
    found = ring_errors(rings, list(experiments), split)
    published = paper_values("extrapolation").set_index(["experiment", "ring"])["value"]
    rows = []
    for unit, scale in (("m^2", 1.0), ("m^2 x 9000", CHAMFER_SCALE)):
        for name, setup in experiments.items():
            row: dict[str, Any] = {"input": input_label(setup), "unit": unit}
            for ring in RINGS:
                estimate = found.estimate([ring_key(name, ring)], resamples=resamples)
                row |= _columns(f"x{ring}", Estimate(*(scale * number for number in estimate)))
                row[f"x{ring}_paper"] = scale * published.get((name, ring), np.nan)
            rows.append(row | size_columns(found, *(ring_key(name, ring) for ring in RINGS)))
    note = (
        " One direction: from the true surface to the prediction. The published evaluation averages over all "
        "touches; here an object's error is the mean over its touches, and classes have the same share."
    )
    return _finish(rows, split, found, note, decimals=None)


def ring_key(experiment: str, ring: int) -> str:
    """Name under which `ring_errors` keeps an experiment's errors in one ring."""
    return f"{experiment} x{ring}"


def ring_errors(rings: pd.DataFrame, experiments: Sequence[str], split: str) -> Errors:
    """Errors in rings as of so many experiments, named by `ring_key`. An object that has no surface in one of
    the rings around any of its touches is omitted from all."""
    known = set(rings.loc[rings["split"] == split, "experiment"])
    for name in experiments:
        if name not in known:
            raise EvaluationError(
                f"no ring evaluation of experiment {name!r} on the {split} split; there are {sorted(known)}"
            )
    rings = rings[rings["experiment"].isin(experiments) & (rings["split"] == split)]
    by_object = rings.groupby(["object", "experiment", "seed", "ring"])["distance"].mean()
    empty = by_object[by_object.isna()].index.get_level_values("object").unique()
    rings = rings[~rings["object"].isin(empty)].dropna(subset="distance")
    keys = [ring_key(name, ring) for name in experiments for ring in RINGS]
    named = rings.assign(key=rings["experiment"] + " x" + rings["ring"].astype(str))
    return errors(named, keys, split, column="distance", key="key")


def single_image(
    evaluations: pd.DataFrame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> pd.DataFrame:
    """Single-image reconstruction by Pixel2Mesh's protocol (supplement, table "Single image 3D shape
    reconstructing results"): the models measured here first, then the paper's own row, then those that it cites.

    Column `source` is `measured` or `cited`: what is cited was measured on other objects. `chamfer` is in thousandths
    at the protocol's scale, `f1_tau` and `f1_2tau` in percent.
    """
    columns = ("chamfer", "f1_tau", "f1_2tau")
    scores = {column: errors(evaluations, list(experiments), split, column) for column in columns}
    found, rows = scores["chamfer"], []
    for name, setup in experiments.items():
        row: dict[str, Any] = {"source": "measured", "method": SINGLE_IMAGE_NAMES[setup["strategy"]], "from": name}
        for column in columns:
            estimate = scores[column].estimate([name], resamples=resamples)
            if column == "chamfer":
                estimate = Estimate(*(pixel2mesh_chamfer(number) for number in estimate))
            row |= _columns(column, estimate)
        rows.append(row | size_columns(found, name))
    published = paper_values("single_image").sort_values("cited_by_the_paper", kind="stable")
    for record in published.to_dict("records"):
        cited = record["cited_by_the_paper"] == "yes"
        rows.append(
            {
                "source": "cited",
                "method": record["method"],
                "from": "cited by the paper" if cited else "the paper",
                **{column: record[column] for column in ("chamfer", "f1_tau", "f1_2tau")},
            }
        )
    note = (
        " Pixel2Mesh's protocol as in Mesh R-CNN's evaluation: meshes scaled by "
        f"{PIXEL2MESH_SCALE:.2f} (0.57 for a bounding box of diagonal 1; here it is 0.5), squared distances, "
        f"tau = {TAU:g}; Chamfer distance in "
        "thousandths. Measured rows: models of this run, trained on the same views for the same processor time; "
        "PSG, Pixel2Mesh and 3D-R2N2 built from their publications (docs/single_image.md). Cited rows: of ShapeNet's "
        "13 classes and published renderings, not this run's objects."
    )
    return _finish(rows, split, found, note, decimals=2, exact={"chamfer": 3})


def surface_quality(
    evaluations: pd.DataFrame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> pd.DataFrame:
    """How smooth predicted surfaces are, on average over classes: the columns that
    `palpate.evaluation.surface_quality` explains. The paper states nothing of it."""
    scores = {column: errors(evaluations, list(experiments), split, column) for column in QUALITY}
    rows = []
    for name, setup in experiments.items():
        row: dict[str, Any] = {"experiment": name, **_inputs(setup)}
        for column, label in QUALITY_LABELS.items():
            row |= _columns(label, scores[column].estimate([name], resamples=resamples))
        rows.append(row | size_columns(scores["bend"], name))
    return _finish(rows, split, scores["bend"], QUALITY_NOTE, decimals=1)


def tuning(points: Sequence[Mapping[str, Any]], trained: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """The points of the grid of hyperparameters with the result of each, the lowest validation loss first.

    points: of `palpate.training.tuning.grid`; trained: the `training.json` of each.
    """
    table = pd.DataFrame(summary(points, trained))
    machines = sorted({training["machine"]["found"] for training in trained})
    table.attrs["note"] = (
        f"Validation loss of {trained[0]['validated']} samples, the best of all evaluations; on {', '.join(machines)}."
    )
    return table


def _by_class(found: Errors, name: str, stated: str, published: pd.Series, resamples: int) -> dict[str, float]:
    """An experiment's measured and published columns: each class, then the average, and how far two seeds differ in it.

    stated: the experiment whose published values stand beside.
    """
    row = {}
    for label in (*found.class_names, AVERAGE):
        part = found if label == AVERAGE else found.of_class(label)
        row |= _columns(label, part.estimate([name], resamples=resamples))
        row[f"{label}_paper"] = published.get((stated, label), np.nan)
    return row | {"between_seeds": found.between_seeds([name])}


def _columns(label: str, estimate: Estimate) -> dict[str, float]:
    return {label: estimate.value, f"{label}_low": estimate.low, f"{label}_high": estimate.high}


def size_columns(found: Errors, *names: str) -> dict[str, Any]:
    """Columns with the data behind a row's numbers: objects, seeds, steps."""
    low = min(found.steps[name][0] for name in names)
    high = max(found.steps[name][1] for name in names)
    return {
        "objects": len(found.objects),
        "seeds": min(len(found.values[name]) for name in names),
        "steps": str(low) if low == high else f"{low} to {high}",
    }


def intervals_note(seeds: int) -> str:
    """What stands in brackets in a table of models with so many seeds."""
    over = "objects, within classes, and over seeds" if seeds > 1 else "objects only, within classes"
    known = "" if seeds > 1 else " One seed: nothing is known of the spread between trainings."
    return f"In brackets: 95 % bootstrap interval over {over}; none where a class has a single object.{known}"


def _between_seeds(found: Errors) -> str:
    """How far two seeds of one model differ, over all models of a table."""
    # A difference of logarithms is a relative difference.
    shares = np.array([found.between_seeds([name], lambda means: np.log(means[..., 0])) for name in found.values])
    if np.isnan(shares).all():
        return ""
    return (
        f" Two seeds of one model differ by {100 * shares.mean():.1f} % of its average (mean over models; "
        f"{100 * shares.max():.1f} % at most)."
    )


def _finish(
    rows: list[dict],
    split: str,
    found: Errors,
    note: str,
    decimals: int | None = 3,
    exact: dict[str, int] | None = None,
) -> pd.DataFrame:
    """The frame, with its note and how its numbers are printed; no columns of values that nobody states."""
    table = without_paper(pd.DataFrame(rows), found.class_names)
    empty = [name for name in table if name.endswith(("_paper", "between_seeds")) and table[name].isna().all()]
    table = table.drop(columns=empty).astype({"objects": "Int64", "seeds": "Int64"})
    classes = ", ".join(f"{np.sum(found.classes == name)} {name}" for name in found.class_names)
    seeds = min(map(len, found.values.values()))
    papers = f"; the paper: {PAPER_OBJECTS[split]}" if has_papers_classes(found.class_names) else ""
    table.attrs["note"] = (
        f"This run: {len(found.objects)} objects of the {split} split ({classes}){papers}.{note} "
        f"{intervals_note(seeds)}{_between_seeds(found)}"
    )
    table.attrs["decimals"] = decimals
    table.attrs["exact"] = exact or {}
    return table
