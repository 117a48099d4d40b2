import threading
import time

import numpy as np
import pytest

from knotwork.core.cli.main import main
from knotwork.core.errors import InputError
from knotwork.core.messages import Pose
from knotwork.plugins.commands.view.player import Player
from knotwork.plugins.sinks.mcap import MANIFEST
from knotwork.plugins.sinks.mcap.recorder import McapRecorder

SECOND = 1_000_000_000


@pytest.fixture
def log(tmp_path, knotwork_context):
    """Ten seconds: a pose each second, x its time."""
    recorder = McapRecorder(knotwork_context(MANIFEST, {"path": str(tmp_path / "log.mcap")}))
    recorder.open()
    for second in range(11):
        pose = Pose(stamp=second * SECOND, role="estimate", pose=np.array([second, 0.0, 0.0]), scan_id=second)
        recorder.on_message("loc.pose", pose.sealed(second * SECOND, second))
    recorder.close()
    return recorder.path


@pytest.fixture
def play(log):
    players = []

    def start(rate):
        player = Player(log, rate)
        thread = threading.Thread(target=player.play)
        players.append((player, thread))
        return player, thread

    yield start
    for player, thread in players:
        player.stop()
        if thread.is_alive():
            thread.join(5)


def until(condition):
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def x(player):
    return player.scene.everything().get("poses", {}).get("loc.pose", {}).get("at", [None])[0]


def place(player):
    return player.scene.everything()["playback"]["place"]


def test_it_plays_to_the_end_and_can_be_sought_in(play):
    player, thread = play(None)
    thread.start()
    until(lambda: x(player) == 10)
    assert place(player) == 1
    refreshed = []
    player.refresh = lambda: refreshed.append(1)
    player.playback.pause()
    player.seek(0.55)
    until(lambda: x(player) == 5)
    assert player.scene.everything()["paths"]["loc.pose"]["points"][::2] == [0, 1, 2, 3, 4, 5]
    assert refreshed
    player.playback.step()
    until(lambda: x(player) == 6)
    player.seek(0.2)  # back
    until(lambda: x(player) == 1)
    player.playback.resume()
    until(lambda: x(player) == 10)


def test_paused_from_the_start(play):
    player, thread = play(1.0)
    player.playback.pause()
    thread.start()
    player.playback.step()
    until(lambda: x(player) == 0)
    player.playback.step("pose")
    until(lambda: x(player) == 1)
    assert place(player) == 0.1


def test_the_rate(play):
    player, thread = play(100.0)
    begun = time.monotonic()
    thread.start()
    until(lambda: x(player) == 10)
    assert time.monotonic() - begun >= 0.1


def test_a_log_that_was_cut_short_plays(log, play):
    data = log.read_bytes()
    log.write_bytes(data[: len(data) - 40])
    player, thread = play(None)
    thread.start()
    until(lambda: x(player) == 10)


def test_not_a_log(tmp_path, capsys):
    (tmp_path / "x.mcap").write_bytes(b"no")
    assert main(["view", str(tmp_path / "x.mcap"), "--port", "0"]) == 2
    assert "not an MCAP log" in capsys.readouterr().err
    assert main(["view", str(tmp_path / "absent.mcap")]) == 2


def test_a_log_of_others(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "foreign.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/chatter", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(InputError, match="no stream that Knotwork wrote"):
        Player(tmp_path / "foreign.mcap", 1.0)


@pytest.mark.parametrize("rate", ["0", "-1", "fast", "nan"])
def test_a_senseless_rate(log, rate, capsys):
    assert main(["view", str(log), f"--rate={rate}"]) == 2
    assert "--rate" in capsys.readouterr().err
