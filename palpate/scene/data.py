"""Scenes that make the data: meshes, grasps, touch."""

from palpate.scene.part import Part

SCENES: dict[str, dict[str, Part]] = {}
