"""The credentials with which client and daemon prove who they are."""

import dataclasses
import os
import re
import stat
import warnings

import grpc

from palpate._errors import InvalidArgument, NotFound

_CA_VARIABLE = "PALPATE_TLS_CA"
_TOKEN_FILE_VARIABLE = "PALPATE_TOKEN_FILE"


def _read(path: str) -> tuple[bytes, int]:
    """Returns the contents of the file and its mode."""
    try:
        with open(path, "rb") as file:
            return file.read(), os.fstat(file.fileno()).st_mode
    except OSError as error:
        raise NotFound(f"cannot read {path}: {error.strerror}") from None


def _read_pem(path: str | None, what: bytes) -> bytes | None:
    if path is None:
        return None
    text, _ = _read(path)
    # Checked here, because gRPC does not say what is wrong with a PEM file.
    if what + b"-----" not in text:
        raise InvalidArgument(f"{path} holds no {what.decode()} in PEM")
    return text


def _read_token(path: str) -> str:
    text, mode = _read(path)
    token = text.rstrip(b"\r\n")
    if not re.fullmatch(rb"[!-~]{1,128}", token):
        raise InvalidArgument(f"{path} holds no token: put into it the line that "
                              "'palpated token add' printed")
    if mode & stat.S_IROTH:
        # Reported at the line that called palpate.connect.
        warnings.warn(f"the token file {path} may be read by every account of this machine: "
                      "'chmod 600' it, and ask for a new token where others could have read this "
                      "one", stacklevel=6)
    return token.decode()


@dataclasses.dataclass(frozen=True)
class Credentials:
    """Paths of files; the rules are those of client/sdk/connection.h."""

    ca_file: str | None = None
    certificate_file: str | None = None
    key_file: str | None = None
    token_file: str | None = None

    @property
    def has_tls(self) -> bool:
        return self.ca_file is not None or self.certificate_file is not None

    def with_environment(self) -> "Credentials":
        """For HOST:PORT: takes absent values from $PALPATE_TLS_CA and $PALPATE_TOKEN_FILE; the
        token only if TLS is used."""
        ca_file = self.ca_file
        if ca_file is None:
            ca_file = os.environ.get(_CA_VARIABLE) or None
        completed = dataclasses.replace(self, ca_file=ca_file)
        if not completed.has_tls or self.token_file:
            return completed
        token_file = os.environ.get(_TOKEN_FILE_VARIABLE) or None
        return dataclasses.replace(completed, token_file=token_file)

    def check(self, is_tcp: bool) -> None:
        """Checks that the credentials fit together. Reads no file. Errors: InvalidArgument."""
        if (self.certificate_file is None) != (self.key_file is None):
            raise InvalidArgument("a certificate and its key come together: name both, or none")
        # Without TLS, others could read the token. Without the daemon's authority, another
        # server could pose as the daemon.
        if self.token_file is not None and not self.has_tls:
            raise InvalidArgument("a token is sent over TLS only: name the daemon's certificate "
                                  "authority too")
        if self.has_tls and not is_tcp:
            raise InvalidArgument("TLS is for HOST:PORT: the socket has its file mode as guard")

    def channel_credentials(self, is_tcp: bool) -> grpc.ChannelCredentials | None:
        """Returns None without TLS. Errors: NotFound, InvalidArgument."""
        self.check(is_tcp)
        if not self.has_tls:
            return None
        tls = grpc.ssl_channel_credentials(
            root_certificates=_read_pem(self.ca_file, b"CERTIFICATE"),
            private_key=_read_pem(self.key_file, b"PRIVATE KEY"),
            certificate_chain=_read_pem(self.certificate_file, b"CERTIFICATE"))
        if not self.token_file:
            return tls
        token = grpc.access_token_call_credentials(_read_token(self.token_file))
        return grpc.composite_channel_credentials(tls, token)
