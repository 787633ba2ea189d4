"""Procedural CAD classes: parametric bottles, knives, cellphones and rifles, made by CSG and lathing.

Real metres, z up: a bottle stands along z; a cellphone stands upright, its screen towards +x; the long
axis of a knife and of a rifle lies along y (tip or muzzle towards +y), its flat side faces +x. Parameters are those of
YAML files, drawn independently of each other.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from numpy.random import Generator

from palpate.batch import generator
from palpate.configuration import read_yaml
from palpate.lazy import lazy_exports

CLASSES = ("bottle", "knife", "cellphone", "rifle")
generators, __getattr__ = lazy_exports(__name__, {"family": ["make", "write"]})
__all__ = ["CLASSES", "style", "styles", "suffix", *generators]
# Probability that a group of parameters (a bottle's top, a rifle's stock) is drawn as in any of the class's styles.
EXCHANGE = 0.25
Group = Mapping[str, Sequence[Any]]  # by name: (low, high, unit, meaning), or (options, meaning)


@cache
def read(class_name: str) -> dict[str, Any]:
    """The groups of `parameters` of a class, and its `styles`. Raises ValueError for an unknown class."""
    if class_name not in CLASSES:
        raise ValueError(f"unknown procedural class {class_name!r}: choose from {', '.join(CLASSES)}")
    content = read_yaml(Path(__file__).with_name(f"{class_name}.yaml"))
    return {key: content[key] for key in ("parameters", "styles")}


def styles(class_name: str) -> tuple[str, ...]:
    """The styles of a class. Raises ValueError for an unknown class."""
    return tuple(read(class_name)["styles"])


def style(class_name: str, index: int, seed: int = 0) -> str:
    """The style of object `index` of a class, without making it. Arguments and errors as `make`."""
    return style_and_rng(class_name, index, seed)[0]


def style_and_rng(class_name: str, index: int, seed: int) -> tuple[str, Generator]:
    """The style of an object, and what draws the rest of it. Arguments and errors as `make`."""
    names = styles(class_name)
    if index < 0:
        raise ValueError(f"the index of a {class_name} must not be negative, got {index}")
    rng = generator(seed, f"{class_name}-{index:04d}", "shapes")
    return names[rng.integers(len(names))], rng


def draw(
    rng: Generator, style: str, parameters: Mapping[str, Group], styles: Mapping[str, Mapping[str, Any]]
) -> SimpleNamespace:
    """A value of each parameter, as attributes. The first group is drawn as in `style`, which has bounds or options in
    place of the parameters' own; each other group, with the probability `EXCHANGE`, as in any of the styles."""
    values: dict[str, Any] = {}
    names = list(styles)
    for position, group in enumerate(parameters.values()):
        other = names[rng.integers(len(names))]
        donor = other if position and rng.uniform() < EXCHANGE else style
        for name, (*given, _) in group.items():
            if len(given) == 1:
                options = styles[donor].get(name, given[0]).split()
                values[name] = options[rng.integers(len(options))]
            else:
                value = rng.uniform(*styles[donor].get(name, given[:2]))
                values[name] = int(value) if given[2] == "count" else value
    return SimpleNamespace(**values)


def suffix(index: int) -> str:
    """The format of object `index`: every third is an OBJ, the others are GLB."""
    return ".obj" if index % 3 == 2 else ".glb"
