"""What goes wrong, by kind; the message is one line for people."""

import grpc


class Error(Exception):
    """Anything that palpated, or the way to it, answers with. str() is one line."""


class InvalidArgument(Error, ValueError):
    """A value out of range, a file that is no volume, a name that is unknown."""


class NotFound(Error):
    """No such file, folder or volume on the daemon's machine."""


class PermissionDenied(Error):
    """A socket that may not be used, a folder that the daemon keeps to itself."""


class TooLarge(Error):
    """More voxels or bytes than fit."""


class DiskFull(Error):
    """No space left where palpated was to write; what was there before is whole."""


class Conflict(Error):
    """Somebody else was first: another revision, a running load, an existing file."""


class FailedPrecondition(Error):
    """Not now: the message says what keeps it from being done."""


class Unavailable(Error, ConnectionError):
    """No palpated there, or not any more; or its servo does not run."""


class Cancelled(Error):
    """Ended by the daemon or by somebody else before it was done."""


class Internal(Error):
    """A fault of the daemon, or bytes that were damaged on their way."""


# As common/wire/status.h has them.
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
    """The error that a failed call to the daemon at `name` stands for."""
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
