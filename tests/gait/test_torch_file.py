"""Files of torch.save are read without PyTorch, and none can call anything or take memory."""

from __future__ import annotations

import io
import pickle
import struct
import tracemalloc
import zipfile
from collections import OrderedDict
from typing import Any

import numpy as np
import pytest

from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.torch_file import open_torch_file

MOST_BYTES = 2**27


def text(value: str) -> bytes:
    """Return the instruction for a text."""
    return b"X" + struct.pack("<I", len(value)) + value.encode()


def number(value: int) -> bytes:
    """Return the instruction for a whole number."""
    return b"J" + struct.pack("<i", value)


def numbers(*values: int) -> bytes:
    """Return the instructions for a tuple of whole numbers."""
    return b"(" + b"".join(map(number, values)) + b"t"


def tensor(key: str, offset: int, shape: bytes, strides: bytes, kind: str = "Float") -> bytes:
    """Return the instructions for a tensor, as PyTorch writes them."""
    storage = b"(" + text("storage") + f"ctorch\n{kind}Storage\n".encode() + text(key) + text("cpu")
    return (
        b"ctorch._utils\n_rebuild_tensor_v2\n("
        + (storage + number(6) + b"tQ" + number(offset) + shape + strides)
        + b"\x89ccollections\nOrderedDict\n)RtR"
    )


def named(**tensors: bytes) -> bytes:
    """Return a pickle of an ordered dictionary with an attribute, as of a module's weights."""
    items = b"".join(text(name) + one for name, one in tensors.items())
    attribute = b"}" + text("_metadata") + b"}s"
    return b"\x80\x02ccollections\nOrderedDict\n)R(" + items + b"u" + attribute + b"b."


def zipped(pickled: bytes, **members: bytes) -> bytes:
    """Return a file of torch.save."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("archive/data.pkl", pickled)
        for name, member in members.items():
            archive.writestr(f"archive/{name.replace('_', '/')}", member)
    return content.getvalue()


SIX = np.arange(6, dtype="<f4")
WEIGHTS = tensor("0", 0, numbers(2, 3), numbers(3, 1))


def test_a_tensor_by_hand_is_read() -> None:
    file = open_torch_file(
        zipped(named(a=WEIGHTS), data_0=SIX.tobytes(), byteorder=b"little"), MOST_BYTES
    )
    assert np.array_equal(file.array("a"), SIX.reshape(2, 3))


def test_a_file_from_before_zips_is_read() -> None:
    first = pickle.dumps(0x1950A86A20F9469CFC6C, 2) + pickle.dumps(1001, 2)
    system = pickle.dumps({"little_endian": True}, 2)
    storage = struct.pack("<q", 6) + SIX.tobytes()
    content = first + system + named(a=WEIGHTS) + pickle.dumps(["0"], 2) + storage
    assert np.array_equal(open_torch_file(content, MOST_BYTES).array("a"), SIX.reshape(2, 3))


@pytest.mark.parametrize(
    ("one", "sentence"),
    [
        (tensor("0", 0, numbers(3, 2), numbers(1, 3)), "a must be stored by itself"),  # transposed
        (tensor("0", 1, numbers(5), numbers(1)), "a must be stored by itself"),
        (tensor("0", 0, numbers(5), numbers(1)), "a must be stored by itself"),
        (tensor("0", 0, numbers(2**30, 2**30), numbers(0, 0)), "a must be stored by itself"),
        (tensor("0", 0, numbers(2**30, 2**30), numbers(2**30, 1)), "a must be stored by itself"),
        (tensor("1", 0, numbers(6), numbers(1)), "a must be stored by itself"),
        (
            tensor("0", 0, numbers(3), numbers(1), "Double"),
            "a must be a tensor of float32; got .*D",
        ),
    ],
)
def test_a_tensor_that_is_not_a_storage_is_refused(one: bytes, sentence: str) -> None:
    file = open_torch_file(zipped(named(a=one), data_0=SIX.tobytes()), MOST_BYTES)
    with pytest.raises(InvalidArgumentError, match=sentence):
        file.array("a")


def test_a_damaged_storage_is_refused() -> None:
    content = zipped(named(a=WEIGHTS), data_0=SIX.tobytes())
    assert content.count(SIX.tobytes()) == 1
    damaged = content.replace(SIX.tobytes(), SIX[::-1].tobytes())
    with pytest.raises(InvalidArgumentError, match=r"a must be stored undamaged; .*Bad CRC-32"):
        open_torch_file(damaged, MOST_BYTES).array("a")


NESTED = b")" + 50_000 * b"\x85"


@pytest.mark.parametrize(
    ("pickled", "sentence"),
    [
        (b"\x80\x02cbuiltins\nbytearray\n\x8a\x05\x00\xf9\x02\x95\x00\x85R.", "calls 'builtins by"),
        (pickle.dumps({"a": bytearray(9)}, 5), "its pickle has the instruction"),
        (b"\x80\x05\x96" + struct.pack("<Q", 2**40) + b".", "expected 1099511627776 bytes"),
        (b"\x80\x02" + 120_000 * b"}" + b".", "more than 100000 instructions"),
        (b"\x80\x02}" + NESTED + b"Ns.", "a name that is no text"),
        (b"\x80\x02}" + text("a") + NESTED + b"s.", "a must be a tensor; got"),
        (named(a=b"N"), "a must be a tensor; got None"),
        (named(a=tensor("0", 0, numbers(6), numbers(1, 1))), "a tensor of no shape"),
        (named(a=tensor("0", 0, numbers(-6), numbers(1))), "a tensor of no shape"),
        (named(a=tensor("0", 0, numbers(*9 * [1]), numbers(*9 * [1]))), "a tensor of no shape"),
        (b"\x80\x02]r\xff\xff\xff\xff.", "it must hold tensors by name"),
        (b"\x80\x02\x85.", "its pickle ends early"),
        (b"\x80\x02cos\nsystem\n" + text("true") + b"\x85R.", "its pickle calls 'os system'"),
    ],
)
def test_a_pickle_of_something_else_is_refused_without_a_call_or_memory(
    pickled: bytes, sentence: str
) -> None:
    content = zipped(pickled)
    tracemalloc.start()
    try:
        with pytest.raises((ValueError, TypeError), match=sentence):
            open_torch_file(content, MOST_BYTES)
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("members", "sentence"),
    [
        ({"data_0": bytes(2**20)}, "it holds more than 1000000 bytes"),
        ({"byteorder": b"big"}, "not in little-endian order"),
        ({f"data_{i}": b"" for i in range(10_001)}, "more than 10000 members"),
    ],
)
def test_an_archive_of_too_much_is_refused(members: dict[str, bytes], sentence: str) -> None:
    content = zipped(named(), **members)
    with pytest.raises(ValueError, match=sentence):
        open_torch_file(content, 10**6)


def test_the_bytes_of_pytorch_are_read() -> None:
    torch = pytest.importorskip("torch")
    weights: OrderedDict[str, Any] = OrderedDict(a=torch.randn(4, 3), b=torch.randn(4))
    for is_zipped in (True, False):
        content = io.BytesIO()
        torch.save(weights, content, _use_new_zipfile_serialization=is_zipped)
        file = open_torch_file(content.getvalue(), MOST_BYTES)
        assert list(file.tensors) == ["a", "b"]
        for name, one in weights.items():
            assert np.array_equal(file.array(name), one.numpy())
