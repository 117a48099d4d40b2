"""What Numba loads before the first kernel of a process can run, less what no kernel may ever ask for."""

from typing import Any


def spare_linear_algebra() -> None:
    """Let Numba's arrays be loaded without SciPy's linear algebra, a quarter of the time to the first result.

    Numba imports it there for one flag only: that it exists. Whatever needs it still imports and checks it
    when it is compiled. Without SciPy, or with a Numba that is built otherwise, nothing is changed.
    """
    from importlib.util import find_spec

    from numba.np import linalg

    ensure: Any = getattr(linalg, "ensure_blas", None)
    if ensure is None or find_spec("scipy") is None:
        return
    linalg.ensure_blas = lambda: None
    try:
        import numba.np.arraymath  # noqa: F401 runs the check as it is imported
    finally:
        linalg.ensure_blas = ensure
