"""Whose method a row is: the paper's, ours, or a look-up; and which experiments of one take the place of another's.

Experiments are named `<strategy>_<vision>[_touch[_n]]` or `<strategy>_touch[_n]`. It needs no pandas.
"""

import re
from collections.abc import Collection, Mapping, Sequence

from palpate.experiments import Experiment

NAMES = {  # strategy, as in names of experiments -> name, whose it is
    "sphere": ("sphere", "paper"),
    "no_copy": ("charts, no copying", "paper"),
    "no_comm": ("charts, no communication", "paper"),
    "charts": ("charts, equation 1", "paper"),
    "mean": ("charts, mean over neighbours", "authors' first release"),  # strategy charts, another architecture
    "pooled": ("pooled touch", "ours"),
    "pooled_no_copy": ("pooled touch, no copying", "ours"),
    "implicit": ("signed distance", "ours"),
    "retrieval": ("retrieval", "no training"),
    "psg": ("in the manner of PSG", ""),
    "pixel2mesh": ("in the manner of Pixel2Mesh", ""),
    "r2n2": ("in the manner of 3D-R2N2", ""),
}
# Methods that the paper's claims and differences are of: what takes the place of the paper's strategies. None: no model
# corresponds. Strategies that are not named stay: the sphere, and charts that are copied only.
METHODS: dict[str, Mapping[str, str | None]] = {
    "charts": {},
    "mean": {"charts": "mean", "no_copy": None},
    "pooled": {"charts": "pooled", "no_copy": "pooled_no_copy"},
    "implicit": {"charts": "implicit", "no_copy": None, "no_comm": None},
}
COMMUNICATION = {"charts": "edges of the graph", "mean": "edges of the graph", "pooled": "pooling by nearness"}
COMMUNICATION_NOTE = (
    " Communication is edges of the graph to touch charts in the paper's method, and pooling by nearness in ours. "
    "Without it touch charts are copied into the mesh, and vision charts do not depend on them."
)
# The paper's strategies whose numbers stand beside others.
STATED = dict.fromkeys(("mean", "pooled", "implicit", "retrieval"), "charts") | {"pooled_no_copy": "no_copy"}
_NAME = re.compile(r"(.+?)(_(?:occluded|unoccluded|touch).*)")


def method_of(experiment: Experiment) -> str:
    """The key of an experiment's method in `NAMES`."""
    return "mean" if experiment.strategy == "charts" and experiment.architecture else experiment.strategy


def label(experiment: Experiment) -> str:
    """An experiment's method as text: `pooled touch, corrected (ours)`."""
    name, whose = NAMES[method_of(experiment)]
    return f"{name}{', corrected' * bool(experiment.correction)}" + f" ({whose})" * bool(whose)


def method_label(strategy: str) -> str:
    """A method as text: `charts, equation 1 (paper)`."""
    return "{} ({})".format(*NAMES[strategy])


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
    return STATED[strategy] + name.removeprefix(strategy).removesuffix("_corrected") if strategy in STATED else name


def exchanged(experiments: Sequence[str], method: str, known: Collection[str]) -> tuple[str, ...] | None:
    """The experiments of a method that take the place of some of the paper's, also with a ring behind their names
    (`charts_occluded x1`); None if there are none among those `known`, or they are the same.

    Vision alone stays where a method has no model of its own for it.
    """
    found = []
    for name in experiments:
        strategy = strategy_of(name)
        if strategy in STATED and method != "charts":
            return None
        other = METHODS[method].get(strategy, strategy)
        if other is None:
            return None
        there = other + name.removeprefix(strategy)
        if there.split(" x")[0] not in known and other != strategy:
            if "_touch" in name:
                return None
            there = name
        found.append(there)
    return tuple(found) if method == "charts" or found != list(experiments) else None
