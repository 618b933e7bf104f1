"""SIMD lanes for numba: a number type that is a whole vector register of robots.

``Lanes(float32, 16)`` is sixteen float32 that compute together. It has ``+ - * /``, negation,
``abs``, ``math.sqrt`` and the primitives of ``arithmetic.py``; plain numbers promote to it. The
physics is then ordinary Python, compiled once for lanes and once for scalars from the same
function objects (``compiling.py``).

Instructions carry no fast-math flag, not even ``contract``: every operation is rounded as
IEEE 754 says, and a multiply-add is fused where the source says ``fma`` and nowhere else. So a
robot's numbers are the same in every lane, at every width, on every CPU (one without the
instruction calls the C library's ``fma``), and in float64 the same to the last bit as plain
Python's.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba.core import cgutils, config, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    overload,
    register_jitable,
    register_model,
)

from aquafish_gym.physics import arithmetic

# A call would pass lanes through memory, and hide from the compiler what does not change from
# step to step: each function becomes part of its caller.
_INLINE = {"forceinline": True}
inlined = register_jitable(**_INLINE)


class Lanes(types.Type):
    """``width`` numbers of type ``base`` in one vector register."""

    def __init__(self, base: types.Float, width: int) -> None:
        self.base = base
        self.width = width
        super().__init__(name=f"Lanes({base}, {width})")

    @property
    def key(self) -> tuple[types.Float, int]:
        return (self.base, self.width)

    def can_convert_from(self, _typingctx: Any, other: types.Type) -> Any:
        """Plain numbers promote to lanes."""
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None

    def unify(self, _typingctx: Any, other: types.Type) -> Any:
        """A variable that starts as a plain number may become lanes."""
        return self if isinstance(other, types.Float | types.Integer) else None


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Lanes) -> None:
        element = ir.FloatType() if fe_type.base == types.float32 else ir.DoubleType()
        super().__init__(dmm, fe_type, ir.VectorType(element, fe_type.width))


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _splat(context: Any, builder: Any, fromty: Any, toty: Lanes, value: Any) -> Any:
    scalar = context.cast(builder, value, fromty, toty.base)
    vector = context.get_value_type(toty)
    first = builder.insert_element(
        ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
    )
    mask = ir.Constant(ir.VectorType(ir.IntType(32), toty.width), [0] * toty.width)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), mask)


def _arithmetic(function: Any, instruction: str) -> None:
    """Give lanes a binary operator."""

    class Typing(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, args: tuple[Any, ...], _kws: Any) -> Any:
            lanes = next((a for a in args if isinstance(a, Lanes)), None)
            if lanes is None or len(args) != 2:
                return None
            if all(a == lanes or isinstance(a, types.Float | types.Integer) for a in args):
                return signature(lanes, lanes, lanes)
            return None

    infer_global(function)(Typing)

    @lower_builtin(function, Lanes, Lanes)
    def _lower(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)


def _unary(function: Any, lower: Callable[[Any, Any, Any], Any]) -> None:
    """Give lanes a function of one argument."""

    class Typing(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, args: tuple[Any, ...], _kws: Any) -> Any:
            if len(args) == 1 and isinstance(args[0], Lanes):
                return signature(args[0], args[0])
            return None

    infer_global(function)(Typing)

    @lower_builtin(function, Lanes)
    def _lower(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return lower(builder, args[0].type, args[0])


def _suffix(number: Any) -> str:
    """Return how LLVM's intrinsics for a type of number, or of lanes, are told apart."""
    if isinstance(number, ir.VectorType):
        return f"v{number.count}{_suffix(number.element)}"
    return "f32" if isinstance(number, ir.FloatType) else "f64"


def _call(name: str) -> Callable[[Any, Any, Any], Any]:
    def lower(builder: Any, vector: Any, value: Any) -> Any:
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector]), f"{name}.{_suffix(vector)}"
        )
        return builder.call(function, [value])

    return lower


