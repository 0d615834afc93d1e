"""Watches two cameras that this program reads itself with OpenCV.

    python examples/opencv_push.py 0 2                    # /dev/video0 and /dev/video2
    python examples/opencv_push.py left.mp4 right.mp4     # anything else that OpenCV opens

    --fps 30        frame rate of the cameras, and the pace at which files are read
    --seconds 10    stop after so long

Each camera is read on a thread of its own. V4L2 devices have the driver's stamps; of everything else only the pictures
tell, for OpenCV does not say when they were taken.
"""

from __future__ import annotations

import argparse
import math
import threading
import time

import cv2
import numpy as np

from syncwatch import Event, Monitor

NAMES = ("left", "right")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    devices = "number of a /dev/video, file or URL of the left and the right camera"
    parser.add_argument("devices", nargs=2, metavar="CAMERA", help=devices)
    parser.add_argument("--fps", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=math.inf)
    given = parser.parse_args()
    stop_at_s = time.monotonic() + given.seconds
    with Monitor(cameras=dict.fromkeys(NAMES, given.fps), on_event=say) as monitor:
        readers = [
            threading.Thread(target=read, args=(monitor, name, device, given.fps, stop_at_s), daemon=True)
            for name, device in zip(NAMES, given.devices, strict=True)
        ]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join()
    for pair, judged in (monitor.status.pairs if monitor.status else {}).items():
        print(f"{pair}: {judged.state.value}")


def read(monitor: Monitor, name: str, device: str, fps: float, stop_at_s: float) -> None:
    is_device = device.isdecimal()
    capture = cv2.VideoCapture(int(device), cv2.CAP_V4L2) if is_device else cv2.VideoCapture(device)
    if not capture.isOpened():
        print(f"{name}: {device} cannot be opened\n", end="", flush=True)
    due_s = time.monotonic()
    while time.monotonic() < stop_at_s:
        ok, picture = capture.read()
        if not ok:
            break
        stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6) if is_device else None
        if not is_device:
            due_s += 1 / fps
            time.sleep(max(due_s - time.monotonic(), 0))
        monitor.push(name, np.asarray(picture, np.uint8), stamp_ns, clock="monotonic", copy=False)
    capture.release()


def say(event: Event) -> None:
    print(f"{event.phase}: {event.text}", flush=True)


if __name__ == "__main__":
    main()
