"""Scenes that are rendered."""

from palpate.scene.part import Part

SCENES: dict[str, dict[str, Part]] = {}
