"""Architectures of the networks: those of config/recipes.yaml, and in `architectures.yaml` the paper's and others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from palpate.configuration import plain, read_yaml
from palpate.experiments import Experiment

ATLAS_RADIUS = 0.26  # m, of the initial sphere, around the object's centre (the published atlas)
Value = TypeVar("Value")


@dataclass(frozen=True)
class Encoder:
    """The image encoder."""

    channels: Sequence[int]  # of each block
    layers: Sequence[int]  # convolutions of each block
    pool: Sequence[int]  # numbers of the layers whose maps are pooled at vertices, from 1 over all blocks
    norm: str = "batch"  # of the convolutions, as padding
    padding: int = 0
    project: int | None = None  # features that pooled ones are projected to; None: all as they are
    downsample: int = 1  # pixels along a side of the squares over which images are averaged first


@dataclass(frozen=True)
class GCN:
    """The graph network."""

    layers: int
    width: int
    normalisation: str = "symmetric"  # of neighbourhoods (the paper's equation 1), or `mean` (the first release)
    shared_coordinates: int = 3  # how many of its 3 outputs are summed over neighbourhoods (the first release: 1)
    slope: float = 0.0  # of its ReLUs below 0


@dataclass(frozen=True)
class Decoder:
    """Of the published single-image networks: see `palpate.models.single_image`."""

    hidden: int
    points: int | None = None
    channels: Sequence[int] | None = None
    level: float | None = None


@dataclass(frozen=True)
class Architecture:
    """The layers and options of one model; defaults are the paper's, as released."""

    encoder: Encoder | None = None
    gcn: GCN | None = None
    decoder: Decoder | None = None
    failed_charts: str = "free"  # charts of unsuccessful touches are deformed, or stay at the fingertip (`fixed`)
    normalise_positions: bool = False  # whether positions are centred and divided by the radius, or in metres
    init: str = "paper"  # of the graph network's weights, as the next: see `palpate.models.gcn`
    last_layer_scale: float = 1.0
    deformations: int = 3  # how often charts are deformed (paper, section 3.1)
    radius: float = ATLAS_RADIUS  # m, of the initial sphere

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> "Architecture":
        """The architecture of a recipe or a checkpoint, as plain data."""
        parts = {"encoder": Encoder, "gcn": GCN, "decoder": Decoder}
        return cls(**dict(row) | {name: part(**row[name]) for name, part in parts.items() if row.get(name)})

    row = plain


def required(value: Value | None, name: str) -> Value:
    """An option of an architecture. Raises ValueError, naming it, if it has none."""
    if value is None:
        raise ValueError(f"the architecture has no {name}, which this model needs")
    return value


_ROWS = read_yaml(Path(__file__).with_suffix(".yaml"))
PAPER_ARCHITECTURES, SINGLE_IMAGE_ARCHITECTURES = (
    {name: Architecture.from_row(row) for name, row in _ROWS[group].items()} for group in ("paper", "single_image")
)


def paper_architecture(experiment: Experiment) -> Architecture:
    """The paper's architecture for an experiment's modality, or a single-image network's own."""
    return SINGLE_IMAGE_ARCHITECTURES.get(experiment.strategy) or PAPER_ARCHITECTURES[experiment.modality]
