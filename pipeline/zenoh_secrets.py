"""Files that say who we are on a Zenoh network: certificates, keys, passwords, looked at before they are needed."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError

LONGEST_PASSWORD = 4096
"""Bytes; what is longer is no password: only so much of a file is read."""


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Files that are there and fit each other."""

    root_ca: Path | None
    certificate: Path | None
    private_key: Path | None

    @classmethod
    def found(cls, base: Path, *, root_ca: str | None, certificate: str | None, private_key: str | None) -> TlsFiles:
        """Paths count from `base`. Raises InputError."""
        given = {"root_ca": root_ca, "certificate": certificate, "private_key": private_key}
        files = {name: None if path is None else existing(base, path, f"tls.{name}") for name, path in given.items()}
        made = cls(**files)
        made._check()
        return made

    def values(self) -> dict[str, str]:
        """By Zenoh's names; our own certificate is the same whoever has begun to talk."""
        named = {
            "root_ca_certificate": self.root_ca,
            "connect_certificate": self.certificate,
            "connect_private_key": self.private_key,
            "listen_certificate": self.certificate,
            "listen_private_key": self.private_key,
        }
        return {name: str(path) for name, path in named.items() if path is not None}

    def _check(self) -> None:
        if self.root_ca is not None:
            try:
                ssl.create_default_context(cafile=self.root_ca)
            except ssl.SSLError:
                raise InputError(f"tls.root_ca: {self.root_ca}: no certificate in it (PEM is expected)") from None
        if self.certificate is None or self.private_key is None:
            return
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(self.certificate, self.private_key, password="")
        except ssl.SSLError as error:
            if error.reason == "KEY_VALUES_MISMATCH":
                raise InputError(
                    f"tls.private_key: {self.private_key}: is not the key of the certificate {self.certificate}"
                ) from None
            raise InputError(
                f"tls.certificate: {self.certificate} and its private_key {self.private_key} cannot be used: "
                "a certificate and a key without a passphrase are expected, both PEM"
            ) from None


def password_of(base: Path, given: str | None, file: str | None) -> str:
    """The password as given, or the first line of the file. Raises InputError, without repeating what is in it."""
    if given is None:
        assert file is not None
        path = existing(base, file, "password_file")
        with path.open("rb") as stream:
            lines = stream.read(LONGEST_PASSWORD).splitlines()
        try:
            given = lines[0].decode() if lines else ""
        except UnicodeDecodeError:
            raise InputError(f"password_file: {path}: the first line is no text") from None
        if not given:
            raise InputError(f"password_file: {path}: the first line is empty")
    if not given:
        raise InputError("password: is empty: is the environment variable it comes from set?")
    return given


def existing(base: Path, path: str, what: str) -> Path:
    """The absolute path of a file that can be read. Raises InputError."""
    file = (base / path).absolute()
    try:
        with file.open("rb"):
            return file
    except FileNotFoundError:
        raise InputError(f"{what}: {file}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{what}: {file}: cannot be read: {error.strerror}") from None
    except ValueError:  # a character that no name of a file can have
        raise InputError(f"{what}: {path!r}: cannot be the name of a file") from None
