"""The methods that are compared: the paper's, ours, and look-ups. `methods.yaml` has them and explains its keys."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from palpate.configuration import read_yaml


class Method(NamedTuple):
    """A method of reconstruction: a row of `methods.yaml`, by its name there."""

    name: str
    title: str
    strategy: str
    whose: str = ""
    architecture: Mapping[str, Any] = {}
    correction: Mapping[str, float] | None = None
    stated_as: str | None = None
    exchanged: Mapping[str, str | None] | None = None
    communication: str = ""
    claims: bool = True

    @property
    def label(self) -> str:
        """The method as text: `pooled touch (ours)`."""
        return self.title + f" ({self.whose})" * bool(self.whose)


METHODS = {
    name: Method(name, **{"strategy": name} | row)
    for name, row in read_yaml(Path(__file__).with_suffix(".yaml")).items()
}
