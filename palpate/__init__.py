"""Palpate: from CAD meshes to a visuo-tactile dataset.

Importing the package loads no engine; each room imports its own when it is used.
"""

__version__ = "0.1.0"


def __getattr__(name: str):
    if name == "Dataset":
        from palpate.store import Dataset

        return Dataset
    if name == "reconstruct":
        from palpate.evaluation.reconstruct import reconstruct

        return reconstruct
    raise AttributeError(f"module 'palpate' has no attribute {name!r}")
