"""Trained models as files: weights, with the experiment and settings behind them. Safe to load (no code in them)."""

import hashlib
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from palpate.atomic import atomic_write
from palpate.models import (
    SINGLE_IMAGE_ARCHITECTURES,
    SINGLE_IMAGE_MODELS,
    Reconstruction,
    SingleImageModel,
    TouchDepth,
    paper_architecture,
)
from palpate.remedy import command

# 1: models had the paper's camera, which was not stored.
SCHEMA_VERSION = 2


class CheckpointError(ValueError):
    """A checkpoint can't be used; the message names the file and what to do."""


def architecture(experiment: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """The layers of an experiment's model: those of its settings, or the paper's for its modalities.

    Of the published single-image networks those of their publications stand for the paper's.
    """
    if settings["architecture"] == "paper":
        if experiment["strategy"] in SINGLE_IMAGE_ARCHITECTURES:
            return SINGLE_IMAGE_ARCHITECTURES[experiment["strategy"]]
        return paper_architecture(experiment["vision"], experiment["touch"])
    return dict(settings["architecture"])


def build(experiment: Mapping[str, Any], layers: Mapping[str, Any]) -> Reconstruction | SingleImageModel:
    """The untrained model of a row of config/experiments.yaml."""
    if experiment["strategy"] in SINGLE_IMAGE_MODELS:
        return SINGLE_IMAGE_MODELS[experiment["strategy"]](layers)
    vision = experiment["vision"] != "none"
    return Reconstruction(experiment["strategy"], vision, experiment["touch"], experiment["grasps"], layers)


def continue_from(model: Reconstruction, path: Path | str) -> str:
    """Give an untrained model the weights of a trained one, its base; returns the SHA-256 of these weights.

    Inputs that the base does not have start with weight 0, so that the model predicts what its base does: rows of the
    first layer's weights, and whole weights of inputs. Raises CheckpointError if the base has weights that the model
    has not.
    """
    base = read(path, "reconstruction")["weights"]
    own = model.state_dict()
    digest = hashlib.sha256()
    for name, values in base.items():
        wanted = own[name].shape if name in own else None
        if wanted is None or values.shape[1:] != wanted[1:] or tuple(values.shape[:1]) > tuple(wanted[:1]):
            raise CheckpointError(f"{path} is no base of this model: its {name} does not fit; choose another base")
        own[name].zero_()
        own[name][tuple(slice(size) for size in values.shape)].copy_(values)
        digest.update(name.encode() + values.numpy().tobytes())
    for name in set(model.INPUT_WEIGHTS) & set(own) - set(base):
        torch.nn.init.zeros_(own[name])
    return digest.hexdigest()


def save(path: Path | str, kind: str, model: torch.nn.Module, described: Mapping[str, Any]) -> None:
    """Write a checkpoint atomically.

    kind: `reconstruction` or `touch_depth`. described: what `load` needs to build the model (`experiment` and
    `architecture`, or `width`), and further values that JSON can hold: for `palpate.reconstruct` the `camera` that all
    images had, a (3, 4) projection to pixels or None, and their `image_size`.
    """
    weights = {name: value.detach().cpu() for name, value in model.state_dict().items()}
    with atomic_write(path) as partial, open(partial, "wb") as file:  # by its name torch would name the content too
        torch.save({"schema_version": SCHEMA_VERSION, "kind": kind, **described, "weights": weights}, file)


def read(path: Path | str, kind: str) -> dict[str, Any]:
    """The content of a checkpoint.

    Raises CheckpointError if it is missing, damaged or can't be read, or is of another schema version or kind of model.
    """
    if not Path(path).exists():
        raise CheckpointError(f"{path} does not exist; train the model with: {command(path)}")
    require_intact(path)
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        version, content_kind = content["schema_version"], content["kind"]
    except Exception as error:
        raise CheckpointError(
            f"{path} is no checkpoint of Palpate ({type(error).__name__}); remove it and train again"
        ) from error
    if version != SCHEMA_VERSION:
        raise CheckpointError(
            f"{path} has schema version {version}, but this palpate reads version {SCHEMA_VERSION}; "
            "use the palpate that made it, or remove it and train the model again"
        )
    if content_kind != kind:
        raise CheckpointError(f"{path} is a model of kind {content_kind}, expected {kind}")
    return content


def require_intact(path: Path | str) -> None:
    """Raise CheckpointError if a file that torch saved is not as it was written.

    It is a ZIP archive, whose members have checksums (CRC-32). torch.load does not look at them.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            wrong = archive.testzip()
    except Exception as error:  # whatever a damaged directory of the archive makes the reader trip over
        raise CheckpointError(
            f"{path} is no checkpoint of Palpate ({type(error).__name__}: {error}); remove it and train again"
        ) from error
    if wrong is not None:
        raise CheckpointError(
            f"{path} has changed since it was written (checksum of {wrong}); remove it and train the model again"
        )


def load(path: Path | str, experiment: Mapping[str, Any] | None = None) -> Reconstruction | SingleImageModel:
    """A trained reconstruction model in evaluation mode, on the CPU.

    path: `<run>/models/<experiment>/seed-<k>/best.ckpt`. experiment: the row of config/experiments.yaml that
    it must be of, if given. Raises CheckpointError, before anything runs, if the file is missing, of another
    schema version, of another experiment, or its weights don't fit the architecture it names.
    """
    content = read(path, "reconstruction")
    if experiment is not None and dict(experiment) != content["experiment"]:
        raise CheckpointError(
            f"{path} was trained for {content['experiment']}, but {dict(experiment)} is asked for; "
            "remove it and train the model again"
        )
    return _filled(path, build(content["experiment"], content["architecture"]), content)


def load_touch_depth(path: Path | str) -> TouchDepth:
    """The trained U-Net in evaluation mode, on the CPU; raises CheckpointError as `load` does."""
    content = read(path, "touch_depth")
    return _filled(path, TouchDepth(content["width"]), content)


def _filled(path: Path | str, model: torch.nn.Module, content: Mapping[str, Any]):
    try:
        model.load_state_dict(content["weights"])
    except RuntimeError as error:
        first = str(error).splitlines()[1].strip() if "\n" in str(error) else str(error)
        raise CheckpointError(
            f"{path}: its weights are of another architecture than this palpate builds ({first}); "
            "use the palpate that made it, or remove it and train the model again"
        ) from error
    return model.eval()
