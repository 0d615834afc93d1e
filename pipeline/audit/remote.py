"""Recordings at a URL of any file system that fsspec knows: found by names, judged on a copy."""

from __future__ import annotations

import posixpath
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.audit.find import Found, find
from pipeline.audit.judge import judge
from pipeline.audit.task import MakePlan, Task, effort, fingerprint
from pipeline.errors import InputError
from pipeline.messages import AuditShape

HEAD_BYTES = 4096
COPIED_BYTES = 1 << 20
HEADS = {".bag", ".db3", ".mcap", ".yaml"}
"""Files that tell by their first bytes what they are; others tell by their names."""

CHANGED = ("mtime", "LastModified", "last_modified", "updated", "created", "ETag", "etag", "md5Hash", "date_time")
"""What file systems call the facts that change with a file."""


def is_url(text: str) -> bool:
    return "://" in text


def tasks_at(url: str, settings: str) -> Iterator[Task]:
    """What there is to judge at a URL and below. Only beginnings of files are fetched. Raises InputError."""
    with _understood(url), tempfile.TemporaryDirectory(prefix="syncwatch-") as folder:
        there = _listed(url)
        outline = Path(folder)
        for place, file in there.files.items():
            path = outline / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(there.head(file) if path.suffix in HEADS else b"")
        for found in find([outline / there.name]):
            yield _task(url, found, found.path.relative_to(outline / there.name).as_posix(), there, settings)


def _task(url: str, found: Found, place: str, there: _There, settings: str) -> Task:
    whole = PurePosixPath(there.name, place)
    own = {name: file for name, file in there.files.items() if PurePosixPath(name).is_relative_to(whole)}
    facts = [(name, file.get("size"), *(file.get(what) for what in CHANGED)) for name, file in own.items()]
    sizes = [(name, int(file.get("size") or 0)) for name, file in own.items()]
    return Task(below(url, place), found.format, fingerprint(facts), settings, effort(sizes), found.trouble)


def judge_copy(task: Task, make_plan: MakePlan, folder: str | None = None) -> AuditShape:
    """What is said of a recording, which is copied to this machine first unless it is a path. Raises nothing.

    folder: where copies go; the system's own place for such things otherwise. A copy is removed afterwards.
    """
    if not is_url(task.path):
        return judge(task, make_plan)
    try:
        with _understood(task.path), tempfile.TemporaryDirectory(prefix="syncwatch-", dir=folder) as place:
            copy = _copied(task.path, Path(place))
            found = [one for one in find([copy]) if one.format is not None]
            if len(found) == 1:
                here = Task(task.path, found[0].format, task.fingerprint, task.settings, task.effort)
                return judge(here, make_plan, str(found[0].path))
            if found:
                return task.record(error=f"it holds {len(found)} recordings: give each of them as a URL of its own")
            return task.record(error=task.trouble or "no recording that is known")
    except InputError as error:
        return task.record(error=str(error))


def below(url: str, place: str) -> str:
    """The URL of a place below another: in a chain of file systems, the first that has a path is the one that counts.

    `zip://day1::file:///a.zip` and `cam` make `zip://day1/cam::file:///a.zip`.
    """
    if place == ".":
        return url
    parts = url.split("::")
    index = next(index for index, part in enumerate(parts) if "://" in part)
    whole = parts[index]
    parts[index] = f"{whole if whole.endswith('/') else whole + '/'}{place}"
    return "::".join(parts)


@dataclass(frozen=True, slots=True)
class _There:
    """The files at a URL and below, hidden ones left out.

    name: of what lies at the URL. files: what the file system tells of each, by its place from the folder that holds
    `name`: `name` itself for a single file, else `name/...`.
    """

    system: Any
    name: str
    files: Mapping[str, Mapping[str, Any]]

    def head(self, file: Mapping[str, Any]) -> bytes:
        size = min(HEAD_BYTES, file.get("size") or 0)
        return bytes(self.system.cat_file(file["name"], 0, size)) if size else b""


def _listed(url: str) -> _There:
    """Raises InputError where there is nothing."""
    from fsspec.core import url_to_fs  # noqa: PLC0415 - of the extra `cluster`, which others do without

    system, root = url_to_fs(url)
    start = str(root).strip("/")
    name = posixpath.basename(start) or "root"
    found: dict[str, Mapping[str, Any]] = {}
    for path, file in system.find(root, detail=True).items():
        parts = PurePosixPath(path.strip("/").removeprefix(start).strip("/")).parts
        if not any(part.startswith(".") for part in parts):
            found[posixpath.join(name, *parts)] = {**file, "name": path}
    if not found:
        raise InputError(f"{url}: there is no file")
    return _There(system, name, found)


def _copied(url: str, folder: Path) -> Path:
    """A copy of the file or the folder at a URL. No name leads out of `folder`: hidden parts, and so `..`, are left."""
    there = _listed(url)
    for place, file in there.files.items():
        target = folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        with there.system.open(file["name"], "rb") as remote, target.open("wb") as local:
            shutil.copyfileobj(remote, local, COPIED_BYTES)
    return folder / there.name


@contextmanager
def _understood(url: str) -> Iterator[None]:
    """What any file system raises becomes InputError."""
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except Exception as error:
        said = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise InputError(f"{url}: cannot be read: {' '.join(said.split())}") from error
