"""The one decorator of the compiled part.

Compiled functions release the interpreter's lock, so that plain threads run simulations side by side: no second
threading library, no clash with a window's or a cluster worker's own threads, and each simulation's arithmetic is the
same wherever it runs. No fast-math: IEEE arithmetic in the written order is what makes results identical bit for bit
on one core, on two and on a cluster.

The machine code is cached beside the source. numba takes a cached function for fresh when its own file is unchanged,
although functions of other files are compiled into it; so the cache is stamped here with all files that take part.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numba.extending

Function = TypeVar("Function", bound=Callable[..., Any])

PARTS = (
    "compiled", "scene/frame", "scene/bvh", "scene/geometry",
    "tracer/rays", "tracer/budget", "tracer/nearest", "tracer/tracer", "tracer/simulation",
)  # fmt: skip


def _stamp() -> bytes:
    here = Path(__file__).parent
    return hashlib.sha256(b"".join((here / f"{name}.py").read_bytes() for name in PARTS)).digest()


STAMP = _stamp()


def compiled(function: Function) -> Function:
    """Compile `function` with numba at its first call, cached, without the interpreter's lock."""
    dispatcher: Any = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    dispatcher._cache._cache_file._source_stamp = STAMP
    return cast(Function, dispatcher)


def inner(function: Function) -> Function:
    """As `compiled`, and written into its callers: for the innermost loops."""
    return cast(Function, numba.njit(nogil=True, error_model="numpy", forceinline=True)(function))


@numba.extending.intrinsic
def _pointer(typingctx: Any, array: Any) -> Any:
    """The address of a contiguous array's first element, to be indexed flat.

    Inner loops read through pointers because handing arrays on costs them two thirds of their time, all of it atomic
    reference counting. There is no length and no owner: whoever takes a pointer keeps the array alive beside it.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    address: Any = numba.types.CPointer
    return address(array.dtype)(array), codegen


pointer: Any = _pointer
