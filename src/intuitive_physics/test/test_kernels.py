"""What kernels need of Numba beyond its documentation: fails with a clear word when it changes."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba import njit
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from intuitive_physics.errors import UnknownNameError
from intuitive_physics.kernels import (
    allocating_entry,
    allocating_kernel,
    decorators,
    entry,
    fast_inlined,
    inlined,
    kernel,
)
from intuitive_physics.kernels import warm_up as kernel_cache
from intuitive_physics.kernels.part_library import PartLibrary

CHANGED = f"Numba {numba.__version__} has changed; see intuitive_physics/kernels/decorators.py:"
ARRAY = np.array([1.0, 2.0])


def first(array):
    return array[0]


def doubled(number):
    return 2.0 * number


def new_array(count):
    return np.zeros(count)


@pytest.mark.parametrize("option", [*decorators.WITHOUT_RUNTIME, *decorators.AS_PART])
def test_undocumented_options_are_accepted(option):
    value = {**decorators.WITHOUT_RUNTIME, **decorators.AS_PART}[option]
    inner = njit(**{option: value})(first)
    try:
        got = njit(lambda array: inner(array))(ARRAY)
    except Exception as error:
        pytest.fail(f"{CHANGED} it refuses the option {option}={value}: {error}")
    assert got == 1.0


def test_parts_are_compiled_with_their_entry_and_only_then():
    inner = kernel(doubled)
    middle = kernel(lambda number: inner(number) + 1.0)
    outer = entry(lambda number: middle(number) + inner(number))
    try:
        assert outer(3.0) == 13.0
    except Exception as error:
        pytest.fail(f"{CHANGED} an entry does not find its parts (part_library.py): {error!r}")
    for part in (inner, middle):
        ((made,)) = part.overloads.values()
        assert isinstance(made.library, PartLibrary), (
            f"{CHANGED} a compiler's library is not the one that code is written into"
        )
        assert len(list(made.library.get_defined_functions())) == 1


def test_a_kernel_without_the_run_time_can_allocate_nothing():
    inner = kernel(new_array)
    try:
        njit(lambda count: inner(count).sum())(3)
    except NumbaError:
        return
    pytest.fail(f"{CHANGED} the option _nrt=False does not keep a kernel from allocating")


@pytest.mark.parametrize("decorate", [kernel, inlined, fast_inlined, allocating_kernel])
def test_numbers_written_out_do_not_compile_once_more(decorate):
    assert hasattr(Dispatcher, "get_call_template"), (
        f"{CHANGED} a dispatcher has no get_call_template, by which numbers written out in a call "
        "are kept from being types"
    )
    inner = decorate(doubled)
    outer = njit(lambda: inner(1) + inner(2) + inner(3))
    assert outer() == 12.0
    assert len(inner.signatures) == 1, (
        f"{CHANGED} {len(inner.signatures)} versions of one function were compiled for the numbers "
        "1, 2 and 3 written out in calls"
    )


def test_what_the_cache_needs_is_there():
    assert hasattr(njit(first), "_cache"), f"{CHANGED} a dispatcher has no _cache"
    for name in ("_reduce", "_rebuild"):
        assert hasattr(CompileResult, name), f"{CHANGED} a compiled function has no {name}"


def test_kernels_that_allocate_do():
    inner = allocating_kernel(new_array)
    outer = allocating_entry(lambda count: inner(count).sum())
    assert outer(3) == 0.0
    np.testing.assert_array_equal(allocating_entry(new_array)(2), [0.0, 0.0])


def test_a_division_by_zero_is_infinite():
    inverse = entry(lambda number: 1.0 / number)
    assert inverse(0.0) == np.inf


def test_reordering_keeps_what_is_not_a_number():
    inner = fast_inlined(lambda a, b: a + b)
    assert np.isnan(njit(lambda a, b: inner(a, b))(np.inf, -np.inf))


def test_a_module_without_warm_ups_is_refused():
    with pytest.raises(UnknownNameError, match=r"intuitive_physics\.errors has no WARM_UPS"):
        kernel_cache.main(["intuitive_physics.errors"])
