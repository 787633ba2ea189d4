"""Config files are read as Snakemake reads them. They are checked against a JSON schema before a run."""

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    import jsonschema


class ConfigError(ValueError):
    """A config or experiment that does not fit its schema; the message lists every difference."""


def nearest(name: str, known: Iterable[str], count: int = 3) -> str:
    """The end of a message about an unknown name: the nearest known ones, `count` at most; empty if none is near."""
    close = difflib.get_close_matches(name, list(known), count)
    return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""


def not_among(name: str, known: Iterable[str]) -> str:
    """The message about an unknown name: all known ones, and the nearest."""
    return f"{name!r} is not one of {', '.join(known)}{nearest(name, known)}"


def absolute(path: Path | str, project: Path | str) -> str:
    """A path of the config: `~` is the user's home (ConfigError if unknown), a relative one is the project's."""
    try:
        return str(Path(project) / Path(path).expanduser())
    except RuntimeError as error:
        raise ConfigError(f"{path}: {error}: write the path out") from None


def merge(base: Mapping[str, Any], overlay: Mapping[str, Any]) -> dict[str, Any]:
    """A config with an overlay's keys, as `--configfile` does it (`snakemake.utils.update_config`): sections key by
    key, all else in place of what was there; an empty section changes nothing. Neither is changed."""
    merged = dict(base)
    for key, value in overlay.items():
        below = merged.get(key, {})
        if not isinstance(value, Mapping):
            merged[key] = value
        elif value or isinstance(below, Mapping):
            merged[key] = merge(below if isinstance(below, Mapping) else {}, value)
    return merged


def read_config(default: Path | str, overlays: Sequence[Path | str]) -> dict[str, Any]:
    """The config that `--configfile <overlays>` gives: the overlays one over the other, and these over the default.
    Raises `ConfigError` for a file that is missing, or is not YAML with keys at its top level."""
    read = []
    for path in (default, *overlays):
        if not Path(path).is_file():
            raise ConfigError(f"{path}: no such file: name the config file of a run")
        read.append(read_yaml(path))
        if not isinstance(read[-1], dict):
            raise ConfigError(f"{path}: expected keys of a config at the top level, as `run: mine`")
    return merge(read[0], reduce(merge, read[1:], {}))


