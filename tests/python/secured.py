"""A palpated that is reached over TLS alone, and by its socket."""

import contextlib
import pathlib
import shutil
import socket
import ssl
import subprocess
import tempfile
import time

import grpc

from palpate.v1 import device_pb2, device_pb2_grpc
from authority import Authority
from free_port import free_port
from support import PALPATED, PATIENCE_S, Daemon, wait_until

ROLES = ["viewer", "editor", "operator", "admin"]


def wait_for(condition, what, patience_s=PATIENCE_S):
    if not wait_until(condition, patience_s):
        raise AssertionError(f"waited {patience_s} s for {what}")


def dawdle(stack, port):
    """Connections that say little: nothing, half of a ClientHello, something else, for
    TLS a handshake and no preface; each another byte now and then, for a second."""
    dawdlers = [stack.enter_context(socket.create_connection(("127.0.0.1", port)))
                for _ in range(60)]
    began = time.monotonic()
    for round_number in range(10):
        for n, dawdler in enumerate(dawdlers):
            text = (b"", b"\x16\x03\x01\x02\x00\x01" + bytes(10), b"GET / HTTP/1.1\r\n")[n % 3]
            with contextlib.suppress(OSError):
                dawdler.sendall(text[round_number:round_number + 1])
        time.sleep(max(0.0, began + 0.1 * (round_number + 1) - time.monotonic()))
    return dawdlers


def stop_forces(channel):
    return device_pb2_grpc.DeviceServiceStub(channel).StopForces(device_pb2.StopForcesRequest(),
                                                                 timeout=PATIENCE_S)


class SecuredDaemon(Daemon):
    """With TLS on a port, tokens of every role, and certificates of two names; their files are in
    the folder `security`. `more`: lines of its configuration."""

    def __init__(self, more="", volume="builtin:sphere:48", host="127.0.0.1"):
        self.security = pathlib.Path(tempfile.mkdtemp(prefix="palpate-security-"))
        self.authority = Authority(self.security, "lab")
        self.certificate, self.key = self.authority.issue(
            "server", "DNS:localhost,IP:127.0.0.1", purpose="serverAuth")
        self.token_file = self.security / "tokens.toml"
        self.tokens = {role: self.add_token(role, role) for role in ROLES}
        self.port = free_port()
        self.address = f"localhost:{self.port}"
        self.config = self.security / "palpated.toml"
        self.config.write_text(f"""
[tls]
certificate = "{self.certificate}"
key = "{self.key}"
client_ca = "{self.authority.ca}"
tokens = "{self.token_file}"
[[tls.client]]
san = "viewer.lab.example"
role = "viewer"
[[tls.client]]
san = "spiffe://lab/operator"
role = "operator"
{more}
""")
        super().__init__(volume, listen=f"{host}:{self.port}",
                         more=["--config", str(self.config)])

    def __exit__(self, *error):
        super().__exit__(*error)
        shutil.rmtree(self.security)

    def add_token(self, name, role):
        made = subprocess.run([PALPATED, "token", "add", name, "--role", role,
                               "--file", str(self.token_file)], check=True, capture_output=True,
                              text=True)
        path = self.security / f"{name}.token"
        path.write_text(made.stdout)
        path.chmod(0o600)
        return path

    def revoke_token(self, name):
        subprocess.run([PALPATED, "token", "revoke", name, "--file", str(self.token_file)],
                       check=True, capture_output=True)

    def channel(self, token=None, certificate=None, authority=None, options=()):
        """As a client that follows no rules of ours would make it."""
        key = None if certificate is None else certificate[1].read_bytes()
        chain = None if certificate is None else certificate[0].read_bytes()
        ca = (authority or self.authority).ca.read_bytes()
        tls = grpc.ssl_channel_credentials(ca, key, chain)
        if token is not None:
            tls = grpc.composite_channel_credentials(
                tls, grpc.access_token_call_credentials(token.read_text().strip()))
        return grpc.secure_channel(self.address, tls,
                                   options=[("grpc.enable_http_proxy", 0), *options])

    def tls(self):
        """Of a client of HTTP/2 that is no library."""
        context = ssl.create_default_context(cafile=str(self.authority.ca))
        context.set_alpn_protocols(["h2"])
        return context

    def local_channel(self):
        return grpc.insecure_channel(f"unix:{self.socket}")

    def ticks(self):
        with self.local_channel() as channel:
            stub = device_pb2_grpc.DeviceServiceStub(channel)
            return stub.GetDevice(device_pb2.GetDeviceRequest(), timeout=PATIENCE_S).servo.ticks
