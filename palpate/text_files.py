"""Tables and records of a run, as text: written whole, and read if they are as they were written."""

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from palpate import seal
from palpate.atomic import atomic_write
from palpate.rebuild_command import rebuild_advice
from palpate.seal import DamagedFile


def read_text(path: Path | str) -> str:
    """The text of a table or record that a run wrote, or a user elsewhere: see `palpate.seal.find`. Raises DamagedFile
    if it is missing, empty, not UTF-8, not what its seal is of, or a table without a line break at its end."""
    path, text, problem = Path(path), "", ""
    try:
        data = path.read_bytes()
        text = data.decode("utf-8")
    except (FileNotFoundError, NotADirectoryError):
        problem = "does not exist"
    except PermissionError:
        raise
    except OSError as error:
        problem = f"can't be read ({error.strerror})"
    except UnicodeDecodeError:
        problem = "is not text"
    else:
        if not data.strip():
            problem = "is empty"
        elif "\0" in text:
            problem = "is not text"
        elif path.suffix == ".csv" and not text.endswith("\n"):  # a record that is cut off is not valid JSON
            problem = "is cut off: no line break at its end"
        elif (sealed := seal.find(path)) and sealed.files.get(path.name) != seal.measured(data):
            problem = f"has changed since it was written ({seal.beside(path).name}: checksum)"
    if problem:
        raise DamagedFile(f"{path} {problem}; {rebuild_advice(path)}")
    return text


def read_rows(path: Path | str, columns: Iterable[str]) -> list[dict[str, str]]:
    """Rows of a CSV table: values by column. Raises DamagedFile as `read_text` does, and if a column is missing or a
    line has more or fewer values than the first."""
    lines, remedy = csv.DictReader(io.StringIO(read_text(path), newline=""), strict=True), rebuild_advice(path)
    try:
        rows = list(lines)
    except csv.Error as error:
        raise DamagedFile(f"{path} is not a valid CSV file ({error}); {remedy}") from None
    if missing := [name for name in columns if name not in (lines.fieldnames or ())]:
        raise DamagedFile(f"{path} has no column {missing[0]!r}; {remedy}")
    for number, row in enumerate(rows, start=1):
        if None in row or None in row.values():
            raise DamagedFile(f"{path} lacks a value, or has one too many, in row {number}; {remedy}")
    return rows


def write_rows(
    path: Path | str, columns: Iterable[str], rows: Iterable[Iterable[Any]], made_from: seal.MadeFrom | None = None
) -> None:
    """Write a CSV table whole, with the columns' names in its first line; made_from: and its seal."""
    with atomic_write(path, made_from) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([columns, *rows])


def read_record(path: Path | str) -> dict[str, Any]:
    """The JSON object of a record. Raises DamagedFile as `read_text` does, and for other JSON."""
    try:
        record = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise DamagedFile(f"{path} is not valid JSON ({error}); {rebuild_advice(path)}") from None
    if not isinstance(record, dict):
        raise DamagedFile(f"{path} is not a JSON object; {rebuild_advice(path)}")
    return record
