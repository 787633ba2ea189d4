"""What the model of a pressed gel leaves out, and what it would change: bodies pressed into the GelSight Mini's gel."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from palpate.touch.gel import Face, Layer, Pressed, indent, press
from studies import finite_elements
from studies.error_vs_runtime.gel import LAYER, PIXELS, WIDTH, radii
from studies.omitted.omission import NOT_MODELLED, STAYS, Omission
from studies.subjects import Subject

EDGE = (WIDTH / PIXELS,) * 2
FORCE, DEEP, SHALLOW = 1.0, 1.6e-3, 0.4e-3  # N; m: 0.4 and 0.1 of the thickness
Y, Z, R = radii(PIXELS)
BALL = finite_elements.ball(0.003)(R)[0]


def face_difference(one: np.ndarray, other: np.ndarray, within: float = np.inf) -> float:
    """Largest distance of two faces, um, up to `within` m from the middle."""
    return 1e6 * float(np.abs(one - other)[within > R].max())


def by_finite_elements(depth: float, width: float = 5.0) -> np.ndarray:
    """The face (n, n) m, of a ball pressed by `depth`, with finite strain; width: radius of the gel, thicknesses."""
    pressed = finite_elements.Gel(*LAYER, min(0.003, 0.7 * width * LAYER.thickness), width=width).press(
        finite_elements.ball(0.003), depth
    )
    face = np.interp(R, pressed.radius + pressed.sideways, pressed.indentation)
    return np.where(width * LAYER.thickness >= R, face, 0)


def by_layer(depth: float) -> np.ndarray:
    """The same by the library's layer."""
    _, (*_, face), _ = indent(Face(LAYER, BALL.shape, EDGE), BALL, depth=depth)
    return face


def sideways(slide: float, friction: float = 0.8) -> Pressed:
    """A ball after a slide along y."""
    return press(BALL, EDGE, LAYER, FORCE, (slide, 0.0), friction=friction)


def sideways_difference(one: Pressed, other: Pressed) -> float:
    """Largest difference of the sideways motion, um."""
    return 1e6 * float(np.linalg.norm(one.displacement - other.displacement, axis=-1).max())


def in_shadow(indentation: np.ndarray, angle: float) -> float:
    """Share of the image that light at `angle` (degrees above the face, along y) does not reach."""
    ray = indentation - Y * np.tan(np.radians(angle))  # the face stands out towards the object: heights are negative
    return float((ray > np.minimum.accumulate(ray, axis=1) + 1e-9).mean())


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Each thing that is left out, on a ball of 3 mm; the difference is what it would change."""
    name, stage = "ball of 3 mm", "gel"
    for depth in (SHALLOW, DEEP):
        runs = [partial(each, depth) for each in (by_finite_elements, by_layer)]
        when = f"{depth / LAYER.thickness:g} of the thickness deep"
        yield Omission(stage, "finite strain", when, name, *runs, face_difference, "um", state=NOT_MODELLED)
    for width in (0.75, 1.5):
        runs = [partial(by_finite_elements, SHALLOW, each) for each in (width, 5.0)]
        when = f"an edge all around, {1e3 * width * LAYER.thickness:g} mm from the middle; {1e3 * SHALLOW:g} mm deep"
        how = {"difference": partial(face_difference, within=width * LAYER.thickness), "unit": "um"}
        yield Omission(stage, "the gel's edge", when, name, *runs, **how, state=NOT_MODELLED)
    runs = [partial(sideways, 1e-4), partial(sideways, 0.0)]
    when = f"a slide of 0.1 mm at {FORCE:g} N: grasps have none"
    yield Omission(stage, "friction", when, name, *runs, sideways_difference, "um", state=NOT_MODELLED)
    shades = {angle: 100 * in_shadow(press(BALL, EDGE, LAYER, FORCE).indentation, angle) for angle in (10, 20)}
    for angle, share in shades.items():
        runs, when = [partial(float, share), float], f"light {angle} degrees above the face"
        how = {"difference": lambda one, other: one - other, "unit": "% of pixels", "state": NOT_MODELLED}
        yield Omission(stage, "shadows", when, name, *runs, **how)
    single = partial(press, BALL, EDGE, LAYER, FORCE, dtype=np.float32)
    runs = [partial(press, BALL, EDGE, Layer(*LAYER), FORCE), single]
    how = {"difference": lambda one, other: face_difference(one.indentation, other.indentation), "unit": "um"}
    yield Omission(stage, "digits beyond single precision", "always", name, *runs, **how, state=STAYS)
