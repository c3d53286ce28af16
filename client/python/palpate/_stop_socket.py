"""The emergency stop by palpated's own socket for it. client/sdk/calls.cpp has the same."""

import contextlib
import os
import socket
import struct

from palpate._address import beside, usual_path
from palpate._enums import ForceReason, ForceState
from palpate._errors import Unavailable
from palpate._value_list import ForceStatus

# palpated answers within a second. In a flood it may close a connection: the next one may pass.
_PATIENCE = struct.pack("ll", 1, 500_000)  # s, µs
_TRIES = 3


def stop_socket_path(socket_path: str) -> str:
    """As FindStopSocket in common/wire/address.h."""
    own = beside(socket_path, "stop")
    return own if os.path.exists(own) else beside(usual_path(socket_path), "stop")


def stop_by_socket(path: str) -> ForceStatus | None:
    """Returns what the forces are then; None if nobody answers there.

    Errors: Unavailable (the loop does not tick, and the stop acts in its next tick).
    """
    for _ in range(_TRIES):
        try:
            words = _ask(path).decode(errors="replace").split()
        except ConnectionResetError:
            continue
        except OSError:
            return None
        if words[:1] == ["waits"]:
            raise Unavailable("the haptic loop did not tick within 1 s: the stop holds from its "
                              "next tick on; look at palpated's log, or end it")
        with contextlib.suppress(ValueError, KeyError):  # of another version
            state, reason, tick, limit_n, torque_limit_n_mm = words[:5]
            int(tick)
            return ForceStatus(state={str(one): one for one in ForceState}[state],
                               reason={str(one): one for one in ForceReason}[reason],
                               limit_n=float(limit_n), torque_limit_n_mm=float(torque_limit_n_mm))
    return None


def _ask(path: str) -> bytes:
    """The answer; empty: the connection was closed. Errors: OSError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        # Not settimeout: in a flood, a connection that may not wait for its turn is refused.
        for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
            connection.setsockopt(socket.SOL_SOCKET, option, _PATIENCE)
        connection.connect(path)
        with contextlib.suppress(BrokenPipeError):
            connection.sendall(b"stop\n")
        return connection.recv(256)  # the answer is one write
