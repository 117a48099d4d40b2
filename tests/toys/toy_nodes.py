"""Small plugins that tests of the framework put into pipelines."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use


class Stamps(PluginConfig):
    stamps: tuple[int, ...] = Field((), description="stamps to give [ns]")


class Way(PluginConfig):
    poses: tuple[tuple[float, float, float], ...] = Field((), description="x, y, yaw, one for each frame")
    rate: float = Field(20.0, description="frames a second")


class Text(PluginConfig):
    text: str = Field("", description="what to fail with")


class Period(PluginConfig):
    period: float = Field(1.0, description="period", json_schema_extra={"unit": "s"})


def knotwork_manifests() -> list[Manifest]:
    twist, pose = Port("twist"), Port("pose", role="estimate")
    return [
        Manifest("toy-log", "driver", "gives twists", "toy_impl:Log", Stamps, outputs={"out": twist}),
        Manifest("toy-way", "driver", "gives odometry", "toy_impl:Odometer", Way, outputs={"out": Port("odometry")}),
        Manifest(
            "toy-sim", "driver", "a world that integrates its commands", "toy_impl:Sim",
            inputs={"twist": Port("twist", optional=True)}, outputs={"truth": Port("pose", role="truth")},
            closed_loop=True,
        ),
        Manifest("toy-device", "driver", "pushes from a thread", "toy_impl:Device", outputs={"out": twist}, push=True),
        Manifest(
            "toy-echo", "observer", "gives a pose for each twist", "toy_impl:Echo",
            inputs={"twist": twist}, outputs={"pose": pose},
        ),
        Manifest(
            "toy-policy", "policy", "answers a truth with a twist", "toy_impl:Policy",
            inputs={"truth": Port("pose", role="truth")}, outputs={"twist": twist},
        ),
        Manifest(
            "toy-timer", "policy", "gives a twist each period", "toy_impl:Timer", Period, outputs={"twist": twist}
        ),
        Manifest(
            "toy-broken", "observer", "raises", "toy_impl:Broken", Text, inputs={"twist": twist}
        ),
        Manifest(
            "toy-liar", "observer", "gives another type than it declares", "toy_impl:Liar",
            inputs={"twist": twist}, outputs={"scan": Port("scan")},
        ),
        Manifest(
            "toy-user", "observer", "uses a prior", "toy_impl:User",
            uses={"prior": Use("prior")}, inputs={"twist": twist},
        ),
        Manifest("toy-prior", "observer", "provides a prior", "toy_impl:Nothing", provides=("prior",)),
        Manifest(
            "toy-keeper", "sink", "keeps everything in memory", "toy_impl:Keeper",
            inputs={"message": Port("*", many=True)},
        ),
        Manifest(
            "toy-bad-sink", "sink", "raises on everything", "toy_impl:BadSink",
            inputs={"message": Port("*", many=True)},
        ),
    ]  # fmt: skip
