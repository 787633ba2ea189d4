"""The picture of a hand with its sensors: frames and gels are drawn where the hand has them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.hand import allegro, from_mjcf
from palpate.results.dataset_figures import GEL, LENGTH, check_sheet
from palpate.sensor import DIGIT, load

HANDS = Path(__file__).parents[2] / "config/hands"


@pytest.mark.parametrize(
    "kind", [DIGIT, load("gelsight_mini"), replace(DIGIT, gel_face=0.0), replace(DIGIT, range=0.019273)]
)
def test_each_sensor_is_drawn_with_its_gel_on_the_hand(kind):
    for hand in (allegro(kind.gel_face), from_mjcf(HANDS / "wsg50.xml", HANDS / "wsg50.yaml", kind.gel_face)):
        for axes in check_sheet(hand, kind, {}).axes:
            assert [text.get_text() for text in axes.texts] == list(hand.sensor_names)
            position, rotation = hand.sensor_frames(hand.forward(np.eye(4), hand.open_joint_positions))
            drawn = np.array([line.get_data_3d() for line in axes.lines]).reshape(-1, 3, 3, 2)
            np.testing.assert_allclose(drawn[..., 0], np.repeat(position[:, None], 3, axis=1), atol=1e-12)
            directions = (drawn[..., 1] - drawn[..., 0]) / LENGTH  # a row an axis
            np.testing.assert_allclose(directions, rotation.swapaxes(1, 2), atol=1e-12)
            faces = [each for each in axes.collections if isinstance(each, Poly3DCollection)]
            gels = [each for each in faces if np.allclose(each._facecolor3d[0][:3], to_rgb(GEL))]
            middles = [np.mean(gel._faces[0], axis=0) for gel in gels]
            np.testing.assert_allclose(middles, position + kind.gel_face * rotation[..., 0], atol=1e-12)


def test_pictures_are_below_the_hand():
    pictures = {f"picture {number}": np.full((5, 5, 3), number, np.uint8) for number in range(8)}
    hands, below = np.split(np.array(check_sheet(allegro(), DIGIT, pictures).axes), [2])
    assert [axes.get_title() for axes in below] == list(pictures)
    assert all(axes.get_position().y1 < hands[0].get_position().y0 for axes in below)
    corners = {(round(axes.get_position().x0, 3), round(axes.get_position().y0, 3)) for axes in below}
    assert len(corners) == 8 and {axes.images[0].get_array()[0, 0, 0] for axes in below} == set(range(8))
