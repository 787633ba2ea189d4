"""Parameters: within their bounds, drawn independently, exchanged between styles by groups; tables without slips."""

import numpy as np
import pytest

from palpate.shapes import CLASSES
from palpate.shapes.family import FAMILIES
from palpate.shapes.parameters import EXCHANGE, Choice, Range, draw

PARAMETERS = {
    "first": {"long": Range(1, 2, "m", ""), "kind": Choice("a b b", "")},
    "second": {"count": Range(0, 3, "count", ""), "wide": Range(0, 1, "m", "")},
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
    family = FAMILIES[class_name]
    known = {name: parameter for group in family.PARAMETERS.values() for name, parameter in group.items()}
    assert len(known) == sum(len(group) for group in family.PARAMETERS.values())
    for style, asked in family.STYLES.items():
        for name, value in asked.items():
            assert name in known, f"{style}: {name}"
            assert isinstance(value, str) == isinstance(known[name], Choice), f"{style}: {name}"
            assert isinstance(value, str) or value[0] <= value[1], f"{style}: {name}"
    for name, parameter in known.items():
        assert parameter.meaning, name
        assert isinstance(parameter, Choice) or (parameter.unit and parameter.low <= parameter.high), name
