"""Training recipes: one by its name with a run's overrides, and from it the settings of one model."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from palpate.architectures import Architecture, paper_architecture
from palpate.configuration import ConfigError, check, merge, not_among, plain
from palpate.experiments import Experiment
from palpate.strategies import STRATEGIES


@dataclass(frozen=True)
class Settings:
    """How one model is trained; config/recipes.yaml says what each is, and None stands for its null."""

    rate: float
    schedule: str
    clip: float | None
    batch: int
    steps: int | None
    epochs: int | None
    evaluate_every: int | None
    patience: int | None
    loss_points: int | None
    validation_samples: int | None

    row = plain


@dataclass(frozen=True)
class TouchDepthSettings(Settings):
    """Of the U-Net."""

    width: int  # channels of its first level


@dataclass(frozen=True)
class ReconstructionSettings(Settings):
    """Of a model of config/experiments.yaml."""

    loss_points: int
    validation_points: int  # sampled on its predictions
    epoch: str  # each of the `objects` once, or each of the `grasps`
    architecture: Architecture

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> "ReconstructionSettings":
        return cls(**{**row, "architecture": Architecture.from_row(row["architecture"])})


@dataclass(frozen=True)
class Recipe:
    """A recipe of config/recipes.yaml with a run's `training.override`, section by section as there."""

    touch_depth: TouchDepthSettings
    reconstruction: Mapping[str, Any]
    modalities: Mapping[str, Mapping[str, Any]]
    strategies: Mapping[str, Mapping[str, Any]]

    row = plain

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> "Recipe":
        return cls(**{**row, "touch_depth": TouchDepthSettings(**row["touch_depth"])})

    @classmethod
    def read(cls, recipes: Path | str, name: str, override: Mapping[str, Any], schema: Path | str) -> "Recipe":
        """The recipe `name` of the file `recipes` with a run's `override` merged over it, checked. Raises ConfigError,
        naming the keys, for an unknown recipe, or if a part of it does not fit the schema or has neither steps nor
        epochs."""
        known = yaml.safe_load(Path(recipes).read_text())
        check(known, schema, str(recipes))
        if name not in known:
            raise ConfigError(f"config training.recipe: no recipe {name!r} in {recipes}; known: {', '.join(known)}")
        recipe = merge(known[name], override)
        check({name: recipe}, schema, f"recipe {name} with config training.override")
        if unknown := [key for key in recipe["strategies"] if key not in STRATEGIES]:
            raise ConfigError(f"recipe {name} with config training.override: {not_among(unknown[0], STRATEGIES)}")
        sections = {"touch_depth": recipe["touch_depth"], "reconstruction": recipe["reconstruction"]}
        for section in ("modalities", "strategies"):
            for key, over in recipe[section].items():
                sections[f"{section}.{key}"] = merged = merge(recipe["reconstruction"], over)
                # Settings of one modality or strategy are complete only with those of all models.
                complete = recipe | {"reconstruction": merged, "modalities": {}, "strategies": {}}
                check({name: complete}, schema, f"recipe {name}, {section}.{key}")
        for path, settings in sections.items():
            if settings["steps"] is None and settings["epochs"] is None:
                raise ConfigError(f"recipe {name}: {path} needs steps or epochs")
        return cls.from_row(recipe)

    def settings(self, experiment: Experiment) -> ReconstructionSettings:
        """How to train one experiment: `reconstruction` with what its modality, its strategy, then its row change.
        Steps, epochs and the steps between evaluations are then multiplied by `steps_factor`, if there is one."""
        merged = merge(self.reconstruction, self.modalities.get(experiment.modality, {}))
        merged = merge(merged, self.strategies.get(experiment.strategy, {}))
        papers = merged["architecture"] == "paper"
        layers = paper_architecture(experiment).row() if papers else merged["architecture"]
        merged["architecture"] = merge(layers, experiment.architecture)
        factor = merged.pop("steps_factor", 1)
        for key in ("steps", "epochs", "evaluate_every"):
            merged[key] = merged[key] and max(1, round(factor * merged[key]))
        return ReconstructionSettings.from_row(merged)
