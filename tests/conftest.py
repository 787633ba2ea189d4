# bpy must be imported before anything that loads embree (trimesh does): the other way round fails with an
# undefined symbol.
import bpy  # noqa: F401
