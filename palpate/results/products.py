"""Tables and figures of a run: each is one function of this package, declared by a decorator (see CONTRIBUTING.md).

The function's name is the table's or the figure's. The first paragraph of its docstring is the caption. The
decorator's values (`Product`) say what it reads. Its parameters get what is read under the same name, as listed in
`workflow/scripts/product.py`; a figure also gets the `path` to write to. Inputs, params, captions and targets of the
workflow follow from this.
"""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from palpate.configuration import read_yaml
from palpate.experiments import SPLITS, Comparison, Experiment
from palpate.results.page import styled
from palpate.results.published import paper_rows, terms
from palpate.stages import STAGES

Function = TypeVar("Function", bound=Callable)
FOLDER = Path(__file__).parent
FILES = ("touches", "touch_depth", "trainings")  # evaluation of the U-Net, the U-Net, the grid of hyperparameters
UNIONS = ("claims", "effects", "retrieval")  # sources of evaluations that are no table of config/experiments.yaml
CAPTIONS = read_yaml(FOLDER / "captions.yaml")  # of reports, which `studies` makes, and for tables with intervals


@dataclass(frozen=True)
class Product:
    """One table or figure, as its decorator declares it."""

    kind: str  # `tables` or `figures`, its folder in the run
    function: Callable[..., Any]  # gives the table, or draws the figure
    # By default the function's. `{class_name}` or `{model}` in it, and in the caption, stands for each class of the
    # run, or each model whose layers the paper lists.
    name: str
    # Whose evaluations it reads, over all surfaces, in rings around touches, and after chosen grasps: those of a table
    # of config/experiments.yaml, or of one of `UNIONS`.
    evaluations: str = ""
    rings: str = ""
    selections: str = ""
    models: tuple[str, ...] = ()  # experiments whose trained models it reads
    files: tuple[str, ...] = ()  # of `FILES`
    # Stages whose stores it reads, `dataset` for all that every dataset has; one that was read, not simulated, lacks
    # some. A run has no product of stores that its config does not ask for.
    stores: tuple[str, ...] = ()
    splits: tuple[str, ...] = ()  # that it needs objects of; by default that of its table of config/experiments.yaml
    category: str = "Models"  # or `Dataset`
    simulated: bool = False  # whether a dataset that was read, not simulated, can't have it
    form: str = "png"  # suffix of a figure's file, or `gif`
    on_request: bool = False  # whether only a request by name makes it, not `all`

    def __post_init__(self) -> None:
        """Raises ValueError for a stage or a file that there is not, and for a function without a caption."""
        if unknown := {*self.stores} - {*STAGES} | {*self.files} - {*FILES}:
            raise ValueError(f"unknown {', '.join(sorted(unknown))}: stores are of {[*STAGES]}, files of {[*FILES]}")
        if not self.caption:
            raise ValueError("its docstring, whose first paragraph is the caption, is missing")

    @property
    def caption(self) -> str:  # the first paragraph of its function's docstring, in one line
        return " ".join((inspect.getdoc(self.function) or "").split("\n\n")[0].split())

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(inspect.signature(self.function).parameters)

    @property
    def comparison(self) -> str:
        """The table of config/experiments.yaml whose experiments it reads evaluations of; empty without one."""
        source = self.evaluations or self.rings or self.selections
        return source if source not in UNIONS else ""

    def needed_splits(self, tables: Mapping[str, Comparison]) -> tuple[str, ...]:
        """The splits that it needs objects of. tables: those of config/experiments.yaml."""
        return self.splits or ((tables[self.comparison].split,) if self.comparison in tables else ())


DECLARED: dict[tuple[str, str], Product] = {}  # by kind and name


def table(**declaration: Any) -> Callable[[Function], Function]:
    """Declares a function that gives a DataFrame, by attributes of `Product`. Raises ValueError, naming file and line,
    for what `Product` does not have, and for a name that is another one's."""
    return partial(_declare, "tables", declaration)


def figure(**declaration: Any) -> Callable[[Function], Function]:
    """Declares, as `table`, a function that draws a figure to `path`, in the figures' style."""
    return lambda function: _declare("figures", declaration, styled(function))


def _declare(kind: str, declaration: dict[str, Any], function: Function) -> Function:
    if declaration.get("stores") == ("dataset",):
        stores = (stage.name for stage in STAGES.values() if stage.in_dataset and not stage.asked_by)
        declaration = declaration | {"stores": tuple(stores)}
    try:
        product = Product(kind, function, **{"name": function.__name__} | declaration)
        if (kind, product.name) in DECLARED:
            raise ValueError(f"there are two {kind} named {product.name}")
    except (ValueError, TypeError) as error:
        code = inspect.unwrap(function).__code__
        raise ValueError(f"{code.co_filename}:{code.co_firstlineno}: {function.__name__}: {error}") from None
    DECLARED[kind, product.name] = product
    return function


@cache
def products() -> tuple[Product, ...]:
    """The tables and figures, those of the dataset first, then by module, in the order of the source."""
    for module in pkgutil.iter_modules([str(FOLDER)]):
        importlib.import_module(f"palpate.results.{module.name}")
    return tuple(sorted(DECLARED.values(), key=lambda product: (product.category, product.function.__module__)))


def find(kind: str, name: str) -> tuple[Product, dict[str, str]] | None:
    """The product of a name, and what the fields in its name stand for; None for an unknown name."""
    for product in products():
        pattern = re.sub(r"\\\{(\w+)\\\}", r"(?P<\1>.+)", re.escape(product.name))
        if product.kind == kind and (match := re.fullmatch(pattern, name)):
            return product, match.groupdict()
    return None


def caption(kind: str, name: str) -> str:
    """The caption of a table, figure or report, with code between backticks; empty for an unknown name."""
    if kind == "reports":
        return CAPTIONS["reports"].get(name, "")
    product, fields = find(kind, name) or (None, {})
    if not product:
        return ""
    text = product.caption.format(**fields)
    has_intervals = product.comparison or product.evaluations or "touches" in product.files
    return f"{text} {CAPTIONS['intervals']}" if kind == "tables" and has_intervals else text


def position(kind: str, name: str) -> tuple[int, str]:
    """What sorts names in the order of their products; unknown ones at the end, by name."""
    named = find(kind, name)
    return products().index(named[0]) if named else len(products()), name


def needed_splits(experiment: Experiment, tables: Mapping[str, Comparison]) -> list[str]:
    """The splits of which a table, a claim or a difference takes an experiment's errors; all if none does.
    tables: those of config/experiments.yaml."""
    names = {experiment.name, experiment.stated_as}  # ours take the paper's place in claims and differences

    def are_in(*cells: str) -> bool:
        return bool(names & {term.key for cell in cells for term in terms(cell)})

    needed = {row["split"] for row in paper_rows("claims") if are_in(row["experiments"])}
    for product in products():
        if product.comparison in tables and experiment.name in tables[product.comparison].by_name:
            needed |= set(product.needed_splits(tables))
    if any(are_in(row["experiment"], row["compared_with"]) for row in paper_rows("effects")):
        needed |= set(SPLITS)
    return [split for split in SPLITS if split in needed or not needed]
