"""Training recipes: one by its name with a run's overrides, and from it the settings of one model. The grid of
hyperparameters that the supplement tunes. No torch."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate.architectures import Architecture, paper_architecture, required
from palpate.configuration import ConfigError, check, merge, not_among, plain, read_yaml
from palpate.experiments import Experiment, combinations
from palpate.strategies import STRATEGIES

TUNED = ("rate", "cnn_layers", "gcn_layers", "width")
BLOCKS = 4  # of an image encoder, in the paper's models


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
        naming the keys, for an unknown recipe, a part without steps or epochs, patience where the last step is kept,
        what the schema does not allow, and as `read_yaml`."""
        known = read_yaml(recipes)
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
            if settings["patience"] and settings["schedule"] != "constant":
                raise ConfigError(f"recipe {name}: {path} has patience, which needs schedule constant")
        return cls.from_row(recipe)

    def settings(self, experiment: Experiment) -> ReconstructionSettings:
        """How to train one experiment. Over `reconstruction` its modality's settings are merged, then its strategy's;
        over their architecture its own. Steps, epochs and the steps between evaluations are then multiplied by
        `steps_factor`, if there is one."""
        merged = merge(self.reconstruction, self.modalities.get(experiment.modality, {}))
        merged = merge(merged, self.strategies.get(experiment.strategy, {}))
        papers = merged["architecture"] == "paper"
        layers = paper_architecture(experiment).row() if papers else merged["architecture"]
        merged["architecture"] = merge(layers, experiment.architecture)
        factor = merged.pop("steps_factor", 1)
        for key in ("steps", "epochs", "evaluate_every"):
            merged[key] = merged[key] and max(1, round(factor * merged[key]))
        return ReconstructionSettings.from_row(merged)


def tuning_grid(file: Path | str, name: str) -> list[dict[str, Any]]:
    """The points of a grid of `config/tuning.yaml`, each a value of every one of `TUNED`. Raises ConfigError if there
    is no such grid or it does not have these keys, and as `read_yaml`."""
    grids = read_yaml(file)
    if name not in grids:
        raise ConfigError(f"config tuning.grid: no grid {name!r} in {file}; known: {', '.join(grids)}")
    if set(grids[name]) != set(TUNED):
        raise ConfigError(f"{file}: grid {name} must have {', '.join(TUNED)}, but it has {', '.join(grids[name])}")
    return combinations({key: grids[name][key] for key in TUNED})


def layers_of_blocks(count: int) -> list[int]:
    """Convolutions in each of the paper's four blocks; the last has the remainder (18: 5, 5, 5, 3; 12: 3, 3, 3, 3).
    Raises ConfigError if the last block would be empty."""
    most = -(-count // BLOCKS)
    layers = [most] * (BLOCKS - 1) + [count - (BLOCKS - 1) * most]
    if layers[-1] < 1:
        raise ConfigError(f"tuning: {count} CNN layers can't be laid into {BLOCKS} blocks as the paper's")
    return layers


def tuning_settings(
    settings: ReconstructionSettings, point: Mapping[str, Any], steps: int | None
) -> ReconstructionSettings:
    """The settings of one training of the grid: those of the experiment, with a point's layers and rate. Maps are
    pooled after the last three blocks, as in the paper's tables. steps: replaces those of the settings, unless None."""
    layers, old = layers_of_blocks(point["cnn_layers"]), settings.architecture
    encoder = replace(required(old.encoder, "encoder"), layers=layers, pool=list(itertools.accumulate(layers))[1:])
    gcn = replace(required(old.gcn, "gcn"), layers=point["gcn_layers"], width=point["width"])
    architecture = replace(old, encoder=encoder, gcn=gcn)
    return replace(settings, architecture=architecture, rate=point["rate"], steps=steps or settings.steps)
