"""Watches the two cameras of a Raspberry Pi 5 that this program reads itself with picamera2.

    python examples/picamera2_push.py

Written after the documentation of picamera2 and libcamera and not run on a Raspberry Pi yet. libcamera stamps the start
of the exposure of the first line, on the clock CLOCK_BOOTTIME that both cameras share.
"""

from __future__ import annotations

import sys
import threading

try:
    from picamera2 import Picamera2
except ModuleNotFoundError:
    sys.exit("picamera2 is not here: `sudo apt install python3-picamera2`, and a .venv with --system-site-packages")

from syncwatch import Event, Monitor, StampReference

FPS = 30.0
SIZE = (640, 480)
CAMERAS = {"left": 0, "right": 1}


def main() -> None:
    stop = threading.Event()
    with Monitor(cameras=dict.fromkeys(CAMERAS, FPS), on_event=say) as monitor:
        readers = [threading.Thread(target=read, args=(monitor, *item, stop), daemon=True) for item in CAMERAS.items()]
        for reader in readers:
            reader.start()
        try:
            stop.wait()
        except KeyboardInterrupt:
            stop.set()
        for reader in readers:
            reader.join(2)


def read(monitor: Monitor, name: str, number: int, stop: threading.Event) -> None:
    camera = Picamera2(number)
    # What picamera2 calls RGB888 lies in memory as blue, green, red.
    camera.configure(camera.create_video_configuration(main={"size": SIZE, "format": "RGB888"}))
    camera.set_controls({"FrameRate": FPS})
    camera.start()
    while not stop.is_set():
        request = camera.capture_request()
        try:
            picture, said = request.make_array("main"), request.get_metadata()
        finally:
            request.release()
        monitor.push(
            name,
            picture,
            said["SensorTimestamp"],
            exposure_ns=1000 * said["ExposureTime"],
            clock="boottime",
            stamp_reference=StampReference.START,
            copy=False,
        )
    camera.stop()


def say(event: Event) -> None:
    print(f"{event.phase}: {event.text}", flush=True)


if __name__ == "__main__":
    main()
