"""The one decorator for hot loops: compiled by Numba, cached on disk, run without the interpreter lock."""

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., object])

# Sums may be reordered and multiply-adds fused; NaN and inf keep their meaning (scans carry both).
_FASTMATH = {"contract", "reassoc", "arcp", "nsz"}


def kernel(function: F) -> F:
    """Compile a pure function over arrays and scalars.

    The same machine and versions give the same bits. After editing a kernel that a kernel in
    another file calls, delete the `__pycache__/*.nbi` files: Numba sees only a file's own changes.
    """
    return cast(F, njit(cache=True, nogil=True, fastmath=_FASTMATH)(function))


def inlined(function: F) -> F:
    """Compile a step of a kernel that is worth more when its caller's loop contains it than when called."""
    return cast(F, njit(cache=True, nogil=True, fastmath=_FASTMATH, forceinline=True)(function))
