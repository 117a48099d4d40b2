import sys
from dataclasses import replace

import pytest

from knotwork.core import message_types
from knotwork.core.conformance import ClosedRegistry
from knotwork.core.errors import InputError
from knotwork.core.manifest import CONTRACT_VERSION, KINDS, Manifest
from knotwork.core.registry import Registry, load_object

GOOD = Manifest("good", "sink", "takes nothing", "reg_good.impl:Thing")
HEAD = "from knotwork.core.manifest import Manifest\n"


@pytest.fixture(autouse=True)
def own_table_of_types(monkeypatch):
    monkeypatch.setattr(message_types, "_TYPES", message_types.message_types())


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Make a distribution that can be found: its modules, its entry points."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)

    def run(distribution, modules, points, version="1.0"):
        for name, text in modules.items():
            (tmp_path / f"{name}.py").write_text(text)
        info = tmp_path / f"{distribution}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n")
        lines = "".join(f"{name} = {value}\n" for name, value in points.items())
        (info / "entry_points.txt").write_text(f"[knotwork.plugins]\n{lines}")

    yield run
    for name in set(sys.modules) - before:
        if name.startswith("reg_"):
            del sys.modules[name]


def test_builtins_are_found_and_usable():
    registry = Registry(third_parties=False)
    broken = {r.name: r.cause for r in registry.records() if r.cause}
    assert not broken
    assert {"carmen", "sim2d", "ekf", "mcap"} <= set(registry.names())
    assert registry.record("carmen").source == "knotwork.plugins.drivers.carmen"
    assert registry.names("policy") == ["follow-path"]
    order = [KINDS.index(r.kind) for r in registry.records()]
    assert order == sorted(order)


def test_a_third_party_registers_as_a_built_in_does(install):
    install(
        "acme",
        {"reg_acme": HEAD + "MANIFEST = Manifest('acme-map', 'map', 's', 'reg_acme:X')"},
        {"acme-map": "reg_acme:MANIFEST"},
    )
    record = Registry(builtins=()).record("acme-map")
    assert (record.kind, record.distribution, record.state, record.cause) == ("map", "acme 1.0", "ok", "")
    assert record.source == "reg_acme:MANIFEST"


def test_a_module_with_several_manifests(install):
    text = HEAD + "def knotwork_manifests():\n    return [Manifest(n, 'sink', 's', 'x:Y') for n in ('one', 'two')]"
    install("acme", {"reg_many": text}, {"many": "reg_many"})
    assert Registry(builtins=()).names() == ["one", "two"]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("import no_such_module_xyz", "ModuleNotFoundError: No module named 'no_such_module_xyz'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("def broken(:", "SyntaxError"),
        ("MANIFEST = 3", "TypeError: expected a knotwork.core.manifest.Manifest, got int"),
        ("", "AttributeError"),
        ("raise ValueError", "ValueError"),
        ("raise RuntimeError('first\\nsecond')", "RuntimeError: first"),
    ],
)
def test_a_broken_package_is_a_record_with_its_cause(install, text, cause):
    install("acme", {"reg_bad": text}, {"bad": "reg_bad:MANIFEST"})
    install(
        "fine", {"reg_fine": HEAD + "MANIFEST = Manifest('fine', 'sink', 's', 'x:Y')"}, {"fine": "reg_fine:MANIFEST"}
    )
    registry = Registry(builtins=())
    record = registry.record("bad")
    assert record.state == "broken"
    assert record.cause.startswith(cause)
    assert "\n" not in record.cause
    assert registry.find("bad") is None
    assert registry.why_not("bad") == record.cause
    assert registry.names() == ["fine"]


@pytest.mark.parametrize(
    ("change", "state", "cause"),
    [
        ({"contract": CONTRACT_VERSION + 1}, "broken", "written for contract 2, this is contract 1: update knotwork"),
        ({"contract": CONTRACT_VERSION - 1}, "broken", "written for contract 0, this is contract 1: update the plugin"),
        ({"kind": "robot"}, "broken", "unknown kind 'robot', expected one of driver, map"),
        ({"config": 3}, "broken", "config must be a pydantic model class, got 3"),
        ({"options": dict}, "broken", "config must be a pydantic model class"),
        ({"requires": ("no_such_thing",)}, "missing", "needs no_such_thing: pip install no_such_thing"),
        (
            {"requires": ("no_such_thing.sub", "json"), "extra": "can"},
            "missing",
            "needs no_such_thing.sub: pip install 'knotwork[can]'",
        ),
        (
            {"message_types": {"scan": "other.module:Scan"}},
            "broken",
            "message type `scan` is knotwork.core.messages:Scan already",
        ),
        (
            {"message_types": {"reg_type": "nonsense"}},
            "broken",
            "message type `reg_type`: `nonsense` is not of the form",
        ),
    ],
    ids=str,
)
def test_a_manifest_that_cannot_be_used(change, state, cause):
    record = ClosedRegistry(replace(GOOD, **change)).record("good")
    assert record.state == state
    assert record.cause.startswith(cause)
    assert ClosedRegistry(replace(GOOD, **change)).find("good") is None


