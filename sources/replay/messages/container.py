"""What every container of messages is read through: its topics, and the messages of one of them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from pipeline.errors import InputError
from sources.replay.files import unreadable
from sources.replay.notices import Notices


@dataclass(frozen=True, slots=True)
class Topic:
    """A named stream of messages.

    kind:       message type as ROS 2 or Foxglove spell it (`sensor_msgs/msg/Image`, `foxglove.RawImage`).
    encoding:   how messages are serialised: ros1, cdr, protobuf or json.
    count:      messages, where the container tells.
    definition: the text that defines `kind`, where the container has it.
    """

    name: str
    kind: str
    encoding: str
    count: int | None = None
    definition: str = ""


class Message(NamedTuple):
    """logged_ns: when the recorder wrote it. sequence: the container's counter, None where it has none."""

    logged_ns: int
    sequence: int | None
    data: bytes


class Container(Protocol):
    """A file or folder of messages. `messages` may be called again, and for several topics at once."""

    where: Path

    @property
    def topics(self) -> Sequence[Topic]: ...

    def messages(self, topic: str, from_ns: int | None = None) -> Generator[Message, None, None]:
        """The messages of a topic as they were written, from `from_ns` of log time on; ends where the file does."""
        ...


MAGIC_SIZE = 16


def magic(path: Path) -> bytes:
    """The first bytes of a file, none for a folder. Raises InputError when it cannot be read."""
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(MAGIC_SIZE)
    except OSError as error:
        raise unreadable(path, error) from error


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """What a library raises over a damaged container becomes InputError: they raise anything."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise unreadable(path, error) from error
    except Exception as error:
        raise InputError(f"{path}: damaged or no recording: {_told(error)}") from error


def until_damaged(
    path: Path, notices: Notices, messages: Callable[[], Iterator[Message]]
) -> Generator[Message, None, None]:
    """The messages of a container as far as it can be read; where it cannot, that is said and they end."""
    try:
        yield from messages()
    except InputError:
        raise
    except Exception as error:
        notices.warning(f"{path}: damaged or truncated ({_told(error)}): it is read up to there")


def _told(error: Exception) -> str:
    said = str(error).strip().splitlines()
    return f"{type(error).__name__}: {said[0]}" if said else type(error).__name__