_arithmetic(operator.add, "fadd")
_arithmetic(operator.sub, "fsub")
_arithmetic(operator.mul, "fmul")
_arithmetic(operator.truediv, "fdiv")
_arithmetic(operator.iadd, "fadd")
_arithmetic(operator.isub, "fsub")
_arithmetic(operator.imul, "fmul")
_unary(operator.neg, lambda builder, _vector, value: builder.fneg(value))
_unary(abs, _call("llvm.fabs"))
_unary(math.sqrt, _call("llvm.sqrt"))


@intrinsic
def _fused(_typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    found = next((t for t in (a, b, c) if isinstance(t, Lanes)), types.float64)

    def codegen(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        number = args[0].type
        name = f"llvm.fma.{_suffix(number)}"
        kind = ir.FunctionType(number, [number] * 3)
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return signature(found, found, found, found), codegen


@overload(arithmetic.fma, strict=False, jit_options=_INLINE)
def _fma(a: Any, b: Any, c: Any) -> Any:
    return lambda a, b, c: _fused(a, b, c)


@intrinsic
def _select_less(_typingctx: Any, a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    lanes = next(t for t in (a, b, then, otherwise) if isinstance(t, Lanes))

    def codegen(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return signature(lanes, lanes, lanes, lanes, lanes), codegen


@overload(arithmetic.where_less, strict=False, jit_options=_INLINE)
def _where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    if any(isinstance(t, Lanes) for t in (a, b, then, otherwise)):
        return lambda a, b, then, otherwise: _select_less(a, b, then, otherwise)
    return lambda a, b, then, otherwise: then if a < b else otherwise


@intrinsic
def _floor_lanes(_typingctx: Any, x: Any) -> Any:
    def codegen(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _call("llvm.floor")(builder, args[0].type, args[0])

    return signature(x, x), codegen


@overload(arithmetic.floor, strict=False, jit_options=_INLINE)
def _floor(x: Any) -> Any:
    if isinstance(x, Lanes):
        return lambda x: _floor_lanes(x)
    return lambda x: float(math.floor(x))


def _vector_pointer(
    context: Any, builder: Any, arrayty: Any, array: Any, lanes: Any, i: Any
) -> Any:
    """Point at entry i * width of a flat array, as at one vector."""
    data = context.make_array(arrayty)(context, builder, value=array).data
    start = builder.mul(i, ir.Constant(i.type, lanes.width))
    pointer = builder.gep(data, [start])
    return builder.bitcast(pointer, context.get_value_type(lanes).as_pointer())


def _alignment(lanes: Lanes) -> int:
    return 4 if lanes.base == types.float32 else 8


@intrinsic
def _load(_typingctx: Any, array: Any, index: Any, like: Any) -> Any:
    """Lanes from entries index * width onwards of a flat array of the lanes' base type."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _vector_pointer(context, builder, sig.args[0], args[0], sig.return_type, args[1])
        return builder.load(pointer, align=_alignment(sig.return_type))

    if not isinstance(array, types.Array) or array.dtype != like.base:
        return None
    return signature(like, array, types.intp, like), codegen


@intrinsic
def _save(_typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Lanes into entries index * width onwards of a flat array of the lanes' base type."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _vector_pointer(context, builder, sig.args[0], args[0], sig.args[2], args[1])
        builder.store(args[2], pointer, align=_alignment(sig.args[2]))
        return context.get_dummy_value()

    if not isinstance(array, types.Array) or array.dtype != value.base:
        return None
    return signature(types.void, array, types.intp, value), codegen


@intrinsic
def put_transposed(
    _typingctx: Any, source: Any, index: Any, target: Any, start: Any, stride: Any, like: Any
) -> Any:
    """Write ``width`` entries of a flat array of lanes, one lane after another.

    Entries ``index`` to ``index + width - 1`` of ``source`` are loaded; lane i of them becomes
    ``width`` numbers in a row of ``target``, from its element ``start + i * stride`` on.
    """

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        lanes = sig.args[5]
        width = lanes.width
        one = ir.Constant(args[1].type, 1)
        rows, at = [], args[1]
        for _ in range(width):
            pointer = _vector_pointer(context, builder, sig.args[0], args[0], lanes, at)
            rows.append(builder.load(pointer, align=_alignment(lanes)))
            at = builder.add(at, one)
        data = context.make_array(sig.args[2])(context, builder, value=args[2]).data
        at = args[3]
        for column in _transpose(builder, rows):
            pointer = builder.bitcast(builder.gep(data, [at]), column.type.as_pointer())
            builder.store(column, pointer, align=_alignment(lanes))
            at = builder.add(at, args[4])
        return context.get_dummy_value()

    if not all(isinstance(a, types.Array) and a.dtype == like.base for a in (source, target)):
        return None
    counts = (types.intp, types.intp)
    return signature(types.void, source, types.intp, target, *counts, like), codegen


def _transpose(builder: Any, rows: list[Any]) -> list[Any]:
    """Return the columns of a square of vectors, by swapping ever larger blocks in pairs."""
    width = len(rows)
    block = 1
    while block < width:
        keep = [lane & block == 0 for lane in range(width)]
        upper = [i if kept else width + i - block for i, kept in enumerate(keep)]
        lower = [i + block if kept else width + i for i, kept in enumerate(keep)]
        masks = [ir.Constant(ir.VectorType(ir.IntType(32), width), mask) for mask in (upper, lower)]
        for i in range(width):
            if keep[i]:
                pair = rows[i], rows[i + block]
                rows[i], rows[i + block] = (builder.shuffle_vector(*pair, mask) for mask in masks)
        block *= 2
    return rows


@intrinsic(prefer_literal=True)
def zero_lanes(_typingctx: Any, array: Any, width: Any) -> Any:
    """Return lanes of zeros, as many as the literal ``width``, of the array's type."""
    if not isinstance(width, types.IntegerLiteral):
        return None
    lanes = Lanes(array.dtype, width.literal_value)

    def codegen(context: Any, _builder: Any, _sig: Any, _args: Any) -> Any:
        return cgutils.get_null_value(context.get_value_type(lanes))

    return signature(lanes, array, width), codegen


@overload(arithmetic.fetch, strict=False, jit_options=_INLINE)
def _fetch(array: Any, index: Any, like: Any) -> Any:
    if isinstance(like, Lanes):
        return lambda array, index, like: _load(array, index, like)
    return lambda array, index, like: array[index]


@overload(arithmetic.put, strict=False, jit_options=_INLINE)
def _put(array: Any, index: Any, value: Any) -> Any:
    if isinstance(value, Lanes):
        return lambda array, index, value: _save(array, index, value)

    def put(array: Any, index: Any, value: Any) -> None:
        array[index] = value

    return put


# What has a second body here and must not be registered with its plain one.
PRIMITIVES = (
    arithmetic.fma,
    arithmetic.where_less,
    arithmetic.floor,
    arithmetic.fetch,
    arithmetic.put,
)


@functools.cache
def register_bytes() -> int:
    """Return how many bytes the widest vector register holds that numba compiles for.

    That is this machine's, unless numba is told otherwise (``NUMBA_CPU_NAME``,
    ``NUMBA_CPU_FEATURES``).
    """
    if config.CPU_FEATURES is not None:
        features = {f[1:] for f in config.CPU_FEATURES.split(",") if f.startswith("+")}
    elif config.CPU_NAME not in (None, binding.get_host_cpu_name()):
        features = set()  # only the name's compiler knows
    else:
        features = {name for name, found in binding.get_host_cpu_features().items() if found}
    if "avx512f" in features:
        return 64
    return 32 if "avx" in features else 16
