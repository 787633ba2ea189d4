"""The grid of hyperparameters that the supplement tunes, and the settings of each of its points. No torch."""

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from palpate.architectures import required
from palpate.configuration import ConfigError
from palpate.learning.recipes import ReconstructionSettings

KEYS = ("rate", "cnn_layers", "gcn_layers", "width")
BLOCKS = 4  # of an image encoder, in the paper's models


def grid(file: Path | str, name: str) -> list[dict[str, Any]]:
    """The points of a grid of `config/tuning.yaml`, each a value of every one of `KEYS`. Raises ConfigError if there is
    no such grid or it does not have these keys."""
    grids = yaml.safe_load(Path(file).read_text())
    if name not in grids:
        raise ConfigError(f"config tuning.grid: no grid {name!r} in {file}; known: {', '.join(grids)}")
    if set(grids[name]) != set(KEYS):
        raise ConfigError(f"{file}: grid {name} must have {', '.join(KEYS)}, but it has {', '.join(grids[name])}")
    values = (grids[name][key] for key in KEYS)
    return [dict(zip(KEYS, point, strict=True)) for point in itertools.product(*values)]


def layers_of_blocks(count: int) -> list[int]:
    """Convolutions in each of the paper's four blocks; the last has the remainder (18: 5, 5, 5, 3; 12: 3, 3, 3, 3).
    Raises ConfigError if the last block would be empty."""
    most = -(-count // BLOCKS)
    layers = [most] * (BLOCKS - 1) + [count - (BLOCKS - 1) * most]
    if layers[-1] < 1:
        raise ConfigError(f"tuning: {count} CNN layers can't be laid into {BLOCKS} blocks as the paper's")
    return layers


def point_settings(
    settings: ReconstructionSettings, point: Mapping[str, Any], steps: int | None
) -> ReconstructionSettings:
    """The settings of one training of the grid: those of the experiment, with a point's layers and rate. Maps are
    pooled after the last three blocks, as in the paper's tables. steps: replaces those of the settings, unless None."""
    layers, old = layers_of_blocks(point["cnn_layers"]), settings.architecture
    encoder = replace(required(old.encoder, "encoder"), layers=layers, pool=list(itertools.accumulate(layers))[1:])
    gcn = replace(required(old.gcn, "gcn"), layers=point["gcn_layers"], width=point["width"])
    architecture = replace(old, encoder=encoder, gcn=gcn)
    return replace(settings, architecture=architecture, rate=point["rate"], steps=steps or settings.steps)