@pytest.mark.parametrize(
    "change", ["contract='two'", "name=None", "name=['x']", "requires=3", "message_types=[1]", "kind=[]"]
)
def test_whatever_a_stranger_puts_into_a_manifest(install, change):
    fields = {"name": "'odd'", "kind": "'sink'", "summary": "''", "impl": "'x:Y'"} | dict([change.split("=", 1)])
    text = ", ".join(f"{k}={v}" for k, v in fields.items())
    install("acme", {"reg_odd": HEAD + f"MANIFEST = Manifest({text})"}, {"odd": "reg_odd:MANIFEST"})
    records = Registry(builtins=()).records()
    assert [r.state for r in records] == ["broken"] or change == "name=None"
    assert all(isinstance(r.name, str) for r in records)


def test_a_taken_name_stays_with_its_first_owner(install):
    other = HEAD + "MANIFEST = Manifest('carmen', 'robot', 's', 'x:Y', message_types={'reg_taken': 'x:Y'})"
    install("acme", {"reg_other": other, "reg_worse": "1 / 0"}, {"carmen": "reg_other:MANIFEST", "ekf": "reg_worse"})
    registry = Registry()
    assert registry.find("carmen").impl.startswith("knotwork.")
    assert registry.find("ekf") is not None
    clash = registry.record("carmen (acme 1.0)")
    assert clash.state == "broken"
    assert clash.cause.startswith("the name 'carmen' is taken by knotwork ")
    assert registry.record("ekf (acme 1.0)").cause.startswith("ZeroDivisionError")
    assert "reg_taken" not in message_types.message_types()


def test_a_bad_hook_spoils_only_its_own_plugin(install):
    text = HEAD + (
        "from knotwork.core.hooks import hookimpl\nMANIFEST = Manifest('hooked', 'sink', 's', 'x:Y')\n"
        "@hookimpl\ndef knotwork_run_started(no_such_argument): ...\n"
    )
    install("acme", {"reg_hook": text}, {"hooked": "reg_hook"})
    record = Registry(builtins=()).record("hooked")
    assert record.state == "broken"
    assert record.cause.startswith("PluginValidationError")


def test_hooks_of_a_module_are_called(install):
    text = HEAD + (
        "from knotwork.core.hooks import hookimpl\nMANIFEST = Manifest('hooked', 'sink', 's', 'x:Y')\nseen = []\n"
        "@hookimpl\ndef knotwork_run_started(run): seen.append(run)\n"
    )
    install("acme", {"reg_hooked": text}, {"hooked": "reg_hooked"})
    registry = Registry(builtins=())
    assert registry.names() == ["hooked"]
    registry.hooks.hook.knotwork_run_started(run="it")
    assert sys.modules["reg_hooked"].seen == ["it"]


def test_own_message_types_become_known():
    manifest = replace(GOOD, message_types={"reg_own": "knotwork.core.messages:Scan"})
    ClosedRegistry(manifest)
    assert message_types.message_types()["reg_own"] == "knotwork.core.messages:Scan"


@pytest.mark.parametrize("path", ["no_such_module:X", "json:NoSuchName", "", "json", ":x"])
def test_load_object_names_what_cannot_be_imported(path):
    with pytest.raises(InputError, match=r"plugin x: .* cannot be imported: \w+Error") as caught:
        load_object(path, "plugin x")
    assert caught.value.exit_code == 2


def test_nearest():
    registry = ClosedRegistry(replace(GOOD, name="spline-surface"))
    assert registry.nearest("spline-surfaces") == "did you mean 'spline-surface'?"
    assert "knotwork plugins" in registry.nearest("zzz")


def test_a_closed_registry_sees_nothing_else(install):
    install("acme", {"reg_acme": HEAD + "MANIFEST = Manifest('a', 'map', 's', 'x:Y')"}, {"a": "reg_acme:MANIFEST"})
    assert ClosedRegistry(GOOD).names() == ["good"]
