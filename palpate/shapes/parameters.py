"""Parameters of the procedural classes: names, ranges and units; drawn independently of each other."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from numpy.random import Generator

from palpate.batch import generator
from palpate.configuration import read_yaml
from palpate.shapes import CLASSES

# Probability that a group of parameters (a bottle's top, a rifle's stock) is drawn as in any of the class's styles.
EXCHANGE = 0.25


class Range(NamedTuple):
    """A number, drawn evenly between two bounds. The unit "1" is a ratio; "count" is cut to a whole number."""

    low: float
    high: float
    unit: str
    meaning: str


class Choice(NamedTuple):
    """One of the names in `options`, which spaces separate. A name that is there twice is twice as likely."""

    options: str
    meaning: str


Parameters = dict[str, Mapping[str, Range | Choice]]  # by group and name
# By style and parameter: [low, high] in place of a range's bounds, or other options of a choice.
Styles = dict[str, Mapping[str, list[float] | str]]


def read(class_name: str, form: Mapping[str, Range]) -> tuple[Parameters, Styles]:
    """Parameters and styles of a class, from its YAML file; form: the last group (`palpate.shapes.deformation`)."""
    content = _file(class_name)
    groups = {
        group: {name: (Range if len(values) == 4 else Choice)(*values) for name, values in parameters.items()}
        for group, parameters in content["parameters"].items()
    }
    return groups | {"form": form}, content["styles"]


@cache
def _file(class_name: str) -> dict[str, Any]:
    """What the YAML file of a class holds. Raises ValueError for an unknown class."""
    if class_name not in CLASSES:
        raise ValueError(f"unknown procedural class {class_name!r}: choose from {', '.join(CLASSES)}")
    return read_yaml(Path(__file__).with_name(f"{class_name}.yaml"))


def styles(class_name: str) -> tuple[str, ...]:
    """The styles of a class. Raises ValueError for an unknown class."""
    return tuple(_file(class_name)["styles"])


def style(class_name: str, index: int, seed: int = 0) -> str:
    """The style of object `index` of a class, without making it. Arguments and errors as `palpate.shapes.make`."""
    return style_and_rng(class_name, index, seed)[0]


def style_and_rng(class_name: str, index: int, seed: int) -> tuple[str, Generator]:
    """The style of an object, and what draws the rest of it."""
    names = styles(class_name)
    if index < 0:
        raise ValueError(f"the index of a {class_name} must not be negative, got {index}")
    rng = generator(seed, f"{class_name}-{index:04d}", "shapes")
    return names[rng.integers(len(names))], rng


def draw(rng: Generator, style: str, parameters: Parameters, styles: Styles) -> SimpleNamespace:
    """A value of each parameter, as attributes.

    The first group is always drawn as in `style`; each other group is drawn as in a style that is chosen at random with
    the probability `EXCHANGE`.
    """
    values: dict[str, Any] = {}
    names = list(styles)
    for position, group in enumerate(parameters.values()):
        other = names[rng.integers(len(names))]
        donor = other if position and rng.uniform() < EXCHANGE else style
        for name, parameter in group.items():
            own: Any = styles[donor].get(name)
            if isinstance(parameter, Choice):
                options = (own or parameter.options).split()
                values[name] = options[rng.integers(len(options))]
            else:
                value = rng.uniform(*(own or parameter[:2]))
                values[name] = int(value) if parameter.unit == "count" else value
    return SimpleNamespace(**values)
