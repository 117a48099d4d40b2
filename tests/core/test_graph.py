import re

import pytest

from knotwork.core import graph
from knotwork.core.config import NodeSpec, Pipeline
from knotwork.core.errors import ConfigError
from knotwork.core.manifest import Manifest, PluginConfig, Port, Use


def manifest(kind="observer", inputs=None, outputs=None, uses=None, **rest):
    def ports(given):
        return {
            n: Port(*p) if isinstance(p, tuple) else p if isinstance(p, Port) else Port(p)
            for n, p in (given or {}).items()
        }

    given = {name: use if isinstance(use, Use) else Use(use) for name, use in (uses or {}).items()}
    return Manifest("toy", kind, "toy", "x:Y", inputs=ports(inputs), outputs=ports(outputs), uses=given, **rest)


LOG = manifest("driver", outputs={"scan": "scan", "odometry": "odometry"})
PRIOR = manifest(
    inputs={"odometry": "odometry", "correction": Port("pose", role="estimate", optional=True, feedback=True)},
    outputs={"prior": ("pose", "prior")},
    provides=("prior",),
)
MAP = manifest("map", provides=("map",))
LOCALIZER = manifest(
    "localizer", inputs={"scan": "scan"}, outputs={"pose": ("pose", "estimate")}, uses={"map": "map", "prior": "prior"}
)
SINK = manifest("sink", inputs={"messages": Port("*", many=True)})


def pipeline(clock="auto", inputs=None, uses=None, **nodes):
    inputs, uses = inputs or {}, uses or {}
    specs = {
        name: NodeSpec(
            name, "toy", m, PluginConfig(), None, uses.get(name, {}),
            {port: (w,) if isinstance(w, str) else tuple(w) for port, w in inputs.get(name, {}).items()}, None,
        )
        for name, m in nodes.items()
    }  # fmt: skip
    places = {f"nodes.{name}": f"f.yaml:{line}:3" for line, name in enumerate(nodes, start=3)}
    return Pipeline("p", "", clock, "max", 0, specs, {}, {}, places | {"": "f.yaml:1:1"}, "f.yaml")


def wires(built):
    return {(str(e.stream), f"{e.node}.{e.port}") for e in built.edges}


def problems(spec):
    with pytest.raises(ConfigError) as caught:
        graph.build(spec)
    return caught.value.problems


def slam(**more):
    return pipeline(log=LOG, prior=PRIOR, map=MAP, localizer=LOCALIZER, **more)


def test_inference_by_type_and_role():
    built = graph.build(slam(sink=SINK))
    own = {w for w in wires(built) if not w[1].startswith("sink")}
    assert own == {
        ("log.odometry", "prior.odometry"),
        ("localizer.pose", "prior.correction"),
        ("log.scan", "localizer.scan"),
    }
    taken = {w[0] for w in wires(built) if w[1].startswith("sink")}
    assert taken == {"log.scan", "log.odometry", "prior.prior", "localizer.pose"}
    assert {(u.node, u.target) for u in built.uses} == {("localizer", "map"), ("localizer", "prior")}


def test_a_role_is_respected():
    drive = manifest("policy", inputs={"pose": ("pose", "prior")})
    assert ("prior.prior", "drive.pose") in wires(graph.build(slam(drive=drive)))
    any_pose = manifest("policy", inputs={"pose": "pose"})
    (problem,) = problems(slam(drive=any_pose))
    assert "prior.prior, localizer.pose all give one" in problem.message
    assert problem.hint == "write inputs: {pose: prior.prior}"
    assert problem.where == "f.yaml:7:3"
    only = manifest("policy", inputs={"pose": ("pose", "truth")})
    (problem,) = problems(slam(drive=only))
    assert "needs a pose (truth), and no node gives one" in problem.message
    assert problem.hint == "there is only pose (estimate), pose (prior)"


def test_no_node_feeds_itself_by_inference():
    relay = manifest(inputs={"scan": "scan"}, outputs={"scan": "scan"})
    assert wires(graph.build(pipeline(log=LOG, relay=relay))) == {("log.scan", "relay.scan")}


