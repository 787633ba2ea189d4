"""Imports Blender as a module, with its pitfalls."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from palpate.vision.system import install_command, missing_libraries


def load() -> ModuleType:
    """Import `bpy`, once, and return it.

    Blender's thread pool takes the size of the machine when it starts, and its idle threads spin: a render with one
    thread took 0.51 s of CPU for 0.26 s. Blender is therefore started while the process may use one core only; Cycles
    still gets as many threads as the renderer asks for.

    Raises ImportError naming what to install, or what to import earlier.
    """
    if "bpy" in sys.modules:
        return sys.modules["bpy"]
    try:
        with _one_core():
            import bpy
    except ImportError as error:
        raise ImportError(_advice(error)) from error
    return bpy


def _advice(error: ImportError) -> str:
    """The message for a Blender that can't be imported: what to install, or what to import earlier."""
    if missing := missing_libraries():
        return (
            f"Blender can't start without the system libraries {', '.join(missing)}. On Debian and Ubuntu, as"
            f" root: {install_command(missing.values())}"
        )
    if "undefined symbol" in str(error):
        return (
            f"Blender can't start after a library that brings its own embree (trimesh does): call"
            f" palpate.vision.blender.load() before importing it ({error})"
        )
    return f"Blender can't start: {error}. Expected the package bpy 4.5 for Python 3.11 (envs/requirements.txt)"


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep this process on one core for as long as the context lasts, where the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


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
