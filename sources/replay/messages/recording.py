"""A recording of messages by topic: every container read into the same streams, paired by time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampOrigin
from sources.replay.messages.container import Container, Topic
from sources.replay.messages.decoders import make_decoder
from sources.replay.messages.mcap_file import McapFile, is_mcap
from sources.replay.messages.rosbag1 import Rosbag1, is_bag
from sources.replay.messages.rosbag2 import Split, is_db3, is_folder, open_file, open_folder
from sources.replay.messages.topics import choose
from sources.replay.notices import Notices
from sources.replay.streams import SAME_EPOCH_NS, Entry, Raw, Recording, Request, Stream, fps_of

PEEKED = 50
"""Messages that tell a topic's frame rate and whether its stamps are any."""

LEAD_NS = 5 * NS_PER_S
"""How long before a wanted stamp messages are read: pictures are logged after they were taken."""


def is_rosbag1(paths: Sequence[Path]) -> bool:
    return all(is_bag(path) for path in paths)


def is_rosbag2(paths: Sequence[Path]) -> bool:
    return is_folder(paths[0]) if len(paths) == 1 and paths[0].is_dir() else all(is_db3(path) for path in paths)


def is_messages_in_mcap(paths: Sequence[Path]) -> bool:
    return all(is_mcap(path) for path in paths)


def is_container(path: Path) -> bool:
    """Whether it is a file of messages by topic."""
    return is_mcap(path) or is_bag(path) or is_db3(path)


def no_lone_camera(_: Path) -> str | None:
    """A container is recognised whatever it holds; what is missing in it is said when it is read."""
    return None


def read(request: Request) -> Recording:
    """Several paths are parts of one recording, in that order."""
    settings = request.settings
    if settings.pair_by in {"number", "index"}:
        raise InputError(f"{request.paths[0]}: messages pair by time, not by {settings.pair_by}")
    parts = [_opened(path, request.notices) for path in request.paths]
    container = parts[0] if len(parts) == 1 else Split(request.paths[0], parts)
    chosen = choose(container.where, container.topics, settings.topics, settings.cameras, request.notices)
    looks = {name: _look(container, topic) for name, topic in chosen.topics.items()}
    by_header = settings.stamps != "log" and all(look.has_stamps for look in looks.values())
    if not by_header and settings.stamps != "log":
        if settings.stamps == "header":
            raise InputError(f"{container.where}: the messages' own stamps are 0: stamps: log takes the recorder's")
        request.notices.warning("the messages' own stamps are 0: the recorder's are taken, which say when they came")
    origins = _origins_ns(list(looks.values()), request.notices, by_header=by_header)
    streams = tuple(
        Stream(
            name=name,
            where=container.where / look.topic.name.strip("/"),
            fps=request.fps(fps_of(look.stamps_ns(by_header=by_header))),
            count=look.topic.count,
            entries=partial(_entries, container, look, _start(settings.from_s, look), by_header=by_header),
            origin_ns=origin,
        )
        for (name, look), origin in zip(looks.items(), origins, strict=True)
    )
    return Recording(streams, StampOrigin.DEVICE if by_header else StampOrigin.ARRIVAL, pairs=chosen.pairs)


def _opened(path: Path, notices: Notices) -> Container:
    if path.is_dir():
        return open_folder(path, notices)
    if is_bag(path):
        return Rosbag1(path, notices)
    return McapFile(path, notices) if is_mcap(path) else open_file(path, notices)


@dataclass(frozen=True, slots=True)
class _Look:
    """The first messages of a topic: when they were logged, and what they say of themselves."""

    topic: Topic
    logged_ns: tuple[int, ...]
    headers_ns: tuple[int | None, ...]
    counts: bool

    @property
    def has_stamps(self) -> bool:
        return None not in self.headers_ns

    def stamps_ns(self, *, by_header: bool) -> list[int]:
        return [stamp for stamp in (self.headers_ns if by_header else self.logged_ns) if stamp is not None]


def _look(container: Container, topic: Topic) -> _Look:
    """Raises InputError for a topic without a message."""
    decode = make_decoder(topic)
    logged: list[int] = []
    headers: list[int | None] = []
    counters: set[int | None] = set()
    for message in islice(container.messages(topic.name), PEEKED):
        seen = decode(message.data)
        logged.append(message.logged_ns)
        headers.append(seen.stamp_ns)
        counters.add(message.sequence if seen.sequence is None else seen.sequence)
    if not logged:
        raise InputError(f"{container.where}: {topic.name}: not one picture in it")
    return _Look(topic, tuple(logged), tuple(headers), len(counters) > 1)


def _origins_ns(looks: Sequence[_Look], notices: Notices, *, by_header: bool) -> list[int]:
    """The stamp at which each stream's time starts: one for all that share a clock, as far as the log tells."""
    leads = [look.stamps_ns(by_header=by_header)[0] - look.logged_ns[0] for look in looks]
    start = min(look.logged_ns[0] for look in looks)
    if max(leads) - min(leads) <= SAME_EPOCH_NS:
        return [min(look.stamps_ns(by_header=by_header)[0] for look in looks)] * len(looks)
    notices.warning("the cameras' clocks differ: each camera's time is counted from when its first picture was logged")
    return [lead + start for lead in leads]


def _start(from_s: float | None, look: _Look) -> int | None:
    """The log time from which messages are read; video is read whole, as pictures build on those before them."""
    if from_s is None or "Video" in look.topic.kind:
        return None
    return look.logged_ns[0] + round(from_s * NS_PER_S) - LEAD_NS


def _entries(
    container: Container, look: _Look, from_ns: int | None, *, by_header: bool
) -> Generator[Entry, None, None]:
    topic = look.topic
    decode = make_decoder(topic)
    for index, message in enumerate(container.messages(topic.name, from_ns)):
        where = f"{container.where}: {topic.name}: message {index}"
        try:
            seen = decode(message.data)
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        counter = message.sequence if seen.sequence is None else seen.sequence
        yield Entry(
            sequence=counter if look.counts else None,
            group=None,
            captured_ns=seen.stamp_ns if by_header and seen.stamp_ns is not None else message.logged_ns,
            where=where,
            load=partial(_loaded, seen.load, where),
            arrived_ns=message.logged_ns,
        )


def _loaded(load: Callable[[], Raw], where: str) -> Raw:
    try:
        return load()
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
