"""The layers of live modules, run one by one, compared with the rows of the paper's tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from palpate.architectures import PAPER_ARCHITECTURES
from palpate.camera import IMAGE_SIZE
from palpate.experiments import Experiment
from palpate.results import products
from palpate.results.published import paper_rows
from palpate.touch.reading import RESOLUTION
from palpate.vision.views import SIZE as VIEW_SIZE

if TYPE_CHECKING:
    from pandas import DataFrame
    from torch import Tensor, nn

    from palpate.models.reconstruction import Reconstruction
    from palpate.models.touch_depth import TouchDepth

FIELDS = ["input", "operation", "shape"]
WORDS = {"BatchNorm2d": "BN", "GroupNorm": "IN", "ReLU": "ReLU", "Linear": "Linear"}  # by the type of a layer
# Names of convolutions and poolings, and the stride that goes without saying.
STRIDED = {"Conv2d": ("Conv", 1), "ConvTranspose2d": ("DeConv", 2), "MaxPool2d": ("MaxPooling", 2)}


def operation(layer: nn.Module) -> str:
    """A layer, or a block of layers, in the wording of the paper's tables."""
    kind = type(layer).__name__
    if kind in STRIDED:
        name, stride = STRIDED[kind]
        size, real = (np.broadcast_to(cast("Any", value), 2) for value in (layer.kernel_size, layer.stride))
        return f"{name} ({size[0]} x {size[1]})" + ("" if real[0] == stride else f" (stride {real[0]})")
    return WORDS.get(kind) or " + ".join(map(operation, cast("nn.Sequential", layer)))


class Listing:
    """Rows of index, input, operation and shape; steps are counted from 1."""

    def __init__(self) -> None:
        self.rows: list[dict[str, str]] = []

    def add(self, operation: str, shape: tuple[int, ...] | int, *sources: str, index: str | None = None) -> str:
        """Adds a row and returns its name. shape: C, H, W of a map, or a vertex's channels."""
        steps = sum(row["index"].isdigit() for row in self.rows)
        size = f"|V| x {shape}" if isinstance(shape, int) else " x ".join(map(str, shape))
        row = {"index": index or str(1 + steps), "input": " ".join(sources), "operation": operation, "shape": size}
        self.rows.append(row)
        return operation if index else f"({1 + steps})"

    def run(self, layer: nn.Module, source: tuple[str, Tensor]) -> tuple[str, Tensor]:
        """Runs a layer on the output of a row, and adds it; names and outputs go together."""
        output = layer(source[1])
        return self.add(operation(layer), output.shape[1:], source[0]), output


def read_layers(module: Reconstruction | TouchDepth, image: Tensor | None = None) -> list[dict[str, str]]:
    """The layers of a module in the order in which they run: rows of index, input, operation, shape.
    image: (1, 3, H, W) that they are run on. The wording is that of the supplement's tables. `index` counts from 1; two
    rows before name the inputs, `image` and `vertices`. Shapes are a sample's: C x H x W, or |V| x C."""
    import torch

    from palpate.models.touch_depth import TouchDepth

    listing = Listing()
    with torch.no_grad():
        (_unet_layers if isinstance(module, TouchDepth) else _reconstruction_layers)(module, image, listing)
    return sorted(listing.rows, key=lambda row: row["index"].isdigit())


def _unet_layers(model: Any, reading: Any, listing: Listing) -> None:  # PyTorch declares no types of its layers
    import torch

    x = listing.add("Input", reading.shape[1:], index="image"), reading
    levels = []
    for level, blocks in enumerate(model.down):
        for layer in [*([model.pool[level - 1]] if level else []), *blocks]:
            x = listing.run(layer, x)
        levels.append(x)
    levels.pop()
    for upsample, up in zip(model.upsample, model.up, strict=True):
        x, skip = listing.run(upsample, x), levels.pop()
        joined = torch.cat([x[1], skip[1]], dim=1)
        x = listing.run(up, (listing.add("Concatenate", joined.shape[1:], x[0], skip[0]), joined))
    listing.run(model.depth, x)


