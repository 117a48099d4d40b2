"""The one decorator for hot loops: compiled by Numba, cached on disk, run without the interpreter lock."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from knotwork.core import kernel_cache
from knotwork.core.lean_numba import config, njit

F = TypeVar("F", bound=Callable[..., object])

# Sums may be reordered and multiply-adds fused; NaN and inf keep their meaning (scans carry both).
_FASTMATH = {"contract", "reassoc", "arcp", "nsz"}
_CACHE = kernel_cache.folder()
kernel_cache.announce()


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
