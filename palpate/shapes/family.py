"""The procedural classes, and objects by class and index."""

from functools import partial

import numpy as np
import trimesh

from palpate.batch import generator
from palpate.shapes import bottle, cellphone, knife, rifle
from palpate.shapes.assembly import assemble
from palpate.shapes.deformation import deformed
from palpate.shapes.parameters import draw

# Each module has PARAMETERS and STYLES (see `palpate.shapes.parameters`), AXES (the long one, and that towards which
# objects bend), and build (parameters, rng) -> list of parts.
FAMILIES = {"bottle": bottle, "knife": knife, "cellphone": cellphone, "rifle": rifle}
CLASSES = tuple(FAMILIES)


def style(class_name: str, index: int, seed: int = 0) -> str:
    """The style of object `index` of a class, a key of its `STYLES`. Arguments and errors as `make`."""
    return _style_and_rng(class_name, index, seed)[0]


def _style_and_rng(class_name: str, index: int, seed: int) -> tuple[str, np.random.Generator]:
    if class_name not in FAMILIES:
        raise ValueError(f"unknown procedural class {class_name!r}: choose from {', '.join(CLASSES)}")
    if index < 0:
        raise ValueError(f"the index of a {class_name} must not be negative, got {index}")
    rng, names = generator(seed, f"{class_name}-{index:04d}", "shapes"), list(FAMILIES[class_name].STYLES)
    return names[rng.integers(len(names))], rng


def make(class_name: str, index: int, seed: int = 0) -> trimesh.Scene:
    """Build object `index` of a class: a scene of closed meshes, one a material, of 5,000 to 20,000 faces.

    Metres, z up, poses as in the package's docstring. The same arguments give the same object. Raises
    ValueError for an unknown class or a negative index.
    """
    name, rng = _style_and_rng(class_name, index, seed)
    family = FAMILIES[class_name]
    p = draw(rng, name, family.PARAMETERS, family.STYLES)
    waves = int(rng.integers(2**32))
    return assemble(
        family.build(p, rng), partial(deformed, p=p, long_axis=family.AXES[0], bend_axis=family.AXES[1], seed=waves)
    )
