"""What a longer training changes: the errors of models by training steps, differences of two models at each length, and
the losses of the trainings. Prints tables in Markdown and draws a picture.

    python -m studies.training_length docs/results/paper docs/results/paper_long --picture length.png
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from palpate.experiments import SPLITS
from palpate.results.bootstrap import ratio
from palpate.results.errors import errors
from palpate.results.page import COLOURS, FAINT, LABEL, TITLE, new_figure, save, styled

MODELS = {
    "charts_occluded": "charts (paper's)",
    "charts_occluded_touch": "and one grasp",
    "template_occluded": "template (ours)",
    "template_occluded_touch": "and one grasp",
    "retrieval_occluded": "look-up",
    "retrieval_occluded_touch": "and one grasp",
}
PAIRS = (
    ("charts_occluded_touch", "charts_occluded"),
    ("template_occluded_touch", "template_occluded"),
    ("template_occluded", "charts_occluded"),
    ("template_occluded_touch", "charts_occluded_touch"),
    ("charts_occluded", "retrieval_occluded"),
)
HISTORY = "history.csv"  # columns experiment, seed, step, validation_loss


def read(folders: list[Path]) -> pd.DataFrame:
    """Errors of `MODELS` on every object by all lengths of training: the rows of `chamfer*.csv.xz`."""
    rows = pd.concat(pd.read_csv(path) for folder in folders for path in sorted(folder.glob("chamfer*.csv.xz")))
    return rows[rows["experiment"].isin(MODELS)]


def _of_length(rows: pd.DataFrame) -> Iterator[tuple[int, pd.DataFrame]]:
    """The rows of each length of training; those of the look-up, which has none, are with each."""
    for steps in sorted(set(rows["steps"]) - {0}):
        trained = rows[rows["steps"] == steps]
        untrained = rows[(rows["steps"] == 0) & ~rows.duplicated(["experiment", "split", "object", "window"])]
        yield steps, pd.concat([trained, untrained])


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """The error of each trained model by steps and split: the mean over classes and seeds with its interval, the median
    over objects, and how far two seeds differ."""
    found = []
    for steps, of_length in _of_length(rows):
        for name in dict.fromkeys(of_length.loc[of_length["steps"] > 0, "experiment"]):
            for split in SPLITS:
                measured = errors(of_length[of_length["experiment"] == name], [name], split)
                estimate = measured.estimate([name])
                sizes = {"seeds": len(measured.values[name]), "objects": len(measured.objects)}
                numbers = {**estimate.columns("error"), "median": measured.median([name])}
                spread = {"between seeds": measured.between_seeds([name])}
                found.append({"model": name, "steps": steps, "split": split, **numbers, **spread, **sizes})
    return pd.DataFrame(found)


def differences(rows: pd.DataFrame) -> pd.DataFrame:
    """How far one model's error is above another's by steps and split, in % of the other's, paired by object and seed.
    It is a finding if the interval excludes 0 and two seeds differ by less."""
    found = []
    for steps, of_length in _of_length(rows):
        for pair in PAIRS:
            for split in SPLITS if {*pair} <= set(of_length["experiment"]) else ():
                measured = errors(of_length[of_length["experiment"].isin(pair)], pair, split)
                percent = measured.estimate(pair, lambda means: 100 * (ratio(means) - 1))
                spread = measured.between_seeds(pair, lambda means: 100 * (ratio(means) - 1))
                named = {"model": pair[0], "compared with": pair[1], "steps": steps, "split": split}
                verdict = {-1: "less", 0: "undecided", 1: "more"}[percent.sign(spread)]
                found.append(named | percent.columns("percent") | {"between seeds": spread, "verdict": verdict})
    return pd.DataFrame(found)


@styled
def draw(rows: pd.DataFrame, histories: pd.DataFrame, path: Path) -> None:
    """Left: test errors by steps, a mark a seed; the look-up's dashed. Right: losses on the validation split while the
    models train, a line a seed."""
    figure = new_figure(9.2, 3.4)
    left, right = figure.subplots(1, 2)
    by_object = ["experiment", "steps", "seed", "class", "object"]
    by_seed = rows[rows["split"] == "test"].groupby(by_object)["chamfer"].mean()
    for end in (-1, -2):  # means over objects, then over classes
        by_seed = by_seed.groupby(by_object[:end]).mean()
    for number, (name, label) in enumerate(MODELS.items()):
        if name not in by_seed.index:
            continue
        colour, with_touch = COLOURS[number // 2], number % 2
        mean = by_seed[name].groupby("steps").mean()
        if mean.index.max() == 0:
            left.axhline(mean[0], color=colour, ls=":" if with_touch else "--", lw=1, label=label)
            continue
        left.plot(mean.index, mean, ":" if with_touch else "-", color=colour, lw=1)
        steps, marker = by_seed[name].index.get_level_values("steps"), "s" if with_touch else "o"
        left.plot(steps, by_seed[name], marker, ms=5, label=label, color=colour, mfc="white" if with_touch else colour)
        for _, one in histories[histories["experiment"] == name].groupby(["steps", "seed"]):
            right.plot(one["step"], one["validation_loss"], ":" if with_touch else "-", color=colour, lw=0.8)
    left.set_xscale("log")
    lengths = sorted(set(by_seed.index.get_level_values("steps")) - {0})
    left.set_xticks(lengths, [f"{steps:,}" for steps in lengths], minor=False)
    left.set_xticks([], minor=True)
    left.set_ylabel("test error, m² x 9000", fontsize=LABEL, color=FAINT)
    right.set_yscale("log")
    right.set_yticks([0.5, 1, 2, 5], ["0.5", "1", "2", "5"])
    right.set_yticks([], minor=True)
    right.set_ylabel("loss on the validation split, m² x 9000", fontsize=LABEL, color=FAINT)
    for axes, title in ((left, "Error by the length of training"), (right, "While they train")):
        axes.set_title(title, fontsize=TITLE, loc="left")
        axes.set_xlabel("training steps", fontsize=LABEL, color=FAINT)
        axes.tick_params(labelsize=LABEL, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    left.legend(fontsize=LABEL - 1.5, frameon=False, ncols=3)
    left.set_ylim(bottom=0)
    figure.tight_layout()
    save(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folders", type=Path, nargs="+", help="with chamfer*.csv.xz: errors of every object")
    parser.add_argument("--picture", type=Path, help="PNG")
    arguments = parser.parse_args()
    rows = read(arguments.folders)
    for frame in (table(rows), differences(rows)):
        print(frame.to_markdown(index=False, floatfmt=".3f"), end="\n\n")
    if arguments.picture:
        kept = [folder / HISTORY for folder in arguments.folders if (folder / HISTORY).exists()]
        draw(rows, pd.concat(map(pd.read_csv, kept)), arguments.picture)


if __name__ == "__main__":
    main()
