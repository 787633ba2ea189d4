"""The error of stores, and the messages that it has."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate import checksums
from palpate.rebuild_command import rebuild_advice


class StoreError(ValueError):
    """A store, or arrays to be written, violate the contract; the message names the file."""


def damaged(path: Path, lines: Iterable[str]) -> StoreError:
    """The error about a store whose files are not as they were written; lines: what is wrong with which."""
    return StoreError(f"{path} is damaged: {checksums.join_first(lines)}; {rebuild_advice(path)}")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Context in which any error of a library that reads a store becomes a StoreError, naming file and remedy."""
    try:
        yield
    except (StoreError, IndexError, PermissionError):  # not about what the file holds
        raise
    except Exception as error:
        raise StoreError(f"{path} can't be read ({type(error).__name__}: {error}); {rebuild_advice(path)}") from error
