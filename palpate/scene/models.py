"""Scenes that models see: an experiment each."""

from palpate.scene.part import Part

SCENES: dict[str, dict[str, Part]] = {}
