"""Procedural CAD classes: parametric bottles, knives, cellphones and rifles, made by CSG and lathing.

Real metres, z up: a bottle stands along z; a cellphone stands upright, its screen towards +x; the long
axis of a knife and of a rifle lies along y (tip or muzzle towards +y), its flat side faces +x.
"""

from palpate.shapes.family import CLASSES, make, style, suffix, write

__all__ = ["CLASSES", "make", "style", "suffix", "write"]
