"""The stores of a run: their contract, writing them whole, reading them, and checking them."""

from palpate.store.atomic import whole
from palpate.store.contract import CONTRACT, SCHEMA_VERSION
from palpate.store.dataset import Dataset
from palpate.store.files import Store, StoreError, open, read, write
from palpate.store.join import config_digest, join, write_batch

VALIDATION = ("combine_validation", "validate_batch", "write_findings")

__all__ = [
    *VALIDATION,
    "CONTRACT",
    "SCHEMA_VERSION",
    "Dataset",
    "Store",
    "StoreError",
    "config_digest",
    "join",
    "open",
    "read",
    "whole",
    "write",
    "write_batch",
]


def __getattr__(name: str):
    """Validation loads the rooms that made the data, and Embree; reading a dataset needs neither."""
    if name in VALIDATION:
        from palpate.store import validation

        return getattr(validation, name)
    raise AttributeError(f"module 'palpate.store' has no attribute {name!r}")
