"""The one decorator for hot loops: compiled by Numba, cached on disk, run without the interpreter lock."""

import importlib
import sys
from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import config

from knotwork.core import kernel_cache

F = TypeVar("F", bound=Callable[..., object])

# Sums may be reordered and multiply-adds fused; NaN and inf keep their meaning (scans carry both).
_FASTMATH = {"contract", "reassoc", "arcp", "nsz"}
_CACHE = kernel_cache.folder()
_BLAS = "scipy.linalg.cython_blas"
kernel_cache.announce()


def _import_array_functions() -> None:
    """Import what every kernel needs of Numba, but not SciPy, whose presence Numba only looks up there.

    A kernel with `@` or `np.linalg` still finds SciPy when it is compiled or called.
    """
    if _BLAS in sys.modules:
        return
    sys.modules[_BLAS] = None  # type: ignore[assignment]
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules[_BLAS]


_import_array_functions()


def kernel(function: F) -> F:
    """Compile a pure function over arrays and scalars; the same machine and versions give the same bits."""
    return cast(F, _compiled(function))


def inlined(function: F) -> F:
    """Compile a step of a kernel that is worth more when its caller's loop contains it than when called."""
    return cast(F, _compiled(function, forceinline=True))


def _compiled(function: Callable[..., object], **options: Any) -> Any:
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = before or _CACHE  # type: ignore[attr-defined]
    try:
        return njit(cache=True, nogil=True, fastmath=_FASTMATH, **options)(function)
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]
