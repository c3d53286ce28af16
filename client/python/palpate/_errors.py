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
    """The daemon or a client ended the call before it was done."""


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


def error_of(name: str, failed: grpc.RpcError) -> Error:
    """Returns the error for a failed call to the daemon at `name`."""
    code = failed.code()
    if code == grpc.StatusCode.DEADLINE_EXCEEDED:
        return Unavailable(f"palpated at {name} did not answer in time")
    if code == grpc.StatusCode.UNIMPLEMENTED:
        return Unavailable(f"{name} is not palpated, or one of another version")
    if code == grpc.StatusCode.UNAVAILABLE:
        return Unavailable(f"palpated at {name} is unavailable: {failed.details()}")
    for key, value in failed.trailing_metadata() or ():
        if key == "grpc-status-details-bin" and b"DISK_FULL" in value:
            return DiskFull(failed.details())
    return _KINDS.get(code, Internal)(failed.details())
