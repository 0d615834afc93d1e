"""Offsets around loops of three or more cameras: they must add up, and together they are surer than each alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from pipeline.detectors.offset.arrays import Floats
from pipeline.detectors.offset.weigh import Finding
from pipeline.frame import Pair

MISFIT = 3.5
"""Joint standard errors by which a loop may fail to close: once in two thousand by chance, and a rig has few loops."""

Edge = tuple[str, str]


def measured_pairs(pairs: Sequence[Pair], cameras: Sequence[str]) -> list[Edge]:
    """The pairs of a rig and, with three or more cameras, each camera with the next, so that loops close."""
    edges = [(pair.first, pair.second) for pair in pairs]
    if len(cameras) > 2:
        edges += [edge for edge in pairwise(cameras) if edge not in edges and edge[::-1] not in edges]
    return edges


def closed(found: Mapping[Edge, Finding], periods_ns: Mapping[str, int]) -> dict[Edge, Finding]:
    """All offsets adjusted to add up around every loop (weighted least squares on one moment a camera).

    Where a loop does not close, the pairs in it say so, and name the camera that is in every such loop if one is.
    """
    known = {edge: item for edge, item in found.items() if item.known}
    wrong = [loop for loop in _triangles(known) if not _closes(loop, known, periods_ns)]
    if wrong:
        return {edge: _doubted(edge, item, wrong) for edge, item in found.items()}
    result = dict(found)
    for edge in found:
        adjusted = _by_all(edge, known, periods_ns)
        if adjusted is None:
            continue
        tau_ns, sigma_ns = adjusted
        period_ns, own = periods_ns[edge[1]], found[edge]
        spoke = own.spoke or "other pairs of the loop"
        result[edge] = replace(own, tau=tau_ns / period_ns, sigma=sigma_ns / period_ns, why="", spoke=spoke)
    return result


def _nanoseconds(edge: Edge, found: Mapping[Edge, Finding], periods_ns: Mapping[str, int]) -> tuple[float, float]:
    """Offset and standard error of a pair in either direction."""
    sign = 1 if edge in found else -1
    item = found[edge if sign == 1 else edge[::-1]]
    assert item.tau is not None
    assert item.sigma is not None
    period_ns = periods_ns[edge[1] if sign == 1 else edge[0]]
    return sign * item.tau * period_ns, item.sigma * period_ns


def _triangles(known: Mapping[Edge, Finding]) -> list[tuple[str, str, str]]:
    joined = {frozenset(edge) for edge in known}
    names = sorted({name for edge in known for name in edge})
    return [
        three for three in combinations(names, 3) if all(frozenset(two) in joined for two in combinations(three, 2))
    ]


def _closes(loop: tuple[str, str, str], known: Mapping[Edge, Finding], periods_ns: Mapping[str, int]) -> bool:
    a, b, c = loop
    sides = [_nanoseconds(edge, known, periods_ns) for edge in ((a, b), (b, c), (c, a))]
    error = float(np.sqrt(sum(sigma**2 for _, sigma in sides)))
    return abs(sum(tau for tau, _ in sides)) <= MISFIT * error


def _doubted(edge: Edge, item: Finding, wrong: Sequence[tuple[str, str, str]]) -> Finding:
    suspects = set(wrong[0]).intersection(*wrong[1:])
    if len(suspects) == 1:
        (suspect,) = suspects
        if suspect not in edge:
            return item
        return replace(item, spoke="", why=f"{suspect} does not fit: loops with it do not close")
    if not any(set(edge) <= set(loop) for loop in wrong):
        return item
    return replace(item, spoke="", why=f"offsets of {', '.join(wrong[0])} do not add up")


def _by_all(edge: Edge, known: Mapping[Edge, Finding], periods_ns: Mapping[str, int]) -> tuple[float, float] | None:
    """Offset and standard error of a pair, ns, from all known pairs together; None where they do not connect it."""
    names = sorted({name for two in known for name in two} | set(edge))
    place = {name: index for index, name in enumerate(names)}
    normal: Floats = np.zeros((len(names), len(names)))
    right = np.zeros(len(names))
    for two in known:
        tau_ns, sigma_ns = _nanoseconds(two, known, periods_ns)
        row = np.zeros(len(names))
        row[place[two[1]]], row[place[two[0]]] = 1.0, -1.0
        normal += np.outer(row, row) / sigma_ns**2
        right += row * tau_ns / sigma_ns**2
    wanted = np.zeros(len(names))
    wanted[place[edge[1]]], wanted[place[edge[0]]] = 1.0, -1.0
    inverse = np.linalg.pinv(normal, hermitian=True)
    if not np.allclose(normal @ (inverse @ wanted), wanted, atol=1e-6):
        return None
    return float(wanted @ inverse @ right), float(np.sqrt(wanted @ inverse @ wanted))