def typed(value: Any) -> Any:
    """A value in braces or brackets of a command line's `--config` as YAML reads it; Snakemake leaves texts in it."""
    if isinstance(value, dict):
        return {key: typed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [typed(item) for item in value]
    try:
        read = yaml.safe_load(value) if isinstance(value, str) else value
    except yaml.YAMLError:
        return value
    return read if read is None or isinstance(read, int | float) else value


def parse_texts(config: dict[str, Any], schema: Path | str) -> None:
    """Replace, in place, texts that the schema refuses by what YAML reads them as: `--config` leaves texts."""
    for section in filter(lambda value: isinstance(value, dict), config.values()):
        section.update({key: None for key, value in section.items() if value == "null"})
    for error in list(_validator(schema).iter_errors(config)):
        if isinstance(error.instance, str) and error.absolute_path:
            place, (*above, last) = config, error.absolute_path
            for step in above:
                place = place[step]
            place[last] = typed(error.instance)


# With libyaml's parser, where PyYAML has it, a file is read in a fifth of the time.
_BASES: Any = (yaml.composer.Composer, yaml.CSafeLoader) if yaml.__with_libyaml__ else (yaml.SafeLoader,)


class _Loader(*_BASES):  # type: ignore[misc]
    """YAML, but a key that stands twice in a mapping is an error, and so is a value that contains itself."""

    def __init__(self, text: str):
        _BASES[-1].__init__(self, text)
        self.anchors: dict[Any, yaml.Node] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        node = super().compose_node(parent, index)
        if node is not None and node.end_mark is None:  # named by an alias within it
            raise yaml.YAMLError(f"line {node.start_mark.line + 1}: this value contains itself: remove the alias in it")
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        keys = [key.value for key, _ in node.value if key.tag != "tag:yaml.org,2002:merge"]
        if twice := [key for place, key in enumerate(keys) if key in keys[:place]]:
            line = node.start_mark.line + 1
            raise yaml.YAMLError(f"line {line}: key {twice[0]!r} stands twice in this mapping: remove one")
        return node


def read_yaml(path: Path | str) -> Any:
    """What a YAML file holds. Raises `ConfigError`, naming file and line, if it can't be read, a key stands twice in a
    mapping, or a value contains itself."""
    try:
        return yaml.load(Path(path).read_text(encoding="utf-8"), _Loader)
    except RecursionError:
        raise ConfigError(f"{path}: can't be read as YAML: its values are nested too deep") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: can't be read as YAML: {' '.join(str(error).split())}") from None


def _say(error: "jsonschema.ValidationError") -> Iterator[str]:
    """Lines on a difference. Schemas have a keyword of ours, `errorMessage`, in place of the validator's."""
    where = ".".join(str(step) for step in error.absolute_path)
    if error.validator == "additionalProperties" and error.validator_value is False:
        known = list(error.schema["properties"])
        for key in sorted(set(error.instance) - set(known)):
            path = f"{where}.{key}" if where else str(key)
            yield f"{path}: unknown key" + (nearest(str(key), known, 1) or f"; known keys: {', '.join(known)}")
    elif error.validator == "required":
        for key in sorted(set(error.validator_value) - set(error.instance)):
            yield f"{f'{where}.' if where else ''}{key}: missing"
    elif isinstance(error.schema, dict) and "errorMessage" in error.schema:
        yield f"{where}: {error.instance!r:.200}: {error.schema['errorMessage']}"
    else:
        yield f"{where or 'top level'}: {error.message}"


def _unusable(value: Any, where: tuple[str, ...] = ()) -> Iterator[str]:
    """A line for each number that is NaN or infinite, and each text with control characters, in nested values."""
    place = ".".join(where) or "top level"
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _unusable(item, (*where, str(key)))
    elif isinstance(value, float) and not math.isfinite(value):
        yield f"{place}: {value} is not a finite number"
    elif isinstance(value, str) and re.search(r"[\x00-\x1f\x7f-\x9f]", value):
        yield f"{place}: {value!r} has a line break or another control character: remove it"


def plain(instance: Any) -> dict[str, Any]:
    """A dataclass as nested dictionaries, without the fields that have their default."""
    row = {}
    for field in fields(instance):
        value = getattr(instance, field.name)
        if value != (field.default if field.default_factory is MISSING else field.default_factory()):
            row[field.name] = plain(value) if is_dataclass(value) else value
    return row


def whole_numbers(values: Any) -> Any:
    """Nested dictionaries and lists with whole numbers as integers: YAML has 1.0 as a float, and a schema takes it."""
    if isinstance(values, dict):
        return {key: whole_numbers(value) for key, value in values.items()}
    if isinstance(values, list):
        return [whole_numbers(value) for value in values]
    return int(values) if isinstance(values, float) and values.is_integer() and abs(values) < 2**53 else values


def in_order(values: Any, order: Any) -> Any:
    """Nested dictionaries with their keys in the order of another's; keys that it lacks come after them, by name."""
    if not isinstance(values, dict):
        return values
    known = order if isinstance(order, dict) else {}
    keys = [*filter(values.__contains__, known), *sorted(set(values) - set(known))]
    return {key: in_order(values[key], known.get(key)) for key in keys}


@cache
def _validator(schema: Path | str) -> "jsonschema.Draft202012Validator":
    """The validator of a schema file."""
    import jsonschema  # here: no job needs it

    return jsonschema.Draft202012Validator(read_yaml(schema))


def check(instance: Any, schema: Path | str, what: str) -> None:
    """Raise `ConfigError` with a line for each place where `instance`, called `what`, does not fit the schema."""
    errors = sorted(_validator(schema).iter_errors(instance), key=lambda error: list(map(str, error.absolute_path)))
    # A key that is wrong in several ways (a failed `required` names each missing key) is said once.
    lines = list(dict.fromkeys(line for error in errors for line in _say(error)))
    lines += _unusable(instance)
    if lines:
        raise ConfigError(f"{what} does not fit {Path(schema).name}:\n" + "\n".join(f"  {line}" for line in lines))
