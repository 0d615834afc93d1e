"""The errors a user can cause or meet, each with one clear sentence.

SyncwatchError
|-- InputError     bad configuration, arguments or input: exit status 2
`-- RunError       something failed while running: exit status 1
"""

from __future__ import annotations

import logging

log = logging.getLogger("syncwatch.errors")


class SyncwatchError(Exception):
    """Base of all errors that are shown to the user as one line, without a traceback."""


class InputError(SyncwatchError):
    """What the user gave cannot be used. The text says what, where, which value and what to do."""


class RunError(SyncwatchError):
    """A part failed while running. The text names the part."""


def explained(what: str, error: BaseException) -> SyncwatchError:
    """The error as a sentence for people; our own already are. `what` failed, in words."""
    log.debug("%s", what, exc_info=error)
    if isinstance(error, SyncwatchError):
        return error
    return RunError(f"{what}: {type(error).__name__}: {error}")
