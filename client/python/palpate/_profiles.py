"""Profiles: names for addresses of palpated, with their credentials.

The user's file clients.toml has the profiles for all clients.
"""

import dataclasses
import os
import re
import tomllib
import typing

from palpate._address import check_server, check_socket_path
from palpate._credentials import Credentials
from palpate._errors import InvalidArgument, NotFound

_FILES = ("tls_ca", "tls_cert", "tls_key", "token_file")
_KEYS = ("server", "socket", *_FILES)


@dataclasses.dataclass(frozen=True)
class Profile:
    """A profile of clients.toml.

    name: for connect(profile=name)
    address: HOST:PORT, or the path of a socket; empty if there is a problem
    problem: what is wrong with the profile and what to do; empty: nothing
    """

    name: str
    address: str
    problem: str


def profiles() -> dict[str, Profile]:
    """Returns the profiles of $XDG_CONFIG_HOME/palpate/clients.toml, by name; {}: no such file.

    Includes profiles that connect() would refuse; Profile.problem says why.
    Errors: InvalidArgument (the file is not TOML), NotFound (the file cannot be read).
    Example: print(palpate.profiles()["lab"].address)
    """
    path = _file()
    tables = _tables(path) or {}
    return {name: _profile_of(path, name, tables[name]) for name in _names(tables)}


def place_of_profile(name: str) -> tuple[str, Credentials]:
    """Returns the profile's address and credentials. Nothing must be added to them.

    Errors: NotFound (no such profile), InvalidArgument (a broken profile).
    """
    path = _file()
    if not isinstance(name, str) or not _is_name(name):
        raise InvalidArgument(f"{name!r} cannot be the name of a profile in {path}: choose 1 to 64 "
                              "letters, digits, '.', '_' or '-'")
    tables = _tables(path, wanted=name)
    if tables is None:
        raise NotFound(f"there is no {path} with the profile '{name}': write it, with the line "
                       f"{_header(name)} and below that server = \"HOST:PORT\" or socket = "
                       "\"PATH\"")
    if name not in tables:
        names = _names(tables)
        there = f"it has: {', '.join(names)}" if names else "it has none"
        raise NotFound(f"{path} has no profile '{name}'; {there}" +
                       (f"; its line would be {_header(name)}" if "." in name else ""))
    return _place_of(path, name, tables[name])


def _file() -> str:
    folder = os.environ.get("XDG_CONFIG_HOME", "")
    if not os.path.isabs(folder):
        folder = os.path.expanduser("~/.config")
    return os.path.join(folder, "palpate", "clients.toml")


def _is_name(name: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9._-]{1,64}", name) is not None


def _names(tables: dict[str, typing.Any]) -> list[str]:
    return sorted(name for name, held in tables.items()
                  if isinstance(held, dict) and _is_name(name))


def _header(name: str) -> str:
    # Without quotes, TOML reads a dot as a table within a table.
    return f'["{name}"]' if "." in name else f"[{name}]"


def _tables(path: str, wanted: str | None = None) -> dict[str, typing.Any] | None:
    """Returns the top level of the file; None: there is no such file."""
    try:
        with open(path, "rb") as file:
            return tomllib.load(file)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise NotFound(f"cannot read {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        what = "" if wanted is None else f", so that its profile '{wanted}' cannot be read"
        raise InvalidArgument(f"{path} is not TOML{what}: correct it: {error}") from None


def _profile_of(path: str, name: str, table: typing.Any) -> Profile:
    try:
        return Profile(name, _place_of(path, name, table)[0], "")
    except InvalidArgument as problem:
        return Profile(name, "", str(problem))


def _place_of(path: str, name: str, table: typing.Any) -> tuple[str, Credentials]:
    """Errors: InvalidArgument, with the path and the name."""
    try:
        _check(name, table)
        files = {key: os.path.join(os.path.dirname(path), table[key])
                 for key in ("socket", *_FILES) if key in table}
        address = table["server"] if "server" in table else files["socket"]
        if "server" in table:
            check_server(address)
        else:
            check_socket_path(address)
        credentials = Credentials(*(files.get(key) for key in _FILES))
        credentials.check(is_tcp="server" in table)
        return address, credentials
    except InvalidArgument as problem:
        raise InvalidArgument(f"{path}: profile '{name}': {problem}") from None


def _check(name: str, table: typing.Any) -> None:
    if not isinstance(table, dict):
        raise InvalidArgument(f"it is no table: write the line {_header(name)} and its keys below "
                              "that line")
    for key, value in table.items():
        if key not in _KEYS:
            raise InvalidArgument(f"there is no key {key!r}: use {', '.join(_KEYS)}")
        if not isinstance(value, str):
            raise InvalidArgument(f"{key} is no text: write {key} = \"...\"")
        if not value or any(letter < " " or letter == "\x7f" for letter in value):
            raise InvalidArgument(f"{key} is empty, or has characters that cannot be seen: write "
                                  "the address or path, or leave the key out")
    if ("server" in table) == ("socket" in table):
        raise InvalidArgument("name exactly one of server and socket")
