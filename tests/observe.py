"""Runs the offset detector on two lists of pictures."""

from __future__ import annotations

from pipeline.detectors.offset.detector import OffsetDetector
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.frame import Camera, Frame, Pair, Rig, Triple, Window
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource


def pictures(source, count):
    """The first `count` pictures of both cameras."""
    seen = {"left": [], "right": []}
    source.open()
    try:
        for item in source.frames():
            if len(seen[item.camera]) < count:
                seen[item.camera].append(item.image)
            if all(len(images) == count for images in seen.values()):
                break
    finally:
        source.stop()
        source.close()
    return seen["left"], seen["right"]


def observed(left, right, fps=10.0, **settings):
    """Evidence for each window of two lists of pictures."""
    rig = Rig("bench", (Camera("left", fps), Camera("right", fps)), (Pair("left", "right"),))
    detector = OffsetDetector(OffsetSettings(**settings), name="offset", rig=rig)
    period_ns = round(1e9 / fps)

    def frames(name, images):
        made = [
            None if image is None else Frame(name, n, n * period_ns, "rig", n * period_ns, image, group=n)
            for n, image in enumerate(images)
        ]
        return [None, *made, None]

    sides = {"left": frames("left", left), "right": frames("right", right)}
    return [
        detector.observe(Window(n, {name: Triple(*side[n : n + 3], n) for name, side in sides.items()}))[0]
        for n in range(min(len(left), len(right)))
    ]


def rendered(**settings):
    return SyntheticSource(SyntheticSettings(speed="max", fps=30, width=320, height=240, **settings), seed=5)
