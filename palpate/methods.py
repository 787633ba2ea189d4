"""The methods that are compared: the paper's, ours, and look-ups. An experiment is one of them with inputs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Method:
    """A method of reconstruction.

    Attributes:
        name: in names of experiments. title, whose: in tables.
        strategy: of its model; None: its name. architecture: what it changes in the recipe's.
        correction: its last step where it has touch, as `palpate.experiments.Correction`; None: it has none.
        stated_as: the paper's method whose numbers stand beside it; None: its own, if the paper has them.
        exchanged: what takes the place of the paper's methods in claims and differences, None where no model
            corresponds; methods that are not named stay. None: no claims and differences are of it.
        communication: what differences call so.
    """

    name: str
    title: str
    whose: str = ""
    strategy: str | None = None
    architecture: Mapping[str, Any] = field(default_factory=dict)
    correction: Mapping[str, float] | None = None
    stated_as: str | None = None
    exchanged: Mapping[str, str | None] | None = None
    communication: str = ""

    @property
    def label(self) -> str:
        """The method as text: `pooled touch (ours)`."""
        return self.title + f" ({self.whose})" * bool(self.whose)


_KNOWN_POINTS = {"length": 0.08, "noise": 0.3}
_ALL = (
    Method("sphere", "sphere", "paper"),
    Method("no_copy", "charts, no copying", "paper"),
    Method("no_comm", "charts, no communication", "paper"),
    # Touch charts in the graph (equation 1).
    Method("charts", "charts, equation 1", "paper", exchanged={}, communication="edges of the graph"),
    # The same as the authors' first release has it: the mean over neighbours, and one coordinate that is shared.
    Method(
        "mean",
        "charts, mean",
        "authors' first release",
        strategy="charts",
        architecture={"gcn": {"normalisation": "mean", "shared_coordinates": 1}},
        stated_as="charts",
        exchanged={"charts": "mean", "no_copy": None},
        communication="edges of the graph",
    ),
    # Touch pooled by nearness, bent to the touched points as its last step.
    Method(
        "pooled",
        "pooled touch",
        "ours",
        correction=_KNOWN_POINTS,
        stated_as="charts",
        exchanged={"charts": "pooled", "no_copy": "pooled_no_copy"},
        communication="pooled touch and known points",
    ),
    Method("pooled_no_copy", "pooled touch, no copying", "ours", correction=_KNOWN_POINTS, stated_as="no_copy"),
    # As pooled, but the charts begin as those of the training object that fits best.
    Method(
        "template",
        "template",
        "ours",
        correction=_KNOWN_POINTS,
        stated_as="charts",
        exchanged={"charts": "template", "no_copy": None, "no_comm": None},
    ),
    # The baseline: the training object that fits best, bent to the touched points.
    Method("retrieval", "retrieval", "no training", correction={"length": 0.08, "noise": 0.03}, stated_as="charts"),
    # Of single images only.
    Method("psg", "in the manner of PSG"),
    Method("pixel2mesh", "in the manner of Pixel2Mesh"),
    Method("r2n2", "in the manner of 3D-R2N2"),
)
METHODS = {method.name: method for method in _ALL}
