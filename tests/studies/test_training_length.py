"""Length of training: tables against loops, and a picture of them."""

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from studies.training_length import differences, draw, read, table

PAIR = ["charts_occluded_touch", "charts_occluded"]


def rows(steps, seeds, names=PAIR):
    random = np.random.default_rng(steps)
    made = [
        (name, seed, f"{of}-{number}", of, split, 0, random.uniform(1, 2), steps)
        for name in names
        for seed in seeds
        for split in ("validation", "test")
        for of, count in (("bottle", 2), ("knife", 5))
        for number in range(count)
    ]
    return pd.DataFrame(made, columns=["experiment", "seed", "object", "class", "split", "window", "chamfer", "steps"])


@pytest.fixture
def folders(tmp_path):
    short = pd.concat([rows(10, [0, 1]), rows(0, [0], ["retrieval_occluded"]), rows(10, [0, 1], ["other"])])
    for name, frame in (("short", short), ("long", rows(30, [0]))):
        (tmp_path / name).mkdir()
        frame.to_csv(tmp_path / name / "chamfer.csv.xz", index=False)
    return [tmp_path / "short", tmp_path / "long"]


def by_hand(frame, name, steps):
    """The mean over classes of an experiment's test errors."""
    kept = frame[(frame.experiment == name) & (frame.steps == steps) & (frame.split == "test")]
    return np.mean([kept[kept["class"] == each].chamfer.mean() for each in ("bottle", "knife")])


def test_errors_and_differences_by_length(folders):
    frame = read(folders)
    found = table(frame).set_index(["model", "steps", "split"])
    assert set(found.index.get_level_values("model")) == {*PAIR}  # no look-up, which has no steps, and no other model
    for steps, seeds in ((10, 2), (30, 1)):
        errors = [by_hand(frame, name, steps) for name in PAIR]
        assert found.loc[[(name, steps, "test") for name in PAIR], "error"].tolist() == pytest.approx(errors)
        assert set(found.xs(steps, level="steps")["seeds"]) == {seeds}
    apart = differences(frame).set_index(["model", "compared with", "steps", "split"])["percent"]
    errors = [by_hand(frame, name, 30) for name in PAIR]
    assert apart[*PAIR, 30, "test"] == pytest.approx(100 * (errors[0] / errors[1] - 1))
    untrained = by_hand(frame, "retrieval_occluded", 0)  # stands for every length
    assert apart["charts_occluded", "retrieval_occluded", 30, "test"] == pytest.approx(
        100 * (errors[1] / untrained - 1)
    )


def test_the_picture_shows_each_length(folders, tmp_path):
    histories = pd.DataFrame(
        {"experiment": PAIR[0], "seed": 0, "steps": 30, "step": [15, 30], "validation_loss": [2, 1]}
    )
    for name, frame in (("short", rows(10, [0])), ("both", read(folders))):
        draw(frame, histories, tmp_path / f"{name}.png")
    short, both = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in ("short", "both"))
    assert short.shape == both.shape and (short != both).any()
