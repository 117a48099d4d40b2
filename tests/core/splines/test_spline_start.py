"""What importing the library costs and says."""

import os
import subprocess
import sys
from pathlib import Path


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**os.environ, **environment}
    )


def test_scipy_is_not_imported_until_needed():
    run(
        "import sys; from knotwork.core.splines import Curve, Surface; import numpy as np;"
        "Surface().at(0.0, 0.0); Curve(np.zeros((5, 2)))(3.5); Surface().with_gradient([[0.0, 0.0]]);"
        "heavy = {'scipy.linalg', 'scipy.sparse', 'scipy.interpolate'} & set(sys.modules);"
        "assert not heavy, heavy"
    )


def test_kernels_with_linear_algebra_still_compile_and_check_for_it():
    run(
        "import numpy as np, numba.np.linalg as linalg; import knotwork.core.kernel, numba;"
        "solve = numba.njit(lambda a, b: np.linalg.solve(a, b) + a @ b);"
        "assert np.allclose(solve(2 * np.eye(3), np.ones(3)), 2.5);"
        "assert linalg.ensure_blas.__module__ == 'numba.np.linalg'"
    )


def test_first_use_says_once_that_it_compiles_and_the_second_is_silent(tmp_path: Path):
    code = "from knotwork.core.splines import Surface; s = Surface(); s.at(0.0, 0.0); s.with_gradient([[0.0, 0.0]])"
    first = run(code, NUMBA_CACHE_DIR=str(tmp_path))
    assert first.stderr.count("\n") == 1
    assert "compiling kernels" in first.stderr
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path)).stderr == ""
