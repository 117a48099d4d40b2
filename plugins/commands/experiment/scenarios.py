"""The scenes of section 9.3.2: points, goal views and wrong depths, drawn from a seed."""

import math
from dataclasses import dataclass

import numpy as np

from knotwork.core.camera import project
from knotwork.core.messages import F64

NEAREST = 0.3  # m; a goal view with a nearer point is drawn again
# The thesis does not say how wide the points lie; these give the success rates it reports.
SQUARE = 0.10  # m, half a side
SCATTER = 0.12  # m, largest distance from the axis


@dataclass(frozen=True, slots=True)
class Setting:
    """What the thesis leaves open.

    Attributes
    ----------
    gain
        lambda of the controller [1/s].
    inverse
        Depth guesses are uniform in inverse depth, else in depth.
    depth
        Range of the guesses [m].
    goal
        Position of the goal view [m]; None draws a direction on the sphere and a length in [0.2, 1] m.
    rotation
        Bound of each of the three Euler angles of the goal view [rad].
    """

    gain: float
    inverse: bool
    depth: tuple[float, float] = (0.1, 3.0)
    goal: tuple[float, float, float] | None = None
    rotation: float = math.radians(20.0)


SETTINGS = {
    "A": Setting(gain=0.5, inverse=False),
    "B": Setting(gain=1.0, inverse=True),
    "hard": Setting(gain=1.0, inverse=True, goal=(0.0, 0.0, 0.5), rotation=math.radians(10.0)),
}


@dataclass(frozen=True, slots=True)
class Scenario:
    """Points (n, 3) [m] in the first camera frame, their image at the goal (n, 2), guesses of 1/Z (n,) [1/m]."""

    points: F64
    goal: F64
    guess: F64


def scenario(setting: Setting, n: int, seed: int, index: int) -> Scenario:
    """Draw scenario `index` of a seed: the same for every mode, whatever else is run."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(n, index)))
    points = _points(n, rng)
    while True:
        goal, inverse_depth = project((points - _position(setting, rng)) @ _rotation(setting, rng))
        if np.all(inverse_depth < 1.0 / NEAREST):  # False where a point has no image
            break
    near, far = setting.depth
    guess = rng.uniform(1 / far, 1 / near, n) if setting.inverse else 1.0 / rng.uniform(near, far, n)
    return Scenario(points, goal, guess)


def error_seed(seed: int, index: int) -> int:
    """Return the seed of the noise and the losses of scenario `index`: the same for every mode."""
    return 1000003 * seed + index


def _points(n: int, rng: np.random.Generator) -> F64:
    """Four points are the corners of a square 1.5 m ahead; more are scattered about the axis, 1 to 2 m ahead."""
    if n == 4:
        return np.array([(x * SQUARE, y * SQUARE, 1.5) for x in (-1, 1) for y in (-1, 1)])
    z = rng.uniform(1.0, 2.0, n)
    angle = rng.uniform(0.0, 2.0 * math.pi, n)
    radius = rng.uniform(0.0, SCATTER, n)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))


def _position(setting: Setting, rng: np.random.Generator) -> F64:
    if setting.goal is not None:
        return np.array(setting.goal)
    direction = rng.normal(size=3)
    return rng.uniform(0.2, 1.0) * direction / np.linalg.norm(direction)


def _rotation(setting: Setting, rng: np.random.Generator) -> F64:
    """Rz Ry Rx of three uniform angles: the axes of the goal view in the first camera frame."""
    a, b, c = rng.uniform(-setting.rotation, setting.rotation, 3)
    rx = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    ry = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    rz = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    out: F64 = rz @ ry @ rx
    return out
