"""Surface: points on the exterior surface of an object."""
