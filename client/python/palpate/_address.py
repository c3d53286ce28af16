"""The address of palpated. The rules are those of common/wire/address.h."""

import os
import re
import stat

from palpate._enums import Role
from palpate._errors import InvalidArgument, PermissionDenied, Unavailable

_SYSTEM_FOLDER = "/run/palpate"
_SOCKET_NAME = "palpated.sock"
_SERVER_VARIABLE = "PALPATE_SERVER"
# With a socket beside the usual one, highest first.
_LOWER_ROLES = (Role.OPERATOR, Role.EDITOR, Role.VIEWER)
# sockaddr_un holds 108 bytes with its NUL.
_MAX_SOCKET_PATH_BYTES = 107


def default_socket_path() -> str:
    """Returns $PALPATE_SOCKET, the system's socket, or the user's own."""
    if path := os.environ.get("PALPATE_SOCKET"):
        return path
    system = os.path.join(_SYSTEM_FOLDER, _SOCKET_NAME)
    if os.path.isdir(_SYSTEM_FOLDER) and (
            os.access(_SYSTEM_FOLDER, os.W_OK | os.X_OK) or
            os.access(_highest(system), os.W_OK)):
        return system
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return os.path.join(runtime, "palpate", _SOCKET_NAME)
    return os.path.join(_temporary_folder(), _SOCKET_NAME)


def _temporary_folder() -> str:
    # Any user may create a folder in /tmp. A folder that is not ours alone could be a trap.
    folder = f"/tmp/palpate-{os.getuid()}"
    try:
        info = os.lstat(folder)
    except FileNotFoundError:
        return folder
    if not stat.S_ISDIR(info.st_mode) or info.st_uid != os.getuid() or info.st_mode & 0o022:
        raise PermissionDenied(f"{folder} is not a folder that only you can write: remove it, or "
                               "name the socket")
    return folder


def server_of_environment() -> str | None:
    """Returns $PALPATE_SERVER, or None if unset. Errors: InvalidArgument (not HOST:PORT)."""
    server = os.environ.get(_SERVER_VARIABLE)
    if not server:
        return None
    try:
        check_server(server)
    except InvalidArgument as problem:
        raise InvalidArgument(f"${_SERVER_VARIABLE}: {problem}") from None
    return server


def is_tcp(address: str) -> bool:
    """A text with a slash is the path of a Unix socket, any other one is HOST:PORT."""
    return "/" not in address


def target_of(address: str | None, role: str | None = None) -> tuple[str, str]:
    """Returns a gRPC target and a name for people.

    address: None is the default socket. role: as connect()'s.
    """
    if address is not None and is_tcp(address):
        if role is not None:
            raise InvalidArgument("a role is for the sockets of this machine: over the network, the "
                                  "token has one")
        return _tcp_target(address)
    usual = check_socket_path(default_socket_path() if address is None else address)
    if role is None:
        return _unix_target(_highest(usual))
    if not any(known == role for known in Role):
        raise InvalidArgument(f"{role!r} is no role: use {', '.join(map(str, Role))}")
    return _unix_target(role_socket_path(usual, role))


def role_socket_path(usual: str, role: str) -> str:
    return usual if role == "admin" else beside(usual, str(role))


def beside(path: str, word: str) -> str:
    """Returns a-word.sock for a.sock, and a-word for a."""
    base, suffix = (path[:-5], ".sock") if path.endswith(".sock") else (path, "")
    return f"{base}-{word}{suffix}"


def usual_path(path: str) -> str:
    """The other way round for a role's socket; any other path stays."""
    for role in _LOWER_ROLES:
        for suffix in (".sock", ""):
            if path.endswith(end := f"-{role}{suffix}"):
                return path[:-len(end)] + suffix
    return path


def _highest(usual: str) -> str:
    paths = [usual, *(role_socket_path(usual, str(role)) for role in _LOWER_ROLES)]
    return next((path for path in paths if os.access(path, os.W_OK)), usual)


def check_socket_path(path: str) -> str:
    """Returns the absolute path. Errors: InvalidArgument (gRPC cannot use the path)."""
    absolute = os.path.abspath(path.removeprefix("unix:"))
    if len(os.fsencode(absolute)) > _MAX_SOCKET_PATH_BYTES:
        raise InvalidArgument(f"the path of a socket has at most {_MAX_SOCKET_PATH_BYTES} bytes: "
                              f"{absolute}")
    # gRPC decodes the path as a URI: only these characters mean themselves.
    if not re.fullmatch(r"[A-Za-z0-9/\-._~+=,:@]+", absolute):
        raise InvalidArgument("the path of a socket may hold letters, digits and /-._~+=,:@ only: "
                              f"{absolute}")
    return absolute


def _unix_target(path: str) -> tuple[str, str]:
    absolute = check_socket_path(path)
    name = "unix:" + absolute
    _check_socket(absolute, name)
    return name, name


def _check_socket(path: str, name: str) -> None:
    # gRPC reports all failures to connect alike. The socket's file tells the reason.
    try:
        info = os.stat(path)
    except PermissionError:
        raise PermissionDenied(f"no permission to use {name}") from None
    except OSError:
        raise Unavailable(f"no palpated at {name}: start it with 'palpated' or name its "
                          "socket") from None
    if not stat.S_ISSOCK(info.st_mode):
        raise Unavailable(f"{name} is not a socket: name palpated's socket")
    if not os.access(path, os.W_OK):
        raise PermissionDenied(f"no permission to use {name}: ask for membership of the group that "
                               "owns the socket")


def check_server(address: str) -> tuple[str, str]:
    """Returns host and port. Errors: InvalidArgument (not HOST:PORT)."""
    host_port = _host_and_port(address)
    if host_port is None:
        raise InvalidArgument(f"{address!r} is not HOST:PORT, as in localhost:7400")
    return host_port


def _host_and_port(address: str) -> tuple[str, str] | None:
    match = re.fullmatch(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._][A-Za-z0-9._-]{0,252}):([0-9]{1,5})",
                         address)
    if match is None or not 0 < int(match[2]) < 65536:
        return None
    return match[1], match[2]


def _tcp_target(address: str) -> tuple[str, str]:
    host_port = _host_and_port(address)
    if host_port is None:
        raise InvalidArgument(f"'{address}' is not an address: expected the path of a socket with "
                              "a slash in it, or HOST:PORT, as in localhost:7400")
    host, port = host_port
    if host.startswith("["):
        return f"ipv6:%5B{host[1:-1]}%5D:{port}", address
    # With the scheme, a host called "unix" is not taken for a scheme.
    return f"dns:///{address}", address
