"""The experiments of config/experiments.yaml: each model that a table needs, and the tables as lists of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from palpate.configuration import ConfigError, check, plain

SPLITS = ("validation", "test")  # that models are tested on


@dataclass(frozen=True)
class Correction:
    """How a prediction is bent to the touched points as its last step: `palpate.models.kriging`.

    length: m, of the kernel. noise: variance of a touched point, in units of the variance of what is interpolated.
    """

    length: float
    noise: float


@dataclass(frozen=True)
class Experiment:
    """One model: a row of config/experiments.yaml.

    Attributes:
        name: its key there.
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
        """The experiment of a row of the file, or of the form that `row` gives (checkpoints, Snakemake's params)."""
        correction = Correction(**row["correction"]) if row.get("correction") else None
        return cls(**{"name": name} | dict(row) | {"correction": correction})

    def row(self) -> dict[str, Any]:
        """The row as plain data, keys with their default left out: what checkpoints and Snakemake's params hold."""
        return {key: value for key, value in plain(self).items() if key != "name"}

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

        Raises ConfigError, naming the row, for a table's experiment that is not defined, weights that are not of a
        trained experiment with the same vision, or an experiment without vision and touch.
        """
        rows = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        check(rows, schema, str(path))
        experiments = {}
        for name, row in rows["experiments"].items():
            trained = rows["experiments"].get(row.get("weights"), {})
            if "weights" in row and (
                not trained or "weights" in trained or row.get("vision", trained["vision"]) != trained["vision"]
            ):
                raise ConfigError(
                    f"{path}: {name} has weights {row['weights']}, which is no trained experiment of its vision"
                )
            experiment = Experiment.from_row(name, trained | {"fewer_grasps": False} | row)
            experiments[name] = experiment if experiment.touch else replace(experiment, correction=None)
            if not experiment.has_vision and not experiment.touch:
                raise ConfigError(f"{path}: {experiment.name} needs vision or touch, and has neither")
        tables = {}
        for name, row in rows["tables"].items():
            for experiment in row["experiments"]:
                if experiment not in experiments:
                    raise ConfigError(f"{path}: table {name} has experiment {experiment}, which is not defined")
            tables[name] = Comparison(name, row["split"], tuple(experiments[each] for each in row["experiments"]))
        return cls(experiments, tables)

    def of_weights(self, trained: str) -> list[Experiment]:
        """The experiments that are evaluated with a trained model, itself first."""
        found = [each for each in self.experiments.values() if each.trained == trained]
        return sorted(found, key=lambda each: each.name != trained)
