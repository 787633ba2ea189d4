"""The layers of a live module, recorded with hooks, compared with the rows of the paper's tables."""

from collections.abc import Callable, Mapping
from itertools import chain
from typing import Any

import pandas as pd
import torch
from torch import Tensor, nn

from palpate.camera import IMAGE_SIZE, paper_camera
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.mesh import OBJECT_POSITION
from palpate.models.architectures import PAPER_ARCHITECTURES
from palpate.models.gcn import ZeroNeighbourLayer
from palpate.models.layers import Concatenate, ConvolutionBlock, LinearBlock
from palpate.models.pooling import MapProducts, PerceptualPooling
from palpate.models.reconstruction import Reconstruction
from palpate.models.touch_depth import TouchDepth
from palpate.results import products, published
from palpate.touch.sensor import RESOLUTION
from palpate.vision.views import SIZE as VIEW_SIZE

FIELDS = ["input", "operation", "shape"]
VERTICES = "Vertex Input"


def _convolution(layer: nn.Conv2d | nn.ConvTranspose2d | nn.MaxPool2d, name: str, stride: int) -> str:
    size = layer.kernel_size if isinstance(layer.kernel_size, tuple) else (layer.kernel_size,) * 2
    real = layer.stride if isinstance(layer.stride, int) else layer.stride[0]
    return f"{name} ({size[0]} x {size[1]})" + ("" if real == stride else f" (stride {real})")


def _block(block: nn.Sequential) -> str:
    """The operations of a block of layers, in the wording of the paper's tables."""
    words = {nn.BatchNorm2d: "BN", nn.GroupNorm: "IN", nn.ReLU: "ReLU", nn.Linear: "Linear"}
    return " + ".join(
        _convolution(layer, "Conv", 1) if isinstance(layer, nn.Conv2d) else words[type(layer)] for layer in block
    )


# Modules that are a row of a table, and the row's wording. Modules inside them are not recorded.
OPERATIONS: dict[type[nn.Module], Callable[[Any], str]] = {
    ConvolutionBlock: _block,
    LinearBlock: _block,
    nn.Conv2d: lambda layer: _convolution(layer, "Conv", 1),
    nn.ConvTranspose2d: lambda layer: _convolution(layer, "DeConv", 2),
    nn.MaxPool2d: lambda layer: _convolution(layer, "MaxPooling", 2),
    Concatenate: lambda layer: "Concatenate",
    PerceptualPooling: lambda layer: "perceptual feature pooling",
    MapProducts: lambda layer: "perceptual feature pooling",
    ZeroNeighbourLayer: lambda layer: "GCN Layer",
}


class _Recorder:
    """Records a row when its module runs for the first time (further deformations repeat it)."""

    def __init__(self) -> None:
        self.rows: list[dict[str, str]] = []
        self.names: dict[int, str] = {}
        self.tensors: list[Tensor] = []  # An id stays a tensor's own as long as the tensor lives.
        self.recorded: set[nn.Module] = set()
        self.image_features: Tensor | None = None  # of a vertex
        self.vertices: Tensor | None = None  # a vertex's other inputs

    def add(self, sources: list[Tensor], operation: str, output: Tensor, index: str = "") -> None:
        """Add a row. index: of an input, `image` or `vertices`; other rows are numbered."""
        number = str(1 + sum(row["index"].isdigit() for row in self.rows))
        # Images are (B, C, H, W), vertices (V, B, C).
        shape = " x ".join(map(str, output.shape[1:] if output.ndim == 4 else ["|V|", output.shape[-1]]))
        inputs = " ".join(dict.fromkeys(self.names.get(id(tensor), VERTICES) for tensor in sources))
        self.rows.append({"index": index or number, "input": inputs, "operation": operation, "shape": shape})
        self.tensors.append(output)
        self.names[id(output)] = operation if index else f"({number})"

    def __call__(self, module: nn.Module, inputs: tuple, output: Tensor) -> None:
        if module in self.recorded:
            return
        self.recorded.add(module)
        pools = isinstance(module, MapProducts | PerceptualPooling)
        if isinstance(module, MapProducts):
            # The first layer's weights are applied to the maps: what is pooled has the maps' channels.
            output = torch.empty(1, 1, sum(features.shape[1] for features in inputs[0]))
        if isinstance(module, ZeroNeighbourLayer) and self.vertices is None:
            inputs = (self.first_input(inputs[0]),)
        flat = inputs[0] if pools else chain(*(each if isinstance(each, list) else [each] for each in inputs))
        sources = [tensor for tensor in flat if isinstance(tensor, Tensor)]
        if isinstance(module, Concatenate) and all(id(tensor) not in self.names for tensor in sources):
            return  # a vertex's own inputs
        self.add(sources, OPERATIONS[type(module)](module), output)
        if pools or isinstance(module, LinearBlock):
            self.image_features = output

    def first_input(self, own: Tensor) -> Tensor:
        """The whole input of the first graph layer: a vertex's own (V, B, C), and the image's, which are products."""
        self.vertices = own
        self.add([], VERTICES, own, "vertices")
        if self.image_features is None:
            return own
        joined = torch.empty(1, 1, self.image_features.shape[-1] + own.shape[-1])
        self.add([self.image_features, own], "Concatenate", joined)
        return joined


