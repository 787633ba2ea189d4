"""The stores of a run: their contract, writing them whole, reading them, and checking them."""

from palpate.store.atomic import whole
from palpate.store.contract import CONTRACT, SCHEMA_VERSION
from palpate.store.files import Store, StoreError, open, read, write

__all__ = ["CONTRACT", "SCHEMA_VERSION", "Store", "StoreError", "open", "read", "whole", "write"]
