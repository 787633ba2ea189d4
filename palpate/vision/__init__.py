"""Images of objects alone and in the hand, with mask and depth; Blender renders, and comes with `Renderer`. It must be
imported before what loads embree, as trimesh does: call `palpate.vision.blender.load()` in the first lines."""

from palpate.camera import Camera, looking_at, paper_camera
from palpate.lazy import lazy_exports
from palpate.vision.geom import Mesh, spheres
from palpate.vision.image import Image

with_blender, __getattr__ = lazy_exports(__name__, {"renderer": ["Renderer"]})
__all__ = ["Camera", "Image", "Mesh", "looking_at", "paper_camera", "spheres", *with_blender]