def test_explicit_wires():
    relay = manifest(inputs={"scan": "scan"}, outputs={"scan": "scan"})
    nodes = {"log": LOG, "relay": relay, "end": manifest(inputs={"scan": "scan"})}
    given = {"end": {"scan": "relay.scan"}, "relay": {"scan": "log.scan"}}
    assert wires(graph.build(pipeline(inputs=given, **nodes))) == {
        ("log.scan", "relay.scan"),
        ("relay.scan", "end.scan"),
    }
    by_node = {"end": {"scan": "relay"}, "relay": {"scan": "log"}}
    assert wires(graph.build(pipeline(inputs=by_node, **nodes))) == {
        ("log.scan", "relay.scan"),
        ("relay.scan", "end.scan"),
    }


@pytest.mark.parametrize(
    ("written", "message", "hint"),
    [
        ("log.odometry", "log.odometry gives odometry, expected scan", ""),
        ("log.scam", "no stream 'log.scam'", "did you mean 'log.scan'?"),
        ("zzz", "no stream 'zzz'", "expected node.port"),
        ("two", "'two' is ambiguous: two.a, two.b", ""),
        (["log.scan", "two.a"], "input 'scan' takes one scan, got log.scan, two.a", ""),
        ([], "input 'scan' needs a scan: the list is empty", ""),
    ],
)
def test_wrong_explicit_wires(written, message, hint):
    end = manifest(inputs={"scan": "scan"})
    two = manifest("driver", outputs={"a": "scan", "b": "scan"})
    (problem,) = problems(pipeline(inputs={"end": {"scan": written}}, log=LOG, two=two, end=end))
    assert (problem.message, problem.hint, problem.path) == (message, hint, "nodes.end.inputs.scan")
    assert problem.where == "f.yaml:5:3"


def test_a_stream_written_twice_arrives_once():
    given = {"sink": {"messages": ["log.scan", "log.scan", "log.odometry"]}}
    built = graph.build(pipeline(inputs=given, log=LOG, sink=SINK))
    assert [str(e.stream) for e in built.edges] == ["log.scan", "log.odometry"]


def test_an_empty_list_leaves_an_optional_input_unwired():
    built = graph.build(
        pipeline(inputs={"prior": {"correction": []}}, log=LOG, prior=PRIOR, map=MAP, localizer=LOCALIZER)
    )
    assert ("localizer.pose", "prior.correction") not in wires(built)
    assert built.cycles == ()


def test_all_problems_at_once():
    lonely = manifest(inputs={"imu": "imu"}, uses={"map": "map"})
    found = problems(pipeline(a=lonely, b=lonely))
    assert len(found) == 5  # two inputs, two uses, no driver
    assert any("no driver" in p.message for p in found)
    assert any(p.hint == "add a node that gives imu" for p in found)


# ---- uses


def test_uses():
    two = {"log": LOG, "prior": PRIOR, "one": MAP, "two": MAP, "localizer": LOCALIZER}
    (problem,) = problems(pipeline(**two))
    assert problem.message == "use 'map' takes one map, and one, two all provide one"
    assert problem.hint == "write uses: {map: one}"
    built = graph.build(pipeline(uses={"localizer": {"map": "two"}}, **two))
    assert [u.target for u in built.uses] == ["two", "prior"]
    (problem,) = problems(pipeline(uses={"localizer": {"map": "prior"}}, **two))
    assert (problem.message, problem.hint) == ("'prior' does not provide a map", "these do: one, two")


def test_a_use_that_no_one_provides():
    (problem,) = problems(pipeline(log=LOG, prior=PRIOR, localizer=LOCALIZER))
    assert problem.message == "use 'map' needs a node that provides a map, and none does"
    optional = manifest(inputs={"scan": "scan"}, uses={"map": Use("map", optional=True)})
    assert graph.build(pipeline(log=LOG, a=optional)).uses == ()


def test_used_nodes_come_first():
    built = graph.build(pipeline(localizer=LOCALIZER, map=MAP, prior=PRIOR, log=LOG))
    assert built.order == ("map", "prior", "localizer", "log")
    assert graph.build(slam()).order == ("log", "prior", "map", "localizer")


def test_uses_in_a_circle_are_said_once():
    a = manifest(uses={"x": "x"}, provides=("y",))
    b = manifest(uses={"y": "y"}, provides=("x",))
    (problem,) = problems(pipeline(log=LOG, a=a, b=b))
    assert problem.message == "uses go in a circle: a -> b -> a"


