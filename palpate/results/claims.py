"""The paper's claims that a number can decide, and what this run has to say about each.

A claim is a statistic of averages that must be negative (a difference of errors, a slope, an error less what
is allowed): it holds if the whole 95 % interval is below zero, does not if all of it is above, and is
undecided otherwise. Claims of several statistics hold if all do.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from palpate.results.bootstrap import RESAMPLES
from palpate.results.errors import AVERAGE, Errors, errors
from palpate.results.published import paper_values, published_experiments
from palpate.evaluation.rings import RINGS
from palpate.results.model_tables import INTERVALS, ring_errors, ring_key, touch_errors

HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"
GRASPS = (1, 2, 3, 4, 5)
# "Approximately the same loss at every plane size" (section 5.3): the paper's own vision-only errors change
# by -28 % and -15 % from ring 1 to ring 5.
FLAT = 0.3
# "Practically perfect, when compared to the error incurred over full surfaces" (section 5.3): the paper's own
# share is 1.2 %.
NEAR_PERFECT = 0.05


class Claim(NamedTuple):
    """A sentence of the paper, and the statistic that decides it.

    experiments: whose averages the statistic takes, in order. measured: from averages (..., experiments) to
    the number that is reported. bounds: statistics that must be negative for the claim to hold; the measured
    number itself if there are none.
    """

    claim: str
    section: str
    split: str
    table: str
    experiments: tuple[str, ...]
    measured: Callable[[np.ndarray], np.ndarray]
    unit: str
    bounds: tuple[Callable[[np.ndarray], np.ndarray], ...] = ()


def contrast(*weights: float) -> Callable[[np.ndarray], np.ndarray]:
    """The weighted sum of averages."""
    vector = np.array(weights, dtype=float)
    return lambda means: means @ vector


LESS = contrast(1, -1)  # the first's error less the second's
# Change of the error with each further grasp (least squares).
SLOPE = contrast(*(np.array(GRASPS) - np.mean(GRASPS)) / np.sum((np.array(GRASPS) - np.mean(GRASPS)) ** 2))
ERROR = "m^2 x 9000"


def _lower(claim: str, section: str, split: str, table: str, better: str, worse: str) -> Claim:
    return Claim(claim, section, split, table, (better, worse), LESS, ERROR)


def _model_selection() -> list[Claim]:
    """Section 5.1, on the validation split as there."""
    place = ("5.1", "validation", "model_selection")
    seen = {"occluded": "occluded vision", "unoccluded": "unoccluded vision"}
    claims = []
    for vision, words in seen.items():
        for touch, with_touch in (("_touch", " + touch"), ("", "")):
            claims.append(
                _lower(
                    f"Charts beat the sphere ({words}{with_touch})",
                    *place,
                    f"charts_{vision}{touch}",
                    f"sphere_{vision}{touch}",
                )
            )
    for vision, words in seen.items():
        claims.append(
            _lower(
                f"Copying touch charts helps ({words})",
                *place,
                f"charts_{vision}_touch",
                f"no_copy_{vision}_touch",
            )
        )
    for vision, words in seen.items():
        claims.append(
            _lower(
                f"Communication between charts helps ({words})",
                *place,
                f"charts_{vision}_touch",
                f"no_comm_{vision}_touch",
            )
        )
    for strategy, touch, words in (
        ("charts", "_touch", "charts, vision + touch"),
        ("no_copy", "_touch", "charts without copying, vision + touch"),
        ("no_comm", "_touch", "charts without communication, vision + touch"),
        ("sphere", "_touch", "sphere, vision + touch"),
        ("charts", "", "charts, vision"),
        ("sphere", "", "sphere, vision"),
    ):
        claims.append(
            _lower(
                f"Unoccluded vision is better than occluded ({words})",
                *place,
                f"{strategy}_unoccluded{touch}",
                f"{strategy}_occluded{touch}",
            )
        )
    for strategy in ("charts", "sphere"):
        for vision, words in seen.items():
            claims.append(
                _lower(
                    f"Touch improves {words} ({strategy})",
                    *place,
                    f"{strategy}_{vision}_touch",
                    f"{strategy}_{vision}",
                )
            )
    claims.append(
        Claim(
            "Touch improves occluded vision more than unoccluded",
            *place,
            ("charts_occluded_touch", "charts_occluded", "charts_unoccluded_touch", "charts_unoccluded"),
            contrast(1, -1, -1, 1),
            ERROR,
        )
    )
    for vision, words in seen.items():
        claims.append(
            Claim(
                f"Touch improves {words} more with charts than with the sphere",
                *place,
                (f"charts_{vision}_touch", f"charts_{vision}", f"sphere_{vision}_touch", f"sphere_{vision}"),
                contrast(1, -1, -1, 1),
                ERROR,
            )
        )
    return claims


def _input_modalities() -> list[Claim]:
    """Section 5.1, on the test split."""
    place = ("5.1", "test", "input_modalities")
    claims = [
        _lower(f"Touch improves {vision} vision", *place, f"charts_{vision}_touch", f"charts_{vision}")
        for vision in ("occluded", "unoccluded")
    ]
    others = ("charts_occluded_touch", "charts_occluded", "charts_unoccluded_touch", "charts_unoccluded")
    claims.append(
        Claim(
            "Touch alone is worst (the worst of the others against it)",
            *place,
            (*others, "charts_touch"),
            lambda means: means[..., :4].max(axis=-1) - means[..., 4],
            ERROR,
        )
    )
    return claims


def _grasps() -> list[Claim]:
    """Section 5.2."""
    claims = []
    for name, words in (("charts_touch", "touch"), ("charts_unoccluded_touch", "unoccluded vision + touch")):
        experiments = tuple(name if count == 1 else f"{name}_{count}" for count in GRASPS)
        claims.append(
            Claim(
                f"More grasps help ({words}): change with each further grasp",
                "5.2",
                "test",
                "grasps",
                experiments,
                SLOPE,
                f"{ERROR} a grasp",
            )
        )
        claims.append(
            _lower(
                f"Five grasps are better than one ({words})",
                "5.2",
                "test",
                "grasps",
                experiments[-1],
                name,
            )
        )
    return claims


def _extrapolation() -> list[Claim]:
    """Section 5.3, around touch sites."""
    place = ("5.3", "test", "extrapolation")
    first, last = RINGS[0], RINGS[-1]
    claims = []
    for vision in ("occluded", "unoccluded"):
        alone, touch = f"charts_{vision}", f"charts_{vision}_touch"
        claims += [
            Claim(
                f"At the touch sites (x1) touch lowers the error of {vision} vision",
                *place,
                (ring_key(touch, first), ring_key(alone, first)),
                LESS,
                "m^2",
            ),
            Claim(
                f"Around the touch sites (mean of x2 to x5) touch lowers the error of {vision} vision",
                *place,
                tuple(ring_key(name, ring) for name in (touch, alone) for ring in RINGS[1:]),
                contrast(*[1 / 4] * 4, *[-1 / 4] * 4),
                "m^2",
            ),
            Claim(
                f"With touch the error rises with the distance from the touch ({vision} vision): x1 less x5",
                *place,
                (ring_key(touch, first), ring_key(touch, last)),
                LESS,
                "m^2",
            ),
            Claim(
                f"With {vision} vision only the error is about the same: change from x1 to x5 within "
                f"{100 * FLAT:.0f} %",
                *place,
                (ring_key(alone, first), ring_key(alone, last)),
                lambda means: means[..., 1] / means[..., 0] - 1,
                "of x1",
                (contrast(-(1 + FLAT), 1), contrast(1 - FLAT, -1)),
            ),
        ]
    return claims


def _local() -> list[Claim]:
    """Section 5.3, at a touch site."""
    others = (
        "charts_occluded_touch",
        "charts_occluded",
        "charts_unoccluded_touch",
        "charts_unoccluded",
        "charts_touch",
    )
    return [
        Claim(
            f"Local predictions are near perfect: below {100 * NEAR_PERFECT:.0f} % of the least global error",
            "5.3",
            "test",
            "local_touch_charts",
            ("cloud", *others),
            lambda means: means[..., 0] / means[..., 1:].min(axis=-1),
            "of the global error",
            (lambda means: means[..., 0] - NEAR_PERFECT * means[..., 1:].min(axis=-1),),
        )
    ]


CLAIMS: tuple[Claim, ...] = (
    *_model_selection(),
    *_input_modalities(),
    *_grasps(),
    *_local(),
    *_extrapolation(),
)
TABLES = ("model_selection", "input_modalities", "local_touch_charts", "grasps", "extrapolation")


def decide(
    evaluations: pd.DataFrame, rings: pd.DataFrame, touches: pd.DataFrame, resamples: int = RESAMPLES
) -> pd.DataFrame:
    """What this run says about each claim: one row a claim.

    Args:
        evaluations: rows of `errors.read` of `published_experiments()`; rings: of those of `extrapolation`;
        touches: of `evaluations/touch_depth.csv`.

    Columns: claim, section, split, measured with its interval (`_low`, `_high`) and the same of the paper's
    numbers (`_paper`), unit, verdict, paper_agrees (whether the paper's numbers themselves are so: it states
    no spread), objects, seeds, steps. Raises EvaluationError if an experiment is missing.
    """
    found = _found(evaluations, rings, touches)
    rows = []
    for claim in CLAIMS:
        known = found[claim.table]
        estimate = known.estimate(claim.experiments, claim.measured, resamples)
        bounds = [
            known.estimate(claim.experiments, bound, resamples) for bound in claim.bounds or (claim.measured,)
        ]
        means = _published(claim.table, claim.experiments)
        rows.append(
            {
                "claim": claim.claim,
                "section": claim.section,
                "split": claim.split,
                "measured": estimate.value,
                "measured_low": estimate.low,
                "measured_high": estimate.high,
                "measured_paper": float(claim.measured(means)),
                "unit": claim.unit,
                "verdict": verdict([(bound.low, bound.high) for bound in bounds]),
                "paper_agrees": all(bound(means) < 0 for bound in claim.bounds or (claim.measured,)),
                "objects": len(known.objects),
                "seeds": min(len(known.values[name]) for name in claim.experiments),
                "steps": _steps(known, claim.experiments),
            }
        )
    table = pd.DataFrame(rows).astype({"objects": "Int64", "seeds": "Int64"})
    table["paper_agrees"] = table["paper_agrees"].map({True: "yes", False: "no"})
    counts = table["verdict"].value_counts()
    table.attrs["note"] = (
        f"{counts.get(HOLDS, 0)} of {len(table)} claims hold, {counts.get(FAILS, 0)} do not, "
        f"{counts.get(UNDECIDED, 0)} are undecided by this run. A claim is that a number is negative (where "
        "it names a bound: within it); it holds or not if the whole interval says so. Differences are taken "
        "object by object. `paper agrees`: whether the paper's own numbers, without an interval, say so. "
        f"{INTERVALS} With one seed the interval knows nothing of the spread over seeds."
    )
    table.attrs["decimals"] = None
    return table


def verdict(intervals: list[tuple[float, float]]) -> str:
    """Of intervals (low, high) that must all be below zero; one that can't be told (nan) decides nothing."""
    if all(high < 0 for _, high in intervals):
        return HOLDS
    if any(low > 0 for low, _ in intervals):
        return FAILS
    return UNDECIDED


