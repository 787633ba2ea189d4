"""Batches: an object keeps its own, whatever others come and go."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.catalogue import CatalogueError, Source, assign_batches, read_batches, write_batches
from tests.catalogue.whole import whole_catalogue

names = st.lists(st.text("abcdef", min_size=1, max_size=4), max_size=30, unique=True)


def members(places, names):
    """The objects of each batch that are among the names."""
    found = {}
    for name in names:
        found.setdefault(places[name], set()).add(name)
    return found


@given(names, st.integers(1, 7))
def test_without_known_ones_batches_are_filled_in_order(names, size):
    places = assign_batches(names, size)
    assert [places[name] for name in names] == [f"batch-{i // size:04d}" for i in range(len(names))]


@given(st.lists(names, min_size=1, max_size=4), st.integers(1, 7))
def test_through_any_comings_and_goings_an_object_stays_and_no_batch_overflows(runs, size):
    places = {}
    for names in runs:
        before, places = places, assign_batches(names, size, places)
        assert before.items() <= places.items() and set(names) <= set(places)
        assert all(len(each) <= size for each in members(places, places).values())
        assert assign_batches(names, size, places) == places


def test_of_ten_thousand_objects_one_more_or_one_less_changes_one_batch():
    names = [f"mug-{number:05d}" for number in range(10_000)]
    places = assign_batches(names, 16)
    before = members(places, names)
    for changed in (["ant-0", *names], names[:5000] + names[5001:]):  # the first by name; one from the middle
        after = members(assign_batches(changed, 16, places), changed)
        assert len({batch for batch in {*before, *after} if before.get(batch) != after.get(batch)}) == 1


def test_places_are_kept_in_the_runs_folder(tmp_path):
    assert read_batches(tmp_path, 2, 3) == (2, {})
    places = assign_batches(["a", "b", "c"], 2)
    write_batches(tmp_path, 2, places)
    assert read_batches(tmp_path, 2, 3) == (2, places)
    assert read_batches(tmp_path, 3, 3) == (3, {})  # formed anew
    (tmp_path / "batches.json").write_text("[]")
    with pytest.raises(CatalogueError, match="batches.json has changed .*; remove it"):
        read_batches(tmp_path, 2, 3)


@pytest.mark.parametrize(
    ("objects", "size"), [(3, 16), (271, 16), (272, 17), (512, 32), (20_000, 32), (20_001, 33), (100_000, 160)]
)
def test_large_runs_have_larger_batches_and_a_run_keeps_its_own(tmp_path, objects, size):
    assert read_batches(tmp_path, "auto", objects) == (size, {})
    assert -(-objects // size) <= 625
    assert read_batches(tmp_path, 5, objects) == (5, {})
    write_batches(tmp_path, size, assign_batches(map(str, range(objects)), size))
    assert read_batches(tmp_path, "auto", 10 * objects)[0] == size


def test_rows_of_a_catalogue_are_batch_by_batch(tmp_path):
    (tmp_path / "mug").mkdir()
    for name in "abc":
        (tmp_path / f"mug/{name}.stl").write_text("")
    places = {"mug-b": "batch-0000", "mug-c": "batch-0000", "mug-a": "batch-0001", "mug-gone": "batch-0001"}
    table = whole_catalogue(Source("folder", tmp_path), {"mug": "all"}, batches=places)
    assert list(zip(table["object"], table["batch"], strict=True)) == list(places.items())[:3]
