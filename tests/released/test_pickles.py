import io
import os
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from palpate.batch import UnusableObject
from palpate.released.pickles import load_plain


def assert_same(one, other):
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert list(one) == list(other)
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for each, its in zip(one, other, strict=True):
            assert_same(each, its)
    elif isinstance(one, np.ndarray):
        assert one.shape == other.shape and one.dtype == other.dtype
        if one.dtype == object:
            assert_same(list(one.flat), list(other.flat))
        else:
            np.testing.assert_array_equal(one, other)
    else:
        assert one == other or one != one and other != other


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary()
arrays = npst.arrays(
    npst.boolean_dtypes() | npst.integer_dtypes() | npst.floating_dtypes() | npst.unicode_string_dtypes(),
    npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
)
values = st.recursive(
    scalars | arrays | arrays.filter(lambda array: array.size).map(lambda array: array.ravel()[0]),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner) | st.tuples(inner, inner),
    max_leaves=6,
)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.text(), values))
def test_dictionaries_come_back_as_numpy_would_load_them(tmp_path_factory, saved):
    path = tmp_path_factory.mktemp("npy") / "0.npy"
    np.save(path, saved)
    assert_same(load_plain(path), np.load(path, allow_pickle=True).item())


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("order", ["C", "F"])
def test_every_protocol_is_read(tmp_path, protocol, order):
    saved = {
        "grid": np.array(np.arange(6.0).reshape(2, 3), order=order),
        "big": np.arange(4, dtype=">i2"),
        "ragged": np.array([np.zeros((2, 3)), None, "x"], dtype=object),
        "clouds": [np.zeros((0, 3), np.float32), np.ones((2, 3), np.float32)],
        "number": np.float32(0.5),
        "set": {1, 2},
        "bytes": b"\x00\xff",
    }
    path = tmp_path / "0.npy"
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
        pickle.dump(np.array(saved, dtype=object), file, protocol=protocol)
    loaded = load_plain(path)
    assert_same(loaded["grid"], saved["grid"])
    np.testing.assert_array_equal(loaded["big"], [0, 1, 2, 3])
    assert_same(loaded["ragged"], saved["ragged"])
    assert_same(loaded["clouds"], saved["clouds"])
    assert loaded["number"] == 0.5 and loaded["set"] == {1, 2} and loaded["bytes"] == b"\x00\xff"


def test_names_of_both_numpys_are_read(tmp_path):
    saved = {"depth": np.arange(4.0), "n": np.float32(2)}
    for name in (b"numpy.core.", b"numpy._core."):
        path = tmp_path / "0.npy"
        with path.open("wb") as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
            file.write(pickle.dumps(np.array(saved, dtype=object), 0).replace(b"numpy.core.", name))
        assert_same(load_plain(path), saved)


def test_arrays_without_objects_are_read_too(tmp_path):
    np.save(tmp_path / "points.npy", np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(load_plain(tmp_path / "points.npy"), [[0, 1, 2], [3, 4, 5]])


class Calls:
    """Pickles as a call of any function."""

    def __init__(self, function, *arguments):
        self.reduced = function, arguments

    def __reduce__(self):
        return self.reduced


class OfAType:
    """Pickles as a numpy type with a state of ours."""

    def __init__(self, spec, state):
        self.reduced = np.dtype, (spec, False, True), state

    def __reduce__(self):
        return self.reduced


@pytest.mark.parametrize(
    ("evil", "named"),
    [
        (lambda path: Calls(os.mkdir, str(path)), "posix.mkdir"),
        (lambda path: Calls(eval, f"__import__('os').mkdir({str(path)!r})"), "builtins.eval"),
        (lambda path: Calls(exec, f"import os; os.mkdir({str(path)!r})"), "builtins.exec"),
        (lambda path: Calls(getattr, "mkdir", "upper"), "builtins.getattr"),
        (lambda path: Calls(np.save, str(path), 1), "numpy.save"),
        (lambda path: Calls(np.load, str(path)), "numpy.load"),
        (lambda path: Calls(io.open, str(path), "w"), "io.open"),
        (lambda path: os.mkdir, "posix.mkdir"),
        (lambda path: np.ndarray, "a name as a value"),
        (lambda path: Calls(np.ndarray, (3,)), "an array without contents"),
        (lambda path: Calls(np.dtype, [("a", "O")]), "the type"),
        (lambda path: OfAType("V8", (3, "|", None, None, None, 8, 1, 1)), "the type"),
        (lambda path: OfAType("O", (3, "|", None, ("a",), {"a": 1}, 8, 1, 0)), "a type with parts"),
    ],
)
def test_what_could_run_is_refused_and_named(tmp_path, evil, named):
    target = tmp_path / "made"
    for number, wrap in enumerate((lambda value: {"depth": value}, lambda value: [{"gel": [value]}])):
        path = tmp_path / f"evil-{number}.npy"
        array = np.empty((), dtype=object)
        array[()] = wrap(evil(target))
        np.save(path, array)
        with pytest.raises(UnusableObject, match=f"{named}.*, which is refused") as caught:
            load_plain(path)
        assert str(path) in str(caught.value)
        assert not target.exists()


def test_a_name_can_not_be_changed_by_a_pickle(tmp_path):
    # numpy.dtype, then BUILD with slots' state: an attribute of what the name stands for.
    body = b"\x80\x03cnumpy\ndtype\n(N}X\x09\x00\x00\x00_functionK\x01stb."
    path = tmp_path / "0.npy"
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
        file.write(body)
    with pytest.raises(UnusableObject, match="0.npy"):
        load_plain(path)
    np.save(tmp_path / "1.npy", {"a": np.arange(3)})
    assert load_plain(tmp_path / "1.npy")["a"].tolist() == [0, 1, 2]


@pytest.mark.parametrize("content", [b"", b"not numpy", b"\x93NUMPY\x09\x00", b"\x93NUMPY\x01\x00\x05\x00hello"])
def test_damaged_files_are_named(tmp_path, content):
    path = tmp_path / "0.npy"
    path.write_bytes(content)
    with pytest.raises(UnusableObject, match="0.npy"):
        load_plain(path)
    with pytest.raises(UnusableObject, match="none.npy: no such file"):
        load_plain(tmp_path / "none.npy")


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_file_with_a_changed_byte_is_read_or_named(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("npy") / "0.npy"
    np.save(path, {"depth": [np.zeros((2, 2))] * 4, "touch_success": [True, False], "n": np.float32(1)})
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        load_plain(path)
    except UnusableObject as error:
        assert "0.npy" in str(error)


def test_a_damaged_number_takes_no_memory(tmp_path):
    """As one byte in a file can make of it: the table for object 4,000,000,000 would have 64 GB."""
    path = tmp_path / "0.npy"
    np.save(path, {"depth": [1]})
    before, after = path.read_bytes().rsplit(pickle.EMPTY_DICT, 1)
    kept = pickle.LONG_BINPUT + (4_000_000_000).to_bytes(4, "little")
    path.write_bytes(before + pickle.EMPTY_DICT + kept + after)
    with pytest.raises(UnusableObject, match=r"0\.npy.*object as number 4000000000"):
        load_plain(path)
