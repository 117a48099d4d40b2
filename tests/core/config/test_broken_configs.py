"""Catalogue of broken files: each breaks one thing in a valid one and states what the error must say."""

import pytest

from knotwork.core.config import load
from knotwork.core.errors import ConfigError, InputError


def swap(old, new):
    def mutate(text):
        assert old in text
        return text.replace(old, new, 1)

    return mutate


def append(line):
    return lambda text: text + line + "\n"


BROKEN = {
    # YAML itself
    "repeated key": (
        append("seed: 1\nseed: 2"),
        ["p.yaml:24:1", "'seed' is repeated", "first at p.yaml:23:1"],
    ),
    "repeated node": (
        append("  prior: {plugin: ekf}"),
        ["p.yaml:23:3", "'prior' is repeated", "p.yaml:10:3"],
    ),
    "tab": (swap("  prior:", "\tprior:"), ["p.yaml:10:1", "a tab cannot indent YAML", "use spaces"]),
    "unclosed": (
        swap("{plugin: ekf}", "{plugin: ekf"),
        ["p.yaml:1", "not valid YAML", "opened at p.yaml:10:10"],
    ),
    "colon in text": (swap("the Intel lab", "the: lab"), ["p.yaml:2:17", "needs quotes"]),
    "reference in flow": (swap('"${log}"', "${log}"), ["p.yaml:9:", '"${name}"', "quotes"]),
    "tag": (swap("clock: replay", "clock: !!python/name:os.system x"), ["p.yaml:3:8", "tag", "not allowed"]),
    "object tag": (
        swap("rate: max", "rate: !!python/object/apply:os.system [ls]"),
        ["p.yaml:4:7", "not allowed"],
    ),
    "number as key": (swap("  log: {plugin", "  5: {plugin"), ["p.yaml:9:3", "a key must be text", "quotes"]),
    "list as key": (swap("  log: {plugin", "  [a]: {plugin"), ["p.yaml:9:3", "a key must be text"]),
    "unknown alias": (swap("{plugin: ekf}", "*ekf"), ["p.yaml:10:10", "no anchor &ekf"]),
    "alias in itself": (append("  loop: &a {x: *a}"), ["p.yaml:23:16", "inside its own anchor"]),
    "second document": (append("---\na: 1"), ["p.yaml:23:1", "a second document"]),
    "leading zero": (
        swap("range_max: ${far}", "range_max: 0755"),
        ["p.yaml:14:16", "starts with 0", "octal"],
    ),
    "overflow": (swap("range_max: ${far}", "range_max: 1e999"), ["p.yaml:14:16", "too large for a number"]),
    "control character": (swap("Intel", "In\x07tel"), ["p.yaml:2:20", "U+0007"]),
    "top level list": (lambda text: "- a\n- b\n", ["p.yaml:1:1", "expected a mapping", "a list"]),
    "top level text": (lambda text: "hello\n", ["p.yaml:1:1", "a single value"]),
    "empty": (lambda text: "", ["p.yaml:1:1", "empty"]),
    "only a comment": (lambda text: "# nothing\n", ["p.yaml:1:1", "empty"]),
    "deep": (append("x: " + "[" * 200 + "]" * 200), ["p.yaml:23:4", "nested deeper than 40"]),
    "deep block": (append("x:\n" + "".join(" " * n + "-\n" for n in range(200))), ["nested deeper than 40"]),
    "bad utf-8": (
        lambda text: text.encode().replace(b"Intel", b"Int\xe9l"),
        ["p.yaml:2:21", "0xe9 is not UTF-8"],
    ),
    "utf-16": (lambda text: text.encode("utf-16"), ["p.yaml", "UTF-16"]),
    "binary": (lambda text: b"\x89PNG\r\n\x1a\n\x00\x00", ["p.yaml:1:1", "not UTF-8", "text file"]),
    "nul": (lambda text: b"a: b\x00c", ["p.yaml:1:5", "U+0000"]),
    # top level
    "unknown top key": (append("sed: 3"), ["p.yaml:23:1: sed", "unknown key", "did you mean 'seed'?"]),
    "misspelt nodes": (
        swap("nodes:", "node:"),
        ["p.yaml:8:1: node", "did you mean 'nodes'?", "at least one node"],
    ),
    "no name": (
        swap("pipeline: intel-surface\n", ""),
        ["p.yaml:1:1: pipeline: missing", "name of the pipeline"],
    ),
    "name with slash": (swap("intel-surface", "a/b"), ["p.yaml:1:11: pipeline", "pattern", "'a/b'"]),
    "name is number": (swap("intel-surface", "2024"), ["p.yaml:1:11", "expected a text", "put it in quotes"]),
    "clock": (
        swap("clock: replay", "clock: reply"),
        ["p.yaml:3:8: clock", "'sim'", "did you mean 'replay'?"],
    ),
    "rate zero": (swap("rate: max", "rate: 0"), ["p.yaml:4:7: rate", "'max' or a number > 0", "got 0"]),
    "rate text": (swap("rate: max", "rate: fast"), ["p.yaml:4:7: rate", "'max'", "got 'fast'"]),
    "seed negative": (append("seed: -1"), ["p.yaml:23:7: seed", ">= 0", "got -1"]),
    "seed real": (append("seed: 1.5"), ["p.yaml:23:7: seed", "a whole number", "got 1.5"]),
    "seed sexagesimal": (append("seed: 12:30:45"), ["p.yaml:23:7: seed", "whole number", "got '12:30:45'"]),
    "nodes list": (lambda text: "pipeline: a\nnodes: [a]\n", ["p.yaml:2:8: nodes", "a mapping of nodes"]),
    "no nodes": (lambda text: "pipeline: a\nnodes:\n", ["nodes", "at least one node"]),
    "vars list": (swap('  log: "${DATA:-data}/intel.clf"\n  far: 30.0', "  - 1"), ["vars", "a mapping"]),
    # nodes
    "node name": (append("  a.b: {plugin: mcap}"), ["p.yaml:23:3", "'a.b' is no name of a node"]),
    "node is text": (append("  b: mcap"), ["p.yaml:23:6: nodes.b", "{plugin: NAME}"]),
    "node is null": (append("  b:"), ["p.yaml:23:3: nodes.b", "null removes a node"]),
    "no plugin": (swap("{plugin: ekf}", "{noise: 1}"), ["p.yaml:10:3: nodes.prior.plugin", "missing"]),
    "plugin list": (swap("{plugin: ekf}", "{plugin: [a]}"), ["p.yaml:10:19", "the name of a plugin"]),
    "unknown plugin": (
        swap("plugin: ekf", "plugin: efk"),
        ["p.yaml:10:19: nodes.prior.plugin", "mean 'ekf'?"],
    ),
    "broken plugin": (swap("plugin: ekf", "plugin: cameras"), ["p.yaml:10:19", "needs opencv: pip install"]),
    "command": (swap("plugin: ekf", "plugin: doctor"), ["p.yaml:10:19", "is a command, not a node"]),
    "reserved key": (append("  c: {plugin: clash}"), ["p.yaml:23:15", "reserved: queue"]),
    "failing check": (
        append("  c: {plugin: faulty, x: 0}"),
        ["p.yaml:23:3", "plugin 'faulty'", "ZeroDivisionError"],
    ),
    "unknown config key": (
        swap("range_max:", "range_mx:"),
        [
            "p.yaml:14:5: nodes.map.range_mx",
            "unknown key of plugin 'spline-surface'",
            "did you mean 'range_max'?",
        ],
    ),
    "misspelt framework key": (swap("uses:", "use:"), ["p.yaml:20:5", "did you mean 'uses'?"]),
    "bound and unit": (
        swap("range_max: ${far}", "range_max: -3"),
        ["p.yaml:14:16: nodes.map.range_max: expected a number > 0 [m], got -3"],
    ),
    "bound in list": (
        swap("0.125", "-0.125"),
        ["p.yaml:13:24: nodes.map.resolution.1", "> 0 [m], got -0.125"],
    ),
    "text as number": (
        swap("${far}", "30 m"),
        ["p.yaml:14:16", "number [m]", "'30 m'", "the number alone, in [m]"],
    ),
    "nan": (swap("${far}", ".nan"), ["p.yaml:14:16", "finite number"]),
    "on is no boolean": (
        swap("range_max: ${far}", "fuse: on"),
        ["p.yaml:14:11", "true or false", "(write true)"],
    ),
    "number as text": (
        swap("range_max: ${far}", "save: 12"),
        ["p.yaml:14:11", "expected a text", "in quotes"],
    ),
    "true as number": (swap("${far}", "true"), ["p.yaml:14:16", "expected a number [m], got true"]),
    "scalar as list": (swap("[0.30, 0.125, 0.05]", "0.3"), ["p.yaml:13:17", "expected a list [m], got 0.3"]),
    "model check": (
        swap("${far}", "0.01"),
        ["p.yaml:11:3: nodes.map: range_min must be less than range_max"],
    ),
    "missing key": (
        swap('{plugin: carmen, path: "${log}"}', "{plugin: carmen}"),
        ["p.yaml:9:3: nodes.log.path: missing, expected the log file"],
    ),
    "nested key": (
        append("  r: {plugin: rig, mounts: {front: {yw: 1.0}}}"),
        ["p.yaml:23:37: nodes.r.mounts.front.yw", "unknown key", "yaw"],
    ),
    "nested in list": (
        append("  r: {plugin: rig, beams: [{x: 1}, {x: a}]}"),
        ["p.yaml:23:40: nodes.r.beams.1.x: expected a number [m], got 'a'"],
    ),
    # what belongs to the framework
    "unknown use": (
        swap("{map: map,", "{mpa: map,"),
        ["p.yaml:20:12", "no use 'mpa'", "did you mean 'map'?"],
    ),
    "use of no node": (
        swap("prior: prior}", "prior: priro}"),
        ["p.yaml:20:29", "no node 'priro'", "'prior'?"],
    ),
    "use is list": (
        swap("prior: prior}", "prior: [prior]}"),
        ["p.yaml:20:29", "expected a text, got a list of 1"],
    ),
    "unknown input": (
        swap("{scan: log", "{scn: log"),
        ["p.yaml:21:14", "no input 'scn'", "did you mean 'scan'?"],
    ),
    "input of no node": (
        swap("log.scan", "lgo.scan"),
        ["p.yaml:21:20", "no node 'lgo'", "did you mean 'log'?"],
    ),
    "input of no port": (
        swap("log.scan", "log.scn"),
        ["p.yaml:21:20", "no output 'scn'", "did you mean 'scan'?"],
    ),
    "input without outputs": (swap("log.scan", "prior.pose"), ["p.yaml:21:20", "gives no messages"]),
    "input number": (swap("log.scan", "3"), ["p.yaml:21:20", "a text or a list, got 3"]),
    "input list": (swap("log.scan", "[log.scan, log.nose]"), ["p.yaml:21:31", "no output 'nose'"]),
    "options of nobody": (
        swap("grid: {kernel", "gird: {kernel"),
        ["p.yaml:17:7", "no plugin 'gird'", "'grid'?"],
    ),
    "options of a driver": (swap("grid: {kernel: nearest}", "carmen: {}"), ["p.yaml:17:7", "is a driver"]),
    "options not chosen": (
        swap("kernel: nearest", "kernel: linear"),
        ["p.yaml:17:22", "'bilinear' or 'nearest'"],
    ),
    "options key": (
        swap("{degree: 2}", "{degre: 2}"),
        ["p.yaml:16:24", "options of 'spline-surface'", "'degree'?"],
    ),
    "options scalar": (swap("{kernel: nearest}", "nearest"), ["p.yaml:17:13", "a mapping of options"]),
    "queue policy": (swap("policy: block", "policy: drop"), ["p.yaml:22:56", "'drop-oldest'", "got 'drop'"]),
    "queue size": (swap("size: 1000", "size: 0"), ["p.yaml:22:42", ">= 1 [messages], got 0"]),
    "worker": (
        swap("{plugin: ekf}", "{plugin: ekf, worker: yes}"),
        ["p.yaml:10:32", "true or false", "write true"],
    ),
    # references
    "unknown variable": (
        swap("${far}", "${fra}"),
        ["p.yaml:14:16", "no variable 'fra'", "did you mean 'far'?"],
    ),
    "unknown environment": (swap("${far}", "${env:FAR}"), ["p.yaml:14:16", "no environment variable 'FAR'"]),
    "variable cycle": (swap("far: 30.0", "far: ${b}\n  b: ${c}\n  c: ${far}"), ["far -> b -> c -> far"]),
    "variable in itself": (swap("far: 30.0", "far: ${far}"), ["vars.far", "far -> far"]),
    "unclosed reference": (swap("${far}", "${far"), ["p.yaml:14:16", "not closed", "$${"]),
    "empty reference": (swap("${far}", "${}"), ["p.yaml:14:16", "is no reference"]),
    "list in text": (
        swap("far: 30.0", "far: [1]\n  t: a${far}"),
        ["p.yaml:8:6", "cannot stand inside a text"],
    ),
    "must be given": (swap("far: 30.0", "far:"), ["p.yaml:14:16", "must be given", "--set vars.far=VALUE"]),
    "missing include": (append("include: base.yaml"), ["p.yaml:23:10: include", "base.yaml does not exist"]),
    "include number": (append("include: [1]"), ["p.yaml:23:11: include", "a file name"]),
    "include itself": (append("include: p.yaml"), ["p.yaml:23:10", "p.yaml -> p.yaml"]),
    "include nothing shipped": (
        append("include: configs:nothing"),
        ["p.yaml:23:10", "configs:nothing does not exist"],
    ),
    "include outside": (append("include: configs:../secrets"), ["p.yaml:23:10", "does not exist"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_file_is_explained(name, shelf, valid, write):
    mutate, expected = BROKEN[name]
    path = write(mutate(valid))
    with pytest.raises(ConfigError) as caught:
        load(path, shelf, environment={})
    text = str(caught.value)
    for fragment in expected:
        assert fragment in text, text
    assert isinstance(caught.value, InputError)
    assert caught.value.exit_code == 2


def test_all_problems_come_at_once(shelf, valid, write):
    text = valid.replace("clock: replay", "clock: reply").replace("degree: 2", "degree: 9")
    text = text.replace("${far}", "far").replace("log.scan", "lgo.scan").replace("plugin: ekf", "plugin: efk")
    with pytest.raises(ConfigError) as caught:
        load(write(text), shelf, environment={})
    assert [problem.path for problem in caught.value.problems] == [  # in the order of the lines
        "clock",
        "nodes.prior.plugin",
        "nodes.map.range_max",
        "nodes.map.options.spline-surface.degree",
        "nodes.localizer.inputs.scan",
    ]


def test_one_mistake_is_one_problem(shelf, valid, write):
    for old, new in [("plugin: ekf", "plugin: efk"), ("${far}", "${fra}"), ("log.scan", "lgo.scan")]:
        with pytest.raises(ConfigError) as caught:
            load(write(valid.replace(old, new)), shelf, environment={})
        assert len(caught.value.problems) == 1, str(caught.value)


def test_number_of_problems_is_bounded(shelf, write):
    keys = "".join(f"  k{n}: {{plugin: ekf, wrong{n}: 1}}\n" for n in range(3000))
    with pytest.raises(ConfigError) as caught:
        load(write("pipeline: a\nnodes:\n" + keys), shelf)
    assert len(caught.value.problems) == 51
    assert "and 2950 more problems" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("intle.yaml", ["intle.yaml: does not exist", "did you mean 'intel.yaml'?"]),
        ("nowhere/p.yaml", ["nowhere/p.yaml: does not exist", "there is no folder nowhere"]),
        ("folder", ["folder: cannot be read: it is a folder"]),
        ("intel.yaml/x", ["cannot be read: Not a directory"]),
        ("/dev/zero", ["/dev/zero: cannot be read: it is not a regular file"]),
        ("a\0b", ["null character"]),
        ("x" * 5000, ["cannot be read: File name too long"]),
        ("", ["does not exist"]),
        ("configs:radsh", ["configs:radsh: does not exist"]),
    ],
)
def test_file_that_cannot_be_read(name, expected, shelf, write, tmp_path):
    write("a: 1", "intel.yaml")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ConfigError) as caught:
        load(name, shelf)
    for fragment in expected:
        assert fragment in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unreadable_and_huge_files(shelf, write, monkeypatch):
    path = write("a: 1")
    huge = write("#" * (2 << 20), "huge.yaml")

    def refuse(name, flags):
        raise PermissionError(13, "Permission denied")

    with pytest.raises(ConfigError, match="larger than 1 MiB"):
        load(huge, shelf)
    monkeypatch.setattr("knotwork.core.config.sources._open_regular", refuse)
    with pytest.raises(ConfigError, match=r"^p\.yaml: cannot be read: Permission denied$"):
        load(path, shelf)


def test_secret_is_not_in_the_message(shelf, write):
    text = "pipeline: a\nnodes: {r: {plugin: rig, token: [hunter2, 5]}, s: {plugin: rig, token: 778899}}\n"
    with pytest.raises(ConfigError) as caught:
        load(write(text), shelf, ["nodes.s.password=hunter3", "nodes.t={plugin: ekf, token: hunter5}"])
    text = str(caught.value)
    assert "***" in text
    assert not any(secret in text for secret in ("hunter2", "hunter3", "hunter5", "778899"))
