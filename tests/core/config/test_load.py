"""A valid file: values, types, origins, places, round trip."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from knotwork.core.config import dump, load, mask, show
from knotwork.core.errors import ConfigError


def test_values(shelf, valid, write):
    pipeline = load(write(valid), shelf, environment={})
    assert (pipeline.name, pipeline.description) == ("intel-surface", "the Intel lab")
    assert (pipeline.clock, pipeline.rate, pipeline.seed) == ("replay", "max", 0)
    assert list(pipeline.nodes) == ["log", "prior", "map", "localizer", "recorder"]
    log, prior, surface, localizer, recorder = pipeline.nodes.values()
    assert log.config.path == "data/intel.clf"
    assert prior.config.noise == 0.1
    assert surface.manifest is shelf.find("spline-surface")
    assert surface.config.resolution == (0.3, 0.125, 0.05)
    assert surface.config.range_max == 30.0
    assert surface.options.degree == 2
    assert log.options is None
    assert localizer.uses == {"map": "map", "prior": "prior"}
    assert localizer.inputs == {"scan": ("log.scan",)}
    assert (recorder.queue.size, recorder.queue.policy) == (1000, "block")
    assert surface.queue is None


def test_options_get_their_defaults_without_a_block(shelf, write):
    pipeline = load(write("pipeline: a\nnodes: {m: {plugin: grid}}\n"), shelf)
    assert pipeline.nodes["m"].options.kernel == "bilinear"
    assert pipeline.resolved["nodes"]["m"]["options"] == {"grid": {"kernel": "bilinear"}}


def test_options_of_a_plugin_that_is_not_usable_here_are_left_alone(shelf, write):
    text = "pipeline: a\nnodes: {m: {plugin: grid, options: {cameras: {whatever: 1}}}}\n"
    assert load(write(text), shelf).nodes["m"].plugin == "grid"


def test_types_of_json_are_understood(shelf, write):
    text = "pipeline: a\nnodes: {r: {plugin: rig, folder: out/x, port: 7, limit: 2, beams: [{x: 1}]}}\n"
    config = load(write(text), shelf).nodes["r"].config
    assert config.folder == Path("out/x")
    assert config.port == 7
    assert config.limit == 2.0
    assert config.beams[0].x == 1.0


def test_inputs_take_node_port_or_list(shelf, write):
    text = (
        "pipeline: a\nnodes:\n  l: {plugin: carmen, path: x}\n"
        "  m: {plugin: mcap, inputs: {messages: [l.scan, l]}}\n"
        "  n: {plugin: mcap, inputs: {messages: l}}\n"
    )
    nodes = load(write(text), shelf).nodes
    assert nodes["m"].inputs == {"messages": ("l.scan", "l")}
    assert nodes["n"].inputs == {"messages": ("l",)}


def test_where_finds_the_nearest_place(shelf, valid, write):
    pipeline = load(write(valid), shelf, ["nodes.map.range_min=0.1"], {})
    assert pipeline.where("nodes.localizer.uses.prior") == "p.yaml:20:29"
    assert pipeline.where("nodes.map.resolution.1") == "p.yaml:13:24"
    assert pipeline.where("nodes.map") == "p.yaml:11:3"
    assert pipeline.where("nodes.map.uses.prior") == "p.yaml:11:3"
    assert pipeline.where("nodes.map.range_min") == "--set nodes.map.range_min=0.1"
    assert pipeline.where("nodes.nobody") == "p.yaml:8:1"
    assert pipeline.where("") == "p.yaml:1:1"


def test_origins(shelf, valid, write):
    write("pipeline: b\nnodes: {prior: {noise: 0.5}, log: {pitch: 0.1}}\n", "base.yaml")
    text = valid + "include: base.yaml\n"
    pipeline = load(write(text), shelf, ["vars.far=20"], {"DATA": "/d"})
    origins = {key: str(origin) for key, origin in pipeline.origins.items()}
    assert origins["pipeline"] == "p.yaml:1:11"
    assert origins["nodes.log.path"] == "p.yaml:9:31 via var log (p.yaml:6:8), env DATA"
    assert origins["nodes.log.pitch"] == "base.yaml:2:43"
    assert origins["nodes.prior.noise"] == "base.yaml:2:24"
    assert origins["nodes.map.range_max"] == "p.yaml:14:16 via var far (--set vars.far=20)"
    assert origins["nodes.map.fuse"] == "default of spline-surface"
    assert origins["nodes.map.options.spline-surface.loss"] == "default of spline-surface"
    assert origins["seed"] == "default"
    assert origins["nodes.recorder.queue.size"] == "p.yaml:22:42"


def test_show_with_origins(shelf, valid, write):
    pipeline = load(write(valid), shelf, ["nodes.map.resolution.1=0.2"], {})
    shown = show(pipeline, origin=True)
    assert "    plugin: spline-surface  # p.yaml:12:13\n" in shown
    assert "      - 0.2                 # --set nodes.map.resolution.1=0.2\n" in shown
    assert "    fuse: true              # default of spline-surface\n" in shown
    assert len({line.index("  # ") for line in shown.splitlines() if "  # " in line}) == 1
    assert yaml.safe_load(shown) == yaml.safe_load(show(pipeline)) == pipeline.resolved


def test_show_survives_odd_arguments(shelf, valid, write):
    pipeline = load(write(valid), shelf, ["nodes.log.path='a\n\n  # b: c\x1b'".replace("\x1b", "")], {})
    assert yaml.safe_load(show(pipeline, origin=True)) == pipeline.resolved


def test_secrets_are_masked(shelf, write):
    text = (
        "pipeline: a\nvars: {my_password: hunter2}\n"
        'nodes:\n  r: {plugin: rig, token: hunter3, folder: "x/${my_password}", port: "${API_TOKEN}"}\n'
    )
    pipeline = load(write(text), shelf, environment={"API_TOKEN": "hunter4"})
    shown = show(pipeline, origin=True)
    assert "hunter" not in shown
    assert "token: ***" in shown.replace('"', "")
    assert pipeline.nodes["r"].config.token == "hunter3"
    assert pipeline.nodes["r"].config.port == "hunter4"
    assert "hunter" not in str(mask(pipeline.resolved, pipeline.origins))
    assert mask({"token": "", "user": "me"}) == {"token": "", "user": "me"}


def test_resolved_loads_to_the_same_pipeline(shelf, valid, write):
    pipeline = load(write(valid), shelf, ["nodes.map.plugin=grid", "description=a $${x} b"], {"DATA": "on"})
    assert pipeline.description == "a ${x} b"
    again = load(write(dump(pipeline.resolved), "again.yaml"), shelf, environment={})
    assert again == pipeline
    assert again.resolved == pipeline.resolved
    assert again.path != pipeline.path


TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=12) | st.sampled_from(
    ["${a}", "$${a}", "$", "${", "010", "on", "1e5", "null", "a: b", "#"]
)
RIGS = st.fixed_dictionaries(
    {"plugin": st.just("rig")},
    optional={
        "token": TEXT,
        "folder": TEXT.filter(lambda text: "\0" not in text),
        "port": TEXT | st.integers(0, 99999),
        "limit": st.none() | st.floats(1e-300, 1e300),
        "mount": st.fixed_dictionaries({}, optional={"x": st.floats(allow_nan=False, allow_infinity=False)}),
        "mounts": st.dictionaries(TEXT, st.just({}) | st.just({"yaw": 1e-05}), max_size=3),
        "beams": st.lists(st.fixed_dictionaries({"x": st.floats(-1e9, 1e9)}), max_size=3),
        "queue": st.fixed_dictionaries({"size": st.integers(1, 99)}, optional={"policy": st.just("latest")}),
    },
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rigs=st.lists(RIGS, min_size=1, max_size=3), rate=st.just("max") | st.floats(1e-3, 1e3))
def test_any_pipeline_round_trips(rigs, rate, shelf, tmp_path):
    nodes = {f"n{number}": rig for number, rig in enumerate(rigs)}
    (tmp_path / "a.yaml").write_text(dump({"pipeline": "p", "rate": rate, "nodes": _escape(nodes)}), "utf-8")
    first = load(tmp_path / "a.yaml", shelf, environment={})
    for name, rig in nodes.items():
        assert all(getattr(first.nodes[name].config, key) == rig[key] for key in ("token", "limit") if key in rig)
    (tmp_path / "b.yaml").write_text(dump(first.resolved), "utf-8")
    assert load(tmp_path / "b.yaml", shelf, environment={}) == first


def _escape(data):
    if isinstance(data, str):
        return data.replace("${", "$${")
    if isinstance(data, dict):
        return {key: _escape(value) for key, value in data.items()}
    return [_escape(value) for value in data] if isinstance(data, list) else data


def test_numpy_is_not_imported():
    code = "import sys, knotwork.core.config; sys.exit('numpy' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_shipped_files_are_found_by_name(shelf, write, monkeypatch, tmp_path):
    folder = tmp_path / "shipped"
    folder.mkdir()
    (folder / "base.yaml").write_text("pipeline: base\nnodes: {prior: {plugin: ekf}}\n")
    (folder / "top.yaml").write_text("include: base.yaml\npipeline: top\n")
    monkeypatch.setattr("knotwork.core.config.sources.files", lambda package: folder)
    assert load("configs:top", shelf).name == "top"
    mine = load(write("include: configs:top\nnodes: {prior: {noise: 2}}\n"), shelf)
    assert mine.name == "top"
    assert mine.nodes["prior"].config.noise == 2.0
    assert mine.where("pipeline") == "configs:top:2:11"
    with pytest.raises(ConfigError, match=r"configs:tpo: does not exist \(did you mean 'top'\?\)"):
        load("configs:tpo", shelf)
