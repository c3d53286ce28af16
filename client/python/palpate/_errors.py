"""The errors, by kind. The message is one line for people."""

import grpc


class Error(Exception):
    """An error of palpated or of the connection to it. str() is one line."""


class InvalidArgument(Error, ValueError):
    """A value out of range, a file that is not a volume, an unknown name."""


class NotFound(Error):
    """No such file, folder or volume on the daemon's machine."""


class PermissionDenied(Error):
    """This user may not use the socket, or the daemon does not give access to the folder."""


class TooLarge(Error):
    """More voxels or bytes than fit."""


class DiskFull(Error):
    """No space left where palpated writes. An old file there is unchanged."""


class Conflict(Error):
    """Another client was first: another revision, a running load, an existing file."""


class FailedPrecondition(Error):
    """Not possible now; the message says why."""


class Unavailable(Error, ConnectionError):
    """palpated is not there, went away, or its servo does not run."""


class Cancelled(Error):
    """`progress` returned False, so the call was ended before it was done."""


class Internal(Error):
    """A fault of the daemon, or bytes that were damaged during transfer."""


# The same as in common/wire/status.h.
_KINDS: dict[grpc.StatusCode, type[Error]] = {
    grpc.StatusCode.INVALID_ARGUMENT: InvalidArgument,
    grpc.StatusCode.OUT_OF_RANGE: InvalidArgument,
    grpc.StatusCode.NOT_FOUND: NotFound,
    grpc.StatusCode.PERMISSION_DENIED: PermissionDenied,
    grpc.StatusCode.UNAUTHENTICATED: PermissionDenied,
    grpc.StatusCode.RESOURCE_EXHAUSTED: TooLarge,
    grpc.StatusCode.ABORTED: Conflict,
    grpc.StatusCode.ALREADY_EXISTS: Conflict,
    grpc.StatusCode.FAILED_PRECONDITION: FailedPrecondition,
    grpc.StatusCode.UNAVAILABLE: Unavailable,
    grpc.StatusCode.CANCELLED: Cancelled,
}


def _says(failed: grpc.RpcError, reason: bytes) -> bool:
    return any(key == "grpc-status-details-bin" and reason in value
               for key, value in failed.trailing_metadata() or ())


def is_loading(failed: grpc.RpcError) -> bool:
    """Returns whether palpated has no volume yet, but loads its first one."""
    return failed.code() == grpc.StatusCode.UNAVAILABLE and _says(failed, b"LOADING")


def was_not_sent(failed: grpc.RpcError) -> bool:
    """Returns whether the call did not reach any daemon, because there was no connection."""
    return (failed.code() == grpc.StatusCode.UNAVAILABLE
            and (failed.details() or "").startswith("failed to connect"))


def is_stalled(failed: grpc.RpcError) -> bool:
    """Returns whether gRPC's probes of the connection got no answer."""
    return (failed.code() == grpc.StatusCode.UNAVAILABLE
            and "keepalive" in (failed.details() or ""))


def error_of(name: str, failed: grpc.RpcError) -> Error:
    """Returns the error for a failed call to the daemon at `name`."""
    code = failed.code()
    if code == grpc.StatusCode.DEADLINE_EXCEEDED:
        return Unavailable(f"palpated at {name} did not answer in time")
    if code == grpc.StatusCode.UNIMPLEMENTED:
        return Unavailable(f"{name} is not palpated, or one of another version")
    if is_stalled(failed):
        return Unavailable(f"nothing comes from palpated at {name}: the network is gone, or palpated "
                           "hangs")
    if code == grpc.StatusCode.UNAVAILABLE:
        return Unavailable(f"palpated at {name} is unavailable: {failed.details()}")
    if _says(failed, b"DISK_FULL"):
        return DiskFull(failed.details())
    return _KINDS.get(code, Internal)(failed.details())
