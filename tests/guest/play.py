"""Shows a rendered rig on two v4l2loopback cameras, for ever: `python -m tests.guest.play FPS FILE LEFT RIGHT`.

Both cameras get a picture at the same time, so that stamps agree. A line on standard input makes the right one show the
picture of before from then on; the time of the first such picture is printed, monotonic, ns.
"""

from __future__ import annotations

import fcntl
import select
import sys
import time
from itertools import count
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sources.v4l2 import abi

VIDEO_OUTPUT = 2


def main(fps: float, file: Path, devices: list[Path]) -> None:
    stored = np.load(file)
    left, right = stored["left"], stored["right"]
    there_and_back = [*range(len(left)), *range(len(left) - 2, 0, -1)]
    late = 0
    with shown(devices[0], left, fps) as first, shown(devices[1], right, fps) as second:
        started_s = time.monotonic()
        for number in count():
            time.sleep(max(0.0, started_s + number / fps - time.monotonic()))
            if not late and select.select([sys.stdin], [], [], 0)[0]:
                late = 1
                say(f"{time.monotonic_ns()}")
            first.write(left[there_and_back[number % len(there_and_back)]].tobytes())
            second.write(right[there_and_back[(number - late) % len(there_and_back)]].tobytes())
            if number == 0:
                say("playing")


def shown(device: Path, pictures: np.ndarray, fps: float) -> BinaryIO:
    """A camera to write pictures to; it forgets their size when it is closed."""
    height, width = pictures.shape[1:]
    file = device.open("r+b", buffering=0)
    wanted = abi.Format(type=VIDEO_OUTPUT)
    wanted.pix.width, wanted.pix.height, wanted.pix.pixelformat = width, height, abi.fourcc("GREY")
    wanted.pix.bytesperline, wanted.pix.sizeimage, wanted.pix.field = width, width * height, abi.FIELD_NONE
    fcntl.ioctl(file, abi.S_FMT, wanted)
    rate = abi.StreamParameters(type=VIDEO_OUTPUT)
    rate.timeperframe.numerator, rate.timeperframe.denominator = 1, round(fps)
    fcntl.ioctl(file, abi.S_PARM, rate)
    return file


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(float(sys.argv[1]), Path(sys.argv[2]), [Path(each) for each in sys.argv[3:]])
