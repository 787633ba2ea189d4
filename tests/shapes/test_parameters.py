"""Parameters: within their bounds, drawn independently, exchanged between styles by groups; tables without slips."""

import numpy as np
import pytest

from palpate.shapes import CLASSES, EXCHANGE, draw, read

PARAMETERS = {
    "first": {"long": (1, 2, "m", ""), "kind": ("a b b", "")},
    "second": {"count": (0, 3, "count", ""), "wide": (0, 1, "m", "")},
}
STYLES = {"own": {"long": (5, 6), "wide": (0.5, 1)}, "other": {"wide": (2, 3)}}


def many(style: str, count: int = 4000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    drawn = [vars(draw(rng, style, PARAMETERS, STYLES)) for _ in range(count)]
    return {name: np.array([each[name] for each in drawn]) for name in drawn[0]}


def test_values_are_even_within_bounds_or_those_of_the_style():
    found = many("own")
    assert found["long"].min() >= 5 and found["long"].max() <= 6
    assert np.histogram(found["long"], 4)[0] == pytest.approx(1000, rel=0.1)
    assert (found["kind"] == "b").mean() == pytest.approx(2 / 3, abs=0.03)
    assert set(found["count"]) == {0, 1, 2}


def test_a_group_comes_from_another_style_as_often_as_it_says():
    # Another style is the same one half of the time: there are two.
    assert (many("own")["wide"] >= 2).mean() == pytest.approx(EXCHANGE / 2, abs=0.02)
    assert (many("other")["long"] <= 2).all()


def test_parameters_are_independent():
    found = many("own")
    inside = found["wide"] <= 1
    assert abs(np.corrcoef(found["long"][inside], found["wide"][inside])[0, 1]) < 0.05


@pytest.mark.parametrize("class_name", CLASSES)
def test_styles_name_parameters_and_have_bounds_in_order(class_name):
    parameters, styles = read(class_name).values()
    known = {name: parameter for group in parameters.values() for name, parameter in group.items()}
    assert len(known) == sum(len(group) for group in parameters.values())
    for style, asked in styles.items():
        for name, value in asked.items():
            assert name in known, f"{style}: {name}"
            assert isinstance(value, str) == (len(known[name]) == 2), f"{style}: {name}"
            assert isinstance(value, str) or value[0] <= value[1], f"{style}: {name}"
    for name, (first, *rest, meaning) in known.items():
        assert meaning, name
        assert (isinstance(first, str) and not rest) or (first <= rest[0] and isinstance(rest[1], str)), name
