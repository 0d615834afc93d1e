"""Prints what rendering a stereo pair costs, as a ratio to a pass of template matching in the same run.

    python benchmarks/render.py

The pass is the spatial detector's: the middle half of one gradient picture slid over three others, 640x480.
"""

from __future__ import annotations

import statistics
import time
from typing import get_args

import cv2

from pipeline.frame import NS_PER_MS
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import START_NS, SyntheticSource

ROUNDS = 60


def main() -> None:
    cv2.setNumThreads(1)
    print(f"{'motion':10} {'pair ms':>8} {'match ms':>9} {'ratio':>6}")
    for motion in get_args(SyntheticSettings.model_fields["motion"].annotation):
        source = SyntheticSource(SyntheticSettings(motion=motion), seed=1)
        source.open()
        costs_ms = [_measure(source, START_NS + number * 33_333_333) for number in range(ROUNDS)]
        pair_ms, match_ms = (statistics.median(column) for column in zip(*costs_ms, strict=True))
        print(f"{motion:10} {pair_ms:8.1f} {match_ms:9.1f} {pair_ms / match_ms:6.2f}")


def _measure(source: SyntheticSource, shown_ns: int) -> tuple[float, float]:
    started_ns = time.thread_time_ns()
    picture, _ = source.picture_at("left", shown_ns), source.picture_at("right", shown_ns)
    rendered_ns = time.thread_time_ns()
    gradient = cv2.magnitude(cv2.Sobel(picture, cv2.CV_32F, 1, 0), cv2.Sobel(picture, cv2.CV_32F, 0, 1))
    template = gradient[:, gradient.shape[1] // 4 : -gradient.shape[1] // 4]
    sliding_ns = time.thread_time_ns()
    for _ in range(3):
        cv2.matchTemplate(gradient, template, cv2.TM_CCORR_NORMED)
    return (rendered_ns - started_ns) / NS_PER_MS, (time.thread_time_ns() - sliding_ns) / NS_PER_MS


if __name__ == "__main__":
    main()
