"""Extreme cases of a pressed gel: material, thickness, force, and shapes that a pad may meet."""

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from palpate.touch.gel import TOLERANCE, Layer, Pressed, press
from studies.stability.cases import Cases, Finding, at_least, at_most, equal, rejects

CASES = Cases()
PIXELS, WIDTH = 60, 0.012  # of a face, m
EDGE = WIDTH / PIXELS
GEL = Layer(0.004, 145e3, 0.48)
FORCES = (1e-3, 1.0, 20.0)  # N
EXACT = 1e-12  # relative, of the pressures' sum
# Of the largest indentation: the solver's stop test. A rough surface that is touched by a single pixel has the most.
DEEPEST = 1e3 * TOLERANCE

Y, Z = np.meshgrid(*[(np.arange(PIXELS) + 0.5 - PIXELS / 2) * EDGE] * 2)
R = np.hypot(Y, Z)
ROUGH = np.random.default_rng(0).normal(0, 1, R.shape)
SHAPES = {
    "ball of 3 mm": R**2 / 0.006,
    "face": np.zeros_like(R),
    "flat punch": np.where(R < 0.003, 0, np.inf),
    "blade": np.where(np.abs(Y) < EDGE, 0, np.inf),
    "wedge": np.abs(Y),
    "corner": np.maximum(Y, Z) + 0.5 * np.abs(Y - Z),
    "needle": 10 * R,
    "punch, tilted by 17 degrees": np.where(R < 0.003, 0.3 * Y, np.inf),
    "face, tilted by 72 degrees": 3 * Y,
    "roughness of 50 um": 5e-5 * ROUGH,
    "noise of 10 mm": 0.01 * np.abs(ROUGH),
    "hole of 3 mm": np.where(R > 0.0015, 0, np.inf),
    "step of 2 mm": np.where(Y > 0, 0, 0.002),
    "ball at the rim": ((Y - Y.max()) ** 2 + Z**2) / 0.006,
    "one pixel": np.where((Y[0, 30] == Y) & (Z[30, 0] == Z), 0, np.inf),
    "one pixel at the corner": np.where((Y.max() == Y) & (Z.max() == Z), 0, np.inf),
}


def sound(shapes: Mapping[str, np.ndarray], layer: Layer, forces=FORCES, what: str = "") -> Iterator[Finding]:
    """Findings: contacts converge, nothing penetrates, pressures push and sum to the force."""
    sums, depths, least = [], [], []
    for surface in shapes.values():
        for force in forces:
            pressed = press(surface, (EDGE, EDGE), layer, force)
            sums.append(abs(pressed.pressure.sum() * EDGE**2 / force - 1))
            depths.append(penetration(pressed, surface))
            least.append(pressed.pressure.min())
    yield at_most(f"force off{what}", float(max(sums)), EXACT)
    yield at_most(f"penetration over indentation{what}", 1e3 * float(max(depths)), DEEPEST, "‰")
    yield at_least(f"least pressure{what}", float(min(least)), 0.0, "Pa")


def penetration(pressed: Pressed, surface: np.ndarray) -> float:
    """How deep the face is in the surface at most, over its largest indentation."""
    known = np.isfinite(surface)
    gap = pressed.indentation[known] + surface[known] - surface[known].min() - pressed.approach
    return -float(gap.min()) / float(pressed.indentation.max())


@CASES.case("shapes against a gel, 0.001 to 20 N", "gel")
def shapes(subject) -> Iterator[Finding]:
    """Faces, edges, corners, tilts, roughness, holes, single pixels; also at the rim of the face."""
    for name, surface in SHAPES.items():
        yield from sound({name: surface}, GEL, what=f", {name}")


@CASES.case("Poisson's ratios to 0.5 itself", "gel")
def incompressible(subject) -> Iterator[Finding]:
    """A gel that keeps its volume has no uniform compression: only its bulge gives way."""
    for poisson in (0.0, 0.3, 0.45, 0.49, 0.4999, 0.5):
        yield from sound(SHAPES, GEL._replace(poisson=poisson), (1.0,), f", nu {poisson:g}")
    small, large = (press(R**2 / 0.006, (EDGE, EDGE), GEL._replace(poisson=nu), 1.0) for nu in (0.5, 0.4999))
    yield at_most("approach at 0.5 over that at 0.4999", small.approach / large.approach, 1.0)


@CASES.case("gels of 0.3 mm and 20 mm", "gel")
def thicknesses(subject) -> Iterator[Finding]:
    """Far thinner than a contact, and thicker than the face is wide."""
    for thickness in (3e-4, 0.02):
        few = {name: SHAPES[name] for name in ("ball of 3 mm", "face", "wedge", "one pixel", "roughness of 50 um")}
        for poisson in (0.3, 0.5):
            what = f", {1e3 * thickness:g} mm, nu {poisson:g}"
            yield from sound(few, GEL._replace(thickness=thickness, poisson=poisson), (1e-3, 1.0), what)


@CASES.case("stiffness by factors of 1000", "gel")
def stiffness(subject) -> Iterator[Finding]:
    """A gel a thousand times as stiff, under a thousand times the force, has the same face."""
    for surface in (SHAPES["ball of 3 mm"], SHAPES["roughness of 50 um"]):
        gels = {x: GEL._replace(shear_modulus=145e3 * x) for x in (1e-3, 1.0, 1e3)}
        faces = [press(surface, (EDGE, EDGE), gel, x).indentation for x, gel in gels.items()]
        off = max(np.abs(face - faces[1]).max() for face in faces) / faces[1].max()
        yield at_most("face changes", float(off), 1e-6)


@CASES.case("friction at its limits", "gel")
def friction(subject) -> Iterator[Finding]:
    """No friction, very much, slides of 1 nm and 10 mm, a twist; a contact of one pixel."""
    slides = {"1 nm": (1e-9, 0.0), "10 um": (1e-5, 0.0), "10 mm": (0.0, 0.01)}
    for name in ("ball of 3 mm", "one pixel", "wedge"):
        for much in (0.0, 0.5, 1e3):
            over = []
            for slide in slides.values():
                pressed = press(SHAPES[name], (EDGE, EDGE), GEL, 1.0, slide, twist=1e-3, friction=much)
                size = np.linalg.norm(pressed.traction, axis=-1)
                over.append(float((size - much * pressed.pressure).max() / pressed.pressure.max()))
            yield at_most(f"traction over Coulomb's, {name}, friction {much:g}", max(over), 1e-9)


@CASES.case("what cannot be pressed", "gel")
def impossible(subject) -> Iterator[Finding]:
    """Each is refused with a reason."""
    ball = SHAPES["ball of 3 mm"]
    for what, change, reason in (
        ("no surface", {"surface": np.full_like(ball, np.inf)}, "somewhere finite"),
        ("NaN", {"surface": np.where(R > 0.005, ball, np.nan)}, "got none, NaN"),
        ("no force", {"force": 0.0}, "expected a positive number"),
        ("NaN force", {"force": np.nan}, "expected a positive number"),
        ("nu 0.51", {"layer": GEL._replace(poisson=0.51)}, "Poisson's ratio"),
        ("no thickness", {"layer": GEL._replace(thickness=0.0)}, "above 0"),
    ):
        arguments = {"surface": ball, "pixel": (EDGE, EDGE), "layer": GEL, "force": 1.0} | change
        yield rejects(what, partial(press, **arguments), ValueError, reason)
    far = press(ball, (EDGE, EDGE), GEL, 100.0)
    yield equal("100 N: strain beyond linear theory is stated", far.strain > 0.4, True, "", f"{far.strain:.2f}")
