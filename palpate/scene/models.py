"""Scenes that models see: an experiment each, a row of config/experiments.yaml.

Facts of one: `strategy`, `vision`, `touch`, `grasps`, as there. Parts are what its pack holds, and with that
the stages that the workflow runs for it, and what its model is built of. A pack, which experiments that see
the same share, has a plan of its own.
"""

from collections.abc import Callable, Mapping
from typing import Any

from palpate.scene.part import Part

GRASPS = 5  # of the largest experiment: four touch charts each


def _sees(vision: str) -> Callable[[Mapping[str, Any]], str | None]:
    return lambda facts: f"vision is {vision}" if facts["vision"] == vision else None


def _encodes(facts: Mapping[str, Any]) -> str | None:
    return None if facts["vision"] == "none" else f"vision is {facts['vision']}"


def _feels(facts: Mapping[str, Any]) -> str | None:
    return "it has touch" if facts["touch"] else None


def _feels_charts(facts: Mapping[str, Any]) -> str | None:
    return "touch comes as charts" if facts["touch"] and facts["strategy"] != "sphere" else None


def _feels_readings(facts: Mapping[str, Any]) -> str | None:
    return "the sphere's touch comes as readings" if facts["touch"] and facts["strategy"] == "sphere" else None


def _fills_all_charts(facts: Mapping[str, Any]) -> str | None:
    joined = facts["touch"] and facts["strategy"] in ("charts", "no_copy")
    return f"all {GRASPS} grasps are felt" if joined and facts["grasps"] >= GRASPS else None


OF_PACKS = {
    "unoccluded renders": Part("no unoccluded image is seen", _sees("unoccluded")),
    "occluded renders": Part("no occluded image is seen", _sees("occluded")),
    "views": Part("no single image from all around is seen", _sees("views")),
    "touch": Part("nothing is felt", _feels),
    "touch charts": Part("no touch comes as a chart: the U-Net is not needed for it either", _feels_charts),
    "touch readings": Part("no touch comes as a reading", _feels_readings),
}
OF_MODELS = {
    "image encoder": Part("there is no image to encode", _encodes),
    "reading encoder": Part("there is no reading to encode", _feels_readings),
    "spare touch charts": Part("vertices and edges that no touch fills", _fills_all_charts),
}
SCENES: dict[str, dict[str, Part]] = {"pack": OF_PACKS, "experiment": {**OF_PACKS, **OF_MODELS}}
