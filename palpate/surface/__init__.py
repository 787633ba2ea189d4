"""Surface: points spread uniformly over the exterior of an object."""

from palpate.surface.sampling import METHODS, sample

__all__ = ["METHODS", "sample"]
