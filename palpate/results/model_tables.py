"""The models' tables: measured averages with their intervals, the paper's values beside.

A measured column `x` is followed by `x_low` and `x_high`, its 95 % interval; an error also by `x_median`, the median
over objects; then `x_paper`, where the paper states it. `method` says whose a row is: the paper's, ours, or a look-up.
`between_seeds` is how far two seeds of a row's model differ in its average; `weights` names the experiment whose
trained model a row is, if it is another's. Columns that nothing stands in are left out.

evaluations: rows of `rows.read`; rings: the same with `RING_COLUMNS`, touches: with `TOUCH_COLUMNS`, selections: with
`SELECTION_COLUMNS`. experiments: those of the table. The functions raise EvaluationError if one is missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.experiments import Experiment
from palpate.learning.rows import QUALITY
from palpate.protocol import CHAMFER_SCALE, PIXEL2MESH_SCALE, RINGS, TAU, pixel2mesh_chamfer
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES, ratio
from palpate.results.errors import AVERAGE, Errors, errors, of_split
from palpate.results.published import has_papers_classes, paper_values, stated, without_paper

if TYPE_CHECKING:
    from pandas import DataFrame as Frame
    from pandas import Series

PAPER_OBJECTS = {"validation": 258, "test": 175}  # supplement, Dataset Statistics
TOUCH_ESTIMATES = {"cloud": "local point cloud", "chart": "touch chart"}
MEDIANS_NOTE = " In parentheses: median over objects."
COMMUNICATION_NOTE = (
    " Communication is edges of the graph to touch charts in the paper's method, and pooling by nearness in ours, "
    "which also bends charts to touched points. Without it touch charts are copied into the mesh, and vision charts "
    "do not depend on them."
)
STEPS_NOTE = " The paper trained for at most 260 epochs in batches of 16."
QUALITY_LABELS = {"bend": "bend_degrees", "folded": "folded_percent", "gap": "gap_mm", "across": "across_degrees"}
QUALITY_NOTE = (
    " bend: mean angle between adjacent faces of a chart; folded: pairs of them bent by more than 90 degrees; gap: "
    "mean distance of boundary vertices that the initial sphere joins; across: mean angle between a face and the true "
    "surface. Of charts the vision charts only."
)

Experiments = Mapping[str, Experiment]


@products.table(evaluations="model_selection")
def model_selection(
    evaluations: Frame, experiments: Experiments, split: str = "validation", resamples: int = RESAMPLES
) -> Frame:
    """Model selection: Chamfer distance (9000 times m²) on the validation split, by class and on average, of the
    paper's twelve models and of ours."""
    number = paper_values("model_selection").drop_duplicates("experiment").set_index("experiment")["row"]
    table = _errors_by_class("model_selection", evaluations, experiments, split, resamples)
    table.insert(0, "row", table["experiment"].map(number).astype("Int64"))
    return table


