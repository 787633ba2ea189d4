"""Images of objects alone and in the hand, with mask and depth, from the paper's camera; Blender renders.

Importing the room loads numpy only; Blender (`bpy`) comes with the first `Renderer`. It must be imported
before anything that loads embree (trimesh does): `palpate.vision.blender.load()` in a script's first lines
sees to it.
"""

from palpate.vision.camera import Camera, looking_at, paper_camera
from palpate.vision.image import Image
from palpate.vision.meshes import Mesh, spheres

__all__ = ["Camera", "Image", "Mesh", "Renderer", "looking_at", "paper_camera", "spheres"]


def __getattr__(name: str):
    if name == "Renderer":
        from palpate.vision.renderer import Renderer

        return Renderer
    raise AttributeError(f"module 'palpate.vision' has no attribute {name!r}")
