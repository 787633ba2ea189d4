"""Trained models as files: weights, with the experiment and settings behind them. Safe to load (no code in them)."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch

from palpate import seal
from palpate.architectures import Architecture
from palpate.atomic import atomic_write
from palpate.experiments import Experiment
from palpate.models import SINGLE_IMAGE_MODELS, Reconstruction, SingleImageModel, TouchDepth
from palpate.models.reconstruction import HAND_SENSORS
from palpate.models.templates import Templates
from palpate.rebuild_command import rebuild_command
from palpate.sensor import DIGIT, Sensor

Model = TypeVar("Model", bound=torch.nn.Module)
SCHEMA_VERSION = 4  # of checkpoints; those of another are refused


class CheckpointError(ValueError):
    """A checkpoint can't be used; the message names the file and what to do."""


def build(
    experiment: Experiment,
    architecture: Architecture,
    hand_sensors: int = HAND_SENSORS,
    sensor: Sensor = DIGIT,
    templates: Templates | None = None,
) -> Reconstruction | SingleImageModel:
    """The untrained model of an experiment; with templates, if its strategy begins with them."""
    if experiment.strategy in SINGLE_IMAGE_MODELS:
        return SINGLE_IMAGE_MODELS[experiment.strategy](architecture)
    return Reconstruction(experiment, architecture, hand_sensors, sensor, templates)


def save(path: Path | str, kind: str, model: torch.nn.Module, described: Mapping[str, Any]) -> None:
    """Write a checkpoint atomically. kind: `reconstruction` or `touch_depth`. described: what `load` needs to build the
    model (`experiment` and `architecture`, or `width`; `sensor` and `hand_sensors`), and more that JSON can hold: the
    `camera` of all images, (3, 4) to pixels or None, and their `image_size`."""
    weights = {name: value.detach().cpu() for name, value in model.state_dict().items()}
    content = io.BytesIO()  # torch's own writing of a file does not say that the disk is full
    torch.save({"schema_version": SCHEMA_VERSION, "kind": kind, **described, "weights": weights}, content)
    with atomic_write(path, seal.NOTHING) as partial:
        partial.write_bytes(content.getbuffer())


def read(path: Path | str, kind: str) -> dict[str, Any]:
    """The content of a checkpoint. Raises CheckpointError if it is missing, damaged or can't be read, or is of another
    schema version or kind of model."""
    if not Path(path).exists():
        raise CheckpointError(f"{path} does not exist; train the model with: {rebuild_command(path)}")
    require_intact(path)
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        version, content_kind = content["schema_version"], content["kind"]
        if version == SCHEMA_VERSION and not isinstance(content["weights"], dict):
            raise TypeError("no weights")
    except Exception as error:
        problem = f"no checkpoint of Palpate ({type(error).__name__})"
        raise CheckpointError(f"{path} is {problem}; remove it and train again") from error
    if version != SCHEMA_VERSION:
        raise CheckpointError(
            f"{path} has schema version {version}, but this palpate reads version {SCHEMA_VERSION}; "
            "use the palpate that made it, or remove it and train the model again"
        )
    if content_kind != kind:
        raise CheckpointError(f"{path} is a model of kind {content_kind}, expected {kind}")
    name, trained = name_of(path), content.get("name")
    if None not in (name, trained) and name != trained:
        remedy = f"remove it and train it with: {rebuild_command(path)}"
        raise CheckpointError(f"{path} is the model {trained}, not {name}; {remedy}")
    return content


def name_of(path: Path | str) -> str | None:
    """The name `<experiment>/seed-<k>` of a checkpoint in a run's folder `models`; None elsewhere."""
    parts = Path(path).parts[-4:-1]
    return "/".join(parts[1:]) if len(parts) == 3 and parts[0] == "models" else None


