"""What a file is that is no mesh of `palpate.mesh.FORMATS`, by its suffix or its content, and what to do about it."""

import re
from pathlib import Path

from palpate.configuration import read_yaml

_TABLES = read_yaml(Path(__file__).with_suffix(".yaml"))
# Name and remedy of formats that are not read, by suffix.
UNREAD: dict[str, tuple[str, str]] = {
    suffix: (name, remedy)
    for remedy, formats in _TABLES["unread"].items()
    for name, suffixes in formats.items()
    for suffix in suffixes.split()
}
_XML = r"(?:<\?xml[^>]*>\s*)?(?:<!--(?s:.*?)-->\s*)*"
_BEGINNINGS = [
    (re.compile(rf"\s*(?:{pattern.replace('%XML', _XML)})".encode()), meaning)
    for pattern, meaning in _TABLES["beginnings"]
]


def what_it_is(path: Path | str) -> str:
    """What a file is by its content, and the remedy, if it is not what its suffix says; else empty."""
    suffix = Path(path).suffix.lower()
    with open(path, "rb") as file:
        head = file.read(4096).removeprefix(b"\xef\xbb\xbf")
    meaning = next((meaning for pattern, meaning in _BEGINNINGS if pattern.match(head)), suffix)
    if meaning == suffix or (suffix == ".3mf" and head[:2] == b"PK"):
        return ""
    if meaning in UNREAD:
        return "{} by its content: {}".format(*UNREAD[meaning])
    return f"{meaning[1:].upper()} by its content: rename it to {meaning}" if meaning[0] == "." else meaning
