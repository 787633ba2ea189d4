"""Rendered images: colours, mask and depth as arrays, read from Blender's EXR files."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.camera import Camera, matrices

CHANNELS = ("ViewLayer.Combined", "ViewLayer.Depth.Z", "ViewLayer.IndexOB.X")  # Blender's names, as of `Layers`
NOTHING = 1e9  # Blender's depth where a pixel shows nothing; real depths are far below


class Image(NamedTuple):
    """An image of size s, row 0 at the top."""

    rgb: np.ndarray  # (s, s, 3) uint8, sRGB; with a transparent background (s, s, 4), alpha not premultiplied
    mask: np.ndarray  # (s, s) uint8, 255 where the pixel's centre shows the object, else 0
    depth: np.ndarray  # (s, s) float16, metres along the camera's axis at the pixel's centre, +inf for nothing


class Layers(NamedTuple):
    """Cycles' passes of a picture, float32, row 0 at the top."""

    combined: np.ndarray  # (s, s, 4) linear RGBA, colours premultiplied by alpha
    depth: np.ndarray  # (s, s) metres, `NOTHING` and more where there is nothing
    object_index: np.ndarray  # (s, s) 1 for the object, 0 for all else

    @classmethod
    def empty(cls, size: int) -> "Layers":
        """A picture that shows nothing."""
        blank = np.zeros((size, size), dtype=np.float32)
        return cls(np.zeros((size, size, 4), dtype=np.float32), blank + 10 * np.float32(NOTHING), blank)

    def image(self, background: ArrayLike | None) -> Image:
        """The image over a background in linear RGB; for none, with a fourth channel."""
        nothing = ~((self.depth > 0) & (self.depth < NOTHING))
        depth = np.where(nothing, np.inf, self.depth).astype(np.float16)
        mask = np.where(~nothing & (self.object_index > 0.5), 255, 0).astype(np.uint8)
        return Image(over_background(self.combined, background), mask, depth)


def vision_record(pictures: Sequence[tuple[Image, list[Image]]], cameras: Sequence[Camera]) -> dict[str, np.ndarray]:
    """The record of the vision store of one object, from its k cameras and what `Renderer.render_cameras` made."""
    alone = [image for image, _ in pictures]
    held = list(zip(*(images for _, images in pictures), strict=True))  # g grasps of k cameras
    record = {}
    for suffix, field in {"": "rgb", "_mask": "mask", "_depth": "depth"}.items():
        record[f"unoccluded{suffix}"] = np.stack([getattr(image, field) for image in alone])
        record[f"occluded{suffix}"] = np.array([[getattr(image, field) for image in images] for images in held])
    return record | matrices(cameras)


def read_layers(path: Path | str) -> Layers:
    """Passes of a multilayer EXR file, one that Blender or `write_layers` wrote."""
    import OpenEXR

    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        return Layers(*(np.array(channels[name].pixels) for name in CHANNELS))


def write_layers(path: Path | str, layers: Layers) -> None:
    """Keep a picture's passes as a multilayer EXR file: 32 bit floats, zip, Blender's channel names."""
    import OpenEXR

    channels = dict(zip(CHANNELS, layers, strict=True))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light, 1 is white, as sRGB uint8 (IEC 61966-2-1): Blender's view transform "Standard"."""
    linear = np.clip(linear, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.float_power(linear, 1 / 2.4) - 0.055)
    return (encoded * 255 + 0.5).astype(np.uint8)


def linear(encoded: ArrayLike) -> np.ndarray:
    """sRGB colours in 0..1 as linear light: the inverse of `srgb`."""
    encoded = np.asarray(encoded, dtype=float)
    return np.where(encoded <= 0.04045, encoded / 12.92, np.float_power((encoded + 0.055) / 1.055, 2.4))


def over_background(combined: np.ndarray, background: ArrayLike | None) -> np.ndarray:
    """Premultiplied linear RGBA (..., 4) over a linear colour as sRGB (..., 3); over none, sRGBA (..., 4)."""
    colour, alpha = combined[..., :3], combined[..., 3:]
    if background is not None:
        behind = np.asarray(background, dtype=np.float32)
        result = np.broadcast_to(srgb(behind), colour.shape).copy()
        seen = combined.any(axis=-1)
        result[seen] = srgb(colour[seen] + (1 - alpha[seen]) * behind)
        return result
    straight = np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0)
    return np.concatenate([srgb(straight), (alpha * 255 + 0.5).clip(0, 255).astype(np.uint8)], axis=-1)
