"""Real monitors and a real dashboard, each a program of its own, on a prefix of their own."""

from __future__ import annotations

import subprocess
import sys
import uuid
from pathlib import Path

from tests.network import wait_for
from tests.programs import ROOT

SOURCE = "{{type: synthetic, duration_s: 600, fps: {fps}, width: {width}, height: {height}, speed: 1.0, {more}}}"
CONFIG = """
rig: {name}
source: {source}
faults: {faults}
detectors: {detectors}
sinks:
  zenoh: {{prefix: {prefix}, {zenoh}}}
"""


class Stage:
    """Starts rigs and dashboards, and ends them all."""

    def __init__(self, folder: Path) -> None:
        self.prefix = f"test/{uuid.uuid4().hex[:8]}"
        self._folder = folder
        self._running: list[subprocess.Popen[str]] = []

    def rig(
        self,
        name: str,
        *,
        source: str = "motion: handheld",
        fps: int = 10,
        small: bool = True,
        faults: str = "[]",
        detectors: str = "{timestamp: {}}",
        zenoh: str = "mode: peer",
    ) -> subprocess.Popen[str]:
        width, height = (160, 120) if small else (320, 240)
        text = CONFIG.format(
            name=name,
            source=SOURCE.format(fps=fps, width=width, height=height, more=source),
            faults=faults,
            detectors=detectors,
            prefix=self.prefix,
            zenoh=zenoh,
        )
        file = self._folder / f"{name}.yaml"
        file.write_text(text)
        return self._start("run", str(file))

    def dashboard(self, *arguments: str) -> tuple[subprocess.Popen[str], str]:
        """The program, and the address it printed."""
        process = self._start("dashboard", self.prefix, *arguments)
        assert process.stdout is not None
        return process, wait_for(process.stdout.readline).strip()

    def _start(self, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "syncwatch", *arguments]
        with (self._folder / f"log{len(self._running)}.txt").open("w") as log:
            process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True)
        self._running.append(process)
        return process

    def end(self) -> None:
        for process in self._running:
            process.kill()
        for process in self._running:
            process.communicate()
