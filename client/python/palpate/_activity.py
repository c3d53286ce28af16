"""Who is connected to the daemon, and who changed what."""

import dataclasses

from palpate._enums import Role
from palpate._held import held_in
from palpate._value_list import LastChange
from palpate.v1 import activity_pb2


@dataclasses.dataclass(frozen=True)
class ConnectedCaller:
    """Somebody who uses the daemon now.

    identity: such as "token or-2"; all programs on one of the daemon's sockets are one, such as "local socket"
    role: what the caller may do
    peer: where it calls from, such as "ipv4:192.0.2.7"; empty: a socket
    connected_s: how long ago it came, s
    watches: it receives poses
    is_you: it is this connection
    """

    identity: str
    role: Role
    peer: str
    connected_s: float
    watches: bool
    is_you: bool


@dataclasses.dataclass(frozen=True)
class Activity:
    """Who uses the daemon, and who changed what; Connection.activity().

    callers: those with a running call, or one in the last 10 s, in the order in which they came
    changes: the newest change of each thing, newest first, since the daemon's start
    """

    callers: tuple[ConnectedCaller, ...]
    changes: tuple[LastChange, ...]


def activity_of(answer: activity_pb2.GetActivityResponse) -> Activity:
    return Activity(
        tuple(ConnectedCaller(caller.caller.identity, Role(caller.caller.role), caller.peer,
                              caller.connected_s, caller.watches, caller.is_you)
              for caller in answer.callers),
        tuple(LastChange(**held_in(change)) for change in answer.changes))
