import itertools
import threading
import time

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from knotwork.core.errors import DriverError, InputError  # noqa: E402
from knotwork.plugins.drivers.camera import Config, LiveConfig  # noqa: E402
from knotwork.plugins.drivers.camera import live as live_module  # noqa: E402
from knotwork.plugins.drivers.camera.calibration import read_calibration  # noqa: E402
from knotwork.plugins.drivers.camera.driver import Camera  # noqa: E402
from knotwork.plugins.drivers.camera.live import LiveCamera  # noqa: E402

GOOD = "fx: 300\nfy: 310\ncx: 160\ncy: 120\n"
SHIFT = (1.5, -0.75)  # px a frame


@pytest.fixture
def texture():
    rng = np.random.default_rng(0)
    noise = rng.uniform(0, 255, (400, 500)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)


def picture(texture, k):
    matrix = np.array([[1, 0, SHIFT[0] * k - 60], [0, 1, SHIFT[1] * k - 60]])
    return cv2.warpAffine(texture, matrix, (320, 240), flags=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


@pytest.fixture
def folder(tmp_path, texture):
    images = tmp_path / "images"
    images.mkdir()
    for k in range(12):
        cv2.imwrite(str(images / f"{k:04}.png"), picture(texture, k))
    (tmp_path / "camera.yaml").write_text(GOOD)
    return tmp_path


def frames(context, folder, **config):
    node = Camera(context(Config(**{"source": folder / "images", "calibration": folder / "camera.yaml"} | config)))
    node.open()
    out = [message for _, message in node.events()]
    node.close()
    return node, out


def test_points_keep_their_ids_and_move_as_the_picture_does(context, folder):
    node, out = frames(context, folder, rate=20, features=60)
    assert [m.stamp for m in out] == [50_000_000 * k for k in range(12)]
    assert node.progress() == 1.0
    assert len(out[0].ids) > 30
    for before, after in itertools.pairwise(out):
        assert len(set(after.ids.tolist())) == len(after.ids)
        common, i, j = np.intersect1d(before.ids, after.ids, return_indices=True)
        assert len(common) > 0.8 * len(before.ids)
        moved = (after.points[j] - before.points[i]) * (300, 310)
        np.testing.assert_allclose(np.median(moved, axis=0), SHIFT, atol=0.06)
        assert (np.hypot(*(moved - SHIFT).T) < 0.3).mean() > 0.95


def test_a_video_file_gives_the_same_tracks(context, folder, texture):
    path = folder / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20, (320, 240))
    if not writer.isOpened():
        pytest.skip("this OpenCV cannot write videos")
    for k in range(8):
        writer.write(cv2.cvtColor(picture(texture, k), cv2.COLOR_GRAY2BGR))
    writer.release()
    _, out = frames(context, folder, source=path)
    assert [m.stamp for m in out] == [50_000_000 * k for k in range(8)]
    common, i, j = np.intersect1d(out[0].ids, out[-1].ids, return_indices=True)
    assert len(common) > 20
    moved = np.median((out[-1].points[j] - out[0].points[i]) * (300, 310), axis=0)
    np.testing.assert_allclose(moved, np.multiply(SHIFT, 7), atol=0.3)


def test_distortion_is_taken_out(context, folder):
    (folder / "camera.yaml").write_text(GOOD + "distortion: [-0.2, 0.05, 0.001, -0.002]\n")
    _, bent = frames(context, folder)
    (folder / "camera.yaml").write_text(GOOD)
    _, straight = frames(context, folder)
    matrix = np.array([[300.0, 0, 160], [0, 310, 120], [0, 0, 1]])
    rays = np.column_stack((bent[0].points, np.ones(len(bent[0].ids))))
    lens = np.array([-0.2, 0.05, 0.001, -0.002])
    again, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, lens)
    pixels = straight[0].points * (300, 310) + (160, 120)
    np.testing.assert_allclose(again[:, 0], pixels, atol=0.01)


def test_damaged_images_are_skipped_and_counted(context, folder):
    (folder / "images" / "0003.png").write_bytes(b"not an image")
    node, out = frames(context, folder)
    assert len(out) == 11
    assert node.context.counts == {"unreadable_images": 1}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("fx: 300\nfy: 300\ncx: 1\n", "cy: expected a number"),
        ("fx: -1\nfy: 300\ncx: 1\ncy: 1\n", "positive"),
        ("fx: nan\nfy: 300\ncx: 1\ncy: 1\n", "fx: expected a number"),
        (GOOD + "distortion: [1, 2]\n", "distortion"),
        (GOOD + "k1: 1\n", "unknown: k1"),
        ("just text", "not a calibration"),
        ("a: [", "not a YAML file"),
    ],
)
def test_a_wrong_calibration_says_what_is_wrong(tmp_path, text, says):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as error:
        read_calibration(path)
    assert str(path) in str(error.value)


