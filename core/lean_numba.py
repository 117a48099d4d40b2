"""Numba without the packages that it imports only to see whether they are there: a third of its import time.

A kernel with `@` or `np.linalg` still finds SciPy, when it is compiled or first called.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["config", "event", "njit"]


@contextmanager
def _hidden(*names: str) -> Iterator[None]:
    """Make packages that are not imported yet look absent."""
    hidden = [name for name in names if name not in sys.modules]
    for name in hidden:
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]


with _hidden("scipy.linalg.cython_blas", "coverage"):
    import numba.np.arraymath  # noqa: F401 - here Numba looks for BLAS; every kernel needs the module
    from numba import njit
    from numba.core import config, event
