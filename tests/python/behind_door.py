"""A palpated behind palpate-door."""

import contextlib
import os
import pathlib
import socket
import subprocess
import tempfile
import threading

from authority import Authority
from free_port import free_port
from secured import ROLES, SecuredDaemon, wait_for
from support import DOOR, PALPATE, PATIENCE_S, Daemon


class DaemonBehindDoor(SecuredDaemon):
    """With a door on a port, tokens of every role, and certificates of two names; their files are
    in the folder `security`, and what the door keeps in `door`. `more`: lines of palpated's
    configuration."""

    def __init__(self, more="", volume="builtin:sphere:48", host="127.0.0.1"):
        self.security = pathlib.Path(tempfile.mkdtemp(prefix="palpate-security-"))
        self.authority = Authority(self.security, "lab")
        self.certificate, self.key = self.authority.issue(
            "server", "DNS:localhost,IP:127.0.0.1", purpose="serverAuth")
        self.door = self.security / "door"
        self.door.mkdir()
        (self.door / "door.toml").write_text(
            f'certificate = "{self.certificate}"\nkey = "{self.key}"\n'
            f'client_ca = "{self.authority.ca}"\n')
        self.tokens = {role: self.add_token(role, role) for role in ROLES}
        for name, role in (("viewer.lab.example", "viewer"), ("spiffe://lab/operator", "operator")):
            self.run_door("add", name, "--role", role, "--certificate")
        self.config = self.security / "palpated.toml"
        self.config.write_text(more)
        Daemon.__init__(self, volume, more=["--config", str(self.config)])
        self.port = free_port()
        self.address = f"localhost:{self.port}"
        self.open_door(f"{host}:{self.port}")

    def open_door(self, listen):
        self.nginx = subprocess.Popen(
            [DOOR, "--folder", self.door, "run", "--listen", listen, "--socket", self.socket],
            stderr=subprocess.PIPE, text=True)
        self._door_reader = threading.Thread(
            target=lambda lines, said: said.extend(iter(lines.readline, "")),
            args=(self.nginx.stderr, self.said), daemon=True)
        self._door_reader.start()
        wait_for(lambda: self.nginx.poll() is not None or self.is_open(), "the door")

    def is_open(self):
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port)).close()
            return True

    def close_door(self):
        self.nginx.terminate()
        self.nginx.wait(PATIENCE_S)
        self._door_reader.join(PATIENCE_S)
        self.nginx.stderr.close()

    def __exit__(self, *error):
        self.close_door()
        super().__exit__(*error)

    def run_door(self, *arguments):
        path = os.path.dirname(PALPATE) + ":" + os.environ["PATH"]
        return subprocess.run([DOOR, "--folder", self.door, *arguments], check=True,
                              capture_output=True, text=True,
                              env={**os.environ, "PATH": path}).stdout

    def add_token(self, name, role):
        path = self.security / f"{name}.token"
        path.write_text(self.run_door("add", name, "--role", role))
        path.chmod(0o600)
        return path

    def revoke_token(self, name):
        self.run_door("revoke", name, "--socket", self.socket)
