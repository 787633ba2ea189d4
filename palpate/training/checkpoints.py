"""Trained models as files: weights, with the experiment and settings behind them. Safe to load (no code in them)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from palpate.atomic import atomic_write
from palpate.models import Reconstruction, TouchDepth, paper_architecture

SCHEMA_VERSION = 1


class CheckpointError(ValueError):
    """A checkpoint can't be used; the message names the file and what to do."""


def architecture(experiment: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """The layers of an experiment's model: those of its settings, or the paper's for its modalities."""
    if settings["architecture"] == "paper":
        return paper_architecture(experiment["vision"], experiment["touch"])
    return dict(settings["architecture"])


def build(experiment: Mapping[str, Any], layers: Mapping[str, Any]) -> Reconstruction:
    """The untrained model of a row of config/experiments.yaml."""
    vision = experiment["vision"] != "none"
    return Reconstruction(experiment["strategy"], vision, experiment["touch"], experiment["grasps"], layers)


def save(path: Path | str, kind: str, model: torch.nn.Module, described: Mapping[str, Any]) -> None:
    """Write a checkpoint, whole or not at all. kind: `reconstruction` or `touch_depth`. described: what
    `load` needs to build the model (`experiment` and `architecture`, or `width`), and anything else that JSON
    can hold."""
    weights = {name: value.detach().cpu() for name, value in model.state_dict().items()}
    with atomic_write(path) as partial:
        torch.save({"schema_version": SCHEMA_VERSION, "kind": kind, **described, "weights": weights}, partial)


def read(path: Path | str, kind: str) -> dict[str, Any]:
    """What a checkpoint holds. Raises CheckpointError if it is missing, can't be read, of another schema
    version, or of another kind of model."""
    target = "/".join(Path(path).parts[-4:])
    if not Path(path).exists():
        raise CheckpointError(f"{path} does not exist; train the model with: snakemake {target}")
    try:
        held = torch.load(path, map_location="cpu", weights_only=True)
        version, found = held["schema_version"], held["kind"]
    except Exception as error:
        raise CheckpointError(
            f"{path} is no checkpoint of Palpate ({type(error).__name__}); remove it and train again"
        ) from error
    if version != SCHEMA_VERSION:
        raise CheckpointError(
            f"{path} has schema version {version}, but this palpate reads version {SCHEMA_VERSION}; "
            "use the palpate that made it, or remove it and train the model again"
        )
    if found != kind:
        raise CheckpointError(f"{path} is a model of kind {found}, expected {kind}")
    return held


def load(path: Path | str, experiment: Mapping[str, Any] | None = None) -> Reconstruction:
    """A trained reconstruction model in evaluation mode, on the CPU.

    path: `<run>/models/<experiment>/seed-<k>/best.ckpt`. experiment: the row of config/experiments.yaml that
    it must be of, if given. Raises CheckpointError, before anything runs, if the file is missing, of another
    schema version, of another experiment, or its weights don't fit the architecture it names.
    """
    held = read(path, "reconstruction")
    if experiment is not None and dict(experiment) != held["experiment"]:
        raise CheckpointError(
            f"{path} was trained for {held['experiment']}, but {dict(experiment)} is asked for; "
            "remove it and train the model again"
        )
    return _filled(path, build(held["experiment"], held["architecture"]), held)


def load_touch_depth(path: Path | str) -> TouchDepth:
    """The trained U-Net in evaluation mode, on the CPU; raises CheckpointError as `load` does."""
    held = read(path, "touch_depth")
    return _filled(path, TouchDepth(held["width"]), held)


def _filled(path: Path | str, model: torch.nn.Module, held: Mapping[str, Any]):
    try:
        model.load_state_dict(held["weights"])
    except RuntimeError as error:
        first = str(error).splitlines()[1].strip() if "\n" in str(error) else str(error)
        raise CheckpointError(
            f"{path}: its weights are of another architecture than this palpate builds ({first}); "
            "use the palpate that made it, or remove it and train the model again"
        ) from error
    return model.eval()
