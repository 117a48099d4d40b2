"""Pictures of textured walls as a camera on a base sees them, with the exact depth of each pixel; also as a stream."""

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

SIZE = (640, 480)  # px
FX, FY, CX, CY = 520.0, 515.0, 322.0, 236.0
CALIBRATION = f"fx: {FX}\nfy: {FY}\ncx: {CX}\ncy: {CY}\n"
OFFSET = 0.08  # m, camera ahead of the axle
_DENSITY = 500.0  # texture pixels for each radian at the first frame: the same grain on all walls
# Walls that face the first camera frame: depth, left, right, top, bottom [m], x right, y down, z forward.
WALLS = ((3.2, -3.5, 3.5, -2.6, 2.6), (2.3, 0.25, 0.95, -0.8, 0.5), (1.5, -0.75, -0.2, -0.35, 0.6))


def camera_pose(base):
    """Return rotation (3, 3) and position (3,) of the camera in its first frame, for a base at (x, y, yaw)."""
    x, y, yaw = base
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array(((c, 0.0, -s), (0.0, 1.0, 0.0), (s, 0.0, c)))
    return rotation, np.array((-(y + OFFSET * s), 0.0, x + OFFSET * (c - 1.0)))


class Scene:
    """Walls with a texture each, the same for each seed."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        self._textures = []
        for depth, left, right, top, bottom in WALLS:
            density = _DENSITY / depth
            shape = round((bottom - top) * density), round((right - left) * density)
            coarse, fine = (
                cv2.GaussianBlur(rng.uniform(0, 1, shape).astype(np.float32), (0, 0), s) for s in (5.0, 1.6)
            )
            texture = coarse / coarse.std() + fine / fine.std()
            self._textures.append(cv2.normalize(texture, None, 10, 245, cv2.NORM_MINMAX).astype(np.uint8))
        self._noise = [1.5 * rng.normal(size=SIZE[::-1]) for _ in range(7)]
        self._count = 0

    def picture(self, base):
        """Return what the camera sees (rows, columns), with a grey noise of 1.5."""
        rotation, position = camera_pose(base)
        lens = np.array(((FX, 0.0, CX), (0.0, FY, CY), (0.0, 0.0, 1.0)))
        out = np.zeros((SIZE[1], SIZE[0]), dtype=np.uint8)
        for (depth, left, _, top, _), texture in zip(WALLS, self._textures, strict=True):
            # A texture pixel (c, r) is the point (left + c/density, top + r/density, depth).
            pixel = depth / _DENSITY
            to_wall = np.array(((pixel, 0, left), (0, pixel, top), (0, 0, depth)))
            to_wall[:, 2] -= position
            homography = lens @ rotation.T @ to_wall
            image = cv2.warpPerspective(texture, homography, SIZE, flags=cv2.INTER_AREA)
            there = cv2.warpPerspective(np.full_like(texture, 255), homography, SIZE, flags=cv2.INTER_NEAREST)
            out = np.where(there > 0, image, out)
        self._count += 1
        return (out + self._noise[self._count % len(self._noise)]).clip(0, 255).astype(np.uint8)

    @staticmethod
    def depth(points, base, margin=0.0):
        """Return the depth (n,) of normalised image points (n, 2); NaN within `margin` of a wall's edge."""
        rotation, position = camera_pose(base)
        rays = np.column_stack((points, np.ones(len(points)))) @ rotation.T
        out = np.full(len(points), np.nan)
        for depth, left, right, top, bottom in WALLS:
            z = (depth - position[2]) / rays[:, 2]
            x, y = position[0] + z * rays[:, 0], position[1] + z * rays[:, 1]
            m = margin * z
            wide = (x > left - m) & (x < right + m) & (y > top - m) & (y < bottom + m)
            inside = (x > left + m) & (x < right - m) & (y > top + m) & (y < bottom - m)
            out[wide] = np.nan
            out[inside] = z[inside]
        return out


class Stream:
    """Motion JPEG over HTTP, as network cameras give it: `at()` is the pose of the base, asked for each picture."""

    def __init__(self, scene, at, rate=20.0):
        stop = self._stop = threading.Event()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                due = time.monotonic()
                while not stop.is_set():
                    jpeg = cv2.imencode(".jpg", scene.picture(at()), (cv2.IMWRITE_JPEG_QUALITY, 95))[1].tobytes()
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    try:
                        self.wfile.write(head.encode() + jpeg + b"\r\n")
                    except OSError:
                        return
                    due = max(due + 1.0 / rate, time.monotonic())
                    time.sleep(max(0.0, due - time.monotonic()))

            def log_message(self, *_):
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_address[1]}/camera.mjpg"

    def __enter__(self):
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._server.shutdown()
        self._server.server_close()