def test_sources_that_are_not_there(context, folder):
    (folder / "empty").mkdir()
    (folder / "text.avi").write_text("no video")
    for name, says in (("nothing.avi", "no such"), ("empty", "no images"), ("text.avi", "cannot open")):
        with pytest.raises(DriverError, match=says):
            frames(context, folder, source=folder / name)
    with pytest.raises(InputError, match="cannot read"):
        frames(context, folder, calibration=folder / "none.yaml")


def test_a_live_camera_pushes_and_comes_back_after_it_was_unplugged(context, folder, texture, monkeypatch):
    opened, tracked = [], threading.Semaphore(1)

    class Device:
        """Gives five pictures, then is unplugged; the second time it is not there."""

        def __init__(self, number):
            opened.append(number)
            self.k = 0

        def isOpened(self):
            return len(opened) != 2

        def set(self, key, value):
            pass

        def read(self):
            tracked.acquire(timeout=5)  # gives the next picture when the last one was tracked
            self.k += 1
            if self.k > 5:
                tracked.release()
            return self.k <= 5, picture(texture, self.k)

        def release(self):
            pass

    monkeypatch.setattr(live_module.cv2, "VideoCapture", Device)
    monkeypatch.setattr(live_module, "_AGAIN", 0.01)
    node = LiveCamera(context(LiveConfig(calibration=folder / "camera.yaml", device=3, size=(320, 240), rate=30)))
    node.open()
    got = threading.Event()
    emit = node.context.emit

    def take(port, message):
        emit(port, message)
        tracked.release()
        if len(node.context.emitted) == 10:
            got.set()

    node.context.emit = take
    node.start()
    assert got.wait(30)
    node.stop()
    node.close()
    stamps = [message.stamp for _, message in node.context.emitted]
    assert stamps == sorted(stamps)
    assert opened[:3] == [3, 3, 3]
    assert node.context.counts["lost_camera"] >= 1


def test_a_slow_tracker_gets_the_newest_picture(context, folder, texture, monkeypatch):
    shown, slow, done = threading.Semaphore(1), threading.Event(), threading.Event()

    class Device:
        def __init__(self, address):
            self.k = 0

        def isOpened(self):
            return True

        def read(self):
            shown.acquire()
            self.k += 1
            return True, np.full((240, 320), self.k, dtype=np.uint8)

        def release(self):
            pass

    class SlowTracker:
        seen = []

        def follow(self, grey):
            self.seen.append(int(grey[0, 0]))
            slow.set()
            done.wait(20)
            return np.zeros(0, dtype=np.int64), np.zeros((0, 2))

    monkeypatch.setattr(live_module.cv2, "VideoCapture", Device)
    node = LiveCamera(context(LiveConfig(calibration=folder / "camera.yaml", device="rtsp://there")))
    node._tracker = SlowTracker()
    node.open()
    node.start()
    assert slow.wait(20)  # picture 1 is being tracked
    for _ in range(4):
        shown.release()
    while node.context.counts.get("skipped_pictures", 0) < 3:
        time.sleep(0.01)
    done.set()
    while len(SlowTracker.seen) < 2:
        time.sleep(0.01)
    shown.release()
    node.stop()
    assert SlowTracker.seen[:2] == [1, 5]


@pytest.mark.parametrize(("device", "found"), [("0", 0), (2, 2), ("/dev/v4l/by-id/x", "/dev/v4l/by-id/x")])
def test_a_device_is_a_number_or_a_name(folder, device, found):
    assert LiveConfig(calibration=folder / "camera.yaml", device=device).device == found


def test_a_live_camera_that_is_not_there(context, folder, monkeypatch):
    class Nothing:
        def __init__(self, number):
            pass

        def isOpened(self):
            return False

    monkeypatch.setattr(live_module.cv2, "VideoCapture", Nothing)
    node = LiveCamera(context(LiveConfig(calibration=folder / "camera.yaml")))
    with pytest.raises(DriverError, match="cannot open the camera"):
        node.open()
