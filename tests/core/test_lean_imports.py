import subprocess
import sys


def in_a_fresh_process(code):
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_a_pipeline_imports_the_manifests_of_its_own_plugins_only():
    in_a_fresh_process(
        "import sys\n"
        "from knotwork.core.registry import Registry\n"
        "registry = Registry(third_parties=False)\n"
        "assert registry.find('carmen').name == 'carmen'\n"
        "assert 'knotwork.plugins.drivers.sim2d' not in sys.modules\n"
        "assert registry.nearest('sim2') == \"did you mean 'sim2d'?\"\n"
    )


def test_kernels_are_imported_without_scipy_and_find_it_when_they_need_it():
    in_a_fresh_process(
        "import sys\n"
        "import knotwork.core.kernel\n"
        "assert not {'scipy.linalg', 'scipy.linalg.cython_blas'} & set(sys.modules)\n"
        "import numba, numpy\n"
        "times = numba.njit(lambda a: a @ a)\n"
        "assert (times(2.0 * numpy.eye(2)) == 4.0 * numpy.eye(2)).all()\n"
        "assert sys.modules['scipy.linalg.cython_blas'] is not None\n"
    )
