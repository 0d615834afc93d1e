"""Pydantic's validation errors become problems: one plain sentence for each place in the data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pipeline.configtext.locate import Spot, allowed_keys, locate
from pipeline.configtext.report import Path, Problem, suggestion
from pipeline.configtext.sentences import Finding, finding, sentence

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


@dataclass(frozen=True, slots=True)
class _Located:
    kind: str
    loc: tuple[int | str, ...]
    spot: Spot
    path: Path
    finding: Finding


def problems_from(error: ValidationError, prefix: Path, model: type[BaseModel]) -> list[Problem]:
    """What the error says, for data that stands at the prefix and was validated by the model."""
    located = [_located(item, model) for item in error.errors(include_url=False)]
    groups: dict[Path, list[_Located]] = {}
    for item in _likely_members(located):
        groups.setdefault((*prefix, *item.path), []).append(item)
    return [_problem(path, group) for path, group in groups.items()]


def _located(item: Any, model: type[BaseModel]) -> _Located:
    kind, context = item["type"], item.get("ctx", {})
    spot = locate(model, item["loc"])
    path = spot.path
    # The discriminator is what is wrong or missing, though pydantic blames the mapping around it.
    discriminator = str(context.get("discriminator", ""))
    if kind in ("union_tag_invalid", "union_tag_not_found") and discriminator.startswith("'"):
        path = (*path, discriminator.partition(" | ")[0].strip("'"))
    return _Located(kind, item["loc"], spot, path, finding(kind, item["msg"], item["input"], context))


def _likely_members(items: list[_Located]) -> list[_Located]:
    """Without the complaints of those members of a union that the data was clearly not meant for.

    Where a member took the data apart and complains about a part of it, the others only say that it is not theirs;
    of several such members the one with the fewest complaints was meant.
    """
    unions = {item.loc[:at] for item in items for at in item.spot.labels}
    for union in sorted(unions, key=len):
        at = len(union)
        inside = [item for item in items if at in item.spot.labels and item.loc[:at] == union]
        complaints: dict[int | str, list[_Located]] = {}
        for item in inside:
            complaints.setdefault(item.loc[at], []).append(item)
        depth = {label: max(len(item.path) for item in group) for label, group in complaints.items()}
        surface = min(depth.values(), default=0)
        if len(complaints) < 2:
            continue
        apart = {label: len(group) for label, group in complaints.items() if depth[label] > surface} or {
            label: len(group) for label, group in complaints.items()
        }
        kept = [label for label, count in apart.items() if count == min(apart.values())]
        items = [item for item in items if item not in inside or item.loc[at] in kept]
    return items


def _problem(path: Path, group: list[_Located]) -> Problem:
    first = group[0]
    if first.kind == "extra_forbidden":
        owner = first.spot.owner
        return Problem(path, "unknown field", suggestion(str(path[-1]), allowed_keys(owner)) if owner else None, "key")
    message, hint = sentence([item.finding for item in group])
    is_key = first.loc[-1:] == ("[key]",)
    return Problem(path, message, hint, "key" if is_key else "value")
