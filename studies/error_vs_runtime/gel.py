"""A pressed gel: error of the deformed face, of the force and of the sideways motion, against time.

The reference is finite-strain finite elements (`studies.finite_elements`). All methods are given the depth to which a
body is pressed, since filters of the height map know no force.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from palpate.sensor import load
from palpate.touch.gel import TOLERANCE, Face, Layer, indent
from palpate.touch.shading import smoothed
from studies import finite_elements
from studies.error_vs_runtime.study import Method, Study, variants

LAYER, WIDTH, PIXELS = Layer(0.004, 145e3, 0.48), 0.015, 100  # m; of gelsight_mini.yaml
BODIES = {  # name: profile, m deep: to 0.4 of the thickness
    "ball of 3 mm, 0.25 mm deep": (finite_elements.ball(0.003), 0.25e-3),
    "ball of 3 mm, 1 mm deep": (finite_elements.ball(0.003), 1e-3),
    "ball of 3 mm, 1.6 mm deep": (finite_elements.ball(0.003), 1.6e-3),
    "punch of 2 mm, 0.5 mm deep": (finite_elements.punch(0.002, 0.0003), 0.5e-3),
}


class Case(NamedTuple):
    """A body that is pressed to a depth (m), and what finite elements give."""

    profile: Callable
    depth: float
    reference: finite_elements.Pressed


class Result(NamedTuple):
    """What a method gives on its n x n pixels; NaN for what it has not."""

    indentation: np.ndarray  # (n, n) m
    force: float  # N
    sideways: np.ndarray  # (n, n) m, away from the middle


def radii(pixels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y, z and distance from the middle (n, n) of the pixels' centres, m."""
    places = ((np.arange(pixels) + 0.5) / pixels - 0.5) * WIDTH
    y, z = np.meshgrid(places, places)
    return y, z, np.hypot(y, z)


class Elastic:
    """The library's layer, pressed to a depth in place of with a force."""

    def __init__(self, pixels: int = PIXELS, tolerance: float = TOLERANCE, padding: float = 3.0, dtype=np.float64):
        self.pixels, self.tolerance, self.padding, self.dtype = pixels, tolerance, padding, dtype

    @cached_property
    def face(self) -> Face:
        """The layer's kernels, which a run computes once."""
        edge = WIDTH / self.pixels
        return Face(LAYER, (self.pixels,) * 2, (edge, edge), self.dtype, self.padding)

    def __call__(self, case: Case) -> Result:
        y, z, r = radii(self.pixels)
        gap = case.profile(r)[0].astype(self.dtype)
        pressure, (*moved, indentation), _ = indent(self.face, gap, depth=case.depth, tolerance=self.tolerance)
        force = float(pressure.sum(dtype=float)) * (WIDTH / self.pixels) ** 2
        return Result(indentation, force, (moved[0] * y + moved[1] * z) / r)


def filtered(case: Case, sensor) -> Result:
    """The height map, through the Gaussians of a sensor's `smoothing`; without one, as it is."""
    _, _, r = radii(PIXELS)
    height = np.maximum(case.depth - case.profile(r)[0], 0)
    indentation = smoothed(height, sensor) if sensor.smoothing else height
    return Result(indentation, np.nan, np.full_like(height, np.nan))


class GelStudy(Study):
    """Ways to find the face of a pressed gel; cases are bodies, not objects of the run."""

    stage = "gel"
    units = {"shape": "um", "force": "%", "sideways": "um"}
    reference = "axisymmetric finite elements, neo-Hookean, finite strain"

    def cases(self):
        """Each body with its finite elements, some seconds each."""
        gel = finite_elements.Gel(*LAYER, fine=0.003)
        for name, (profile, depth) in BODIES.items():
            yield name, Case(profile, depth, gel.press(profile, depth))

    def methods(self) -> list[Method]:
        elastic = "elastic layer"
        # Square pixels of the study's width, with Taxim's Gaussians in metres.
        taxim = replace(load("gelsight_mini"), width=WIDTH, height=WIDTH, resolution=(PIXELS, PIXELS))
        return [
            *variants(elastic, "tolerance", (1e-1, 1e-2, 1e-3, 1e-5), lambda x: Elastic(tolerance=x), TOLERANCE),
            *variants(elastic, "pixels", (50, 200), lambda x: Elastic(pixels=x)),
            *variants(elastic, "padding, thicknesses", (0.5, 1, 2, 5), lambda x: Elastic(padding=x)),
            Method(elastic, "precision", "single", Elastic(dtype=np.float32)),
            Method("Taxim's filter", "Gaussians", 7, partial(filtered, sensor=taxim)),
            Method("height map", "Gaussians", 0, partial(filtered, sensor=load("digit"))),
        ]

    def errors(self, case: Case, result: Result) -> dict[str, float]:
        """Root mean squares over the image of shape and sideways motion; the force's part of the reference's."""
        _, _, r = radii(len(result.indentation))
        reference = case.reference
        where = reference.radius + reference.sideways
        shape = result.indentation - np.interp(r, where, reference.indentation)
        sideways = result.sideways - np.interp(r, where, reference.sideways)
        return {
            "shape": 1e6 * float(np.sqrt(np.mean(shape**2))),
            "force": 100 * abs(result.force / reference.force - 1),
            "sideways": 1e6 * float(np.sqrt(np.mean(sideways**2))),
        }


study = GelStudy