def _found(evaluations, rings, touches) -> dict[str, Errors]:
    """The errors that the claims of each table are decided by."""
    needed = {
        table: list(dict.fromkeys(n for claim in CLAIMS if claim.table == table for n in claim.experiments))
        for table in TABLES
    }
    found = {
        "model_selection": errors(evaluations, needed["model_selection"], "validation"),
        "input_modalities": errors(evaluations, needed["input_modalities"], "test"),
        "grasps": errors(evaluations, needed["grasps"], "test"),
        "extrapolation": ring_errors(rings, published_experiments("extrapolation"), "test"),
    }
    found["local_touch_charts"] = _together(found["input_modalities"], touch_errors(touches, "test"))
    return found


def _together(whole: Errors, local: Errors) -> Errors:
    """Errors of both on the objects that both have (one without a successful touch has no local error)."""
    here = np.isin(whole.objects, local.objects)
    there = np.isin(local.objects, whole.objects)
    values = {name: array[:, here] for name, array in whole.values.items()}
    values |= {name: array[:, there] for name, array in local.values.items()}
    return Errors(whole.objects[here], whole.classes[here], values, whole.steps | local.steps)


def _published(table: str, names: tuple[str, ...]) -> np.ndarray:
    """The paper's averages of the same name."""
    frame = paper_values("input_modalities" if table == "local_touch_charts" else table)
    if table == "extrapolation":
        known: Mapping = {ring_key(row.experiment, row.ring): row.value for row in frame.itertuples()}
    elif table == "grasps":
        known = dict(zip(frame["experiment"], frame["value"], strict=True))
    else:
        frame = frame[frame["class"] == AVERAGE]
        known = dict(zip(frame["experiment"], frame["value"], strict=True))
    local = paper_values("local_touch_charts").set_index("class")["value"]
    return np.array([local[AVERAGE] if name == "cloud" else known[name] for name in names])


def _steps(found: Errors, names: tuple[str, ...]) -> str:
    low, high = min(found.steps[n][0] for n in names), max(found.steps[n][1] for n in names)
    return str(low) if low == high else f"{low} to {high}"
