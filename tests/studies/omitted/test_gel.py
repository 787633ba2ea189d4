"""What the model of a pressed gel leaves out: the cases are what they say, and no difference is hidden."""

from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from palpate.touch.gel import press
from studies import finite_elements
from studies.omitted import gel
from studies.omitted.omission import NOT_MODELLED, STAYS, results

SLIDE = 2e-5  # m


@pytest.fixture(scope="module")
def rows():
    """The report's rows by their items; of finite elements with fewer columns, each case once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finite_elements, "Gel", partial(finite_elements.Gel, columns=40, rows=8))
        pressed = cache(gel.by_finite_elements)
        patch.setattr(gel, "by_finite_elements", lambda depth, width=5.0: pressed(depth, width))
        by_item = {}
        for row in gel.omissions(Path(), [], {}):
            by_item.setdefault(row.item, []).append(row)
        yield by_item


def differences(rows):
    return [results(row)["difference"] for row in rows]


def test_nothing_is_claimed_to_change_nothing(rows):
    *modelled_otherwise, precision = rows
    assert modelled_otherwise == ["finite strain", "the gel's edge", "friction", "shadows"]
    assert {row.state for item in modelled_otherwise for row in rows[item]} == {NOT_MODELLED}
    assert [row.state for row in rows[precision]] == [STAYS]


def test_both_faces_have_the_ball_s_shape_where_it_touches(rows):
    middle = gel.R < 0.5e-3
    for face in (gel.by_layer(gel.SHALLOW), gel.by_finite_elements(gel.SHALLOW)):
        np.testing.assert_allclose(face[middle], gel.SHALLOW - gel.BALL[middle], atol=4e-6)


def test_finite_strain_counts_more_the_deeper_the_ball_is(rows):
    """Linear theory is that of small depths: the difference falls faster than the depth."""
    shallow, deep = differences(rows["finite strain"])
    assert 0 < shallow < deep * gel.SHALLOW / gel.DEEP
    assert deep < 0.05 * 1e6 * gel.DEEP


def test_an_edge_counts_less_the_farther_it_is(rows):
    near, far = differences(rows["the gel's edge"])
    assert near > 2 * far > 0


def test_where_the_face_sticks_it_moves_by_the_slide(rows):
    """The middle of a contact sticks, and the rest moves less."""
    moved = gel.sideways_difference(gel.sideways(SLIDE), gel.sideways(0.0))
    assert moved == pytest.approx(1e6 * SLIDE, rel=0.05)
    assert differences(rows["friction"]) == pytest.approx([100], rel=0.001)
    smooth = [gel.sideways(slide, friction=0.0) for slide in (SLIDE, 0.0)]
    assert gel.sideways_difference(*smooth) == 0


@pytest.mark.parametrize("angle", [10, 20, 45])
def test_a_slot_s_wall_throws_a_shadow_of_its_depth_over_the_tangent(angle):
    depth = 4e-4
    slot = np.where(np.abs(gel.Y) < 3e-3, depth, 0.0)
    shadow = gel.in_shadow(slot, angle) * gel.WIDTH
    assert shadow == pytest.approx(depth / np.tan(np.radians(angle)), abs=gel.EDGE[0])
    assert gel.in_shadow(slot.T, angle) == 0  # light along it


def test_shadows_are_those_that_a_march_along_each_ray_finds(rows):
    face = press(gel.BALL, gel.EDGE, gel.LAYER, gel.FORCE).indentation
    dark = np.zeros((2, *face.shape), dtype=bool)
    for light, angle in enumerate((10, 20)):
        for row, column in np.ndindex(face.shape):
            before = np.arange(column)
            ray = -face[row, column] + np.tan(np.radians(angle)) * (column - before) * gel.EDGE[0]
            dark[light, row, column] = (-face[row, before] > ray + 1e-9).any()
    shares = 100 * dark.mean(axis=(1, 2))
    assert differences(rows["shadows"]) == pytest.approx(shares) and shares[0] > shares[1] > 0


def test_single_precision_is_off_by_less_than_a_twentieth_of_a_micrometre(rows):
    (difference,) = differences(rows["digits beyond single precision"])
    assert 0 < difference < 0.05
