"""The experiments of config/experiments.yaml: methods with inputs, declared as grids; and the tables that show them."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from palpate.configuration import ConfigError, check, merge, plain, read_yaml
from palpate.strategies import STRATEGIES, Strategy

SPLITS = ("validation", "test")  # that models are tested on


class Method(NamedTuple):
    """A method of reconstruction: a row of `methods.yaml`, which explains them, by its name there."""

    name: str
    title: str
    strategy: str
    whose: str = ""
    architecture: Mapping[str, Any] = {}
    correction: Mapping[str, float] | None = None
    stated_as: str | None = None
    lacks: Sequence[str] | None = None
    claims: bool = True

    @property
    def label(self) -> str:  # the method as text: `template (ours)`
        return self.title + f" ({self.whose})" * bool(self.whose)


METHODS = {
    name: Method(name, **{"strategy": name} | row)
    for name, row in read_yaml(Path(__file__).with_name("methods.yaml")).items()
}


def name_of(row: Mapping[str, Any]) -> str:
    """The name of an experiment of these properties: `template_unoccluded_touch_5`, `template_touch_any`."""
    method, vision, fewer_grasps, grasps = row["method"], row["vision"], row.get("fewer_grasps"), row.get("grasps", 1)
    if vision == "views":
        return "single_image" if method == "charts" else f"single_image_{method}"
    images = [] if vision == "none" else [vision]
    touches = ["touch"] * (row["touch"] and not (fewer_grasps and images))
    return "_".join([method, *images, *touches, *(["any"] if fewer_grasps else [str(grasps)] * (grasps > 1))])


@dataclass(frozen=True)
class Correction:
    """How a prediction is bent to the touched points as its last step: `palpate.models.kriging`. length: m, of the
    kernel. noise: variance of a touched point, in units of the variance of what is interpolated."""

    length: float
    noise: float


@dataclass(frozen=True)
class Experiment:
    """One model: a combination of a grid of config/experiments.yaml.
    name: made of its properties (`name_of`), or stated. strategy: by its name. vision: of `strategies.VISIONS`. grasps:
    how many at most. fewer_grasps: whether it is trained with any number of them; from none where it has vision.
    weights: the experiment whose trained model it is evaluated with; None: its own. correction: its last step, by the
    touched points, after training. architecture: what it changes in the recipe's."""

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
    def plan(self) -> Strategy:  # what its strategy takes, begins with and predicts
        return STRATEGIES[self.strategy]

    @property
    def method(self) -> Method:  # its method: the last one of its strategy whose architecture it has
        own = self.architecture
        of_strategy = (method for method in METHODS.values() if method.strategy == self.strategy)
        return [method for method in of_strategy if merge(own, method.architecture) == own][-1]

    @property
    def stated_as(self) -> str:  # the paper's experiment of the same inputs, whose numbers stand beside its own
        other = self.method.stated_as
        return name_of(self.row() | {"method": other}) if other else self.name

    @property
    def input_label(self) -> str:  # its inputs as text: `unoccluded vision + touch`
        vision = {"none": [], "views": ["single view"]}.get(self.vision, [f"{self.vision} vision"])
        return " + ".join([*vision, *["touch"] * self.touch]) or "nothing"

    @property
    def has_vision(self) -> bool:  # whether it takes images of any kind
        return self.vision != "none"

    @property
    def trained(self) -> str:  # the experiment whose trained model it is: `models/<trained>`
        return self.weights or self.name

    @property
    def is_trained(self) -> bool:  # whether it has a trained model: all but look-ups
        return self.plan.is_trained

    @property
    def fewest_grasps(self) -> int:  # the fewest grasps whose touches a sample has
        return self.grasps if not self.fewer_grasps else 0 if self.has_vision else 1

    @property
    def takes_charts(self) -> bool:  # whether touches reach the model as charts, not as readings
        return self.touch and self.plan.touch_input != "readings"

    @property
    def takes_masks(self) -> bool:  # whether images reach it as silhouettes: where training objects are retrieved
        return self.has_vision and self.plan.takes_masks

    @property
    def takes_grasps(self) -> bool:
        """Whether anything that the model takes depends on a grasp: touches, or an occluded image."""
        return self.touch or self.vision == "occluded"

    @property
    def modality(self) -> str:  # what recipes call its inputs: `occluded_touch`, `touch`, `single_image`
        if self.vision == "views":
            return "single_image"
        return "_".join([self.vision] * self.has_vision + ["touch"] * self.touch)


