"""Pages to look at a run: `run_page` shows all of it, `object_page` one object with its grasps to turn with the mouse.

A page is one HTML file that needs no network; that of an object holds three.js (three.min.js, MIT).
"""

import importlib

MODULES = {"object_page": "page", "record_scene": "scene", "run_page": "index"}  # imported when they are used
__all__ = ["object_page", "record_scene", "run_page"]


def __getattr__(name: str):
    if name in MODULES:
        return getattr(importlib.import_module(f"palpate.viewer.{MODULES[name]}"), name)
    raise AttributeError(f"module 'palpate.viewer' has no attribute {name!r}")
