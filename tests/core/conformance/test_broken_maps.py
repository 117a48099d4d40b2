"""Maps and localisers, deliberately broken, fail the check meant for them."""

from dataclasses import replace

import numpy as np
import pytest

from knotwork.core.errors import KnotworkError

WRONG = (AssertionError, pytest.fail.Exception, KnotworkError)
RNG = np.random.default_rng()  # what a plugin must not do: not seeded


# ---- maps


def alignment_with(**methods):
    """A map's class whose alignments have other methods; each gets the right answer first."""

    def broken(cls):
        class Bad(cls):
            def alignment(self, scan, guess, motion=None):
                right = super().alignment(scan, guess, motion)
                wrong = type("Wrong", (type(right),), {})
                for name, method in methods.items():
                    original = getattr(type(right), name)
                    setattr(wrong, name, lambda self, *a, o=original, m=method, **k: m(o(self, *a, **k)))
                right.__class__ = wrong
                return right

        return Bad

    return broken


def map_with(**methods):
    def broken(cls):
        bad = type("Bad", (cls,), {})
        for name, method in methods.items():
            right = getattr(cls, name)
            setattr(bad, name, lambda self, *a, o=right, m=method, **k: m(o(self, *a, **k)))
        return bad

    return broken


def always_fuses(cls):
    return type(
        "Bad", (cls,), {"update": lambda self, scan, pose, alignment=None, fuse=True: cls.update(self, scan, pose)}
    )


def ignores_the_mount(cls):
    return type(
        "Bad",
        (cls,),
        {"update": lambda self, scan, pose, *a, **k: cls.update(self, replace(scan, mount=(0, 0, 0)), pose)},
    )


def believes_every_file(cls):
    return type("Bad", (cls,), {"load": lambda self, path: None})


def raises_value_error(cls):
    def load(self, path):
        raise ValueError("bad magic")

    return type("Bad", (cls,), {"load": load})


def never_saves(cls):
    return type("Bad", (cls,), {"save": lambda self, path: path.write_bytes(b"x"), "load": lambda self, path: None})


def dense(cls):
    def nbytes(self):
        keys = np.array(list(self.cells[-1].tiles) or [(0, 0)])
        return int(np.prod(np.ptp(keys, axis=0) + 1)) * 4 * 64 * 64 + 1

    return type("Bad", (cls,), {"nbytes": property(nbytes)})


def lopsided(terms):
    return replace(terms, H=terms.H + np.triu(np.ones((3, 3)), 1))


MAPS = [
    ("test_empty", map_with(empty=lambda x: False)),
    ("test_empty", map_with(occupancy=lambda x: x + 0.1)),
    ("test_occupancy", map_with(occupancy=lambda x: -x)),
    ("test_occupancy", map_with(occupancy=lambda x: 40 * x)),
    ("test_occupancy", map_with(occupancy=lambda x: x + 0.01)),
    ("test_robot_pose_not_sensor_pose", ignores_the_mount),
    ("test_rasterize", map_with(rasterize=lambda x: (x[0].astype(int), *x[1:]))),
    ("test_rasterize", map_with(rasterize=lambda x: (x[0].T, *x[1:]))),
    ("test_rasterize", map_with(rasterize=lambda x: (x[0][::-1], *x[1:]))),
    ("test_normal_equations", alignment_with(normal_equations=lopsided)),
    ("test_normal_equations", alignment_with(normal_equations=lambda t: replace(t, H=-t.H))),
    ("test_normal_equations", alignment_with(normal_equations=lambda t: replace(t, n_used=t.n_total + 1))),
    ("test_gradient", alignment_with(normal_equations=lambda t: replace(t, g=2 * t.g))),
    ("test_gradient", alignment_with(normal_equations=lambda t: replace(t, g=t.g * [1, 1, 0.9]))),
    ("test_costs_agree", alignment_with(costs=lambda c: 1.001 * c)),
    (
        "test_costs_agree",
        alignment_with(costs=lambda c: 2 * c, normal_equations=lambda t: replace(t, cost=2 * t.cost)),
    ),
    ("test_jacobian", alignment_with(residuals=lambda rj: (rj[0], -rj[1]))),
    ("test_jacobian", alignment_with(residuals=lambda rj: (rj[0], rj[1] * [1, 1, 0.9]))),
    ("test_pulls_towards_the_truth", alignment_with(costs=lambda c: -c)),
    ("test_pulls_towards_the_truth", alignment_with(inliers=lambda share: 0.5)),
    ("test_fuse_false_changes_nothing", always_fuses),
    ("test_same_again", map_with(occupancy=lambda x: x * RNG.uniform(0.9, 1.0))),
    ("test_poor_scans", alignment_with(inliers=lambda share: share or np.nan)),
    ("test_poor_scans", alignment_with(normal_equations=lambda t: t if t.n_total > 5 else replace(t, cost=np.nan))),
    ("test_memory", lambda cls: type("Bad", (cls,), {"nbytes": property(lambda self: 1000)})),
    ("test_memory", dense),
    ("test_save_and_load", never_saves),
    ("test_damaged_file", believes_every_file),
]


@pytest.mark.parametrize(("name", "broken"), MAPS)
def test_maps(made, check, name, broken):
    with pytest.raises(WRONG):
        check("map", name, cls=broken(made["map"].cls))


def test_a_map_that_raises_something_else_on_a_bad_file(made, check):
    with pytest.raises(ValueError, match="bad magic"):
        check("map", "test_damaged_file", cls=raises_value_error(made["map"].cls))


# ---- localisers


def poses_with(change):
    """A localiser's class whose estimates are changed on their way out."""

    def broken(cls):
        class Bad(cls):
            def __init__(self, context):
                super().__init__(context)
                emit = context.emit
                context.emit = lambda port, message: emit(port, change(message))

        return Bad

    return broken


def parrots_the_prior(cls):
    class Bad(cls):
        def _descend(self, alignment, prior):
            return prior.pose, prior.covariance

    return Bad


def fuses_when_lost(cls):
    class Bad(cls):
        def on_scan(self, scan):
            super().on_scan(scan)
            self.context.uses["map"].update(scan, np.zeros(3))

    return Bad


LOCALIZERS = [
    ("test_recovers_small_offsets", parrots_the_prior),
    (
        "test_recovers_small_offsets",
        poses_with(lambda p: replace(p, covariance=p.covariance + np.triu(np.ones((3, 3)), 1))),
    ),
    ("test_recovers_small_offsets", poses_with(lambda p: replace(p, covariance=-p.covariance))),
    ("test_recovers_small_offsets", poses_with(lambda p: replace(p, covariance=None))),
    ("test_recovers_small_offsets", poses_with(lambda p: replace(p, scan_id=-1))),
    ("test_recovers_small_offsets", poses_with(lambda p: replace(p, stamp=0))),
    ("test_recovers_small_offsets", poses_with(lambda p: replace(p, role="prior"))),
    ("test_recovers_small_offsets", poses_with(lambda p: replace(p, lost=True))),
    ("test_poor_scans", poses_with(lambda p: replace(p, pose=np.full(3, np.nan)))),
    ("test_same_again", poses_with(lambda p: replace(p, pose=p.pose + RNG.normal(0, 1e-12, 3)))),
    ("test_says_lost", poses_with(lambda p: replace(p, lost=False))),
    ("test_says_lost", fuses_when_lost),
]


@pytest.mark.parametrize(("name", "broken"), LOCALIZERS)
def test_localizers(made, check, name, broken):
    with pytest.raises(WRONG):
        check("localizer", name, cls=broken(made["localizer"].cls))
