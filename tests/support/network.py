"""Two machines on one cable: network namespaces of their own, without the network of this machine.

As root, or as a user where the kernel lets users make namespaces.
"""

import os
import subprocess


class Network:
    """`server` and `client` are prefixes of commands that run there. A `with` block ends both."""

    SERVER = "10.78.0.1"
    # Also the server's.
    SERVER_TOO = "10.78.0.2"

    def __enter__(self):
        self._holders = []
        try:
            self._connect()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _connect(self):
        new = ["unshare", *(["--map-root-user"] if os.geteuid() else []), "--net"]
        self._user = ["--user", "--preserve-credentials"] if os.geteuid() else []
        server = self._hold(new)
        self.server = self._enter(server)
        # Of the same owner, so that a cable may lead there.
        client = self._hold([*self.server, "unshare", "--net"])
        self.client = self._enter(client)
        for command in (
                [*self.server, "ip", "link", "add", "cable", "type", "veth", "peer", "name", "cable",
                 "netns", str(client)],
                [*self.server, "ip", "address", "add", f"{self.SERVER}/24", "dev", "cable"],
                [*self.server, "ip", "address", "add", f"{self.SERVER_TOO}/24", "dev", "cable"],
                [*self.client, "ip", "address", "add", "10.78.0.9/24", "dev", "cable"],
                *([*there, "ip", "link", "set", link, "up"]
                  for there in (self.server, self.client) for link in ("lo", "cable"))):
            subprocess.run(command, check=True)

    def __exit__(self, *_):
        for holder in self._holders:
            holder.kill()
            holder.wait()
            holder.stdout.close()

    def _hold(self, command):
        """A process that keeps a namespace; its number."""
        holder = subprocess.Popen([*command, "sh", "-c", "echo $$; exec sleep 100000"],
                                  stdout=subprocess.PIPE, text=True)
        self._holders.append(holder)
        return int(holder.stdout.readline())

    def _enter(self, holder):
        return ["nsenter", "--target", str(holder), *self._user, "--net"]
