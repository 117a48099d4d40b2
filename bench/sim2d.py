"""How fast the simulator is: times real time, and the cost of a turn of the lidar with and without the index.

python bench/sim2d.py
"""

import time
from types import SimpleNamespace

import numpy as np

from knotwork.core.messages import Twist
from knotwork.core.world import raycast
from knotwork.core.world.files import load_world, shipped_worlds
from knotwork.plugins.drivers.sim2d import Config
from knotwork.plugins.drivers.sim2d.driver import Sim2d

SECONDS = 60.0


def real_time_factor(world):
    """Turning on the spot, 50 Hz odometry, 5 Hz scans; processor time, best of three."""
    best = 0.0
    for _ in range(3):
        config = Config(world=world, duration=SECONDS)
        context = SimpleNamespace(name="sim", seed=0, config=config, count=lambda *a: None, report=print)
        sim = Sim2d(context)
        sim.warm()
        begun = time.process_time()
        for item in sim.events():
            if isinstance(item, int):
                sim.on_twist(Twist(stamp=item, vx=0.0, wz=0.5))
        best = max(best, SECONDS / (time.process_time() - begun))
    return best


def microseconds(world, cell):
    """A turn of 360 rays, 3.5 m; best of many."""
    raycast._CELL = cell
    caster = raycast.RayCaster(load_world(world))
    x, y, _ = caster.world.start
    angles = np.arange(360) * np.pi / 180
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    origins = np.tile((x + 0.1, y), (360, 1))
    times = []
    for _ in range(300):
        begun = time.perf_counter()
        caster.cast(origins, directions, 5.25)
        times.append(time.perf_counter() - begun)
    return min(times) * 1e6


if __name__ == "__main__":
    print(f"{'world':15} {'obstacles':>9} {'x real time':>11} {'turn, index [us]':>17} {'turn, all [us]':>15}")
    for name in shipped_worlds():
        obstacles = load_world(name)
        count = len(obstacles.segments) + len(obstacles.arcs)
        print(
            f"{name:15} {count:9} {real_time_factor(name):11.0f} {microseconds(name, 0.5):17.1f} "
            f"{microseconds(name, 1e6):15.1f}"
        )
