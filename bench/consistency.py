"""Is the localiser's covariance true? Simulated robots: NEES over seeds, growth along a corridor, kidnapping.

python bench/consistency.py nees [--world apartment] [--seeds 50] [--duration 40] [--set map.sigma=0.2]
python bench/consistency.py corridor [--duration 300]
python bench/consistency.py kidnap [--seeds 5]
"""

import argparse
import json
from typing import Any

import numpy as np
from slam import Bench, build

from knotwork.core.geometry import wrap
from knotwork.core.messages import Odometry, Pose, Scan
from knotwork.core.registry import Registry


def simulate(
    seed: int, settings: dict[str, dict[str, Any]], world: str, duration: float, **keys: Any
) -> dict[str, Any]:
    """Run one simulated robot; return truth, estimates, covariances and flags of its scans."""
    registry = Registry(third_parties=False)
    from knotwork.plugins.drivers.sim2d.driver import Sim2d

    manifest = registry.find("sim2d")
    sim_keys = {"world": world, "duration": duration, "lidar": {"accuracy": 0}, **settings.get("sim", {}), **keys}
    context = Bench("sim", manifest.config(**sim_keys), None, seed=seed)
    sim = Sim2d(context)
    prior, prior_context = build(registry, "ekf", **settings.get("prior", {}))
    chart, chart_context = build(registry, "spline-surface", **settings.get("map", {}))
    localizer, own = build(registry, "gauss-newton", **settings.get("localizer", {}))
    drive, drive_context = build(registry, "follow-path", world=world, path="tour", loop=True)
    own.uses = {"map": chart, "prior": prior}
    contexts = [context, prior_context, chart_context, own, drive_context]
    truth, poses, covariances, flags, priors, times = [], [], [], [], [], []
    now, seq = 0, 0
    true: dict[int, np.ndarray] = {}
    for item in sim.events():
        if isinstance(item, int):
            now = item
            continue
        port, message = item
        sealed = message.sealed(max(now, message.stamp), seq)
        seq += 1
        for each in contexts:
            each.time = now
        if port == "truth":
            true[sealed.scan_id] = sealed.pose
        elif isinstance(sealed, Odometry):
            prior.on_odometry(sealed)
            out = [m for p, m in prior_context.sent if p == "prior"]
            prior_context.sent.clear()
            for m in out:
                drive.on_pose(m.sealed(now, seq))
            for _p, m in drive_context.sent:
                sim.on_twist(m)
            drive_context.sent.clear()
        elif isinstance(sealed, Scan):
            prior.on_scan(sealed)
            priors.append(prior.prior(sealed.stamp))
            localizer.on_scan(sealed)
            pose = own.sent.pop()[1]
            assert isinstance(pose, Pose)
            own.sent.clear()
            prior.on_correction(pose.sealed(now, seq))
            if hasattr(drive, "on_estimate"):
                drive.on_estimate(pose.sealed(now, seq))
            truth.append(true.pop(sealed.scan_id))
            poses.append(pose.pose)
            covariances.append(pose.covariance)
            flags.append((pose.quality, pose.lost))
            times.append(sealed.stamp / 1e9)
    return {
        "truth": np.array(truth), "poses": np.array(poses), "covariances": np.array(covariances),
        "flags": np.array(flags), "times": np.array(times), "map": chart, "priors": priors,
        "reports": None, "localizer": localizer,
    }  # fmt: skip


def errors(result: dict[str, Any]) -> np.ndarray:
    e = result["poses"] - result["truth"]
    e[:, 2] = [wrap(float(v)) for v in e[:, 2]]
    return e


def nees(result: dict[str, Any]) -> np.ndarray:
    return np.einsum("ni,nij,nj->n", errors(result), np.linalg.inv(result["covariances"]), errors(result))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("nees", "corridor", "kidnap"))
    parser.add_argument("--world", default="apartment")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--duration", type=float, default=40.0)
    parser.add_argument("--set", action="append", default=[])
    arguments = parser.parse_args()
    settings: dict[str, dict[str, Any]] = {}
    for item in arguments.set:
        key, _, value = item.partition("=")
        node, _, name = key.partition(".")
        settings.setdefault(node, {})[name] = json.loads(value)
    if arguments.what == "nees":
        mean, rms = [], []
        for seed in range(arguments.seeds):
            result = simulate(seed, settings, arguments.world, arguments.duration)
            mean.append(nees(result)[10:])
            e = errors(result)[10:]
            rms.append((np.sqrt((e[:, :2] ** 2).sum(1).mean()), np.degrees(np.sqrt((e[:, 2] ** 2).mean()))))
        values = np.concatenate(mean)
        print(
            f"NEES mean {values.mean():.2f} median {np.median(values):.2f} over {arguments.seeds} seeds, "
            f"of runs {np.min([v.mean() for v in mean]):.2f} to {np.max([v.mean() for v in mean]):.2f}; "
            f"rms {np.mean(rms, axis=0)[0] * 1e3:.1f} mm {np.mean(rms, axis=0)[1]:.3f} deg; "
            f"sigma {np.sqrt(result['covariances'][-1].diagonal())}"
        )
    elif arguments.what == "corridor":
        result = simulate(0, settings, "corridor-300m", arguments.duration)
        e, sigma = errors(result), np.sqrt(result["covariances"][:, 0, 0])
        for k in np.linspace(10, len(e) - 1, 10).astype(int):
            x = result["truth"][k, 0]
            print(
                f"at {x:6.1f} m: error {e[k].round(3)}, sigma x {sigma[k]:.3f} m, "
                f"map {result['map'].nbytes / 1e6:.2f} MB"
            )
    else:
        for seed in range(arguments.seeds):
            result = simulate(
                seed,
                settings,
                arguments.world,
                arguments.duration,
                kidnap=settings.get("kidnap", {}).get("list", [{"at": 20, "to": [1.75, 1.0, 1.5]}]),
            )
            lost = result["flags"][:, 1] > 0
            print(
                seed,
                "lost at",
                result["times"][lost][:1],
                "found at",
                result["times"][~lost & (np.arange(len(lost)) > (np.flatnonzero(lost)[:1].tolist() or [10**9])[0])][:1],
                "final error",
                errors(result)[-1].round(3),
            )


if __name__ == "__main__":
    main()
