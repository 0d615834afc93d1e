"""Files that commands write their results to: what keeps them from being written is found before the work begins."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import InputError, RunError


def output_file(option: str, name: str, inputs: Sequence[str] = ()) -> Path:
    """The file an option names. inputs: what is read, which must not be written over. Raises InputError."""
    target = Path(name)
    what = None
    if name == "-":
        what = "a file is needed"
    elif target.is_dir():
        what = "it is a folder"
    elif not target.parent.is_dir():
        what = f"there is no folder {target.parent}"
    elif not os.access(target if target.exists() else target.parent, os.W_OK):
        what = "permission denied"
    elif any(target.exists() and Path(path).exists() and target.samefile(path) for path in inputs):
        what = "it is what is to be read: name another file"
    if what is not None:
        raise InputError(f"{option} {target}: cannot be written: {what}")
    return target


def write_output(option: str, target: Path, text: str) -> None:
    """Raises RunError."""
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(f"{option} {target}: cannot be written: {error.strerror}") from None
