"""What a declaration says of a table or figure, read from the source."""

import inspect

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


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A function that reads the declarations of a module's text."""
    monkeypatch.setattr(products, "FOLDER", tmp_path)

    def read(text: str):
        (tmp_path / "own.py").write_text(text)
        products.products.cache_clear()
        return products.products()

    yield read
    products.products.cache_clear()


def test_a_function_is_all_that_a_table_needs(own):
    (product,) = own(WORST)
    assert (product.kind, product.name, product.parameters) == ("tables", "worst_objects", ("evaluations", "split"))
    assert caption("tables", "worst_objects").startswith("The objects with the largest error. In brackets,")
    assert find("figures", "worst_objects") is None and caption("figures", "worst_objects") == ""
    # The split that it names is needed beside those of claims.
    assert product.needed_splits(DECLARED.tables) == ("validation",)
    assert needed_splits(DECLARED.experiments["charts_touch_3"], DECLARED.tables) == ["validation", "test"]


def test_a_field_in_a_name_is_one_in_its_caption(own):
    own(WORST.replace('evaluations="grasps"', 'name="worst_of_{class_name}"').replace("The objects", "{class_name}s"))
    product, fields = find("tables", "worst_of_a mug")
    assert fields == {"class_name": "a mug"} and find("tables", "worst") is None
    assert caption("tables", "worst_of_a mug") == "a mugs with the largest error."


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('    """The objects', '    pass\n    """The objects', "caption, is missing"),
        ('evaluations="grasps"', "evaluations=GRASPS", "malformed"),
        ('evaluations="grasps"', 'stores=("fabric",)', "unknown fabric: stores are of"),
        ('evaluations="grasps"', 'evaluation="grasps"', "unexpected keyword argument 'evaluation'"),
    ],
)
def test_a_declaration_that_makes_no_sense_is_named(own, old, new, message):
    assert old in WORST
    with pytest.raises(ValueError, match=rf"own\.py:6: worst_objects: .*{message}"):
        own(WORST.replace(old, new))


def test_names_are_unique(own):
    with pytest.raises(ValueError, match=r"own\.py:17: there are two tables named worst_objects"):
        own(WORST + WORST)


@pytest.mark.parametrize("product", products.products(), ids=lambda each: f"{each.kind}/{each.name}")
def test_declarations_are_those_of_the_functions(product):
    """What the source says is what Python makes of it."""
    function = product.load()
    assert tuple(inspect.signature(function).parameters) == product.parameters
    assert " ".join(inspect.getdoc(function).split()).startswith(product.caption)