def _reconstruction_layers(model: Any, image: Tensor | None, listing: Listing) -> None:
    own = source = "Vertex Input"
    channels = model.gcn.layers[0].weight.shape[0]
    if image is not None:
        x, maps = (listing.add("Image Input", image.shape[1:], index="image"), image), []
        for number, layer in enumerate(model.encoder.layers, start=1):
            x = listing.run(layer, x)
            if number in model.encoder.pool:
                maps.append(x)
        features = sum(output.shape[1] for _, output in maps)
        source = listing.add("perceptual feature pooling", features, *(name for name, _ in maps))
        if model.project:
            features = model.project[0].out_features
            source = listing.add(operation(model.project), features, source)
    listing.add(own, channels, index="vertices")
    if image is not None:
        source = listing.add("Concatenate", features + channels, source, own)
    for layer in model.gcn.layers:
        source = listing.add("GCN Layer", layer.weight.shape[1], source)


def compare(model: str, rows: list[dict[str, str]]) -> DataFrame:
    """The paper's table of a model beside the rows read off a live module, a verdict for each. Columns: index; input,
    operation, shape, of the module and (`_paper`) of the paper; `verdict`: `agrees`, `contradiction` (the paper
    contradicts itself: `note` says how, and the module is as it says), or `differs`. `attrs["note"]` counts them."""
    from pandas import DataFrame

    files = ("architectures", "contradictions")  # in the supplement's table "..." is written out
    papers = [[row for row in paper_rows(file) if row["model"] == model] for file in files]
    paper, known, live = ({row["index"]: row for row in listed} for listed in (*papers, rows))
    table = []
    for index in dict.fromkeys([*paper, *live]):
        published, measured, remark = (listed.get(index, {}) for listed in (paper, live, known))
        line: dict[str, str | None] = {"index": index}
        for field in FIELDS:
            line |= {f"{field}_paper": published.get(field), field: measured.get(field)}
        line |= {"verdict": "differs", "note": ""}
        if published and measured:
            if _same(published, measured):
                line |= {"verdict": "agrees", "note": remark.get("note", "")}
            elif remark and _same(published | {key: value for key, value in remark.items() if value}, measured):
                line |= {"verdict": "contradiction", "note": remark["note"]}
        table.append(line)
    frame = DataFrame(table)
    counts = frame["verdict"].value_counts()
    frame.attrs["note"] = (
        f"{counts.get('agrees', 0)} of {len(frame)} rows agree with the paper's table; in "
        f"{counts.get('contradiction', 0)} the paper contradicts itself; {counts.get('differs', 0)} differ. "
        "Read off the live module on one sample, at the first of three deformations."
    )
    return frame


@products.table(name="architectures/{model}")
def architecture(model: str) -> DataFrame:
    """Layers of the live module, run one by one, beside the rows of the paper's table. A note explains each place where
    the paper contradicts itself.

    model: "touch_depth" (the U-Net) or a name in `PAPER_ARCHITECTURES`.
    """
    import torch

    from palpate.models.reconstruction import Reconstruction
    from palpate.models.touch_depth import TouchDepth

    if model == "touch_depth":
        return compare(model, read_layers(TouchDepth().eval(), torch.rand(1, 3, RESOLUTION, RESOLUTION)))
    layers = PAPER_ARCHITECTURES[model]
    vision = "occluded" if layers.encoder else "none"
    module = Reconstruction(Experiment(model, "charts", vision, "touch" in model, 1), layers).eval()
    size = VIEW_SIZE if model == "single_image" else IMAGE_SIZE
    return compare(model, read_layers(module, torch.rand(1, 3, size, size) if layers.encoder else None))


def _same(one: Mapping[str, str], other: Mapping[str, str]) -> bool:  # but for the order of inputs
    return all(sorted(one[field].split()) == sorted(other[field].split()) for field in FIELDS)
