"""The picture of a hand with its sensors: frames and gels are drawn where the hand has them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.hand import allegro, from_mjcf
from palpate.results.hand_sheet import GEL, LENGTH, hand_figure
from palpate.sensor import DIGIT, load

HANDS = Path(__file__).parents[2] / "config/hands"


@pytest.mark.parametrize(
    "kind", [DIGIT, load("gelsight_mini"), replace(DIGIT, gel_face=0.0), replace(DIGIT, range=0.019273)]
)
def test_each_sensor_is_drawn_with_its_gel_on_the_hand(kind):
    for hand in (allegro(kind.gel_face), from_mjcf(HANDS / "wsg50.xml", HANDS / "wsg50.yaml", kind.gel_face)):
        whole, *sides = hand_figure(hand, kind).axes
        assert [axes.get_title() for axes in sides] == list(hand.sensor_names)
        assert [text.get_text() for text in whole.texts] == list(hand.sensor_names)
        position, rotation = hand.sensor_frames(hand.forward(np.eye(4), hand.open_joint_positions))
        drawn = np.array([line.get_data_3d() for line in whole.lines]).reshape(-1, 3, 3, 2)
        np.testing.assert_allclose(drawn[..., 0], np.repeat(position[:, None], 3, axis=1), atol=1e-12)
        directions = (drawn[..., 1] - drawn[..., 0]) / LENGTH  # a row an axis
        np.testing.assert_allclose(directions, rotation.swapaxes(1, 2), atol=1e-12)
        for axes in sides:
            (line,) = (line for line in axes.lines if line.get_color() == GEL)
            np.testing.assert_allclose(line.get_xdata(), 1e3 * kind.gel_face)
