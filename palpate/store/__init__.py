"""The stores of a run: their contract, writing them whole, reading them, and checking them."""

from palpate.store.atomic import whole
from palpate.store.contract import CONTRACT, SCHEMA_VERSION
from palpate.store.dataset import Dataset
from palpate.store.files import Store, StoreError, open, read, write
from palpate.store.join import config_digest, join

__all__ = [
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
]
