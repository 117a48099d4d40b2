import subprocess
import sys

import pytest

PACKAGES = ["drivers.carmen", "drivers.gazebo_text", "drivers.minesrover", "commands.evaluate"]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_manifest_loads_without_numpy(package):
    code = (
        f"import sys, knotwork.plugins.{package} as p; m = p.MANIFEST;"
        "assert not {'numpy', 'scipy', 'numba'} & set(sys.modules);"
        "import importlib; module, name = m.impl.split(':'); getattr(importlib.import_module(module), name);"
        "assert not {'scipy', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
