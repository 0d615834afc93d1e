"""Opens sessions on a Zenoh network and says in words why that does not work."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from pathlib import Path

import zenoh

from pipeline.errors import InputError
from pipeline.zenoh_network import NetworkSettings, access_values, made_config, session_config

log = logging.getLogger("syncwatch.zenoh")

NOBODY = "nobody answers there"
SOURCE_PLACE = re.compile(r"\.? at /\S+\.rs:\d+\.?")

ANSWER_WITHIN_MS = 1000
"""How long somebody who has taken a connection may stay silent before that is what is wrong."""

UNKNOWN_USER = "it does not know user '{user}' with this password"
NO_USER = "it asks for a user and a password"
WORDS: Sequence[tuple[str, str]] = (
    (r"Connection refused|os error 111", NOBODY),
    (r"failed to lookup", "there is no host of this name"),
    (r"unreachable|os error (?:101|113)", "there is no way to this host"),
    (r"in response to an OpenSyn", UNKNOWN_USER),
    (r"in response to an InitSyn", NO_USER),
    (r"UsrPwd extension - Recv InitSyn", "it takes no users and passwords: leave user out"),
    (r"UnknownIssuer|BadSignature", "its certificate was not issued by tls.root_ca"),
    (r"not valid for name|NotValidForName", "its certificate is for another host (tls.verify_name)"),
    (r"Expired|NotValidYet", "a certificate is not valid at this time"),
    (r"alert: (?:UnknownCA|BadCertificate|DecryptError|CertificateUnknown)", "it does not accept our tls.certificate"),
    (r"alert: CertificateRequired", "it asks for a certificate of ours: tls.certificate and tls.private_key"),
    (r"handshake eof|corrupt message|InvalidContentType", "it does not speak TLS"),
    (r"early eof", "it hangs up: does it expect tls/ instead of tcp/?"),
    (r"deadline has elapsed|os error 110", "it does not answer"),
)
"""What Zenoh 1.10 says when one endpoint cannot be used, and what that means."""


class Network:
    """A network as the settings describe it. base: the folder that relative paths count from.

    Files are looked at when this is made, and again for each session. Raises InputError for one that is no good.
    """

    def __init__(self, settings: NetworkSettings, base: Path = Path()) -> None:
        self.settings = settings
        self._base = base
        session_config(settings, base)

    def open(self) -> zenoh.Session:
        """Raises ZError where nothing can be reached, InputError for a file that is no good any more."""
        return zenoh.open(session_config(self.settings, self._base))

    def why_not(self) -> str:
        """Why nobody is at the other end: tries every endpoint to connect to once, which takes a second at worst each.

        Empty where somebody is, or nobody to connect to was named. A session itself only ever says that it could not
        connect; one that tries once and gives up says why.
        """
        found = {endpoint: self._why_not(endpoint) for endpoint in self.settings.connect}
        said = list(dict.fromkeys(reason for reason in found.values() if reason))
        return "; ".join(said)

    def _why_not(self, endpoint: str) -> str:
        """Empty where nothing is wrong (any more)."""
        values = {
            "mode": "peer",
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": 0,
            "connect/exit_on_failure": True,
            "listen/endpoints": [],
            "scouting/multicast/enabled": False,
            "transport/unicast/open_timeout": ANSWER_WITHIN_MS,
        }
        try:
            zenoh.open(made_config(values | access_values(self.settings, self._base))).close()
        except zenoh.ZError as error:
            log.debug("zenoh: %s", first_words(error))
            return _in_words(str(error), self.settings.user)
        except InputError as error:
            return str(error)
        return ""


def first_words(error: zenoh.ZError) -> str:
    """What went wrong, without the places in Zenoh's own source."""
    return SOURCE_PLACE.sub("", str(error).splitlines()[0])


def _in_words(error: str, user: str | None) -> str:
    for pattern, words in WORDS:
        if re.search(pattern, error):
            if user is None and words is UNKNOWN_USER:
                return "it turns us away"
            if user is not None and words is NO_USER:
                return "it turns us away"
            return words.format(user=user)
    return SOURCE_PLACE.sub("", error.splitlines()[0])
