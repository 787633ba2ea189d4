"""The data card of an exported run: a README with the header that Hugging Face reads, made from the run."""

import csv
import json
import os
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import yaml
from packaging import licenses

from palpate import __version__
from palpate.catalogue import SPLITS
from palpate.configuration import nearest
from palpate.dataset.summary import kind_of_reason
from palpate.hand import Hand
from palpate.interchange.layouts import Contents, pictures, versions
from palpate.store.contract import FRAMES
from palpate.store.files import StoreError

TEMPLATE = Path(__file__).with_name("card.md.jinja")
# Number of samples below which Hugging Face has a name, and that name.
SIZES = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M", 1e7: "1M<n<10M"}
SPDX = "https://spdx.org/licenses/"


def spdx(licence: str) -> str:
    """A licence, or an expression of several, as SPDX writes it; `unknown` stays. Raises ValueError for other names."""
    if licence == "unknown":
        return licence
    try:
        return str(licenses.canonicalize_license_expression(licence))
    except licenses.InvalidLicenseExpression:
        hint = nearest(licence.lower(), licenses.LICENSES)
        known = f"such as CC-BY-4.0 ({SPDX}), nor LicenseRef-<name>"
        raise ValueError(f"{licence!r} is no licence of SPDX, {known}{hint}") from None


def licence_url(licence: str) -> str:
    """Where SPDX has the text of a licence; empty for an expression, and for `unknown`."""
    return SPDX + licence if licence.lower() in licenses.LICENSES else ""


def write_card(path: Path, contents: Contents, digests: Mapping[tuple[str, str], str]) -> None:
    """Write the card into an export's folder: its contents, how it was made, its checks and errors, its terms.
    digests: of the stores that the arrays are from, by stage and batch. Names and reasons, from meshes, are escaped.
    Raises StoreError for a damaged `last_run.json`."""
    dataset, splits, layout, licence = contents.dataset, contents.splits, contents.layout, contents.licence
    hand = dataset[0].hand if "grasps" in dataset.stages else None
    number, config, url = sum(map(len, splits.values())), dataset.config, licence_url(licence)
    listed = url or licence == "unknown"  # by Hugging Face: SPDX's names in lower case, and no expressions
    data_files = [{"split": split, "path": layout.split_files.format(split)} for split in splits]
    header = {
        **({"license": licence.lower()} if listed else {"license": "other", "license_name": licence}),
        "pretty_name": f"Palpate run {dataset.name}",
        "size_categories": [next((name for limit, name in SIZES.items() if number < limit), "n>10M")],
        "tags": ["tactile", "vision", "robotics", "3d", "simulation", "palpate"],
        "configs": [{"config_name": "default", "data_files": data_files}],
    }
    started = dataset.folder / "last_run.json"
    try:
        commit = json.loads(started.read_text(encoding="utf-8")).get("commit", "") if started.is_file() else ""
    except ValueError:
        raise StoreError(f"{started} is damaged; remove it: the next start of the run writes it again") from None
    environment = jinja2.Environment(trim_blocks=True, keep_trailing_newline=True, undefined=jinja2.StrictUndefined)
    environment.filters["escaped"] = escaped
    checks = _rows(dataset.folder / "reports/validation.csv")
    counts = Counter((record.class_name, record.split) for record in dataset)
    rows = [[escaped(name), *(counts[name, split] for split in SPLITS)] for name in dataset.classes]
    reasons = Counter((row["stage"], without_folders(kind_of_reason(row["reason"]))) for row in dataset.rejections())
    tables = map(_rows, dataset.folder.glob("reports/validation/*.csv"))
    files = (row for table in tables for row in table if row["check"] == "files")
    checked = {(row["store"], row["batch"], row["where"]) for row in files}
    text = environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        contents=contents,
        splits=list(SPLITS),
        header=yaml.safe_dump(header, sort_keys=False),
        version=__version__,
        number=number,
        licence_url=url,
        frames=FRAMES,
        parts=os.listdir(path.parent),
        kind=config.get("source", {}).get("kind", "unknown"),
        counts=[*rows, ["all", *(len(dataset.split(split)) for split in SPLITS)]],
        figures=sorted(figure.name for figure in path.parent.glob("figures/*.png")),
        versions=versions(dataset),
        commit=commit,
        arrays=_arrays(contents),
        hand=hand,
        joints=_joints(hand) if hand else [],
        rejections=[[count, escaped(stage), escaped(text)] for (stage, text), count in reasons.most_common()],
        checks=checks,
        failed=sum(row["passed"] != "True" for row in checks),
        # Stores that are not as they were when the run was validated.
        unchecked=[f"{key[0]}/{key[1]}" for key, digest in digests.items() if (*key, digest) not in checked],
        config=yaml.safe_dump(_public(config), sort_keys=False),
    )
    path.write_text(text, encoding="utf-8")


def escaped(text: str) -> str:
    """Text in one line that Markdown and HTML show verbatim: no markup, no link, no invisible character."""
    line = " ".join("".join(letter if letter.isprintable() else " " for letter in str(text)).split())
    return re.sub(r"[^\w ,.;%+=()/'-]|(?<!\w)_|_(?!\w)|(?<=www)\.|/(?=/)", lambda sign: f"&#{ord(sign[0])};", line)


def _public(value: Any) -> Any:
    """A part of the config without the machine's folders: of paths the last name only, and no `results`."""
    if isinstance(value, Mapping):
        return {key: _public(item) for key, item in value.items() if key != "results"}
    if isinstance(value, list):
        return [_public(item) for item in value]
    return Path(value).name if isinstance(value, str) and value.startswith(("/", "~", "..")) else value


def without_folders(text: str) -> str:
    """Text with the last name only of each path in it from the root, a home folder or above.

    >>> without_folders("can't read /home/me/scans/cup.png (named in ../cup.mtl)")
    "can't read cup.png (named in cup.mtl)"
    """
    return re.sub(r"(?<![\w.:/~<-])(?:file:/+|~[\w.-]*/|\.\./|/)(?:[^/\s:;,'\"()]*/)*", "", text)


def _arrays(contents: Contents) -> list[list[Any]]:
    """Name, shape, type, unit, axes, names of files or columns, and meaning of each array."""
    rows, grasps, example = [], contents.grasps, contents.example
    for name, (_, spec) in grasps.sources.items():
        names = contents.layout.names(name, [*pictures(grasps, name, example[name])])
        place = " to ".join(f"`{file}`" for file in dict.fromkeys([names[0], names[-1]]))
        meaning = spec.meaning.replace("`hand/", "`hand.json`'s `")
        axes = ", ".join(grasps.dimensions(name))
        rows.append([f"`{name}`", example[name].shape, example[name].dtype, spec.unit, axes, place, meaning])
    return rows


def _joints(hand: Hand) -> list[list[Any]]:
    """Number, name, link, the link that this is on, movement, range and unit, and the joint that it follows."""
    rows, links, joints = [], [*map(escaped, hand.link_names)], [*map(escaped, hand.joint_names)]
    for number, (link, driver) in enumerate(zip(hand.joint_link, hand.joint_driver, strict=True)):
        how, unit = ("slides", "m") if hand.joint_slides[number] else ("turns", "rad")
        low, high = hand.joint_range[number]
        places = [links[link], links[hand.link_parent[link]], how, f"{low:.4g} to {high:.4g} {unit}"]
        rows.append([number, joints[number], *places, "" if driver == number else joints[driver]])
    return rows


def _rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table; none if it is missing."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines())) if path.is_file() else []
