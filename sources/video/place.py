"""Where a video is: what FFmpeg is told, and what people may be shown of it."""

from __future__ import annotations

import stat
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

SCHEME = "://"
FILE = "file://"


@dataclass(frozen=True, slots=True)
class Place:
    """url: as FFmpeg takes it, passwords and all. shown: the same without what might be secret. file: if it is one."""

    url: str
    shown: str
    file: Path | None = None

    @property
    def trouble(self) -> str | None:
        """What keeps a file from being read, as far as can be told without reading it."""
        if self.file is None:
            return None
        try:
            mode = self.file.stat().st_mode
        except OSError as error:
            return error.strerror or "cannot be read"
        except ValueError:  # a character that no name of a file can have
            return "cannot be the name of a file"
        if stat.S_ISDIR(mode):
            return "is a folder (source replay reads folders)"
        if stat.S_ISCHR(mode):
            return "is a device (source v4l2 reads the cameras of this machine)"
        return None

    @property
    def is_recording(self) -> bool:
        """Whether it is a file that holds still."""
        return self.file is not None and self.file.is_file()


def place_of(text: str, base: Path) -> Place:
    """base: the folder that a relative path counts from."""
    if SCHEME in text and not text.startswith(FILE):
        return Place(text, _without_secrets(text))
    path = Path(text.removeprefix(FILE))
    try:
        path = base / path.expanduser()
    except RuntimeError:  # ~name of a user who does not exist: then it is a file name
        path = base / path
    return Place(f"file:{path}", str(path), path)


def _without_secrets(url: str) -> str:
    """Scheme, host and path: what stands before @, after ? and after # is left out.

    Of what is no URL nothing is shown: it may be a password with a / in it that stands where host and path should.
    """
    scheme, _, rest = url.partition(SCHEME)
    try:
        parts = urlsplit(url)
        _ = parts.port  # ValueError if it is no number
    except ValueError:
        return f"{scheme}{SCHEME}..."
    return f"{scheme}{SCHEME}{parts.netloc.rpartition('@')[2]}{parts.path}" if rest else url
