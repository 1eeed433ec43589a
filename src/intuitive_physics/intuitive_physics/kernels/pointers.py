"""Access to memory by its address: a kernel then takes one pointer instead of ten arrays.

Numba passes an array as seven or more numbers; calls of functions with a dozen arrays took longer
than their work.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import from_dtype, types
from numba.extending import intrinsic


def record_getter(dtype: np.dtype) -> Callable:
    """Return a function (address, index) for kernels that returns one record of an array."""
    record = from_dtype(dtype)
    size = dtype.itemsize

    @intrinsic
    def record_at(typingctx, address, index):
        def generate(context, builder, signature, arguments):
            start, number = arguments
            offset = builder.mul(number, context.get_constant(types.intp, size))
            return builder.inttoptr(builder.add(start, offset), context.get_value_type(record))

        return record(types.intp, types.intp), generate

    return record_at


def _element(context, builder, start, number):
    pointer = context.get_value_type(types.CPointer(types.float64))
    return builder.gep(builder.inttoptr(start, pointer), [number])


@intrinsic
def flag_at(typingctx, address):
    """The int64 at an address, read from memory each time, as another thread may change it."""

    def generate(context, builder, signature, arguments):
        pointer = context.get_value_type(types.CPointer(types.int64))
        return builder.load_atomic(builder.inttoptr(arguments[0], pointer), "monotonic", 8)

    return types.int64(types.intp), generate


@intrinsic
def float_at(typingctx, address, index):
    """Element `index` of the array of float64 at an address."""

    def generate(context, builder, signature, arguments):
        return builder.load(_element(context, builder, *arguments))

    return types.float64(types.intp, types.intp), generate


@intrinsic
def put_float(typingctx, address, index, value):
    """Write element `index` of the array of float64 at an address."""

    def generate(context, builder, signature, arguments):
        builder.store(arguments[2], _element(context, builder, *arguments[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.float64), generate
