"""Explains why gRPC cannot connect, and what to do."""

import contextlib
import socket

_PROBE_TIMEOUT_S = 1.0


def why_unreached(name: str, details: str, *, has_tls: bool, ca_file: str | None) -> str:
    """Returns one line. name: the socket or HOST:PORT; details: the text of gRPC's UNAVAILABLE.

    If gRPC does not tell the cause, the line names all possible causes.
    """
    if name.startswith("unix:"):
        return f"no palpated at {name}: start it, or name its address"
    host, _, port = name.rpartition(":")
    if "DNS resolution failed" in details:
        return f"no palpated at {name}: the host {host} is not known: check the address"
    # gRPC reports only the host's last address. Another address may have refused us.
    if "Connection refused" in details and not _listens(host.strip("[]"), int(port)):
        return (f"no palpated at {name}: nothing listens there: start it there with --listen, or "
                "check the address")
    if not has_tls:
        return (f"no palpated at {name} that answers without TLS: start it there, or give tls_ca "
                "of one that has TLS")
    if "certificate verify failed" in details:
        authority = ("an authority that this machine trusts" if ca_file is None else
                     f"the authority in {ca_file}")
        return (f"no palpated at {name} that proves itself: its certificate is not signed by "
                f"{authority}, or is not valid today: give tls_ca the authority that signed it")
    if "is not in peer certificate" in details:
        return (f"no palpated at {name} that proves itself: its certificate does not name "
                f"{host}: use a host name that it has, or have one made that names {host}")
    if "wrong version number" in details:
        return (f"what answers at {name} has no TLS: check the address, or leave out tls_ca and "
                "$PALPATE_TLS_CA")
    return (f"no palpated at {name} that proves itself to the given authority over TLS: check the "
            "address, that its certificate names this host, and that it has TLS")


def _listens(host: str, port: int) -> bool:
    with contextlib.suppress(OSError):
        socket.create_connection((host, port), _PROBE_TIMEOUT_S).close()
        return True
    return False
