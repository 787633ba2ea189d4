"""Surface: points spread uniformly over the exterior of an object."""

from palpate.surface.rays import sample

__all__ = ["sample"]
