"""What a declaration says of a table or figure, and that reading the declarations loads no engine."""

import inspect
import runpy
import subprocess
import sys

import pytest

from palpate.results import products
from palpate.results.products import caption, find, needed_splits
from tests.learning.synthetic import DECLARED

WORST = '''
from palpate.results import products


@products.table(evaluations="grasps", splits=("validation",))
def worst_objects(evaluations, split):
    """The objects with the largest
    error.

    Args: these are no part of the caption.
    """
'''
HEAVY = ("pandas", "matplotlib", "torch", "bpy", "mujoco", "trimesh", "embreex", "igl", "scipy", "zarr", "h5py")


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A function that runs a module's text; gives what it alone declares."""
    monkeypatch.setattr(products, "products", lambda: tuple(products.DECLARED.values()))

    def read(text: str) -> tuple[products.Product, ...]:
        monkeypatch.setattr(products, "DECLARED", {})
        (tmp_path / "own.py").write_text(text)
        runpy.run_path(str(tmp_path / "own.py"))
        return products.products()

    return read


def test_a_function_is_all_that_a_table_needs(own):
    (product,) = own(WORST)
    assert (product.kind, product.name, product.parameters) == ("tables", "worst_objects", ("evaluations", "split"))
    assert caption("tables", "worst_objects").startswith("The objects with the largest error. In brackets,")
    assert find("figures", "worst_objects") is None and caption("figures", "worst_objects") == ""
    # The split that it names is needed beside those of claims.
    assert product.needed_splits(DECLARED.tables) == ("validation",)
    assert needed_splits(DECLARED.experiments["charts_touch_3"], DECLARED.tables) == ["validation", "test"]


def test_a_declaration_is_evaluated(own):
    (product,) = own("SPLITS = 'train', 'validation', 'test'\n" + WORST.replace('("validation",)', "SPLITS[1:]"))
    assert product.splits == ("validation", "test")


def test_a_field_in_a_name_is_one_in_its_caption(own):
    own(WORST.replace('evaluations="grasps"', 'name="worst_of_{class_name}"').replace("The objects", "{class_name}s"))
    product, fields = find("tables", "worst_of_a mug")
    assert fields == {"class_name": "a mug"} and find("tables", "worst") is None
    assert caption("tables", "worst_of_a mug") == "a mugs with the largest error."


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('    """The objects', '    pass\n    """The objects', "caption, is missing"),
        ('evaluations="grasps"', 'stores=("fabric",)', "unknown fabric: stores are of"),
        ('evaluations="grasps"', 'evaluation="grasps"', "unexpected keyword argument 'evaluation'"),
    ],
)
def test_a_declaration_that_makes_no_sense_is_named(own, old, new, message):
    assert old in WORST
    with pytest.raises(ValueError, match=rf"own\.py:5: worst_objects: .*{message}"):
        own(WORST.replace(old, new))


def test_names_are_unique(own):
    with pytest.raises(ValueError, match=r"own\.py:16: worst_objects: there are two tables named worst_objects"):
        own(WORST + WORST)


def test_a_figure_is_drawn_in_the_style_of_all_and_a_table_is_the_function_itself(own):
    text = "import matplotlib\n" + WORST.replace("evaluations, split", "path=''")
    text += "    return matplotlib.rcParams['text.color']\n"
    (table,) = own(text)
    (figure,) = own(text.replace("products.table", "products.figure"))
    assert figure.parameters == table.parameters == ("path",)
    assert figure.function() == "#222222" != table.function()


def test_reading_the_declarations_loads_no_engine():
    code = (
        "import sys; from palpate.results import products; assert len(products.products()) > 20;"
        f"sys.exit(', '.join(name for name in {HEAVY!r} if name in sys.modules) or None)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_declarations_are_in_the_order_of_category_module_and_source():
    declared = products.products()
    codes = [inspect.unwrap(each.function).__code__ for each in declared]
    places = [(one.category, code.co_filename, code.co_firstlineno) for one, code in zip(declared, codes, strict=True)]
    assert places == sorted(places)
