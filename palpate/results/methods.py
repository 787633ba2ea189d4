"""Whose method a row is: the paper's, ours, or a look-up; and which experiments of one take the place of another's.

`methods.yaml` has a row a strategy. Experiments are named `<strategy>_<vision>[_touch[_n]]` or `<strategy>_touch[_n]`.
It needs no pandas.
"""

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from palpate.configuration import read_yaml
from palpate.experiments import Experiment

_ROWS: dict[str, dict[str, Any]] = read_yaml(Path(__file__).with_suffix(".yaml"))
NAMES = {strategy: (row["name"], row["whose"]) for strategy, row in _ROWS.items()}
EXCHANGED, COMMUNICATION, STATED = (
    {strategy: row[key] for strategy, row in _ROWS.items() if key in row}
    for key in ("exchanged", "communication", "stated_as")
)
METHODS = tuple(EXCHANGED)  # that claims and differences are of
COMMUNICATION_NOTE = (
    " Communication is edges of the graph to touch charts in the paper's method, and pooling by nearness in ours, "
    "which also bends charts to touched points. Without it touch charts are copied into the mesh, and vision charts "
    "do not depend on them."
)
_NAME = re.compile(r"(.+?)(_(?:occluded|unoccluded|touch).*)")


def method_of(experiment: Experiment) -> str:
    """An experiment's method: its strategy, or `mean` with the first release's graph."""
    first_release = experiment.architecture.get("gcn", {}).get("normalisation") == "mean"
    return "mean" if first_release else experiment.strategy


def method_label(method: str) -> str:
    """A method as text: `pooled touch (ours)`."""
    name, whose = NAMES[method]
    return name + f" ({whose})" * bool(whose)


def label(experiment: Experiment) -> str:
    """An experiment's method as text."""
    return method_label(method_of(experiment))


def input_label(experiment: Experiment) -> str:
    """An experiment's inputs as text: `unoccluded vision + touch`."""
    vision = {"none": [], "views": ["single view"]}.get(experiment.vision, [f"{experiment.vision} vision"])
    return " + ".join([*vision, *["touch"] * experiment.touch]) or "nothing"


def strategy_of(name: str) -> str:
    """The strategy in an experiment's name; empty for a name of another form."""
    found = _NAME.fullmatch(name)
    return found[1] if found else ""


def stated_as(name: str) -> str:
    """The paper's experiment of the same inputs, whose numbers stand beside those of an experiment."""
    strategy = strategy_of(name)
    return STATED[strategy] + name.removeprefix(strategy) if strategy in STATED else name


def exchanged(experiments: Sequence[str], method: str, known: Collection[str]) -> tuple[str, ...] | None:
    """The experiments of a method that take the place of some of the paper's, also with a ring behind their names
    (`charts_occluded x1`); None if there are none among those `known`, or they are the same.

    Vision alone stays where a method has no model of its own for it.
    """
    found = []
    for name in experiments:
        strategy, (plain, *ring) = strategy_of(name), name.split(" x")
        other = EXCHANGED[method].get(strategy, strategy)
        if other is None or (strategy in STATED and method != "charts"):
            return None
        there = other + plain.removeprefix(strategy)
        if other != strategy and there not in known:
            if "_touch" in plain:
                return None
            there = plain
        found.append(" x".join([there, *ring]))
    return tuple(found) if found != list(experiments) or method == "charts" else None
