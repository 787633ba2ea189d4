"""How many seeds would decide whether touch, grasps, copying and communication change as much as the paper states, by
how far seeds and objects differ in published errors. Prints a table in Markdown.

    python -m studies.seeds_needed docs/results/paper
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import t

from palpate.results.errors import Errors, errors
from palpate.results.published import effects, stated

PAPERS = ("charts", "sphere")  # methods
# Of the paper, with its numbers.
TABLES = {"model_selection": "validation", "input_modalities": "test", "grasps": "test"}
MOST = 100


def seeds_needed(effect: float, between_seeds: float, between_objects: float) -> int | None:
    """The fewest seeds with which the 95 % interval of a difference as large as `effect` excludes 0; None: more than
    `MOST`. between_seeds: standard deviation; between_objects: standard error, which no seed makes smaller."""
    for count in range(2, MOST + 1):
        error = np.hypot(between_seeds / count**0.5, between_objects)
        if t.ppf(0.975, count - 1) * error < abs(effect):
            return count
    return None


def spreads(measured: Errors, experiment: str, other: str) -> tuple[float, float, float]:
    """The difference of two experiments' errors, its standard deviation between seeds, and its standard error by the
    objects. The average is over classes."""
    apart = measured.values[experiment] - measured.values[other]  # (k, n)
    of_class = [apart[:, measured.classes == name] for name in measured.class_names]
    by_seed = np.mean([part.mean(axis=1) for part in of_class], axis=0)
    variances = [part.mean(axis=0).var(ddof=1) / part.shape[1] for part in of_class]
    return float(by_seed.mean()), float(by_seed.std(ddof=1)), float(np.sqrt(sum(variances)) / len(variances))


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each of the paper's differences whose experiments `rows` has, and each split that it has numbers of."""
    found = []
    for row in effects(set(rows["experiment"])):
        for name, split in TABLES.items():
            papers = [stated(name).get(key, np.nan) for key in row["stated"]]
            pair = [row["experiment"], row["compared_with"]]
            if row["method"] not in PAPERS or np.isnan(papers).any():
                continue
            value, by_seed, by_object = spreads(errors(rows[rows["experiment"].isin(pair)], pair, split), *pair)
            effect = papers[0] - papers[1]
            found.append(
                {
                    "difference": f"{row['effect']}, {row['method']}",
                    "split": split,
                    "measured": value,
                    "the paper's": effect,
                    "between seeds": by_seed,
                    "between objects": by_object,
                    "seeds": seeds_needed(effect, by_seed, by_object) or f"> {MOST}",
                }
            )
    return pd.DataFrame(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="with chamfer*.csv.xz: errors of every object by several seeds")
    files = sorted(parser.parse_args().folder.glob("chamfer*.csv.xz"))
    print(table(pd.concat(map(pd.read_csv, files))).to_markdown(index=False, floatfmt=".3f"))


if __name__ == "__main__":
    main()
