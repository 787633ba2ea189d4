"""The page of a run, `index.html`: its objects, figures, tables, claims, trainings, times and config, to read offline.

It can be made again at any time, also of a run in part and of one with failures. `index.html.jinja` lays it out.
"""

import csv
import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup, escape
from PIL import Image

from palpate import viewer
from palpate.batch import one_line_error
from palpate.catalogue import SPLITS, CatalogueEntry
from palpate.dataset import Dataset, ObjectRecord
from palpate.dataset.run import Run
from palpate.rebuild_command import RECORD
from palpate.results.products import caption, position
from palpate.stages import STAGES
from palpate.viewer import duration
from palpate.viewer.html import data_uri, render, resource

PICTURED = 300  # objects with a picture in the page: 1 to 3 kB each
OBJECT_PAGES = 8  # pages of objects that are written with it: up to a second, and 3 to 6 MB, each
THUMBNAIL, FIGURE = 160, 1500  # pixels
EMBEDDED = 3_000_000  # bytes of figures in the page; what is beyond is read from its file
MOST_ROWS = 500  # of a table
VERDICTS = {"holds": "good", "agrees": "good", "better": "good", "does not hold": "bad", "worse": "bad"}
CURVE = (150, 34)  # width and height of a training's curve


class Cell(NamedTuple):
    """A table's cell."""

    text: str
    value: float | None = None  # what a number is sorted by
    kind: str = ""  # of a verdict, "good" or "bad"
    curve: Sequence[str] = ()  # polylines of SVG


class Table(NamedTuple):
    """A table of the page."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    rows_in_all: int  # also those that are not in the page
    name: str = ""
    caption: Markup | str = ""
    note: Markup | str = ""
    files: Mapping[str, str] = {}  # links to it by their suffixes


def run_page(
    folder: Path | str,
    path: Path | str | None = None,
    pages: Path | str | None = None,
    object_pages: int = OBJECT_PAGES,
) -> Path:
    """Write the page of a run; returns its path, by default `index.html` in the run's folder.
    pages: folder of the objects' own pages, by default `viewer` in the run's. object_pages: how many objects get one,
    of all classes in turn, if it is missing or older than their stores. The page names what can't be read."""
    run, problems = Run(folder), []
    path, pages = Path(path or run.folder / "index.html"), Path(pages or run.folder / "viewer")
    link = partial(_link, run.folder, path.parent)

    def read(otherwise: Any, part: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return part(*arguments)
        except (OSError, ValueError, LookupError) as error:
            problems.append(one_line_error(error))
            return otherwise

    entries = read({}, lambda: run.catalogue)
    rejections = read([], run.rejections)
    dataset = read(None, Dataset, run.folder) if entries else None
    stages = dataset.stages if dataset else []
    shown = spread(dataset or (), PICTURED)
    whole = [record for record in shown if stages and all(path.exists() for path in _stores(record, stages))]
    for record in spread(whole, object_pages):
        if not _is_current(page := pages / f"{record.name}.html", record):
            read(None, viewer.object_page, page, record)  # loads trimesh
    tables = [read(None, _result, file, name, link) for name, file in _files(run.folder, "tables", "md")]
    render(
        path,
        "index.html.jinja",
        name=run.folder.resolve().name,
        folder=run.folder,
        link=link,
        duration=duration,
        last=read({}, lambda: json.loads(_text(run.folder / "last_run.json") or "{}")),
        settings=read({}, lambda: run.config),
        config=_text(run.folder / RECORD),
        counts=_counts(entries, {row["object"] for row in rejections}),
        objects=[_thumbnail(record, stages, link, pages) for record in shown],
        usable=len(dataset or ()),
        listed=(run.folder / "rejected.csv").exists(),
        rejected=_table(("object", "stage", "reason"), [row.values() for row in rejections]),
        checks=list(csv.DictReader(_text(run.folder / "reports/validation.csv").splitlines())),
        warnings=read([], _warnings, run.folder),
        figures=read([], _figures, run.folder, link),
        tables={table.name: table for table in tables if table},
        trainings=read(_table((), ()), _trainings, run.folder),
        times=read(_table((), ()), _times, run.folder),
        problems=problems,
        style=resource("index.css"),
        script=resource("index.js"),
    )
    return path


def spread(records: Iterable[ObjectRecord], most: int) -> list[ObjectRecord]:
    """At most so many objects, the first ones of each class in turn; in the order in which they came."""
    classes: dict[str, list[tuple[int, ObjectRecord]]] = {}
    for number, record in enumerate(records):
        classes.setdefault(record.class_name, []).append((number, record))
    turns = [numbered for numbered in chain(*zip_longest(*classes.values())) if numbered]
    return [record for _, record in sorted(turns[:most], key=lambda numbered: numbered[0])]


def _table(heads: Sequence[str], rows: Iterable[Iterable[Any]], **other: Any) -> Table:
    def cell(value: Any) -> Cell:
        if isinstance(value, int | float):
            return Cell(f"{value:,}", float(value))
        return value if isinstance(value, Cell) else Cell(str(value))

    rows = list(rows)
    return Table(heads, [[*map(cell, row)] for row in rows[:MOST_ROWS]], len(rows), **other)


def _link(folder: Path, place: Path, *parts: str) -> str:
    """The address of a file of the run, as seen from the page; its name may have any characters."""
    return quote(os.path.relpath(folder.resolve().joinpath(*parts), place.resolve()))


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def _marked(text: str) -> Markup:
    return Markup(re.sub(r"(`+)(.+?)\1", r"<code>\2</code>", str(escape(text))))


def _files(folder: Path, kind: str, suffix: str) -> list[tuple[str, Path]]:
    """Tables, figures or reports of the run with their names, in the order of `products`."""
    paths = folder.glob(f"{kind}/**/*.{suffix}")
    named = [(path.relative_to(folder / kind).with_suffix("").as_posix(), path) for path in paths]
    return sorted(named, key=lambda file: position(kind, file[0]))


def _result(path: Path, name: str, link: Callable[..., str]) -> Table:
    lines = _text(path).splitlines()
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines if line.startswith("|")]
    if len(cells) < 2:
        raise ValueError(f"{path}: not a table in Markdown")
    heads, _, *rows = [[cell.strip().replace(r"\|", "|") for cell in row] for row in cells]
    order = [*range(len(heads))]
    if name == "claims":
        order.insert(heads.index("claim") + 1, order.pop(heads.index("verdict")))
    shown = [[_shown(heads[column], row[column]) for column in order] for row in rows]
    files = {form: link("tables", name + form) for form in (".csv", ".md", ".tex") if path.with_suffix(form).exists()}
    note = _marked("\n".join(line for line in lines if not line.startswith("|")).strip())
    about = {"name": name, "caption": _marked(caption("tables", name)), "note": note, "files": files}
    return _table([heads[column] for column in order], shown, **about)


