"""Writes what benchmarks.fleet measured into its section of docs/fleet.md."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.fleet_heard import Delivery, Measured, Part

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"


def put_in(page: str, section: str) -> str:
    """The page with the section in place of what stood between the marks. Raises ValueError where it has none."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no {BEGIN} and {END}")
    return f"{before}{BEGIN}\n{section}{END}{after}"


def section(measured: Measured) -> str:
    return "\n".join(_lines(measured)) + "\n"


def _lines(measured: Measured) -> Iterator[str]:
    yield (
        f"<!-- Written by `make fleet`. Do not edit: words are in benchmarks/fleet_page.py. -->\n\n"
        f"{measured.rigs} rigs in {measured.processes} processes, a session each, two routers (Python sessions in "
        f"router mode), one monitor;\nall of them share one machine ({measured.machine}) and its loopback. After "
        f"{measured.up_s:.0f} s all were there.\n"
    )
    yield "| | statuses arrived | events arrived | status, median and 99 % | event, median and 99 % |"
    yield "|---|---|---|---|---|"
    for part in measured.parts:
        latency = (f"{part.latency_ms[kind][0]:.0f}, {part.latency_ms[kind][1]:.0f} ms" for kind in ("status", "event"))
        yield f"| {part.name} | {_told(part.statuses)} | {_told(part.events)} | {' | '.join(latency)} |"
    yield ""
    yield "| | site router | regional router | monitor |"
    yield "|---|---|---|---|"
    for part in measured.parts:
        if part.cpu:
            routers = (f"{_cpu(part, name)}, {part.memory_mb[name]:.0f} MB" for name in ("site", "regional"))
            yield f"| {part.name} | {' | '.join(routers)} | {_cpu(part, 'monitor')} |"
    yield ""
    for part in measured.parts:
        if part.verdicts_arrived:
            arrived = part.verdicts_arrived
            each = f"{min(arrived.values(), default=0)} to {max(arrived.values(), default=0)} of each rig"
            yield f"Of {part.verdicts_sent} verdicts {sum(arrived.values())} came through the thinning: {each}.\n"
        if part.resumed_s is not None:
            lost = part.statuses.sent - part.statuses.arrived
            yield (
                f"When {part.name}: {lost} statuses ({lost / measured.rigs:.1f} a rig) and "
                f"{part.events.sent - part.events.arrived} events were lost,\n{part.events.disordered} events came out "
                f"of order; {part.resumed_s:.1f} s after its return every rig's status had come again.\n"
            )
    if measured.watched is not None:
        heard, status, seconds = measured.watched.heard, measured.watched.status, measured.watched.seconds
        yield (
            f"`syncwatch watch --once --json` heard {heard} of {measured.rigs} rigs and ended with status {status} "
            f"after {seconds:.1f} s,\nstart of the program included.\n"
        )


def _told(delivery: Delivery) -> str:
    twice = f", {delivery.twice} of them twice" if delivery.twice else ""
    share = 100 * delivery.arrived / max(delivery.sent, 1)
    return f"{delivery.arrived} of {delivery.sent} ({share:.2f} %){twice}"


def _cpu(part: Part, name: str) -> str:
    return f"{100 * part.cpu[name]:.0f} % of a core"
