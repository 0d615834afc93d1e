"""A consumer of stereo frames that must not compute depth out of pictures that were not taken together."""

from __future__ import annotations

from collections.abc import Iterable

from syncwatch import Frame


def pairs_by_stamp(frames: Iterable[Frame], tolerance_ns: int = 5_000_000) -> list[tuple[Frame, Frame]]:
    """Left and right frames whose timestamps are close, as most programs pair them."""
    lefts: dict[int, Frame] = {}
    pairs = []
    for frame in frames:
        if frame.camera == "left":
            lefts[frame.captured_ns] = frame
            continue
        left = lefts.get(min(lefts, key=lambda stamp: abs(stamp - frame.captured_ns), default=0))
        if left is not None and abs(left.captured_ns - frame.captured_ns) <= tolerance_ns:
            pairs.append((left, frame))
    return pairs