def _shown(head: str, text: str) -> Cell:
    """A cell of a table; a number, alone or before its interval, is sorted by."""
    number = re.match(r"-?\d+(\.\d+)?(e[-+]\d+)?(?=$| [\[(])", text) if head not in ("class", "section") else None
    return Cell(text, float(number[0]) if number else None, VERDICTS.get(text.partition(" (")[0], ""))


def _counts(entries: Mapping[str, CatalogueEntry], rejected: set[str]) -> Table:
    """Objects that are used, by class and split, and those that were rejected."""
    counts = Counter((entry.class_name, entry.split, name in rejected) for name, entry in entries.items())
    rows = []
    for group in sorted({entry.class_name for entry in entries.values()}):
        used, unused = ([counts[group, split, state] for split in SPLITS] for state in (False, True))
        rows.append([group, *used, sum(used), sum(unused)])
    if rows:
        rows.append(["total", *(sum(numbers) for numbers in list(zip(*rows, strict=True))[1:])])
    return _table(("class", *SPLITS, "used", "rejected"), rows)


def _thumbnail(record: ObjectRecord, stages: Sequence[str], link: Callable[..., str], pages: Path) -> dict[str, str]:
    """An object, with its picture, and the address of its page if there is one."""
    picture = ""
    for stage, name in (("vision", "unoccluded"), ("views", "image")):
        if stage in stages and not picture:
            try:
                image = getattr(record, name)
                picture = data_uri(image.reshape(-1, *image.shape[-3:])[0], THUMBNAIL)
            except (OSError, ValueError):
                continue  # this batch's are not made yet, or damaged, as `palpate validate` says
    page = pages.resolve() / f"{record.name}.html"
    names = {"name": record.name, "group": f"{record.class_name}, {record.split}"}
    return {**names, "picture": picture, "page": link(page) if _is_current(page, record) else ""}


