"""Stores, the files of one stage and batch: their contract, writing them whole, reading them."""

from palpate.store.contract import CONTRACT, SCHEMA_VERSION
from palpate.store.files import Store, StoreError, join, open, read, write, write_batch

__all__ = ["CONTRACT", "SCHEMA_VERSION", "Store", "StoreError", "join", "open", "read", "write", "write_batch"]
