"""SIMD lanes for numba: a number type that holds a vector register of robots.

``Lanes(float32, 16)`` is sixteen float32 that compute together. It has ``+ - * /``, negation,
``abs``, ``math.sqrt`` and the primitives of ``arithmetic.py``; plain numbers promote to it. The
physics is then ordinary Python, compiled once for lanes and once for scalars from the same
function objects (``compiling.py``).

Instructions carry no fast-math flag, not even ``contract``: every operation is rounded according
to IEEE 754, and a multiply-add is fused only in ``fma``. A robot's numbers are therefore the same
in every lane, at every width, on every CPU (one without the instruction calls the C library's
``fma``), and in float64 equal to plain Python's to the last bit.

On a GPU (``engines/cuda.py``) a lane is a thread: the value of ``Lanes(float32, 16)`` is one
float32 there, sixteen threads in a row are a register, and everything else is the same.
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

# Each function is inlined: a call would pass lanes through memory and hide from the compiler what
# is constant from step to step. numba's wrapper for C is unused and a tenth of the compilation.
_INLINE = {"forceinline": True, "no_cfunc_wrapper": True}
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
        element = dmm.lookup(fe_type.base).get_value_type()
        super().__init__(dmm, fe_type, ir.VectorType(element, fe_type.width))


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _splat(context: Any, builder: Any, fromty: Any, toty: Lanes, value: Any) -> Any:
    scalar = context.cast(builder, value, fromty, toty.base)
    vector = context.get_value_type(toty)
    if not isinstance(vector, ir.VectorType):  # a thread's
        return scalar
    first = builder.insert_element(
        ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
    )
    mask = ir.Constant(ir.VectorType(ir.IntType(32), toty.width), [0] * toty.width)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), mask)


def _give(function: Any, arguments: int, lower: Callable[..., Any], scalars: bool = False) -> None:
    """Define a function on lanes, and on ``scalars``, that ``lower(builder, *values)`` builds."""

    class Typing(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: tuple[Any, ...], _kws: Any) -> Any:
            plain = types.float64 if scalars else None
            found = next((a for a in args if isinstance(a, Lanes)), plain)
            return found and signature(found, *[found] * arguments)

    infer_global(function)(Typing)
    for kind in (Lanes, types.Float) if scalars else (Lanes,):
        lower_builtin(function, *[kind] * arguments)(
            lambda _context, builder, _sig, args: lower(builder, *args)
        )


def _call(name: str) -> Callable[..., Any]:
    """Return a function that builds a call of LLVM's intrinsic of this name."""

    def lower(builder: Any, *values: Any) -> Any:
        kind = values[0].type
        vector = isinstance(kind, ir.VectorType)
        suffix = f"v{kind.count}{kind.element.intrinsic_name}" if vector else kind.intrinsic_name
        types_of = ir.FunctionType(kind, [kind] * len(values))
        function = cgutils.get_or_insert_function(builder.module, types_of, f"{name}.{suffix}")
        return builder.call(function, values)

    return lower


def _else_on_gpu(lower: Callable[..., Any], on_gpu: Callable[..., Any]) -> Callable[..., Any]:
    """Return what builds an operation by ``lower`` on vectors, and by ``on_gpu`` on a thread's."""

    def either(builder: Any, *values: Any) -> Any:
        vector = isinstance(values[0].type, ir.VectorType)
        return (lower if vector else on_gpu)(builder, *values)

    return either


# CUDA's compiler fuses LLVM's own multiplications and additions, but not these intrinsics. It knows
# neither fneg nor fabs.
def _rounded(operation: str) -> Callable[..., Any]:
    """Return what builds an operation on a thread's numbers that is fused with no other."""

    def lower(builder: Any, *values: Any) -> Any:
        kind = values[0].type
        name = f"llvm.nvvm.{operation}.rn.{'d' if isinstance(kind, ir.DoubleType) else 'f'}"
        types_of = ir.FunctionType(kind, [kind] * len(values))
        function = cgutils.get_or_insert_function(builder.module, types_of, name)
        return builder.call(function, values)

    return lower


def _negated(builder: Any, x: Any) -> Any:
    return builder.fsub(ir.Constant(x.type, -0.0), x)


def _absolute(builder: Any, x: Any) -> Any:
    bits = ir.IntType(64 if isinstance(x.type, ir.DoubleType) else 32)
    all_but_sign = ir.Constant(bits, 2 ** (bits.width - 1) - 1)
    return builder.bitcast(builder.and_(builder.bitcast(x, bits), all_but_sign), x.type)


_sum = _else_on_gpu(ir.IRBuilder.fadd, _rounded("add"))
_difference = _else_on_gpu(
    ir.IRBuilder.fsub, lambda builder, a, b: _sum(builder, a, _negated(builder, b))
)
_product = _else_on_gpu(ir.IRBuilder.fmul, _rounded("mul"))
for _kind, _lower in (
    (operator.add, _sum),
    (operator.iadd, _sum),
    (operator.sub, _difference),
    (operator.isub, _difference),
    (operator.mul, _product),
    (operator.imul, _product),
    (operator.truediv, ir.IRBuilder.fdiv),
):
    _give(_kind, 2, _lower)
