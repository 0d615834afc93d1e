"""Chooses the topics that are the cameras of a rig: those the user named, else by their types and names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from sources.replay.messages.container import Topic
from sources.replay.messages.decoders import holds_pictures
from sources.replay.names import camera_names, natural
from sources.replay.notices import Notices

GENERIC = re.compile(r"image(_?(raw|rect|rectified|mono|color|colour))*|raw|compressed|h26[45]|video", re.IGNORECASE)
"""Parts of a topic's name that say what it carries, not which camera it is of."""

NOT_A_CAMERA = re.compile(r"depth|disparity|mask|segmentation|debug|overlay|annotated|thumbnail", re.IGNORECASE)
SIDES = re.compile(
    r"(?<![a-z])(left|right)(?![a-z])|(?:(?<=cam)|(?<=camera)|(?<=infra)|(?<=image))_?[0-9]+", re.IGNORECASE
)
"""What tells cameras of one rig apart: left and right, or a number."""

PREFERRED = ("image_raw", "raw", "image", "image_mono", "image_color", "image_rect", "image_rect_raw")
"""Of several topics of one camera, the least processed is judged."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """The topics of a recording's cameras, by the cameras' names, and the pairs they form where they were guessed."""

    topics: Mapping[str, Topic]
    pairs: tuple[tuple[str, str], ...] | None = None


def choose(
    where: Path,
    there: Sequence[Topic],
    wanted: Mapping[str, str] | Sequence[str] | None,
    cameras: Sequence[str] | None,
    notices: Notices,
) -> Chosen:
    """The cameras among the topics that are there. Raises InputError that lists those with pictures."""
    if wanted is not None:
        return _named(where, there, wanted, cameras)
    found = [topic for topic in there if holds_pictures(topic)]
    groups = _groups(found)
    if not groups:
        raise InputError(f"{where}: {_too_few(found)}")
    topics = [topic for group in groups for topic in group]
    names = camera_names([_as_path(topic) for topic in topics], cameras)
    notices.info(
        "cameras: " + ", ".join(f"{name} {topic.name}" for name, topic in zip(names, topics, strict=True))
        + _left_out(found, topics)
    )  # fmt: skip
    by_topic = {topic.name: name for name, topic in zip(names, topics, strict=True)}
    pairs = tuple((by_topic[first.name], by_topic[other.name]) for first, *others in groups for other in others)
    return Chosen(dict(zip(names, topics, strict=True)), pairs if len(groups) > 1 else None)


def _named(
    where: Path, there: Sequence[Topic], wanted: Mapping[str, str] | Sequence[str], cameras: Sequence[str] | None
) -> Chosen:
    topics = [_called(name, where, there) for name in (wanted.values() if isinstance(wanted, Mapping) else wanted)]
    names = (
        list(wanted) if isinstance(wanted, Mapping) else camera_names([_as_path(topic) for topic in topics], cameras)
    )
    if len(topics) < 2 or len(topics) > len({topic.name for topic in topics}):
        raise InputError(f"{where}: two or more different topics are needed, one a camera")
    return Chosen(dict(zip(names, topics, strict=True)))


def _called(name: str, where: Path, there: Sequence[Topic]) -> Topic:
    """The picture topic of that name, with or without the slash before it. Raises InputError."""
    topic = next((one for one in there if one.name.lstrip("/") == name.lstrip("/")), None)
    if topic is not None and holds_pictures(topic):
        return topic
    listed = _listed([one for one in there if holds_pictures(one)])
    if topic is None:
        raise InputError(f"{where}: no topic '{name}' with pictures: {listed}")
    raise InputError(f"{where}: topic '{name}' holds no pictures but {topic.kind or 'what has no schema'}: {listed}")


def _groups(found: Sequence[Topic]) -> list[list[Topic]]:
    """The cameras of each rig: topics whose names differ in a side or a number only; else all there are."""
    best: dict[str, Topic] = {}
    for topic in sorted(found, key=lambda one: natural(one.name)):
        if NOT_A_CAMERA.search(topic.name) or topic.count == 0:
            continue
        camera = _camera(topic.name)
        if camera not in best or _rank(topic) < _rank(best[camera]):
            best[camera] = topic
    rigs: dict[str, list[Topic]] = {}
    for camera, topic in best.items():
        rigs.setdefault(SIDES.sub("*", camera), []).append(topic)
    several = [topics for topics in rigs.values() if len(topics) > 1]
    if several:
        return several
    return [list(best.values())] if len(best) > 1 else []


def _camera(name: str) -> str:
    """A topic's name without what it carries: `/cam0/image_raw/compressed` is of the camera `/cam0`."""
    parts = name.split("/")
    while len(parts) > 2 and GENERIC.fullmatch(parts[-1]):
        parts.pop()
    return "/".join(parts)


def _rank(topic: Topic) -> tuple[int, int]:
    tail = topic.name.removeprefix(_camera(topic.name)).strip("/")
    return PREFERRED.index(tail) if tail in PREFERRED else len(PREFERRED), len(tail)


def _as_path(topic: Topic) -> Path:
    return Path(_camera(topic.name).strip("/").replace("/", "_"))


def _too_few(found: Sequence[Topic]) -> str:
    if not found:
        return "no topic with pictures: expected sensor_msgs Image or CompressedImage, or Foxglove's, two or more"
    if all(topic.count == 0 for topic in found):
        return f"not one picture in it: {', '.join(topic.name for topic in found)} are empty"
    return f"one camera only: two or more topics with pictures are needed; {_listed(found)}"


def _listed(found: Sequence[Topic]) -> str:
    return "there is " + (", ".join(topic.name for topic in found) or "none")


def _left_out(found: Sequence[Topic], chosen: Sequence[Topic]) -> str:
    others = [topic.name for topic in found if topic not in chosen]
    return f" (left out: {', '.join(others)}; --topics chooses)" if others else ""
