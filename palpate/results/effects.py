"""What touch, grasps, copying and communication change: differences of two experiments, with their verdicts.

`paper/effects.csv` has a row a difference: what it shows, the experiment, the one that it is compared with, and the
experiment of the paper whose numbers stand beside (none: the paper states nothing). `docs/evaluation.md` says what a
finding is.
"""

import numpy as np
import pandas as pd

from palpate.evaluation.rows import SPLITS
from palpate.results.bootstrap import RESAMPLES
from palpate.results.claims import contrast
from palpate.results.errors import AVERAGE, errors
from palpate.results.model_tables import intervals_note, size_columns
from palpate.results.published import effects, paper_values

# The verdict by the sign of a finding, and what stands behind it where a single seed was trained.
VERDICTS = {-1: "better", 0: "undecided", 1: "worse"}
ONE_SEED = " (one seed)"


def touch_effect(evaluations: pd.DataFrame, resamples: int = RESAMPLES) -> pd.DataFrame:
    """Differences of Chamfer distances (m^2 x 9000), paired by object and seed: a row a difference and split.

    evaluations: rows of `rows.read`; differences are those whose experiments it has.

    Columns: effect, experiment, compared_with, split, difference (the experiment's average less the other's) with its
    interval, percent (of the other's) with its interval and the paper's, between_seeds (how far two seeds differ in the
    difference), verdict (`better`: the experiment's error is lower), objects, seeds, steps. A difference is a finding
    if its interval excludes 0 and two seeds differ by less. Raises EvaluationError if experiments were measured on
    different objects or with different seeds.
    """
    chosen = effects(set(evaluations["experiment"]))
    names = sorted({name for row in chosen for name in (row["experiment"], row["compared_with"])})
    (difference,) = contrast(1, -1)
    rows = []
    for split in SPLITS:
        found, stated = errors(evaluations, names, split), _stated(split)
        for row in chosen:
            pair = row["experiment"], row["compared_with"]
            estimate = found.estimate(pair, difference, resamples)
            percent = found.estimate(pair, lambda means: 100 * (means[..., 0] / means[..., 1] - 1), resamples)
            spread = found.between_seeds(pair, difference)
            sizes = size_columns(found, *pair)
            sign = estimate.sign(spread)
            rows.append(
                {
                    "effect": row["effect"],
                    "experiment": pair[0],
                    "compared_with": pair[1],
                    "split": split,
                    "difference": estimate.value,
                    "difference_low": estimate.low,
                    "difference_high": estimate.high,
                    "percent": percent.value,
                    "percent_low": percent.low,
                    "percent_high": percent.high,
                    "percent_paper": 100 * (stated.get(row["stated_as"], np.nan) / stated.get(pair[1], np.nan) - 1),
                    "between_seeds": spread,
                    "verdict": VERDICTS[sign] + (ONE_SEED if sign and sizes["seeds"] == 1 else ""),
                    **sizes,
                }
            )
    table = pd.DataFrame(rows).astype({"objects": "Int64", "seeds": "Int64"})
    order = [row["effect"] for row in chosen]
    table = table.sort_values("effect", key=lambda column: column.map(order.index), kind="stable", ignore_index=True)
    table.attrs["note"] = (
        "A difference is the error of `experiment` less that of `compared with`, paired by object and seed. It is a "
        "finding (better, worse) if its interval excludes 0 and two seeds differ by less (`between seeds`). "
        f"{intervals_note(int(table['seeds'].max()))}"
    )
    table.attrs |= {"decimals": 3, "exact": {"percent": 1}}
    return table


def _stated(split: str) -> dict[str, float]:
    """The paper's averages of its experiments on a split."""
    stated: dict[str, float] = {}
    for table in ("model_selection",) if split == "validation" else ("grasps", "input_modalities"):
        frame = paper_values(table)
        frame = frame[frame["class"] == AVERAGE] if "class" in frame else frame
        stated |= dict(zip(frame["experiment"], frame["value"], strict=True))
    return stated