def require_intact(path: Path | str) -> None:
    """Raise CheckpointError if a checkpoint is not as its seal states, which torch.load does not look at."""
    try:
        seal.verify(path)
    except seal.DamagedFile as error:
        raise CheckpointError(str(error)) from None


def experiment_of(content: Mapping[str, Any]) -> Experiment:
    return Experiment.from_row(str(content.get("name") or "").partition("/")[0], content["experiment"])


def load(path: Path | str, experiment: Experiment | None = None) -> Reconstruction | SingleImageModel:
    """A trained reconstruction model in evaluation mode, on the CPU, from
    `<run>/models/<experiment>/seed-<k>/best.ckpt`. experiment: the one that it must be of, or that is evaluated with
    these weights (`Experiment.weights`). Raises CheckpointError, before anything runs, if the file is missing, of
    another schema version or experiment, or doesn't fit."""
    return model_of(path, read(path, "reconstruction"), experiment)


def model_of(
    path: Path | str, content: dict[str, Any], experiment: Experiment | None = None
) -> Reconstruction | SingleImageModel:
    """As `load`, from the content of the checkpoint, as `read` gives it."""
    sharing = experiment if experiment and experiment.weights is not None else None
    if experiment and not sharing and experiment.row() != content.get("experiment"):
        raise CheckpointError(
            f"{path} was trained for {content.get('experiment')}, but {experiment.row()} is asked for; "
            "remove it and train the model again"
        )

    def make() -> Reconstruction | SingleImageModel:
        architecture = Architecture.from_row(content["architecture"])
        arrays = (content["weights"].get(f"templates.{name}") for name in ("shapes", "masks", "scales"))
        described = sharing or experiment_of(content)
        templates = Templates(*arrays) if described.plan.start == "templates" else None
        model = build(described, architecture, *_sensor_of(content), templates)
        if sharing:  # one without touch leaves out what a touch would pass through
            own, weights = model.state_dict(), content["weights"]
            content["weights"] = {name: weights[name] for name in weights if name in own or name[:6] != "touch_"}
        return model

    return _filled(path, make, content)


def _sensor_of(content: Mapping[str, Any]) -> tuple[int, Sensor]:
    """A hand's number of sensors and their kind, of a checkpoint; the Allegro's of a model without touch."""
    sensor = Sensor.from_description(content["sensor"]) if "sensor" in content else DIGIT
    return content.get("hand_sensors", HAND_SENSORS), sensor


def require_sensor(
    trained_sensors: int | None, trained: Sensor, data_sensors: int | None, data: Sensor, model: Path | str
) -> None:
    """Raise CheckpointError if data are of another kind of sensor than a model, or of another number a hand
    (None: any). model: its name for error messages."""
    differences = list(filter(None, [trained.geometry_difference(data)]))
    if None not in (trained_sensors, data_sensors) and trained_sensors != data_sensors:
        differences.append(f"sensors of a hand: {trained_sensors} and {data_sensors}")
    if differences:
        raise CheckpointError(
            f"{model} was trained with sensor {trained.name!r}, but the data are of {data.name!r}: "
            f"{'; '.join(differences)}; train the model with these data, or use data of its sensor"
        )


def load_touch_depth(path: Path | str) -> TouchDepth:
    """The trained U-Net in evaluation mode, on the CPU; raises as `load`."""
    content = read(path, "touch_depth")
    return _filled(path, lambda: TouchDepth(content["width"], _sensor_of(content)[1]), content)


def _filled(path: Path | str, make: Callable[[], Model], content: Mapping[str, Any]) -> Model:
    """The model that `make` builds, with the content's weights, in evaluation mode."""
    try:
        model = make()
        model.load_state_dict(content["weights"])
    except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        first = " ".join(str(error).split("\n\t")[:2][-1].split())  # of load_state_dict: the first difference
        raise CheckpointError(
            f"{path} holds another model than this palpate builds ({type(error).__name__}: {first}); "
            "use the palpate that made it, or remove it and train the model again"
        ) from error
    return model.eval()
