"""The configuration of one clip, made of parts of a suite file: what is wrong with it is said at its place there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from pipeline.configtext.document import ConfigError, Document, Path, Place, Problem
from pipeline.configtext.report import Source

Origins: TypeAlias = Mapping[Path, Path]
"""From paths of a configuration to the paths of the suite that they were taken from."""


class ClipDocument(Document):
    """A configuration as `make_plan` reads it. Paths that have no origin are those of the suite itself."""

    def __init__(self, data: dict[str, Any], suite: Document, origins: Origins) -> None:
        super().__init__(data, {}, [Source(suite.label, "")])
        self._suite = suite
        self._origins = dict(origins)

    def place(self, path: Path) -> tuple[Place, Place]:
        return self._suite.place(self._origin(path))

    def error(self, problems: Iterable[Problem]) -> ConfigError:
        return self._suite.error(replace(problem, path=self._origin(problem.path)) for problem in problems)

    def _origin(self, path: Path) -> Path:
        for length in range(len(path), 0, -1):
            if path[:length] in self._origins:
                return (*self._origins[path[:length]], *path[length:])
        return path
