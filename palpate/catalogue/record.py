"""The config that a run was made with, in its folder, so that another run does not write over it.

<results>/<run>/config.yaml    all keys, defaults included; `--configfile` takes it
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml

from palpate.atomic import write_if_changed
from palpate.catalogue.source import CatalogueError, Source
from palpate.catalogue.sources import class_counts
from palpate.configuration import ConfigError, read_yaml
from palpate.rebuild_command import RECORD
from palpate.seal import NOTHING


def check_same_run(folder: Path | str, config: Mapping[str, Any], project: Path | str) -> None:
    """Raise CatalogueError if a run's folder holds another run than a checked config describes.

    It is another run if its source or its seed is another, or if it has classes that the config does not name:
    its stores would be written over. Nothing happens if the folder has no record yet. The message names what
    differs, on both sides, and the ways out.
    """
    path = Path(folder, RECORD)
    if not path.is_file():
        return
    try:
        recorded = read_yaml(path)
        lines = _differences(recorded, config, project)
    except (ConfigError, KeyError, TypeError) as error:
        raise CatalogueError(
            f"{path} is damaged ({type(error).__name__}): remove it if this config is that of the run in {folder}"
        ) from None
    if lines:
        raise CatalogueError(
            "\n".join(
                [
                    f"{folder} holds another run, which this one would write over:",
                    *(f"  {line}" for line in lines),
                    "Give this run a name of its own: `run: <name>` in its config, or --config run=<name>. "
                    f"To go on with the run that is there: --configfile {path}. "
                    f"To replace it: remove {folder}; or remove {path} to make again just what differs.",
                ]
            )
        )


def _differences(recorded: Mapping[str, Any], config: Mapping[str, Any], project: Path | str) -> list[str]:
    """A line for each key that makes two configs those of different runs."""
    before, now = (Source.from_config(keys, project) for keys in (recorded, config))
    if before.kind == now.kind == "procedural":  # made in the run's folder, which may have been moved
        before = replace(before, path=now.path)
    pairs = {f"source.{key}": (old, getattr(now, key)) for key, old in asdict(before).items()}
    pairs["seed"] = pairs.pop("source.seed")
    lines = [f"{key}: {old} there, {new} in this config" for key, (old, new) in pairs.items() if old != new]
    if not lines and not recorded["classes"] == config["classes"] == "all":
        # Folders come and go, so `all` against `all` is no change of the config.
        without = set(class_counts(recorded, before)) - set(class_counts(config, now))
        if without:
            lines.append(f"classes: {', '.join(sorted(without))} there, not in this config")
    return lines


def write_record(folder: Path | str, config: Mapping[str, Any]) -> None:
    """Write the config into a run's folder, if what stands there is another."""
    text = "# The config of this run, as it was last started: `--configfile` takes it.\n"
    text += yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
    write_if_changed(Path(folder, RECORD), text, NOTHING)
