"""Frames as rigs deliver them and as recordings hold them, whose true numbers are known, and how they are paired."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Sequence

from pipeline.frame import Camera, Frame
from pipeline.pairing import Pairer, Slot
from tests.frames import PERIOD_NS, frame

MS = 1_000_000
RIG = (Camera("a", 10), Camera("b", 10))
THREE = (*RIG, Camera("c", 10))
STEPS_NS = [37_000 * MS, -37_000 * MS, 500 * MS, -500 * MS, 300 * MS, -700 * MS]


def camera(
    name: str,
    numbers: Iterable[int],
    *,
    ahead: Callable[[int], int] = lambda n: 0,
    latency: Callable[[int], int] = lambda n: 5 * MS,
    clock: str = "rig",
    ids: bool = True,
    period_ns: int = PERIOD_NS,
    seed: int | None = None,
) -> list[Frame]:
    """Frame n is taken at n periods and delivered `latency` later; its stamp is `ahead` of the truth."""
    chance = random.Random(seed)
    made = []
    for n in numbers:
        true_ns = 10**12 + n * period_ns
        noise_ns = round(chance.gauss(0, 3 * MS)) if seed is not None else 0
        stamp, arrived = true_ns + ahead(n) + noise_ns, true_ns + latency(n) + abs(noise_ns)
        made.append(frame(name, stamp, n if ids else None, clock=clock, arrived_ns=arrived, exposure_ns=n))
    return made


def live(*lanes: Sequence[Frame]) -> list[Frame]:
    return sorted((item for lane in lanes for item in lane), key=lambda item: (item.arrived_ns, item.camera))


def recorded(*lanes: Sequence[Frame]) -> list[Frame]:
    """In order of stamps, read at a hundred times the speed."""
    frames = sorted((item for lane in lanes for item in lane), key=lambda item: (item.captured_ns, item.camera))
    return [
        frame(
            item.camera,
            item.captured_ns,
            item.sequence,
            clock=item.clock,
            arrived_ns=n * MS,
            exposure_ns=item.exposure_ns,
        )
        for n, item in enumerate(frames)
    ]


def paired(
    frames: Iterable[Frame], cameras: Sequence[Camera] = RIG, **options: int | None
) -> tuple[Pairer, list[tuple[int | None, ...]]]:
    """The slots as tuples of the numbers of frames, by camera."""
    pairer = Pairer(cameras, **options)
    slots: list[Slot] = [slot for item in frames for slot in pairer.push(item)]
    slots += pairer.flush()
    return pairer, [tuple(item.exposure_ns if item else None for item in slot.values()) for slot in slots]


def whole(slots: Iterable[tuple[int | None, ...]]) -> list[tuple[int | None, ...]]:
    return [slot for slot in slots if None not in slot]


def step_at(onset: int, size_ns: int, until: int = 10**9) -> Callable[[int], int]:
    return lambda n: size_ns * (onset <= n < until)


def delivered_in_order(made: Sequence[Sequence[Frame]]) -> list[Frame]:
    """As a rig delivers: by arrival, but a camera's own frames never overtake each other."""
    held = []
    for lane in made:
        latest = 0
        for item in lane:
            latest = max(latest + 1, item.arrived_ns)
            held.append(
                frame(
                    item.camera,
                    item.captured_ns,
                    item.sequence,
                    clock=item.clock,
                    arrived_ns=latest,
                    exposure_ns=item.exposure_ns,
                )
            )
    return live(held)
