"""Time of one policy step with nine points, and of one observer update with a thousand.

python bench/depth_step.py

The points, depths and certainties of the policy's frames are drawn anew for each frame, so no solver has it easier
than on a robot. `daqp` and the other solvers of qpsolvers are left out where they are not installed.
"""

import time
from importlib.util import find_spec

import numpy as np

from knotwork.core.messages import CameraTwist, Depths, Features
from knotwork.plugins.observers import depth_ekf, depth_fixed_gain
from knotwork.plugins.observers.depth_ekf.node import DepthEkf
from knotwork.plugins.observers.depth_fixed_gain.node import FixedGain
from knotwork.plugins.policies import visual_servo
from knotwork.plugins.policies.visual_servo.policy import VisualServo

ROUNDS = 400


class Context:
    name = "bench"
    options = None

    def __init__(self, config):
        self.config = config
        self.commands = []

    def emit(self, port, message):
        if port == "twist":
            self.commands.append(np.concatenate((message.v / self.config.v_max, message.w / self.config.w_max)))

    def count(self, name, by=1):
        pass

    def report(self, level, text):
        print(level, text)

    def now(self):
        return 0


def timed(call, messages):
    spent, worked = [], []
    for message in messages:
        begin, used = time.perf_counter(), time.process_time()
        call(message)
        worked.append(time.process_time() - used)
        spent.append(time.perf_counter() - begin)
    low, middle, high = np.percentile(spent[20:], (5, 50, 95)) * 1e6
    # On a busy machine the wall clock also counts what others do meanwhile.
    processor, slow, worst = (value * 1e6 for value in np.percentile(worked[20:], (50, 95, 100)))
    return (
        f"median {middle:7.1f} us   5 % {low:7.1f}   95 % {high:7.1f}   "
        f"processor: median {processor:7.1f}   95 % {slow:7.1f}   most {worst:8.1f}"
    )


def observer(node, n):
    rng = np.random.default_rng(0)
    ids, points = np.arange(n), rng.uniform(-0.4, 0.4, (n, 2))
    node.warm()
    node.on_twist(CameraTwist(stamp=0, v=np.array((0.05, 0.0, 0.0)), w=np.zeros(3)))
    frames = [Features(stamp=k * 50_000_000, ids=ids, points=points + 1e-3 * k) for k in range(ROUNDS)]
    return timed(node.on_features, frames)


def policy(solver):
    rng = np.random.default_rng(1)
    s = rng.uniform(-0.3, 0.3, (9, 2))
    goal = {i: (float(x) + 0.1, float(y)) for i, (x, y) in enumerate(s)}
    node = VisualServo(Context(visual_servo.Config(goal=goal, solver=solver)))
    node.warm()
    depths = [
        Depths(
            stamp=k, ids=np.arange(9), points=s + rng.normal(0, 0.05, s.shape), chi=rng.uniform(0.3, 3, 9),
            uncertainty=rng.choice([np.inf, 5e-7, 1e-8], 9),
        )
        for k in range(ROUNDS)
    ]  # fmt: skip
    return timed(node.on_depths, depths), np.array(node.context.commands)


for name, node in (
    ("depth-fixed-gain", FixedGain(Context(depth_fixed_gain.Config()))),
    ("depth-ekf", DepthEkf(Context(depth_ekf.Config()))),
):
    print(f"{name:<17} 1000 features  {observer(node, 1000)}")
exact = None
for solver in ("compiled", "clarabel", "daqp", "osqp", "piqp", "quadprog", "scs", "qpalm"):
    if solver == "compiled" or find_spec(solver) is not None:
        times, commands = policy(solver)
        exact = commands if exact is None else exact
        # Each command depends on the last one by the direction of condition 3: a difference stays for a while.
        wrong = np.percentile(np.abs(commands - exact).max(axis=1), (95, 100))
        away = f"from compiled [radii]: 95 % {wrong[0]:.0e}   most {wrong[1]:.0e}"
        print(f"visual-servo      {solver:<9} n = 9  {times}   {away}")
