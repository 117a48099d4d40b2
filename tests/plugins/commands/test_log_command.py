"""`knotwork log info` and `recover` as a person calls them."""

import argparse
import json

import numpy as np
import pytest

from knotwork.core import codec
from knotwork.core.errors import InputError
from knotwork.core.log.reader import Log
from knotwork.core.log.writer import McapWriter
from knotwork.core.messages import Twist
from knotwork.plugins.commands.log import MANIFEST
from knotwork.plugins.commands.log.command import LogCommand


def call(*words):
    parser = argparse.ArgumentParser()
    command = LogCommand()
    command.arguments(parser)
    return command.run(parser.parse_args([str(word) for word in words]))


@pytest.fixture
def path(tmp_path):
    found = tmp_path / "log.mcap"
    noise = np.random.default_rng(0)
    with found.open("wb", buffering=0) as file:
        writer = McapWriter(file, chunk_size=1024, library="knotwork test")
        writer.add_metadata("knotwork.run", {"pipeline": '"demo"', "config": '{"a":1}', "seed": "4"})
        schema = writer.register_schema("knotwork.twist", "jsonschema", b"{}")
        channel = writer.register_channel(
            "/knotwork/base/twist", "msgpack", schema, {"stream": "base.twist", "type": "twist"}
        )
        for i in range(101):
            time = 10**9 + i * 10**8
            message = Twist(stamp=time, time=time, seq=i, vx=noise.random())
            writer.add(channel, time, time, i, codec.encode(message))
        writer.finish()
    return found


def test_info(path, capsys):
    assert call("info", path) == 0
    text = capsys.readouterr().out
    assert "complete" in text
    assert "101 messages in 10.000 s, from 1.000 to 11.000, written by knotwork test" in text
    assert 'pipeline: "demo"' in text
    assert "config" not in text
    (row,) = [line.split() for line in text.splitlines() if line.startswith("/knotwork")]
    assert row == ["/knotwork/base/twist", "knotwork.twist", "101", "10.00", "Hz"]
    assert call("info", path, "--config") == 0
    assert 'config: {"a":1}' in capsys.readouterr().out


def test_info_as_json(path, capsys):
    call("info", path, "--json")
    facts = json.loads(capsys.readouterr().out)
    assert facts["complete"] is True
    assert facts["run"] == {"pipeline": "demo", "config": {"a": 1}, "seed": 4}
    assert facts["channels"][0]["rate_hz"] == pytest.approx(10)


def test_recover_and_info_of_a_cut_log(path, capsys):
    path.write_bytes(path.read_bytes()[:-700])
    call("info", path)
    assert "cut short (knotwork log recover" in capsys.readouterr().out
    assert call("recover", path) == 0
    text = capsys.readouterr().out
    done = path.with_name("log.mcap.recovered.mcap")
    n = len(list(Log(done).messages()))
    assert f"{done}: {n} messages" in text
    assert "it was cut short" in text
    call("info", done)
    assert "complete" in capsys.readouterr().out


def test_recover_says_what_is_damaged(path, capsys):
    raw = bytearray(path.read_bytes())
    raw[900:4000:100] = b"\xff" * 31
    path.write_bytes(raw)
    assert call("recover", path, "--output", path.with_name("o.mcap")) == 0
    text = capsys.readouterr().out
    assert "damaged chunks" in text
    assert "byte " in text
    assert path.with_name("o.mcap").exists()


def test_recover_of_a_whole_log(path, capsys):
    call("recover", path)
    assert "101 messages\nthe log was whole" in capsys.readouterr().out


def test_info_of_an_empty_log(tmp_path, capsys):
    path = tmp_path / "e.mcap"
    with path.open("wb", buffering=0) as file:
        McapWriter(file).finish()
    assert call("info", path) == 0
    assert "0 messages" in capsys.readouterr().out


def test_user_mistakes(tmp_path, capsys):
    for name in ("info", "recover"):
        with pytest.raises(InputError, match="cannot open"):
            call(name, tmp_path / "none.mcap")
        (tmp_path / "x").write_text("FLASER")
        with pytest.raises(InputError, match="not an MCAP log"):
            call(name, tmp_path / "x")
    with pytest.raises(SystemExit):
        call()
    assert MANIFEST.kind == "command"
