"""Every way a run can fail, and the emulated robot's wheels come to rest in time; see bench/stop_times.py."""

import importlib.util
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[2] / "bench" / "stop_times.py"
spec = importlib.util.spec_from_file_location("stop_times", BENCH)
assert spec is not None
stop_times = importlib.util.module_from_spec(spec)
sys.modules["stop_times"] = stop_times
spec.loader.exec_module(stop_times)

# A loaded machine may be late once; a base that does not stop is late each time.
ATTEMPTS = 3
FAILURES = ("SIGINT", "SIGTERM", "SIGKILL", "exception", "commands lost", "lidar unplugged", "base unplugged")
QUICK = [f"{failure} opencr" for failure in FAILURES]
QUICK += ["SIGKILL dynamixel", "base unplugged dynamixel", "SIGKILL agilex"]


@pytest.mark.parametrize("name", QUICK)
def test_the_wheels_rest_in_time(name, tmp_path):
    case = stop_times.CASES[name]
    times = []
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        try:
            times.append(stop_times.measure(case, folder, seed=attempt))
        except stop_times.DroveOff as why:
            times.append(str(why))
            continue
        if times[-1] <= case.limit:
            return
    pytest.fail(f"{name}: {times}, expected at most {case.limit} s")
