"""The error of stores, and the messages that it has."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.rebuild_command import rebuild_advice
from palpate.seal import DamagedFile


class StoreError(ValueError):
    """A store, or arrays to be written, violate the contract; the message names the file."""


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Context in which any error of a library that reads a store becomes a StoreError, naming file and remedy."""
    try:
        yield
    except (StoreError, IndexError, PermissionError):  # not about what the file holds
        raise
    except DamagedFile as error:
        raise StoreError(str(error)) from None
    except Exception as error:
        raise StoreError(f"{path} can't be read ({type(error).__name__}: {error}); {rebuild_advice(path)}") from error