@torch.no_grad()
def read_layers(module: nn.Module, inputs: Tensor | Mapping[str, Tensor]) -> list[dict[str, str]]:
    """Run a module on its inputs and record its layers: rows of index, input, operation, shape.

    The wording is that of the supplement's tables. `index` counts from 1; two rows before name the inputs,
    `image` and `vertices`. Shapes are a sample's: C x H x W, or |V| x C.
    """
    recorder, hooks, parts = _Recorder(), [], [module]
    image = inputs.get("image") if isinstance(inputs, Mapping) else inputs
    if image is not None:
        recorder.add([], "Image Input" if isinstance(inputs, Mapping) else "Input", image, "image")
    while parts:
        part = parts.pop()
        if type(part) in OPERATIONS:
            hooks.append(part.register_forward_hook(recorder))
        else:
            parts += part.children()
    try:
        module(inputs)
    finally:
        for hook in hooks:
            hook.remove()
    return sorted(recorder.rows, key=lambda row: row["index"].isdigit())


def paper_rows(model: str) -> list[dict[str, str]]:
    """The rows of the supplement's table of a model, "..." written out."""
    table = _read("architectures", model)
    rows: list[dict[str, str]] = []
    for row, following in zip(table, [*table[1:], None], strict=True):
        if row["index"] != "...":
            rows.append(row)
            continue
        assert following is not None
        for index in range(int(rows[-1]["index"]) + 1, int(following["index"])):
            rows.append(rows[-1] | {"index": str(index), "input": f"({index - 1})"})
    return rows


def compare(model: str, rows: list[dict[str, str]]) -> pd.DataFrame:
    """The paper's table of a model beside the rows read off a live module, a verdict for each.

    Columns: index; input, operation, shape, of the module and (`_paper`) of the paper; `verdict`: `agrees`,
    `contradiction` (the paper contradicts itself: `note` says how, and the module is as it says), or
    `differs`. `attrs["note"]` counts them.
    """
    paper, known, live = (
        {row["index"]: row for row in each} for each in (paper_rows(model), _read("contradictions", model), rows)
    )
    table = []
    for index in dict.fromkeys([*paper, *live]):
        published, measured, remark = (each.get(index, {}) for each in (paper, live, known))
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
    frame = pd.DataFrame(table)
    counts = frame["verdict"].value_counts()
    frame.attrs["note"] = (
        f"{counts.get('agrees', 0)} of {len(frame)} rows agree with the paper's table; in "
        f"{counts.get('contradiction', 0)} the paper contradicts itself; {counts.get('differs', 0)} differ. "
        "Read off the live module on one sample, at the first of three deformations."
    )
    return frame


@products.table(name="architectures/{model}")
def architecture(model: str) -> pd.DataFrame:
    """Layers of the live module, read off with hooks, beside the rows of the paper's table. A note explains each place
    where the paper contradicts itself.

    model: "touch_depth" (the U-Net) or a name in `PAPER_ARCHITECTURES`.
    """
    if model == "touch_depth":
        return compare(model, read_layers(TouchDepth().eval(), _image(RESOLUTION)))
    layers = PAPER_ARCHITECTURES[model]
    module = Reconstruction("charts", "encoder" in layers, "touch" in model, 1, layers).eval()
    batch = _seen(VIEW_SIZE if model == "single_image" else IMAGE_SIZE) if module.vision else {}
    if module.touch:
        position = torch.tensor(OBJECT_POSITION).expand(1, module.sensors, 3)
        batch |= {"success": torch.ones(1, module.sensors, dtype=torch.bool), "position": position}
        batch["charts"] = position[:, :, None].expand(-1, -1, TOUCH_VERTICES, -1)
    return compare(model, read_layers(module, batch))


def _seen(size: int) -> dict[str, Tensor]:
    return {"image": _image(size), "camera": torch.from_numpy(paper_camera(size).matrix()).float()[None]}


def _image(size: int) -> Tensor:
    return torch.rand(1, 3, size, size, generator=torch.Generator().manual_seed(0))


def _read(file: str, model: str) -> list[dict[str, str]]:
    rows = [dict(row) for row in published.paper_rows(file) if row["model"] == model]
    if not rows:
        known = sorted({row["model"] for row in published.paper_rows(file)})
        raise ValueError(f"the paper's {file} have no model {model!r}: {known}")
    return rows


def _same(one: Mapping[str, str], other: Mapping[str, str]) -> bool:
    """Whether two rows are equal but for the order of their inputs."""
    return all(sorted(one[field].split()) == sorted(other[field].split()) for field in FIELDS)
