"""Smooth deformations of whole objects: stretched, tapered, twisted, warped, bent.

They move vertices only, so closed solids stay closed; the bounds of `form` keep neighbours in their order.
"""

from types import SimpleNamespace

import numpy as np

from palpate.shapes.parameters import Range

# Waves of the smooth random warp, and the most periods of one across the object's box.
WAVES, PERIODS = 4, 0.8


def form(
    stretch: float = 0, taper: float = 0, twist: float = 0, warp: float = 0, bend: float = 0, lean: float = 0
) -> dict[str, Range]:
    """The group of parameters that `deformed` takes, each between minus and plus its bound (warp: 0 and its bound)."""
    meaning = "{} changes of scale along the axis, densest to widest, around 1"
    return {
        **{f"stretch_{axis}": Range(-stretch, stretch, "1", meaning.format(axis)) for axis in "xyz"},
        "taper": Range(-taper, taper, "1", "growth of both cross axes from the middle to the end"),
        "flare": Range(-taper, taper, "1", "growth of the bend's axis alone from the middle to the end"),
        "twist": Range(-twist, twist, "degrees", "turn about the long axis from end to end"),
        "warp": Range(0, warp, "1", "largest displacement by smooth waves, over the box"),
        "bend": Range(-bend, bend, "degrees", "turn of the long axis from end to end"),
        "lean": Range(
            -lean, lean, "1", "sideways shift of the end over the length, growing with the square of the place"
        ),
    }


def deformed(
    vertices: np.ndarray, bounds: np.ndarray, p: SimpleNamespace, long_axis: int, bend_axis: int, seed: int
) -> np.ndarray:
    """Vertices (n, 3), moved.

    bounds: (2, 3) of the whole object; p: has the parameters of `form`; long_axis, bend_axis: 0, 1 or 2, the axis from
    end to end, and that towards which it bends and leans; seed: of phases and directions of the waves.
    """
    rng = np.random.default_rng(seed)
    low, extent = bounds[0], np.maximum(bounds[1] - bounds[0], 1e-9)
    unit = (vertices - low) / extent
    phase = rng.uniform(0, 2 * np.pi, 3)
    stretch = np.array([p.stretch_x, p.stretch_y, p.stretch_z])
    unit = unit + stretch / (2 * np.pi) * (np.sin(2 * np.pi * unit + phase) - np.sin(phase))
    waves = rng.uniform(-PERIODS, PERIODS, (WAVES, 3)), rng.uniform(0, 2 * np.pi, WAVES), rng.normal(size=(WAVES, 3))
    warp = np.sin(2 * np.pi * unit @ waves[0].T + waves[1]) @ waves[2]
    # The end at the bottom of a long axis z stays flat: that axis does not move by the waves.
    warp[:, long_axis] = 0
    unit = unit + p.warp * warp / np.abs(waves[2]).sum(axis=0)
    side_axis = 3 - long_axis - bend_axis
    place, middle = low + unit * extent, low + extent / 2
    along, across, aside = (place[:, axis] - middle[axis] for axis in (long_axis, bend_axis, side_axis))
    length = extent[long_axis]
    share = along / length
    across, aside = across * (1 + 2 * (p.taper + p.flare) * share), aside * (1 + 2 * p.taper * share)
    angle = np.radians(p.twist) * share
    across, aside = across * np.cos(angle) - aside * np.sin(angle), across * np.sin(angle) + aside * np.cos(angle)
    if abs(p.bend) > 0.1:
        turn = np.radians(p.bend)
        radius = length / turn
        along, across = (radius - across) * np.sin(turn * share), radius - (radius - across) * np.cos(turn * share)
    across = across + p.lean * length * (share + 0.5) ** 2
    result = np.empty_like(vertices)
    result[:, long_axis], result[:, bend_axis], result[:, side_axis] = along, across, aside
    return result + middle
