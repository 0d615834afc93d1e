"""Says what a repair has done, for people and for programs."""

from __future__ import annotations

from pathlib import Path
from statistics import median

from pipeline.frame import NS_PER_MS
from pipeline.repair.groups import Regrouper
from pipeline.repair.measured import Measured, PairRepair


def sentences(measured: Measured, regrouper: Regrouper) -> list[str]:
    """One line a pair, then what was left out."""
    lines = [line for repair in measured.pairs.values() for line in _pair(repair)]
    left_out = [f"{count} of {name}" for name, count in regrouper.left_out.items() if count]
    if left_out:
        lines.append(f"frames without a partner, left out: {', '.join(left_out)}")
    if regrouper.unstamped:
        lines.append(f"stamps that could not be corrected: {regrouper.unstamped}")
    return lines


def metadata(source: Path, measured: Measured, regrouper: Regrouper, *, restamp: bool, version: str) -> dict[str, str]:
    shifts = {name: ",".join(f"{s.start}:{s.shift}" for s in pair.stretches) for name, pair in measured.pairs.items()}
    return {
        "source": source.name,
        "version": version,
        "restamp": str(restamp).lower(),
        "groups": str(regrouper.groups),
        "left_out": ",".join(f"{name}:{count}" for name, count in regrouper.left_out.items()),
        **{f"shifts_{name}": text for name, text in shifts.items()},
    }


def _pair(repair: PairRepair) -> list[str]:
    name, second = repair.pair.name, repair.pair.second
    if not repair.residuals_ns:
        return [f"{name}: no offset could be measured: its frames are paired as they were"]
    ends = [f" to {stretch.start - 1}" for stretch in repair.stretches[1:]]
    lines = [
        f"{name}: from frame {stretch.start}{end}: {second} moved by {stretch.shift:+d} "
        f"frame{'s' * (abs(stretch.shift) > 1)}"
        for stretch, end in zip(repair.stretches, [*ends, ""], strict=True)
        if stretch.shift
    ]
    left_ms = median(repair.residuals_ns) / NS_PER_MS
    return [
        *(lines or [f"{name}: no whole frame apart"]),
        f"{name}: {left_ms:+.1f} ms are left between frames (median)",
    ]
