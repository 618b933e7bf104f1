"""Read tensors from a file of ``torch.save``, without PyTorch and without loading its pickle.

Such a file has a pickle, which says where each tensor lies, and the numbers. Here its instructions
are followed as far as a dictionary of tensors needs them. None of them can call anything.
"""

from __future__ import annotations

import io
import math
import pickletools
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief

# A policy of 20 layers has 1,000 instructions and 40 members. More would take memory, not bytes.
MOST_INSTRUCTIONS = 100_000
MOST_MEMBERS = 10_000
MOST_DIMENSIONS = 8
FLOAT32 = "torch FloatStorage"
_BEFORE_1_6 = 0x1950A86A20F9469CFC6C  # how a file of PyTorch before 1.6 begins


@dataclass(frozen=True)
class Tensor:
    """Where a tensor lies: its storage's type and key, and its place in it."""

    kind: str
    key: str
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.shape)

    @property
    def is_whole(self) -> bool:
        """Whether the entries are stored from the storage's beginning, row by row."""
        following = 1
        for count, stride in zip(self.shape[::-1], self.strides[::-1], strict=True):
            if count != 1 and stride != following:
                return False
            following *= count
        return self.offset == 0


@dataclass(frozen=True)
class TorchFile:
    """The tensors of a file, by name, and what reads a storage, given its key and its bytes."""

    tensors: dict[str, Tensor]
    read: Callable[[str, int], bytes]

    def array(self, name: str) -> NDArray[np.float32]:
        """Return a tensor of finite float32, or raise InvalidArgumentError."""
        tensor = self.tensors.get(name)
        kind = getattr(tensor, "kind", None)
        if tensor is None or kind != FLOAT32:
            raise InvalidArgumentError(f"{name} must be a tensor of float32; got {brief(kind)}")
        try:
            content = self.read(tensor.key, 4 * tensor.size) if tensor.is_whole else b""
        except Exception as error:  # a damaged archive raises a dozen kinds of errors
            raise InvalidArgumentError(
                f"{name} must be stored undamaged; {brief(str(error))}"
            ) from None
        if len(content) != 4 * tensor.size:
            raise InvalidArgumentError(
                f"{name} must be stored by itself, row by row; it is a part or a view of "
                f"storage {brief(tensor.key)}"
            )
        array = np.frombuffer(content, "<f4").astype(np.float32).reshape(tensor.shape)
        if not np.isfinite(array).all():
            raise InvalidArgumentError(f"{name} must be finite; it is not")
        return array


def open_torch_file(content: bytes, most_bytes: int) -> TorchFile:
    """Return the tensors in the content of a file, of at most ``most_bytes`` uncompressed.

    What is no such file raises errors of many kinds.
    """
    if not content.startswith(b"PK"):
        return _open_before_1_6(io.BytesIO(content))
    if content.count(b"PK\1\2") > MOST_MEMBERS:
        raise ValueError(f"it has more than {MOST_MEMBERS} members")
    archive = zipfile.ZipFile(io.BytesIO(content))
    members = {member.filename: member for member in archive.infolist()}
    if sum(member.file_size for member in archive.infolist()) > most_bytes:
        raise ValueError(f"it holds more than {most_bytes} bytes")
    (pickled,) = (name for name in members if name.endswith("/data.pkl"))
    folder = pickled.removesuffix("data.pkl")
    order = f"{folder}byteorder"
    if order in members and archive.read(order) != b"little":
        raise ValueError("its numbers are not in little-endian order")

    def read(key: str, count: int) -> bytes:
        member = members.get(f"{folder}data/{key}")
        return archive.read(member) if member and member.file_size == count else b""

    return TorchFile(_tensors(_described(io.BytesIO(archive.read(pickled)))), read)


def _open_before_1_6(file: BinaryIO) -> TorchFile:
    """Return the tensors of five pickles and the storages behind them."""
    begin, _, _, described, keys = (_described(file) for _ in range(5))
    tensors = _tensors(described)
    if begin != _BEFORE_1_6 or any(tensor.kind != FLOAT32 for tensor in tensors.values()):
        raise ValueError("it must be a file of torch.save, of float32")
    storages: dict[str, bytes] = {}
    for key in keys:
        count = int.from_bytes(file.read(8), "little")
        storages[_text(key)] = file.read(4 * count)
    return TorchFile(tensors, lambda key, _: storages.get(key, b""))


def _tensors(described: object) -> dict[str, Tensor]:
    if not isinstance(described, dict):
        raise TypeError("it must hold tensors by name")
    for name, tensor in described.items():
        if not isinstance(tensor, Tensor):
            raise TypeError(f"{name} must be a tensor; got {brief(tensor)}")
    return described


def _described(file: BinaryIO) -> Any:
    """Return what a pickle describes; refuse instructions that no dictionary of tensors needs."""
    stack: list[Any] = []
    marks: list[int] = []
    memo: dict[Any, Any] = {}

    def pop(count: int) -> tuple[Any, ...]:
        if count > len(stack):
            raise ValueError("its pickle ends early")
        taken = tuple(stack[len(stack) - count :])
        del stack[len(stack) - count :]
        return taken

    for number, (opcode, argument, _) in enumerate(pickletools.genops(file)):
        if number > MOST_INSTRUCTIONS:
            raise ValueError(f"its pickle has more than {MOST_INSTRUCTIONS} instructions")
        match opcode.name:
            case "PROTO" | "BINPERSID":  # the description of a storage stays what it is
                pass
            case "BININT" | "BININT1" | "BININT2" | "BINUNICODE" | "GLOBAL" | "LONG1":
                stack.append(argument)
            case "NEWFALSE" | "NEWTRUE" | "NONE":
                stack.append({"NEWFALSE": False, "NEWTRUE": True, "NONE": None}[opcode.name])
            case "EMPTY_DICT":
                stack.append({})
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_TUPLE":
                stack.append(())
            case "BINPUT" | "LONG_BINPUT":
                memo[argument] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(memo[argument])
            case "MARK":
                marks.append(len(stack))
            case "TUPLE":
                stack.append(pop(len(stack) - marks.pop()))
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                stack.append(pop(int(opcode.name[-1])))
            case "APPEND" | "APPENDS":
                items = pop(1 if opcode.name == "APPEND" else len(stack) - marks.pop())
                stack[-1].extend(items)
            case "SETITEM" | "SETITEMS":
                items = pop(2 if opcode.name == "SETITEM" else len(stack) - marks.pop())
                names = map(_text, items[::2])
                stack[-1].update(zip(names, items[1::2], strict=True))
            case "REDUCE":
                stack.append(_made(*pop(2)))
            case "BUILD":  # attributes of a dictionary
                pop(1)
            case "STOP":
                break
            case _:
                raise ValueError(f"its pickle has the instruction {opcode.name}")
    return stack.pop()


def _text(value: object) -> str:
    if type(value) is not str:
        raise TypeError("its pickle has a name that is no text")
    return value


def _made(name: object, arguments: Any) -> object:
    """Return what a call describes, without the call."""
    if name == "collections OrderedDict" and arguments == ():
        return {}
    if name == "torch._utils _rebuild_tensor_v2":
        (_, kind, key, *_), offset, shape, strides, *_ = arguments
        whole_numbers = all(type(n) is int and n >= 0 for n in (offset, *shape, *strides))
        if not whole_numbers or not len(shape) == len(strides) <= MOST_DIMENSIONS:
            raise ValueError("its pickle has a tensor of no shape")
        return Tensor(_text(kind), _text(key), offset, tuple(shape), tuple(strides))
    raise ValueError(f"its pickle calls {brief(name)}")
