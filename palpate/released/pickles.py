"""Reads `.npy` files with pickled dictionaries without running the pickle's code.

`np.load(allow_pickle=True)` runs any code in a pickle. Here names in a pickle resolve to the few stand-ins below, which
only record their arguments; arrays are built from these records afterwards, from checked shapes, types and bytes.
"""

import pickle
import pickletools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from palpate.batch import UnusableObject

MOST_KEPT = 1_000_000  # objects of a pickle that it refers to again
KINDS = "biufcSU"  # numpy's kinds of types that are plain values: bool, numbers, strings


def load_plain(path: Path | str) -> Any:
    """What `np.load(path, allow_pickle=True)` gives if it is harmless; the element of an array without axes. Raises
    UnusableObject, naming the file, if it asks for anything but arrays, numbers, strings and plain containers, is
    missing, or can't be read."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            major, minor = np.lib.format.read_magic(file)
            read = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}
            if major not in read:
                raise ValueError(f"format version {major}.{minor}")
            shape, _, dtype = read[major](file)
            if not dtype.hasobject:
                file.seek(0)
                array = np.load(file, allow_pickle=False)
            else:
                start = file.tell()
                for opcode, number, _ in pickletools.genops(file):  # the machine makes a table as long as the number
                    if opcode.name in ("BINPUT", "LONG_BINPUT", "PUT") and (number or 0) > MOST_KEPT:
                        raise ValueError(f"it keeps an object as number {number}")
                file.seek(start)
                # The encoding is of Python 2's strings, which held arrays' bytes.
                array = np.asarray(_plain(_Reader(file, encoding="latin1").load()))
                if array.shape != shape:
                    raise ValueError(f"shape {shape} in the header, {array.shape} in the pickle")
            return array.item() if array.shape == () else array
    except FileNotFoundError:
        raise UnusableObject(f"{path}: no such file") from None
    except _Refused as refused:
        expected = "for a pickle can run any code: expected numpy arrays, numbers, strings and plain containers only"
        raise UnusableObject(f"{path}: asks for {refused}, which is refused, {expected}") from None
    except Exception as error:  # a damaged pickle makes the reader trip over anything, also MemoryError
        problem = f"{type(error).__name__}: {error}"
        raise UnusableObject(f"{path}: can't be read as .npy ({problem}): unpack it again") from None


class _Refused(Exception):
    """The name that a pickle asked for."""


class _Reader(pickle.Unpickler):
    """A pickle machine that knows the names of `_STAND_INS` and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for a name in a pickle. Raises `_Refused` for any other."""
        module = module.replace("numpy._core.", "numpy.core.").replace("__builtin__", "builtins")
        if (module, name) not in _STAND_INS:
            raise _Refused(f"{module}.{name}")
        stand_in = _STAND_INS[module, name]
        return lambda *arguments: stand_in(*arguments)  # of its own: a pickle can change what it gets


class _Dtype:
    """Record of a numpy type; of its state only the byte order counts."""

    def __init__(self, spec: Any, *_: Any):
        if not isinstance(spec, str) or np.dtype(spec).fields or np.dtype(spec).kind not in KINDS + "O":
            raise _Refused(f"the type {spec!r}")
        self.dtype = np.dtype(spec)

    def __setstate__(self, state: Any) -> None:
        if any(part is not None for part in state[2:5]):
            raise _Refused("a type with parts")
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class _Array:
    """Record of an array, or of a number or string of numpy's, which has no shape."""

    def __init__(self, shape: Any = None, dtype: Any = None, data: Any = b"", order: Any = "C"):
        self.shape, self.dtype, self.data, self.order = shape, dtype, data, order

    def __setstate__(self, state: Any) -> None:
        _, self.shape, self.dtype, fortran, self.data = state
        self.order = "F" if fortran else "C"

    def value(self) -> Any:
        """The array or the number itself; ValueError if data and shape do not fit."""
        shape, dtype = tuple(int(length) for length in self.shape or ()), self.dtype.dtype
        if dtype.kind == "O":
            array = np.empty(len(self.data), dtype=object)
            for place, element in enumerate(self.data):
                array[place] = _plain(element)
        else:
            # numpy refuses buffers of strings without letters
            array = np.frombuffer(_bytes(self.data), dtype) if dtype.itemsize else np.zeros(shape, dtype)
            array = array.astype(dtype.newbyteorder("="))
        array = array.reshape(shape, order=self.order)
        return array[()] if self.shape is None else array


def _bytes(data: Any = b"", encoding: Any = "latin1") -> bytes:
    """Bytes, also of text, as in protocol 2; a number is refused, because `bytes` of it would allocate as many."""
    if not isinstance(data, bytes | bytearray | str) or encoding not in ("latin1", "latin-1"):
        raise _Refused(f"bytes of {type(data).__name__}, encoding {encoding!r}")
    return data.encode("latin1") if isinstance(data, str) else bytes(data)


def _never(*_: Any) -> None:
    raise _Refused("an array without contents")


_STAND_INS: dict[tuple[str, str], Callable[..., Any]] = {
    ("_codecs", "encode"): _bytes,
    ("builtins", "bytes"): _bytes,
    ("builtins", "set"): set,
    ("numpy", "dtype"): _Dtype,
    ("numpy", "ndarray"): _never,  # named as the kind of array to make, not called
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: _Array(),
    ("numpy.core.multiarray", "scalar"): lambda dtype, data=b"": _Array(None, dtype, data),
    ("numpy.core.numeric", "_frombuffer"): lambda data, dtype, shape, order: _Array(shape, dtype, data, order),
}


def _plain(value: Any) -> Any:
    """The value of a record, within plain containers too."""
    if isinstance(value, _Array):
        return value.value()
    if isinstance(value, dict):
        return {_plain(key): _plain(element) for key, element in value.items()}
    if isinstance(value, list | tuple | set):
        return type(value)(_plain(element) for element in value)
    if callable(value) or isinstance(value, _Dtype):
        raise _Refused("a name as a value")
    return value
