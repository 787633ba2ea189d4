"""Imports Blender as a module, with its pitfalls."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from palpate.vision.system import install_command, missing_libraries


def load() -> ModuleType:
    """Import `bpy`, once, and return it, while the process may use one core only: Blender's thread pool takes the size
    of the machine when it starts, and its idle threads spin (a render with one thread took 0.51 s of CPU for 0.26 s).
    Raises ImportError naming what to install, or what to import earlier."""
    if "bpy" in sys.modules:
        return sys.modules["bpy"]
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None  # macOS has none
    if allowed:
        os.sched_setaffinity(0, {min(allowed)})
    try:
        import bpy
    except ImportError as error:
        if missing := missing_libraries():
            advice = f"without the system libraries {', '.join(missing)}. On Debian and Ubuntu, as root: "
            advice += install_command(missing.values())
        elif "undefined symbol" in str(error):
            advice = "after a library that brings its own embree (trimesh does): call palpate.vision.blender.load() "
            advice += f"before importing it ({error})"
        else:
            advice = f"with the packages here ({error}): it is bpy 4.5 for Python 3.11 (envs/requirements.txt)"
        raise ImportError(f"Blender can't start {advice}") from error
    finally:
        if allowed:
            os.sched_setaffinity(0, allowed)
    return bpy


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress Blender's messages on standard output, which bypass Python's `sys.stdout`."""
    sys.stdout.flush()
    saved = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(saved, 1)
        os.close(nowhere)
        os.close(saved)
