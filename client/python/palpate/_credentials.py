"""How a client proves who it is, and the daemon that it is the daemon."""

import dataclasses
import os
import re
import stat
import warnings

import grpc

from palpate._errors import InvalidArgument, NotFound

_TOKEN_FILE_VARIABLE = "PALPATE_TOKEN_FILE"


def _read(path: str) -> tuple[bytes, int]:
    """What the file holds, and its mode."""
    try:
        with open(path, "rb") as file:
            return file.read(), os.fstat(file.fileno()).st_mode
    except OSError as error:
        raise NotFound(f"cannot read {path}: {error.strerror}") from None


def _read_pem(path: str | None, what: bytes) -> bytes | None:
    if path is None:
        return None
    text, _ = _read(path)
    # gRPC says nothing of what is wrong with such a text.
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
        # At the caller of palpate.connect.
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

    def channel_credentials(self, is_tcp: bool) -> grpc.ChannelCredentials | None:
        """None: without TLS. Errors: NotFound, InvalidArgument."""
        has_tls = self.ca_file is not None or self.certificate_file is not None
        if (self.certificate_file is None) != (self.key_file is None):
            raise InvalidArgument("a certificate and its key come together: name both, or none")
        # Without TLS others could read it, and without the daemon's authority anybody
        # could pose as the daemon.
        if self.token_file is not None and not has_tls:
            raise InvalidArgument("a token is sent over TLS only: name the daemon's certificate "
                                  "authority too")
        if not has_tls:
            return None
        if not is_tcp:
            raise InvalidArgument("TLS is for HOST:PORT: the socket has its file mode as guard")
        tls = grpc.ssl_channel_credentials(
            root_certificates=_read_pem(self.ca_file, b"CERTIFICATE"),
            private_key=_read_pem(self.key_file, b"PRIVATE KEY"),
            certificate_chain=_read_pem(self.certificate_file, b"CERTIFICATE"))
        token_file = self.token_file or os.environ.get(_TOKEN_FILE_VARIABLE)
        if not token_file:
            return tls
        token = grpc.access_token_call_credentials(_read_token(token_file))
        return grpc.composite_channel_credentials(tls, token)