@products.table(evaluations="input_modalities", splits=("test", "validation"))
def input_modalities(
    evaluations: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> Frame:
    """Different input modalities: Chamfer distance (9000 times m²) of the paper's model and of ours on the test split,
    by class and on average; and the average on the validation split. Rows of other methods stand beside the paper's
    value of the same inputs."""
    table = _errors_by_class("input_modalities", evaluations, experiments, split, resamples)
    other = errors(evaluations, list(experiments), "validation")
    rows = [error_columns("validation", other, name, resamples) for name in experiments]
    place = table.columns.get_loc("average_median") + 1
    for number, column in enumerate(rows[0]):
        table.insert(place + number, column, [row[column] for row in rows])
    return table


@products.table(evaluations="grasps")
def grasps(evaluations: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES) -> Frame:
    """More grasps: Chamfer distance (9000 times m²) of models that take 1 to 5 grasps, on the test split."""
    measured, published, rows = errors(evaluations, list(experiments), split), stated("grasps"), []
    for (method, inputs), members in setups(experiments).items():
        row: dict[str, Any] = {"method": method, "input": inputs}
        for count, name in sorted(members.items()):
            row |= error_columns(f"grasps_{count}", measured, name, resamples)
            row[f"grasps_{count}_paper"] = published.get(experiments[name].stated_as, np.nan)
        rows.append(row | size_columns(measured, *members.values()))
    return _finish(rows, split, measured, STEPS_NOTE)


@products.table(rings="extrapolation")
def extrapolation(rings: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES) -> Frame:
    """Around touch sites: mean squared distance from the true surface to the prediction, in square rings of 1 to 5
    times the sensor's size around each touch (ring r lies between r - 1 and r times); in m² as in the paper, and 9000
    times that. Charts without communication are copied into the mesh and change nothing else: where another row with
    touch has a lower error, it extrapolates."""
    measured, published, rows = ring_errors(rings, list(experiments), split), stated("extrapolation"), []
    for unit, scale in (("m^2", 1.0), ("m^2 x 9000", CHAMFER_SCALE)):
        for name, experiment in experiments.items():
            row: dict[str, Any] = {"method": experiment.method.label, "input": experiment.input_label, "unit": unit}
            for ring in RINGS:
                row |= error_columns(f"x{ring}", measured, ring_key(name, ring), resamples, scale)
                row[f"x{ring}_paper"] = scale * published.get(ring_key(experiment.stated_as, ring), np.nan)
            rows.append(row | size_columns(measured, *(ring_key(name, ring) for ring in RINGS)))
    note = (
        " One direction: from the true surface to the prediction. The published evaluation averages over all "
        "touches; here an object's error is the mean over its touches, and classes have the same share."
    )
    return _finish(rows, split, measured, note + COMMUNICATION_NOTE, decimals=None)


@products.table(evaluations="single_image")
def single_image(
    evaluations: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> Frame:
    """Reconstruction from single images, by Pixel2Mesh's protocol: Chamfer distance in thousandths, F1 at tau and 2 tau
    in percent. Networks in the manner of PSG, Pixel2Mesh and 3D-R2N2 were built from their publications. Rows marked as
    cited are the paper's, which cites them; they were measured on other objects."""
    columns = ("chamfer", "f1_tau", "f1_2tau")
    scores = {column: errors(evaluations, list(experiments), split, column) for column in columns}
    measured, rows = scores["chamfer"], []
    for name, experiment in experiments.items():
        row: dict[str, Any] = {"source": "measured", "method": experiment.method.label, "from": name}
        row |= error_columns("chamfer", measured, name, resamples, pixel2mesh_chamfer(1.0))
        for column in columns[1:]:
            row |= scores[column].estimate([name], resamples=resamples).columns(column)
        rows.append(row | size_columns(measured, name))
    published = paper_values("single_image").sort_values("cited_by_the_paper", kind="stable")
    for record in published.to_dict("records"):
        origin = "cited by the paper" if record["cited_by_the_paper"] == "yes" else "the paper"
        row = {"source": "cited", "method": record["method"], "from": origin}
        rows.append(row | {column: record[column] for column in columns})
    note = (
        " Pixel2Mesh's protocol as in Mesh R-CNN's evaluation: meshes scaled by "
        f"{PIXEL2MESH_SCALE:.2f} (0.57 for a bounding box of diagonal 1; here it is 0.5), squared distances, "
        f"tau = {TAU:g}; Chamfer distance in thousandths. Measured rows: models of this run, trained on the same views "
        "for the same processor time; how networks in the manner of others differ from these: docs/single_image.md. "
        "Cited rows: of ShapeNet's 13 classes and published renderings, not this run's objects."
    )
    return _finish(rows, split, measured, note, decimals=2, exact={"chamfer": 3})


@products.table(files=("touches",), splits=("test",))
def local_touch_charts(touches: Frame, split: str = "test", resamples: int = RESAMPLES) -> Frame:
    """Local predictions at each touch of the test split: Chamfer distance (9000 times m²) of the predicted local point
    cloud, and of the touch chart fitted to it, to the true local cloud."""
    measured = touch_errors(touches, split)
    published = paper_values("local_touch_charts").assign(estimate="cloud").set_index(["estimate", "class"])["value"]
    rows = [
        {"prediction": label} | _by_class(measured, name, name, published, resamples) | size_columns(measured, name)
        for name, label in TOUCH_ESTIMATES.items()
    ]
    count = (touches["split"] == split).sum()
    note = f" {count} successful touches; an object's error is the mean over its touches."
    return _finish(rows, split, measured, note, decimals=5)


@products.table(evaluations="input_modalities")
def surface_quality(
    evaluations: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> Frame:
    """Crumpled sheets, torn charts and spikes told apart: angles between adjacent faces (`bend`, `folded`), distances
    between charts that were joined (`gap`), and angles to the true surface (`across`), on the test split."""
    experiments = {name: one for name, one in experiments.items() if one.is_trained}  # not of retrieved points
    scores = {column: errors(evaluations, list(experiments), split, column) for column in QUALITY}
    rows = []
    for name, experiment in experiments.items():
        row: dict[str, Any] = {"experiment": name, **_inputs(experiment)}
        for column, label in QUALITY_LABELS.items():
            row |= scores[column].estimate([name], resamples=resamples).columns(label)
        rows.append(row | size_columns(scores["bend"], name))
    return _finish(rows, split, scores["bend"], QUALITY_NOTE, decimals=1)


@products.table(evaluations="retrieval", splits=("test",))
def retrieval(evaluations: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES) -> Frame:
    """The best trained model of each kind of input beside retrieval, which takes the training object that fits the
    image and the touches best: Chamfer distance (9000 times m²) on the test split, mean and median. Below 1 the ratio
    says that the model is better than a look-up. Best is the lowest mean, of models as of look-ups, chosen after the
    fact on this split."""
    measured, rows = errors(evaluations, list(experiments), split), []
    groups: dict[tuple[str, int], list[str]] = {}
    for name, experiment in experiments.items():
        groups.setdefault((experiment.input_label, experiment.grasps * experiment.touch), []).append(name)
    for (inputs, count), names in sorted(groups.items()):
        look_ups = [name for name in names if not experiments[name].is_trained]
        models = [name for name in names if name not in look_ups]
        if not look_ups or not models:
            continue
        ours, theirs = (
            min(part, key=lambda name: measured.estimate([name], resamples=2).value) for part in (models, look_ups)
        )
        row: dict[str, Any] = {"input": inputs, "grasps": count, "experiment": ours}
        row |= {"method": experiments[ours].method.label}
        for label, name in {"error": ours, "retrieval": theirs}.items():
            row |= error_columns(label, measured, name, resamples)
        rows.append(row | ratio_columns("ratio", measured, ours, theirs, resamples) | size_columns(measured, ours))
    return _finish(rows, split, measured, " In parentheses beside the ratio: that of the medians.")


@products.table(selections="grasp_selection", on_request=True)
def grasp_selection(
    selections: Frame, experiments: Experiments, split: str = "test", resamples: int = RESAMPLES
) -> Frame:
    """Which grasp next: Chamfer distance (9000 times m²) after up to five grasps, chosen one by one among those stored:
    at random, the farthest from those before, where the model's correction is most uncertain, and by an oracle, which
    takes the one that leaves the least error. `left`: the share of the first error after the last. Cited rows are of
    other objects, grasps and models."""
    measured, chosen = selection_errors(selections, experiments, split)
    rows = []
    for (name, strategy), keys in chosen.items():
        experiment = experiments[name]
        row: dict[str, Any] = {"source": "measured", "method": experiment.method.label}
        row |= {"input": experiment.input_label, "strategy": strategy}
        for count, key in keys.items():
            row |= error_columns(f"grasps_{count}", measured, key, resamples)
        first, *_, last = keys.values()
        row |= ratio_columns("left", measured, last, first, resamples)
        rows.append(row | size_columns(measured, *keys.values()))
    cited = paper_values("grasp_selection")[["source", "strategy", "left"]].to_dict("records")
    note = f" Chosen among {selections['stored'].max()} stored grasps. Beside `left`: the ratio of the medians."
    return _finish([*rows, *cited], split, measured, note)


@products.table(files=("trainings",), on_request=True)
def tuning(points: Sequence[dict[str, Any]], trainings: Sequence[Mapping[str, Any]]) -> Frame:
    """The supplement's hyperparameters in every combination of the config's grid, for the model of occluded vision and
    touch: the validation loss (9000 x Chamfer distance), the lowest first.

    points: of `palpate.learning.recipes.tuning_grid`; trainings: the `training.json` of each.
    """
    from pandas import DataFrame as Frame

    columns = ("validation_loss", "best_step", "steps", "seconds", "parameters")
    rows = [point | {key: training[key] for key in columns} for point, training in zip(points, trainings, strict=True)]
    table = Frame(sorted(rows, key=lambda row: row["validation_loss"]))
    machines = ", ".join(sorted({training["machine"]["found"] for training in trainings}))
    validated = trainings[0]["validated"]
    table.attrs["note"] = f"Validation loss of {validated} samples, of the model that is kept; on {machines}."
    return table


def setups(experiments: Experiments) -> dict[tuple[str, str], dict[int, str]]:
    """Experiments that differ in their number of grasps only: (method, input) -> {grasps: name}, in the order given."""
    by_setup: dict[tuple[str, str], dict[int, str]] = {}
    for name, each in experiments.items():
        by_setup.setdefault((each.method.label, each.input_label), {})[each.grasps] = name
    return by_setup


def _inputs(experiment: Experiment) -> dict[str, str]:
    vision = experiment.vision if experiment.has_vision else "–"
    return {"method": experiment.method.label, "vision": vision, "touch": "yes" if experiment.touch else "no"}


def _errors_by_class(table: str, evaluations: Frame, experiments: Experiments, split: str, resamples: int) -> Frame:
    measured = errors(evaluations, list(experiments), split)
    published = paper_values(table).set_index(["experiment", "class"])["value"]
    rows = [
        {"experiment": name, **_inputs(experiment)}
        | _by_class(measured, name, experiment.stated_as, published, resamples)
        | size_columns(measured, name)
        | {"weights": experiment.weights}
        for name, experiment in experiments.items()
    ]
    return _finish(rows, split, measured, STEPS_NOTE + COMMUNICATION_NOTE)


def touch_errors(touches: Frame, split: str) -> Errors:
    """Errors of local predictions as of two experiments, `cloud` and `chart`."""
    names = list(TOUCH_ESTIMATES)
    others = [name for name in (*touches.columns, "seed") if name not in names]
    long = touches.assign(seed=0).melt(others, names, var_name="estimate", value_name="chamfer")
    return errors(long, names, split, key="estimate")


def ring_key(experiment: str, ring: int) -> str:  # of `ring_errors`
    return f"{experiment} x{ring}"


def ring_errors(rings: Frame, experiments: Sequence[str], split: str) -> Errors:
    """Errors in rings as of so many experiments, named by `ring_key`. An object that has no surface in one of
    the rings around any of its touches is omitted from all."""
    rings = of_split(rings, experiments, split, what="ring evaluation")
    by_object = rings.groupby(["object", "experiment", "seed", "ring"])["distance"].mean()
    empty = by_object[by_object.isna()].index.get_level_values("object").unique()
    rings = rings[~rings["object"].isin(empty)].dropna(subset="distance")
    keys = [ring_key(name, ring) for name in experiments for ring in RINGS]
    named = rings.assign(key=rings["experiment"] + " x" + rings["ring"].astype(str))
    return errors(named, keys, split, column="distance", key="key")


def selection_errors(
    selections: Frame, experiments: Iterable[str], split: str
) -> tuple[Errors, dict[tuple[str, str], dict[int, str]]]:
    """Errors after chosen grasps, as of experiments, and their names: (experiment, strategy) -> {grasps: name}."""
    named = selections[selections["split"] == split]
    named = named.assign(key=named["experiment"] + " " + named["strategy"] + " " + named["grasps"].astype(str))
    chosen: dict[tuple[str, str], dict[int, str]] = {}
    for row in named.drop_duplicates("key").sort_values("grasps", kind="stable").itertuples():
        chosen.setdefault((row.experiment, row.strategy), {})[row.grasps] = row.key
    chosen = {place: keys for name in experiments for place, keys in chosen.items() if place[0] == name}
    return errors(named, [key for keys in chosen.values() for key in keys.values()], split, key="key"), chosen


def _by_class(measured: Errors, name: str, stated: str, published: Series, resamples: int) -> dict[str, float]:
    """An experiment's measured columns and the published ones of the experiment `stated`: each class, then the average
    with its median, and how far two seeds differ in it."""
    row: dict[str, float] = {}
    for label in measured.class_names:
        row |= measured.of_class(label).estimate([name], resamples=resamples).columns(label)
        row[f"{label}_paper"] = published.get((stated, label), np.nan)
    row |= error_columns(AVERAGE, measured, name, resamples)
    row[f"{AVERAGE}_paper"] = published.get((stated, AVERAGE), np.nan)
    return row | {"between_seeds": measured.between_seeds([name])}


def error_columns(label: str, measured: Errors, name: str, resamples: int, scale: float = 1.0) -> dict[str, float]:
    """The columns of an experiment's average, times `scale`: with its interval, and its median over objects."""
    columns = measured.estimate([name], resamples=resamples).columns(label, scale)
    return columns | {f"{label}_median": scale * measured.median([name])}


def ratio_columns(label: str, measured: Errors, one: str, other: str, resamples: int) -> dict[str, float]:
    """The columns of one experiment's average over another's, with the ratio of the medians."""
    columns = measured.estimate([one, other], ratio, resamples).within(0).columns(label)
    return columns | {f"{label}_median": measured.median([one]) / measured.median([other])}


def size_columns(measured: Errors, *names: str) -> dict[str, Any]:
    lows, highs = zip(*(measured.steps[name] for name in names), strict=True)
    steps = f"{min(lows)} to {max(highs)}" if min(lows) != max(highs) else str(min(lows))
    seeds = max(len(measured.values[name]) for name in names)
    return {"objects": len(measured.objects), "seeds": seeds, "steps": steps}


def frame_of(rows: list[dict], classes: Iterable[str]) -> Frame:
    from pandas import DataFrame as Frame

    return without_paper(Frame(rows), classes).astype({"objects": "Int64", "seeds": "Int64"})


def intervals_note(seeds: int) -> str:
    over = "objects, within classes, and over seeds" if seeds > 1 else "objects only, within classes"
    known = "" if seeds > 1 else " One seed: nothing is known of the spread between trainings."
    return f"In brackets: 95 % bootstrap interval over {over}; none where a class has a single object.{known}"


def _finish(
    rows: list[dict], split: str, measured: Errors, note: str, decimals: int | None = 3, exact: dict | None = None
) -> Frame:
    """The frame, with its note and how its numbers are printed; no columns of values that nobody states."""
    table = frame_of(rows, measured.class_names)
    sparse = [name for name in table if name.endswith(("_paper", "between_seeds", "weights"))]
    table = table.drop(columns=[name for name in sparse if table[name].isna().all()])
    classes = ", ".join(f"{np.sum(measured.classes == name)} {name}" for name in measured.class_names)
    seeds = max(map(len, measured.values.values()))
    medians = MEDIANS_NOTE * any(name.endswith("_median") for name in table)
    papers = f"; the paper: {PAPER_OBJECTS[split]}" if has_papers_classes(measured.class_names) else ""
    table.attrs["note"] = (
        f"This run: {len(measured.objects)} objects of the {split} split ({classes}){papers}.{note} "
        f"{intervals_note(seeds)}{medians}"
    )
    table.attrs |= {"decimals": decimals, "exact": exact or {}}
    return table
