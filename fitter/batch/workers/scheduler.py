"""Where a Dask cluster is, and how both sides know each other: whoever reaches a scheduler can run code on it."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fit_material.renderer.errors.input_error import InputError

TLS = "tls://"
EXAMPLE = "such as tls://10.0.0.1:8786"


@dataclass(frozen=True)
class Certificates:
    """PEM files.

    Attributes:
        ca_file: certificates, one of which has signed that of the scheduler.
        cert: what this program shows there.
        key: of `cert`; None where that file has both.
    """

    ca_file: Path
    cert: Path
    key: Path | None


@dataclass(frozen=True)
class Scheduler:
    """A scheduler of Dask.

    Attributes:
        address: with its protocol.
        certificates: None where the protocol has none.
    """

    address: str
    certificates: Certificates | None


def scheduler_of(
    address: str | None, ca_file: Path | None, cert: Path | None, key: Path | None, insecure: bool
) -> Scheduler | None:
    """By the command's options; None where there is no address.

    Args:
        insecure: whether another protocol than TLS may be used.

    Raises:
        InputError: anybody could be at that address, an option has no meaning, or a file is missing or wrong.
    """
    files = {"--tls-ca-file": ca_file, "--tls-cert": cert, "--tls-key": key}
    if address is not None and address.startswith(TLS):
        return Scheduler(address, _certificates(files))
    for option, path in files.items():
        if path is not None:
            raise InputError(option, value=path, expected=f"--scheduler and an address by TLS beside it, {EXAMPLE}")
    if address is not None and not insecure:
        reason = "without TLS whoever reaches the scheduler can run code as you, here and on all workers"
        raise InputError(
            "--scheduler", value=address, expected=f"an address by TLS, {EXAMPLE}, or --insecure: {reason}"
        )
    if address is None and insecure:
        raise InputError("--insecure", expected="--scheduler beside it; the processes of this machine are safe")
    return None if address is None else Scheduler(address, None)


def _certificates(files: Mapping[str, Path | None]) -> Certificates:
    """As OpenSSL reads them, one after the other, so that the one that is wrong is named."""
    ca_file, cert, key = files["--tls-ca-file"], files["--tls-cert"], files["--tls-key"]
    if ca_file is None:
        raise InputError("--tls-ca-file", expected=f"the certificates by which a scheduler at {TLS} is recognised")
    if cert is None:
        raise InputError("--tls-cert", expected=f"the certificate by which a scheduler at {TLS} recognises who calls")
    for option, path in files.items():
        if path is not None:
            _check_readable(option, path)
    _check_certificate("--tls-ca-file", ca_file)
    _check_certificate("--tls-cert", cert)
    _check_key(cert, key)
    return Certificates(ca_file, cert, key)


def _check_readable(option: str, path: Path) -> None:
    try:
        if path.exists() and not path.is_file():
            raise InputError(option, value=path, expected="a regular file")
        path.open("rb").close()
    except OSError as error:
        raise InputError(option, value=path, expected=f"a file that can be read ({error.strerror})") from None


def _check_certificate(option: str, path: Path) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(path)
    except ssl.SSLError:
        raise InputError(option, value=path, expected="a file with certificates, in PEM format") from None


def _check_key(cert: Path, key: Path | None) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(cert, key, password=_refuse_passphrase)
    except (ssl.SSLError, _Encrypted):
        expected = f"a file with the private key of {cert}, in PEM format, without a passphrase"
        raise InputError("--tls-key", value=key or "", expected=expected) from None


class _Encrypted(Exception):
    """A key has a passphrase."""


def _refuse_passphrase() -> str:
    """In place of OpenSSL's prompt on the terminal, which Dask would repeat for every connection."""
    raise _Encrypted
