"""Training recipes: one by its name with a run's overrides, and from it the settings of one model."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from palpate.configuration import ConfigError, check

Settings = dict[str, Any]


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> Settings:
    """`base` with the keys of `over`; where both hold a mapping, it is merged in turn. Neither is changed."""
    merged = copy.deepcopy(dict(base))
    for key, value in over.items():
        inner = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value) if inner else copy.deepcopy(value)
    return merged


def resolve(recipes: Path | str, name: str, override: Mapping[str, Any], schema: Path | str) -> Settings:
    """The recipe `name` of the file `recipes` with a run's `override` merged over it, checked.

    Raises ConfigError, naming the keys, if there is no such recipe, or the file or the result does not fit the
    schema or has neither steps nor epochs.
    """
    known = yaml.safe_load(Path(recipes).read_text())
    check(known, schema, str(recipes))
    if name not in known:
        raise ConfigError(f"config training.recipe: no recipe {name!r} in {recipes}; known: {', '.join(known)}")
    recipe = merge(known[name], override)
    check({name: recipe}, schema, f"recipe {name} with config training.override")
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
    return recipe


def modality(experiment: Mapping[str, Any]) -> str:
    """The modality of a model of config/experiments.yaml, as recipes name it: `occluded_touch`, `single_image`.

    Raises ConfigError for an experiment without vision and touch.
    """
    if experiment["vision"] == "views":
        return "single_image"
    inputs = [experiment["vision"]] * (experiment["vision"] != "none") + ["touch"] * experiment["touch"]
    if not inputs:
        raise ConfigError("an experiment needs vision or touch, and this one has neither")
    return "_".join(inputs)


def settings(recipe: Mapping[str, Any], experiment: Mapping[str, Any]) -> Settings:
    """How to train one experiment: `reconstruction` with what its modality, its strategy, then its row change.

    An experiment that goes on from its base model has the settings of `continuation` merged over these. Steps, epochs
    and the steps between evaluations are then multiplied by `steps_factor`, if there is one.
    """
    merged = _merged(recipe, experiment)
    if merged["architecture"] != "paper":
        merged["architecture"] = merge(merged["architecture"], experiment.get("architecture", {}))
    continuation = merged.pop("continuation")
    merged = merge(merged, continuation) if base(recipe, experiment) else merged
    factor = merged.pop("steps_factor", 1)
    lengths = ("steps", "epochs", "evaluate_every")
    return merged | {key: merged[key] and max(1, round(factor * merged[key])) for key in lengths}


def base(recipe: Mapping[str, Any], experiment: Mapping[str, Any]) -> str | None:
    """The name of the model that an experiment's training goes on from; None if it starts from random weights."""
    return experiment.get("base") if _merged(recipe, experiment)["continuation"] else None


def _merged(recipe: Mapping[str, Any], experiment: Mapping[str, Any]) -> Settings:
    merged = merge(recipe["reconstruction"], recipe["modalities"].get(modality(experiment), {}))
    return merge(merged, recipe["strategies"].get(experiment["strategy"], {}))