# ---- cycles


def test_a_cycle_through_a_feedback_port_is_legal():
    built = graph.build(slam())
    assert [set(c) for c in built.cycles] == [{"prior", "localizer"}]


def test_a_cycle_through_a_driver_is_legal():
    sim = manifest("driver", inputs={"twist": Port("twist", optional=True)}, outputs={"truth": ("pose", "truth")})
    drive = manifest("policy", inputs={"pose": "pose"}, outputs={"twist": "twist"})
    assert [set(c) for c in graph.build(pipeline(sim=sim, drive=drive)).cycles] == [{"sim", "drive"}]


@pytest.mark.parametrize("length", [1, 2, 5])
def test_any_other_cycle_is_not(length):
    names = [f"n{i}" for i in range(length)]
    nodes = {name: manifest(inputs={"twist": "twist"}, outputs={"twist": "twist"}) for name in names}
    given = {name: {"twist": f"{names[i - 1]}.twist"} for i, name in enumerate(names)}
    (problem,) = problems(pipeline(inputs=given, log=LOG, **nodes))
    assert problem.message.startswith("streams go in a circle: ")
    assert all(name in problem.message for name in names)
    assert "only through a driver or a feedback port" in problem.hint


def test_a_cycle_of_a_stream_and_a_use_is_not():
    prior = manifest(inputs={"pose": ("pose", "estimate")}, provides=("prior",))
    (problem,) = problems(pipeline(log=LOG, prior=prior, map=MAP, localizer=LOCALIZER))
    assert problem.message.startswith("streams go in a circle")


def test_two_paths_are_no_cycle():
    relay = manifest(inputs={"scan": "scan"}, outputs={"pose": ("pose", "estimate")})
    end = manifest(inputs={"pose": "pose", "scan": "scan"})
    assert graph.build(pipeline(log=LOG, relay=relay, end=end)).cycles == ()


# ---- clocks

SIM = manifest("driver", closed_loop=True)
DEVICE = manifest("driver", push=True)


@pytest.mark.parametrize(
    ("asked", "drivers", "clock"),
    [
        ("auto", {"log": LOG}, "replay"),
        ("auto", {"log": LOG, "sim": SIM}, "sim"),
        ("auto", {"log": LOG, "device": DEVICE}, "real"),
        ("real", {"log": LOG}, "real"),
        ("replay", {"log": LOG}, "replay"),
    ],
)
def test_clocks(asked, drivers, clock):
    assert graph.build(pipeline(clock=asked, **drivers)).clock == clock


@pytest.mark.parametrize("clock", ["replay", "sim"])
def test_a_device_cannot_be_pulled(clock):
    (problem,) = problems(pipeline(clock=clock, one=DEVICE, two=DEVICE))
    assert problem.message == f"clock {clock} cannot pull one, two: a device gives data when it likes"


# ---- pictures


def test_text():
    text = graph.text(graph.build(slam(sink=SINK)), slam(sink=SINK))
    assert text.startswith("pipeline p (clock: replay)\n  log: toy [driver]\n")
    assert "    <- localizer.pose  pose (estimate)  (feedback)\n" in text
    assert "    uses map (map)\n" in text
    assert re.search(r"^cycle: (prior -> localizer -> prior|localizer -> prior -> localizer)$", text, re.M)


def test_mermaid():
    nodes = {"a-b": LOG, "a_b": manifest(inputs={"scan": "scan"}), "a.b": SINK}
    spec = pipeline(**nodes)
    lines = graph.mermaid(graph.build(spec), spec).splitlines()
    assert lines[0] == "flowchart LR"
    names = [line.split("[")[0].strip() for line in lines[1:4]]
    assert len(set(names)) == 3, "different nodes have different identifiers"
    assert all(re.fullmatch(r"\w+", name) for name in names)
    arrow = re.compile(r'  \w+ (-->|-\.->|===)\|"[^"|]+"\| \w+')
    assert all(arrow.fullmatch(line) for line in lines[4:])
    whole = graph.mermaid(graph.build(slam()), slam())
    assert '-.->|"pose (estimate)"|' in whole
    assert '===|"uses map"|' in whole
