"""Images of objects alone and in the hand, with mask and depth, from the paper's camera; Blender renders.

Importing this package loads no Blender: `bpy` comes with the first use of `Renderer`. Blender must be imported
before anything that loads embree, as trimesh does: call `palpate.vision.blender.load()` in a script's first
lines.
"""

from palpate.camera import Camera, looking_at, paper_camera
from palpate.vision.image import Image
from palpate.vision.meshes import Mesh, spheres

__all__ = ["Camera", "Image", "Mesh", "Renderer", "looking_at", "paper_camera", "spheres"]


def __getattr__(name: str):
    if name == "Renderer":
        from palpate.vision.renderer import Renderer

        return Renderer
    raise AttributeError(f"module 'palpate.vision' has no attribute {name!r}")
