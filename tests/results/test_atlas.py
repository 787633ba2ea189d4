"""The figure of the atlas: a disc of charts in several colours, the same each time."""

import itertools

import numpy as np
from matplotlib.image import imread

from palpate.charts import vision_atlas
from palpate.results.model_figures import chart_colours, draw


def test_charts_that_share_a_side_differ_in_colour():
    atlas = vision_atlas()
    colours = chart_colours(np.arange(96))
    corners = [set(map(tuple, atlas.vertices[19 * number : 19 * number + 12].tolist())) for number in range(96)]
    beside = [(a, b) for a, b in itertools.combinations(range(96), 2) if len(corners[a] & corners[b]) == 5]
    assert len(beside) == 96 * 3 / 2
    assert all(colours[a] != colours[b] for a, b in beside)


def test_draws_a_coloured_disc_the_same_each_time(tmp_path):
    for name in ("one.png", "two.png"):
        draw(tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    picture = imread(tmp_path / "one.png")[..., :3]
    white = (picture > 0.99).all(axis=2)
    rows, columns = np.nonzero(~white)
    height, width = np.ptp(rows), np.ptp(columns)
    assert height > 0.8 * len(picture) and abs(height - width) < 0.01 * len(picture)
    # A disc covers pi / 4 of the square around it; gaps between charts take some of it.
    assert 0.85 * np.pi / 4 < (~white).sum() / (height * width) < 1.01 * np.pi / 4
    assert len(np.unique((picture * 8).astype(int).reshape(-1, 3), axis=0)) > 20