def _is_current(page: Path, record: ObjectRecord) -> bool:
    """Whether an object has a page that is not older than what it shows."""
    made = _stores(record, [stage.name for stage in STAGES.values() if stage.in_dataset])
    newest = max((path.stat().st_mtime for path in made if path.exists()), default=0)
    return page.exists() and page.stat().st_mtime >= newest


def _stores(record: ObjectRecord, stages: Iterable[str]) -> list[Path]:
    return [record.mesh.parents[2] / STAGES[stage].path(record.batch) for stage in stages]


def _warnings(folder: Path) -> list[str]:
    """The warnings of the jobs' logs, but for those of rejections; each once."""
    logs = "\n".join(_text(path) for path in sorted(folder.glob("logs/**/*.log")))
    return list(dict.fromkeys(re.findall(r"^\S+ \S+ WARNING (?!.* rejected: )(.+)", logs, re.MULTILINE)))


def _figures(folder: Path, link: Callable[..., str]) -> list[dict[str, Any]]:
    """Figures, and pictures of reports, with captions: in the page, but for GIFs, and beyond `EMBEDDED` bytes."""
    figures: list[dict[str, Any]] = []
    used, places = 0, (("figures", "png"), ("figures", "gif"), ("reports", "png"))
    pictures = [(kind, *file) for kind, suffix in places for file in _files(folder, kind, suffix)]
    for kind, name, path in pictures:
        file = link(kind, f"{name}{path.suffix}")
        with Image.open(path) as picture:
            size = dict(zip(("width", "height"), picture.size, strict=True))
            still = path.suffix == ".png"  # the others move
            source = data_uri(picture.convert("RGB"), FIGURE) if still and used < EMBEDDED else ""
        used, about = used + len(source), {"caption": _marked(caption(kind, name)), "source": source or file}
        figures.append({"name": name, "file": file, **about, **size})
    return figures


def _trainings(folder: Path) -> Table:
    """The trained models with their curves, the training's loss first and then that on the validation split."""
    import pandas

    rows = []
    for path in sorted(folder.glob("models/**/training.json")):
        training = json.loads(path.read_bytes())
        history, seconds = pandas.read_csv(path.with_name("history.csv")), training["seconds"]
        name, loss = path.parent.relative_to(folder / "models").as_posix(), training["validation_loss"]
        cells = Cell("", curve=_curve(history)), Cell(f"{loss:.3f}", loss), training["best_step"], training["steps"]
        rows.append([name, *cells, Cell(duration(seconds), seconds)])
    return _table(("model", "loss", "on validation", "at step", "steps", "time"), rows)


def _curve(history: Any) -> list[str]:
    """Points of polylines: steps to the right, logarithms of losses upwards."""
    losses = history[["train_loss", "validation_loss"]].clip(lower=1e-9).map(math.log)
    low, high = losses.min(axis=None), losses.max(axis=None)
    x, y = CURVE[0] * history["step"] / history["step"].max(), CURVE[1] * (high - losses) / ((high - low) or 1)
    return [" ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y[name], strict=True)) for name in losses]


def _times(folder: Path) -> Table:
    """Jobs, time and memory by stage, from the benchmarks of jobs; tables and figures together."""
    jobs: dict[str, list[tuple[float, float]]] = {}
    kinds = ("tables", "csv"), ("figures", "png"), ("figures", "gif")
    made = {name: kind for kind, form in kinds for name, _ in _files(folder, kind, form)}
    for path in sorted(folder.glob("benchmarks/**/*.tsv")):
        name = path.relative_to(folder / "benchmarks").with_suffix("").as_posix()
        row = next(csv.DictReader(_text(path).splitlines(), delimiter="\t"))
        jobs.setdefault(made.get(name, name.partition("/")[0]), []).append((float(row["s"]), float(row["max_rss"])))
    rows = []
    for name, times in sorted(jobs.items(), key=lambda job: -sum(seconds for seconds, _ in job[1])):
        seconds, memory = zip(*times, strict=True)
        spans = [Cell(duration(span), span) for span in (sum(seconds), max(seconds))]
        rows.append([name, len(times), *spans, Cell(f"{max(memory):,.0f}", max(memory))])
    return _table(("stage", "jobs", "time", "longest job", "most memory of a job, MB"), rows)