@dataclass(frozen=True)
class Comparison:
    """A table of config/experiments.yaml: its experiments by their names, and the split that they are tested on."""

    name: str
    split: str
    by_name: Mapping[str, Experiment]


@dataclass(frozen=True)
class Experiments:
    """The whole of config/experiments.yaml."""

    experiments: Mapping[str, Experiment]
    tables: Mapping[str, Comparison]

    @classmethod
    def read(cls, path: Path | str, schema: Path | str) -> "Experiments":
        """The file's experiments and tables, checked against its schema. Raises ConfigError, naming the experiment, for
        an unknown method, a name that is there twice, weights of no trained experiment with the same vision, or inputs
        that the method can't have; and naming the table, for what no experiment is defined of."""
        declared = read_yaml(path)
        check(declared, schema, str(path))
        try:
            rows = _rows(declared["experiments"])
            experiments = {name: _experiment(name, row, rows) for name, row in rows.items()}
            tables = {
                name: Comparison(name, table["split"], dict(_selected(name, table["experiments"], experiments)))
                for name, table in declared["tables"].items()
            }
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
        return cls(experiments, tables)

    def of_weights(self, trained: str) -> list[Experiment]:
        """The experiments that are evaluated with a trained model, itself first."""
        sharing = [experiment for experiment in self.experiments.values() if experiment.trained == trained]
        return sorted(sharing, key=lambda experiment: experiment.name != trained)


def combinations(grid: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of a grid's lists, the last key's values changing fastest."""
    values = [value if isinstance(value, list) else [value] for value in grid.values()]
    return [dict(zip(grid, combination, strict=True)) for combination in itertools.product(*values)]


def _rows(grids: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """The combinations of all grids by their names, with names of weights in place of properties."""
    rows: dict[str, dict[str, Any]] = {}
    for row in itertools.chain.from_iterable(map(combinations, grids)):
        if row["method"] not in METHODS:
            raise ConfigError(f"method {row['method']!r} is unknown; there are {', '.join(METHODS)}")
        if isinstance(row.get("weights"), dict):
            row["weights"] = name_of(row | row["weights"])
        name = row.pop("name", name_of(row))
        if name in rows:
            raise ConfigError(f"there are two experiments {name}: remove one, or state another `name`")
        rows[name] = row
    return rows


def _experiment(name: str, row: Mapping[str, Any], rows: Mapping[str, Mapping[str, Any]]) -> Experiment:
    """The experiment of a row; what the row does not state is its trained experiment's, or its method's."""
    method, trained = METHODS[row["method"]], rows.get(row["weights"], {}) if "weights" in row else row
    if trained.get("vision") != row["vision"] or (trained is not row and "weights" in trained):
        raise ConfigError(f"{name} has weights {row['weights']}, which is no trained experiment of its vision")
    defaults = {"grasps": 1, "correction": method.correction, "architecture": METHODS[trained["method"]].architecture}
    values = defaults | {key: trained[key] for key in ("correction", "architecture") if key in trained} | {**row}
    values |= {"strategy": method.strategy} | ({} if row["touch"] else {"correction": None})
    experiment = Experiment.from_row(name, {key: values[key] for key in values if key != "method"})
    if not experiment.plan.accepts(experiment.vision, experiment.touch):
        raise ConfigError(f"{name}: {method.name} can't take as input: {experiment.input_label}")
    return experiment


def _selected(
    table: str, items: Sequence[Any], experiments: Mapping[str, Experiment]
) -> Iterator[tuple[str, Experiment]]:
    """The experiments that a table's names and grids say, in order."""
    for item in items:
        rows = {item: {"name": item}} if isinstance(item, str) else {name_of(row): row for row in combinations(item)}
        defined = {name: row for name, row in rows.items() if name in experiments}
        for key, value in itertools.chain.from_iterable(row.items() for row in rows.values()):
            if all(row[key] != value for row in defined.values()):
                raise ConfigError(f"table {table} has an experiment with {key}: {value}, and none is defined")
        yield from ((name, experiments[name]) for name in defined)
