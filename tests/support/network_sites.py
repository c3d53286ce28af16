"""A hub and sites: network namespaces that are joined by slow links alone.

As root, or as a user where the kernel lets users make namespaces."""

import contextlib
import os
import subprocess

from slow_link import SlowLink


class Sites:
    """`hub` and `sites` are prefixes of commands that run there; `links` their SlowLinks. Site n
    reaches the hub at hub_address(n). delay_s: one way. A `with` block ends all."""

    def __init__(self, count, delay_s, loss):
        self._count, self._delay_s, self._loss = count, delay_s, loss
        self._holders = contextlib.ExitStack()
        self._cables = contextlib.ExitStack()
        self.sites, self.links = [], []

    @staticmethod
    def hub_address(site):
        return f"10.79.{site}.1"

    @staticmethod
    def site_address(site):
        return f"10.79.{site}.2"

    def __enter__(self):
        try:
            self._connect()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _connect(self):
        hub = self._hold(["unshare", *(["--map-root-user"] if os.geteuid() else []), "--net"])
        self.hub = self._enter(hub)
        for number in range(self._count):
            # Of the hub's owner, so that a link may lead there.
            site = self._hold([*self.hub, "unshare", "--net"])
            self.sites.append(self._enter(site))
            self.links.append(self._cables.enter_context(SlowLink(
                self.hub, site, f"link{number}",
                [f"{self.hub_address(number)}/24", f"{self.site_address(number)}/24"],
                self._delay_s, self._loss, seed=number)))

    def __exit__(self, *_):
        self._cables.close()
        self._holders.close()

    def _hold(self, command):
        """A process that keeps a namespace with loopback; its number."""
        holder = subprocess.Popen([*command, "sh", "-c", "ip link set lo up; echo $$; exec sleep 100000"],
                                  stdout=subprocess.PIPE, text=True)

        def end():
            holder.kill()
            holder.wait()
            holder.stdout.close()
        self._holders.callback(end)
        return int(holder.stdout.readline())

    def _enter(self, holder):
        user = ["--user", "--preserve-credentials"] if os.geteuid() else []
        return ["nsenter", "--target", str(holder), *user, "--net"]
