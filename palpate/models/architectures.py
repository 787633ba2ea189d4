"""The layers of the paper's networks, as `Reconstruction` takes them; others are in config/recipes.yaml."""

from typing import Any

_CONVOLUTIONS = {
    "channels": [16, 32, 64, 128],
    "layers": [5, 5, 5, 3],
    "pool": [10, 15, 18],
    "norm": "batch",
    "padding": 0,
}
# As released: positions in metres, the published code's random numbers, also in the last layer.
_AS_RELEASED = {"normalise_positions": False, "init": "paper", "last_layer_scale": 1.0}

# The supplement's tables "Architecture for deforming charts with ...", by modality; the
# number of graph layers by their indices. docs/models.md lists where the tables contradict themselves.
PAPER_ARCHITECTURES: dict[str, dict[str, Any]] = {
    "occluded_touch": {"encoder": _CONVOLUTIONS, "gcn": {"layers": 21, "width": 250}, **_AS_RELEASED},
    "occluded": {"encoder": _CONVOLUTIONS, "gcn": {"layers": 21, "width": 200}, **_AS_RELEASED},
    "unoccluded_touch": {"encoder": _CONVOLUTIONS, "gcn": {"layers": 26, "width": 200}, **_AS_RELEASED},
    "unoccluded": {
        "encoder": _CONVOLUTIONS | {"layers": [3, 3, 3, 3], "pool": [3, 6, 9, 12]},
        "gcn": {"layers": 21, "width": 250},
        **_AS_RELEASED,
    },
    "touch": {"gcn": {"layers": 15, "width": 250}, **_AS_RELEASED},
    "single_image": {
        "encoder": {
            "channels": [16, 32, 64, 128, 256],
            "layers": [5, 5, 5, 5, 5],
            "pool": [19, 22, 25],
            "norm": "instance",
            "padding": 1,
            "project": 250,
        },
        "gcn": {"layers": 25, "width": 250},
        **_AS_RELEASED,
    },
}

# The published single-image networks (`palpate.models.single_image`): decoders and graph networks of the sizes that
# their publications state, after the encoder that the paper has for single images.
_ENCODER = {key: value for key, value in PAPER_ARCHITECTURES["single_image"]["encoder"].items() if key != "project"}
SINGLE_IMAGE_ARCHITECTURES: dict[str, dict[str, Any]] = {
    # A map of each block, as the deconvolutions take them.
    "psg": {"encoder": _ENCODER | {"pool": [10, 15, 20, 25]}, "decoder": {"hidden": 2048, "points": 256}},
    "pixel2mesh": {
        "encoder": _ENCODER,
        "gcn": {"layers": 14, "width": 128},
        "init": "he",
        "last_layer_scale": 0.01,
    },
    "r2n2": {"encoder": _ENCODER, "decoder": {"hidden": 1024, "channels": [128, 128, 128, 64], "level": 0.4}},
}


def paper_architecture(vision: str, touch: bool) -> dict[str, Any]:
    """The paper's architecture for a vision (`occluded`, `unoccluded`, `views`, `none`) with or without touch."""
    if vision == "views":
        return PAPER_ARCHITECTURES["single_image"]
    name = "_".join([*([] if vision == "none" else [vision]), *(["touch"] if touch else [])])
    if name not in PAPER_ARCHITECTURES:
        raise ValueError(f"the paper has no architecture for vision {vision!r}, touch {touch}")
    return PAPER_ARCHITECTURES[name]
