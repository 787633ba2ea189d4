"""Procedural CAD classes: parametric bottles, knives, cellphones and rifles, made by CSG and lathing.

Real metres, z up: a bottle stands along z; a cellphone stands upright, its screen towards +x; the long
axis of a knife and of a rifle lies along y (tip or muzzle towards +y), its flat side faces +x.
"""

from palpate.lazy import lazy_exports

CLASSES = ("bottle", "knife", "cellphone", "rifle")
generators, __getattr__ = lazy_exports(__name__, {"family": ["make", "write"], "parameters": ["style", "styles"]})
__all__ = ["CLASSES", "suffix", *generators]


def suffix(index: int) -> str:
    """The format of object `index`: every third is an OBJ, the others are GLB."""
    return ".obj" if index % 3 == 2 else ".glb"
