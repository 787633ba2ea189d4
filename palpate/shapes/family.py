"""The procedural classes, and objects by class and index."""

import numpy as np
import trimesh

from palpate.batch import generator
from palpate.shapes import bottle, cellphone, knife, rifle
from palpate.shapes.assembly import Part, assemble

# Each module has STYLES: builders (rng) -> list of parts.
FAMILIES = {"bottle": bottle, "knife": knife, "cellphone": cellphone, "rifle": rifle}
CLASSES = tuple(FAMILIES)


def parts(class_name: str, index: int, seed: int = 0) -> list[Part]:
    """The solids of an object with their materials; see `make`."""
    if class_name not in FAMILIES:
        raise ValueError(f"unknown procedural class {class_name!r}: choose from {', '.join(CLASSES)}")
    if index < 0:
        raise ValueError(f"the index of a {class_name} must not be negative, got {index}")
    styles = FAMILIES[class_name].STYLES
    rng: np.random.Generator = generator(seed, f"{class_name}-{index:04d}", "shapes")
    # Styles take turns, so that even a small run has one of each.
    return styles[index % len(styles)](rng)


def make(class_name: str, index: int, seed: int = 0) -> trimesh.Scene:
    """Build object `index` of a class: a scene of closed meshes, one a material, of 5,000 to 20,000 faces.

    Metres, z up, poses as in the package's docstring. The same arguments give the same object. Raises
    ValueError for an unknown class or a negative index.
    """
    return assemble(parts(class_name, index, seed))
