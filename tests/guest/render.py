"""Renders the rig that is shown through virtual cameras: `python -m tests.guest.render FILE`, on the host."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource

COUNT = 120
WIDTH, HEIGHT = 320, 240


def main(path: Path) -> None:
    settings = SyntheticSettings(width=WIDTH, height=HEIGHT, fps=15, duration_s=COUNT / 15, motion="handheld")
    source = SyntheticSource(settings, seed=3)
    source.open()
    pictures: dict[str, list] = {"left": [], "right": []}
    for frame in source.frames():
        pictures[frame.camera].append(frame.image)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{name: np.stack(images) for name, images in pictures.items()})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
