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
    schema or says nothing of how long to train.
    """
    known = yaml.safe_load(Path(recipes).read_text())
    check(known, schema, str(recipes))
    if name not in known:
        raise ConfigError(f"config training.recipe: no recipe {name!r} in {recipes}; known: {', '.join(known)}")
    recipe = merge(known[name], override)
    check({name: recipe}, schema, f"recipe {name} with config training.override")
    parts = {"touch_depth": recipe["touch_depth"], "reconstruction": recipe["reconstruction"]}
    for part in ("modalities", "strategies"):
        for key, over in recipe[part].items():
            parts[f"{part}.{key}"] = whole = merge(recipe["reconstruction"], over)
            # What is said of a part of the models is complete only with what is said of all.
            complete = recipe | {"reconstruction": whole, "modalities": {}, "strategies": {}}
            check({name: complete}, schema, f"recipe {name}, {part}.{key}")
    for path, settings in parts.items():
        if settings["steps"] is None and settings["epochs"] is None:
            raise ConfigError(f"recipe {name}: {path} needs steps or epochs")
    return recipe


def modality(experiment: Mapping[str, Any]) -> str:
    """What a model of config/experiments.yaml sees, in the recipes' words: `occluded_touch`, `single_image`.

    Raises ConfigError for an experiment that sees nothing.
    """
    if experiment["vision"] == "views":
        return "single_image"
    seen = [experiment["vision"]] * (experiment["vision"] != "none") + ["touch"] * experiment["touch"]
    if not seen:
        raise ConfigError("an experiment needs vision or touch, and this one has neither")
    return "_".join(seen)


def settings(recipe: Mapping[str, Any], experiment: Mapping[str, Any]) -> Settings:
    """How to train one experiment: `reconstruction` with what its modality, then its strategy, change."""
    found = merge(recipe["reconstruction"], recipe["modalities"].get(modality(experiment), {}))
    return merge(found, recipe["strategies"].get(experiment["strategy"], {}))
