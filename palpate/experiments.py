"""The experiments of config/experiments.yaml: methods with inputs, declared as grids; and the tables that show them."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.configuration import ConfigError, check, merge, plain, read_yaml
from palpate.methods import METHODS, Method

SPLITS = ("validation", "test")  # that models are tested on
PROPERTIES = ("method", "vision", "touch", "grasps", "fewer_grasps")  # that an experiment's name is made of
SINGLE_IMAGE = ("psg", "pixel2mesh", "r2n2")  # methods of views only


def name_of(method: str, vision: str, touch: bool, grasps: int = 1, fewer_grasps: bool = False) -> str:
    """The name of an experiment: `template_unoccluded_touch_5`, `pooled_touch_any`, `single_image_psg`."""
    if vision == "views":
        return "single_image" if method == "charts" else f"single_image_{method}"
    has_vision = vision != "none"
    images, touches = [vision] * has_vision, ["touch"] * (touch and not (fewer_grasps and has_vision))
    number = ["any"] if fewer_grasps else [str(grasps)] * (grasps > 1)
    return "_".join([method, *images, *touches, *number])


@dataclass(frozen=True)
class Correction:
    """How a prediction is bent to the touched points as its last step: `palpate.models.kriging`.

    length: m, of the kernel. noise: variance of a touched point, in units of the variance of what is interpolated.
    """

    length: float
    noise: float


@dataclass(frozen=True)
class Experiment:
    """One model: a combination of a grid of config/experiments.yaml.

    Attributes:
        name: made of its properties (`name_of`), or stated there.
        strategy: the paper's charts, no_copy, no_comm or sphere; ours pooled, pooled_no_copy or template; the
            baseline retrieval, which is not trained; of views only psg, pixel2mesh or r2n2.
        vision: occluded, unoccluded, views or none. touch: whether it takes touches. grasps: how many at most.
        fewer_grasps: whether it is trained with any number of grasps up to `grasps`; from none where it has vision.
        weights: the experiment whose trained model it is evaluated with; None: it is trained itself.
        correction: its last step, by the touched points; None: it has none, or no touch. Training is without.
        architecture: what it changes in the recipe's architecture.
    """

    name: str
    strategy: str
    vision: str
    touch: bool
    grasps: int
    fewer_grasps: bool = False
    weights: str | None = None
    correction: Correction | None = None
    architecture: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_row(cls, name: str, row: Mapping[str, Any]) -> "Experiment":
        """The experiment in the form that `row` gives (checkpoints, Snakemake's params)."""
        correction = Correction(**row["correction"]) if row.get("correction") else None
        return cls(**{"name": name} | dict(row) | {"correction": correction})

    def row(self) -> dict[str, Any]:
        """The row as plain data, keys with their default left out: what checkpoints and Snakemake's params hold."""
        return {key: value for key, value in plain(self).items() if key != "name"}

    @property
    def method(self) -> Method:
        """Its method: the last one of its strategy whose architecture it has."""
        own = self.architecture
        mine = (each for each in METHODS.values() if self.strategy == (each.strategy or each.name))
        return [each for each in mine if merge(own, each.architecture) == own][-1]

    @property
    def stated_as(self) -> str:
        """The paper's experiment of the same inputs, whose numbers stand beside its own."""
        other = self.method.stated_as
        return name_of(other, self.vision, self.touch, self.grasps, self.fewer_grasps) if other else self.name

    @property
    def input_label(self) -> str:
        """Its inputs as text: `unoccluded vision + touch`."""
        vision = {"none": [], "views": ["single view"]}.get(self.vision, [f"{self.vision} vision"])
        return " + ".join([*vision, *["touch"] * self.touch]) or "nothing"

    @property
    def has_vision(self) -> bool:
        """Whether it takes images of any kind."""
        return self.vision != "none"

    @property
    def trained(self) -> str:
        """The experiment whose trained model it is: `models/<trained>`."""
        return self.weights or self.name

    @property
    def is_trained(self) -> bool:
        """Whether it has a trained model: all but the strategy `retrieval`."""
        return self.strategy != "retrieval"

    @property
    def fewest_grasps(self) -> int:
        """The fewest grasps whose touches a sample has."""
        return self.grasps if not self.fewer_grasps else 0 if self.has_vision else 1

    @property
    def takes_charts(self) -> bool:
        """Whether touches reach the model as charts: in all strategies but `sphere` (paper, section 5.1)."""
        return self.touch and self.strategy != "sphere"

    @property
    def takes_readings(self) -> bool:
        """Whether touches reach the model as readings: in strategy `sphere`."""
        return self.touch and self.strategy == "sphere"

    @property
    def takes_images(self) -> bool:
        """Whether images reach it as they are: in all strategies but `retrieval`."""
        return self.has_vision and self.is_trained

    @property
    def takes_masks(self) -> bool:
        """Whether images reach it as silhouettes: where a training object is retrieved."""
        return self.has_vision and self.strategy in ("retrieval", "template")

    @property
    def takes_grasps(self) -> bool:
        """Whether anything that the model takes depends on a grasp: touches, or an occluded image."""
        return self.touch or self.vision == "occluded"

    @property
    def modality(self) -> str:
        """What recipes call its inputs: `occluded_touch`, `touch`, `single_image`."""
        if self.vision == "views":
            return "single_image"
        return "_".join([self.vision] * self.has_vision + ["touch"] * self.touch)


@dataclass(frozen=True)
class Comparison:
    """A table of config/experiments.yaml: its experiments in order, and the split that they are tested on."""

    name: str
    split: str
    experiments: tuple[Experiment, ...]

    @property
    def by_name(self) -> dict[str, Experiment]:
        """The experiments by their names, in order."""
        return {experiment.name: experiment for experiment in self.experiments}


@dataclass(frozen=True)
class Experiments:
    """The whole of config/experiments.yaml."""

    experiments: Mapping[str, Experiment]
    tables: Mapping[str, Comparison]

    @classmethod
    def read(cls, path: Path | str, schema: Path | str) -> "Experiments":
        """The file's experiments and tables, checked against its schema.

        Raises ConfigError, naming the experiment, for an unknown method, two experiments of one name, weights that are
        not of a trained experiment with the same vision, or inputs that the method can't have; and naming the table,
        for an experiment, or a value of a grid, that no experiment is defined of.
        """
        declared = read_yaml(path)
        check(declared, schema, str(path))
        try:
            rows = _rows(declared["experiments"])
            experiments = {name: _experiment(name, row, rows) for name, row in rows.items()}
            tables = {
                name: Comparison(name, table["split"], tuple(_selected(name, table["experiments"], experiments)))
                for name, table in declared["tables"].items()
            }
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
        return cls(experiments, tables)

    def of_weights(self, trained: str) -> list[Experiment]:
        """The experiments that are evaluated with a trained model, itself first."""
        found = [each for each in self.experiments.values() if each.trained == trained]
        return sorted(found, key=lambda each: each.name != trained)


def _combinations(grid: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of a grid's lists, the last key's values changing fastest."""
    values = [value if isinstance(value, list) else [value] for value in grid.values()]
    return [dict(zip(grid, combination, strict=True)) for combination in itertools.product(*values)]


def _name(row: Mapping[str, Any]) -> str:
    """The name that is made of a row's properties."""
    return name_of(**{key: row[key] for key in PROPERTIES if key in row})


def _rows(grids: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """The combinations of all grids by their names."""
    rows: dict[str, dict[str, Any]] = {}
    for row in itertools.chain.from_iterable(map(_combinations, grids)):
        if row["method"] not in METHODS:
            raise ConfigError(f"method {row['method']!r} is unknown; there are {', '.join(METHODS)}")
        name = row.get("name") or _name(row)
        if name in rows:
            raise ConfigError(f"there are two experiments {name}: remove one, or state another `name`")
        rows[name] = row
    return rows


def _experiment(name: str, row: Mapping[str, Any], rows: Mapping[str, Mapping[str, Any]]) -> Experiment:
    """The experiment of a row; what the row does not state is its trained experiment's, or its method's."""
    weights, trained = row.get("weights"), row
    if weights:
        weights = weights if isinstance(weights, str) else _name({**row, **weights})
        trained = rows.get(weights, {})
        if not trained or "weights" in trained or trained["vision"] != row["vision"]:
            raise ConfigError(f"{name} has weights {weights}, which is no trained experiment of its vision")
    method = METHODS[row["method"]]
    values = {"architecture": METHODS[trained["method"]].architecture, "correction": method.correction, "grasps": 1}
    values |= {key: trained[key] for key in ("architecture", "correction") if key in trained}
    values |= row | {"name": name, "strategy": method.strategy or method.name, "weights": weights}
    values |= {} if row["touch"] else {"correction": None}
    experiment = Experiment.from_row(name, {key: value for key, value in values.items() if key != "method"})
    if not experiment.has_vision and not experiment.touch:
        raise ConfigError(f"{name} needs vision or touch, and has neither")
    if method.name in SINGLE_IMAGE and (row["vision"] != "views" or row["touch"]):
        raise ConfigError(f"{name}: method {method.name} takes single images: vision: views, touch: false")
    if row["vision"] == "views" and not experiment.is_trained:
        raise ConfigError(f"{name}: method {method.name} does not take single images: choose another vision")
    return experiment


def _selected(table: str, items: Sequence[Any], experiments: Mapping[str, Experiment]) -> Iterator[Experiment]:
    """The experiments that a table's names and grids say, in order.

    Raises ConfigError for a name, or a value of a grid, that no experiment is defined of.
    """
    for item in items:
        if isinstance(item, str):
            if item not in experiments:
                raise ConfigError(f"table {table} has experiment {item}, which is not defined")
            yield experiments[item]
            continue
        defined = [row for row in _combinations(item) if _name(row) in experiments]
        for key, values in item.items():
            for value in values if isinstance(values, list) else [values]:
                if not any(row[key] == value for row in defined):
                    raise ConfigError(f"table {table} has experiments of {key} {value}, and none is defined")
        yield from (experiments[_name(row)] for row in defined)
