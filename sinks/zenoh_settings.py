"""Where and how a rig is published over Zenoh."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator

from pipeline.zenoh_network import NetworkSettings
from sinks.zenoh_preview import PreviewSettings

KEY_CHUNK = re.compile(r"(?!@)[^/*$#?\s]+")
"""A chunk that begins with @ would be hidden from a subscriber's wildcards."""


def is_key_chunk(text: str) -> bool:
    return KEY_CHUNK.fullmatch(text) is not None and text.isprintable()


def _key_prefix(value: str) -> str:
    if not all(is_key_chunk(chunk) for chunk in value.split("/")):
        raise ValueError(f"'{value}' is not a key: chunks of letters, digits, - _ . joined by /, e.g. site/hall2")
    return value


Prefix = Annotated[str, AfterValidator(_key_prefix)]


class PublishingSettings(NetworkSettings):
    """How a sink takes part in Zenoh's network.

    required: end the run when nothing can be reached at the start.
    """

    required: bool = False


class ZenohSettings(PublishingSettings):
    """Where and how the rig is published, under <prefix>/<rig>.

    verdicts: publish all of them, those that differ in state from the one before, or none.
    preview: publish small pictures of the cameras, too.
    """

    type: Literal["zenoh"] = "zenoh"
    prefix: Prefix = "syncwatch"
    verdicts: Literal["all", "changes", "none"] = "all"
    preview: PreviewSettings | None = None
