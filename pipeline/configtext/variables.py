"""Environment variables inside configuration values: ``${NAME}``, ``${NAME:-default}``, and ``$${`` for a literal."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from pipeline.configtext.report import show

if TYPE_CHECKING:
    from collections.abc import Mapping

_OPENING = re.compile(r"\$\$\{|\$\{")
_REFERENCE = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(?::-(.*))?", re.DOTALL)


def substitute(text: str, environ: Mapping[str, str]) -> tuple[str, list[str]]:
    """The text with its variables replaced, and a sentence for each that cannot be.

    As in a shell, a default also stands in for a variable that is set but empty.
    What a variable or a default holds is not searched for variables again.
    """
    done: list[str] = []
    complaints: list[str] = []
    at = 0
    while opening := _OPENING.search(text, at):
        done.append(text[at : opening.start()])
        at = opening.end()
        if opening.group() == "$${":
            done.append("${")
            continue
        end = text.find("}", at)
        if end < 0:
            complaints.append("'${' without a closing '}' - write $${ for a literal ${")
            break
        value, complaint = _look_up(text[at:end], environ)
        done.append(value)
        complaints.extend([complaint] if complaint else [])
        at = end + 1
    done.append(text[at:])
    return "".join(done), complaints


def _look_up(reference: str, environ: Mapping[str, str]) -> tuple[str, str | None]:
    match = _REFERENCE.fullmatch(reference)
    if match is None:
        return "", f"{show('${' + reference + '}')} is not a variable - write ${{NAME}} or ${{NAME:-default}}"
    name, default = match.groups()
    if default is not None and "${" in default:
        return "", f"the default of ${{{name}:-...}} holds another ${{ - a default is plain text"
    value = environ.get(name)
    if default is not None:
        return value or default, None
    if value is None:
        return "", f"environment variable {name} is not set; write ${{{name}:-default}} to give a default"
    return value, None