_give(operator.neg, 1, _else_on_gpu(ir.IRBuilder.fneg, _negated))
_give(abs, 1, _else_on_gpu(_call("llvm.fabs"), _absolute))
_give(math.sqrt, 1, _call("llvm.sqrt"))
_give(arithmetic.fma, 3, _call("llvm.fma"), scalars=True)
_give(arithmetic.floor, 1, _call("llvm.floor"), scalars=True)
_give(
    arithmetic.where_less,
    4,
    lambda builder, a, b, *values: builder.select(builder.fcmp_ordered("<", a, b), *values),
    scalars=True,
)


def _on_gpu(context: Any, lanes: Any) -> bool:
    return not isinstance(context.get_value_type(lanes), ir.VectorType)


def _own_lane(builder: Any, kind: Any, lanes: Any) -> Any:
    """Return which lane of its register a thread is."""
    number = ir.IntType(32)
    name = "llvm.nvvm.read.ptx.sreg.tid.x"
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(number, []), name)
    thread = builder.call(function, [])
    return builder.zext(builder.and_(thread, ir.Constant(number, lanes.width - 1)), kind)


def _pointer(context: Any, builder: Any, arrayty: Any, array: Any, lanes: Any, i: Any) -> Any:
    """Return a pointer to lanes from entry i * width of a flat array on, or to a thread's own."""
    data = context.make_array(arrayty)(context, builder, value=array).data
    start = builder.mul(i, ir.Constant(i.type, lanes.width))
    if _on_gpu(context, lanes):
        start = builder.add(start, _own_lane(builder, i.type, lanes))
    return builder.bitcast(builder.gep(data, [start]), context.get_value_type(lanes).as_pointer())


@intrinsic
def _load(_typingctx: Any, array: Any, index: Any, like: Any) -> Any:
    """Lanes from entries index * width onwards of a flat array of the lanes' base type."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, sig.args[0], args[0], sig.return_type, args[1])
        return builder.load(pointer, align=sig.return_type.base.bitwidth // 8)

    if not isinstance(array, types.Array) or array.dtype != like.base:
        return None
    return signature(like, array, types.intp, like), codegen


@intrinsic
def _save(_typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Lanes into entries index * width onwards of a flat array of the lanes' base type."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, sig.args[0], args[0], sig.args[2], args[1])
        builder.store(args[2], pointer, align=sig.args[2].base.bitwidth // 8)
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
            pointer = _pointer(context, builder, sig.args[0], args[0], lanes, at)
            rows.append(builder.load(pointer, align=lanes.base.bitwidth // 8))
            at = builder.add(at, one)
        data = context.make_array(sig.args[2])(context, builder, value=args[2]).data
        at = args[3]
        if _on_gpu(context, lanes):  # each thread writes a row of its own
            lane = _own_lane(builder, at.type, lanes)
            at = builder.add(at, builder.mul(lane, args[4]))
            for entry in rows:
                builder.store(entry, builder.gep(data, [at]))
                at = builder.add(at, one)
            return context.get_dummy_value()
        for column in _transpose(builder, rows):
            pointer = builder.bitcast(builder.gep(data, [at]), column.type.as_pointer())
            builder.store(column, pointer, align=lanes.base.bitwidth // 8)
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


@intrinsic
def first_lane(_typingctx: Any, like: Any) -> Any:
    """Return the first lane that this code computes: 0, or on a GPU the thread's own."""

    def codegen(context: Any, builder: Any, sig: Any, _args: Any) -> Any:
        lanes, kind = sig.args[0], context.get_value_type(types.intp)
        on_gpu = _on_gpu(context, lanes)
        return _own_lane(builder, kind, lanes) if on_gpu else ir.Constant(kind, 0)

    return signature(types.intp, like), codegen


@intrinsic
def lanes_here(_typingctx: Any, like: Any) -> Any:
    """Return how many lanes, from the first one on, this code computes: all, or one on a GPU."""

    def codegen(context: Any, _builder: Any, sig: Any, _args: Any) -> Any:
        count = 1 if _on_gpu(context, sig.args[0]) else sig.args[0].width
        return ir.Constant(context.get_value_type(types.intp), count)

    return signature(types.intp, like), codegen


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


@overload(arithmetic.square_root, strict=False, jit_options=_INLINE)
def _square_root(x: Any) -> Any:
    return lambda x: math.sqrt(x)


@overload(arithmetic.cosine_sine, strict=False, jit_options=_INLINE)
def _cosine_sine(angle: Any) -> Any:
    sine_cosine, per_turn = arithmetic.sine_cosine, 1 / arithmetic.TAU

    def cosine_sine(angle: Any) -> tuple[Any, Any]:
        sine, cosine = sine_cosine(angle * per_turn)
        return cosine, sine

    return cosine_sine


# Functions with a second body here; their plain body must not be registered.
PRIMITIVES = (
    arithmetic.fma,
    arithmetic.where_less,
    arithmetic.floor,
    arithmetic.square_root,
    arithmetic.cosine_sine,
    arithmetic.fetch,
    arithmetic.put,
)


@functools.cache
def register_bytes() -> int:
    """Return the number of bytes in the widest vector register that numba compiles for.

    That is this machine's, unless ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES`` is set.
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
