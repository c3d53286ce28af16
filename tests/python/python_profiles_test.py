"""Where palpated is, by profile, variable and argument; and what says why it is not reached."""

import contextlib
import os
import pathlib
import socket
import tempfile
import unittest
import unittest.mock
import warnings

import palpate
from palpate._unreached import why_unreached
from authority import Authority
from free_port import free_port
from secured import SecuredDaemon, wait_for
from support import Daemon

VARIABLES = ("PALPATE_SERVER", "PALPATE_SOCKET", "PALPATE_TLS_CA", "PALPATE_TOKEN_FILE",
             "XDG_CONFIG_HOME")


class PlacesTest(unittest.TestCase):
    """With a folder for clients.toml, and none of the variables but those of set()."""

    def setUp(self):
        self.home = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(prefix="palpate-profiles-")))
        self.enterContext(unittest.mock.patch.dict(os.environ))
        for name in VARIABLES:
            os.environ.pop(name, None)
        self.set(XDG_CONFIG_HOME=self.home)
        self.file = self.home / "palpate/clients.toml"
        self.file.parent.mkdir()

    def set(self, **variables):
        os.environ.update({name: str(value) for name, value in variables.items()})

    def refused(self, kind, parts, *arguments, **named):
        """By a line that names these."""
        with self.assertRaises(kind) as caught:
            palpate.connect(*arguments, **named).close()
        for part in [parts] if isinstance(parts, str) else parts:
            self.assertIn(part, str(caught.exception))
        self.assertNotIn("\n", str(caught.exception))


class Files(PlacesTest):
    def test_no_file(self):
        self.assertEqual(palpate.profiles(), {})
        self.refused(palpate.NotFound, [str(self.file), "[lab]"], profile="lab")
        self.file.parent.rmdir()
        self.assertEqual(palpate.profiles(), {})
        # Below what is no folder.
        self.file.parent.write_text("")
        self.assertEqual(palpate.profiles(), {})

    def test_an_unknown_profile_names_those_that_are_there(self):
        self.file.write_text('stray = 1\n[b]\nserver = "h:1"\n[a]\nserver = 7\n')
        self.refused(palpate.NotFound, [str(self.file), "'x'", "a, b"], profile="x")
        self.refused(palpate.NotFound, '["a.x"]', profile="a.x")

    def test_the_list(self):
        self.file.write_text('[two]\nsocket = "deep/p.sock"\n[one]\nserver = "lab-1.example:7400"\n'
                             'tls_ca = "no-such.pem"\n[bad]\n["with.dot"]\nserver = "[::1]:7"\n')
        found = palpate.profiles()
        self.assertEqual(list(found), ["bad", "one", "two", "with.dot"])
        self.assertEqual({name: held.address for name, held in found.items()},
                         {"bad": "", "one": "lab-1.example:7400", "with.dot": "[::1]:7",
                          "two": str(self.file.parent / "deep/p.sock")})
        self.assertEqual([name for name, held in found.items() if held.problem], ["bad"])
        with self.assertRaises(AttributeError):
            found["one"].address = "other:1"

    def test_what_is_wrong_is_one_line_with_the_file_and_the_profile(self):
        server = 'server = "h:1"\n'
        for text, what in (
                ("", "socket"), (server + 'socket = "s"\n', "socket"),
                ('tls_ca = "ca.pem"\n', "server"), (server + 'tls_cat = "x"\n', "tls_cat"),
                (server + "[lab.more]\n", "more"), ("server = 7400\n", "server"),
                (server + "tls_ca = true\n", "tls_ca"), ('server = ""\n', "server"),
                ('server = "h"\n', "HOST:PORT"), ('server = "/run/p.sock"\n', "HOST:PORT"),
                ('server = "h:99999"\n', "HOST:PORT"), ('socket = "a b"\n', "socket"),
                ('socket = "a\\nb"\n', "socket"), (server + 'tls_cert = "c"\n', "key"),
                (server + 'token_file = "t"\n', "TLS"),
                ('socket = "s"\ntls_ca = "c"\n', "HOST:PORT")):
            with self.subTest(text):
                self.file.write_text("[lab]\n" + text)
                self.refused(palpate.InvalidArgument, [str(self.file), "'lab'", what],
                             profile="lab")
        # No table at all.
        self.file.write_text('lab = "h:1"\n')
        self.refused(palpate.InvalidArgument, "[lab]", profile="lab")
        self.assertEqual(palpate.profiles(), {})

    def test_what_is_not_toml_or_cannot_be_read(self):
        for text in (b'[lab]\nserver = "h:1\n', b"[lab]\n\xff = 1\n", b"[lab]\n[lab]\n",
                     b"a = " + b"[" * 100_000):
            self.file.write_bytes(text)
            self.refused(palpate.InvalidArgument, [str(self.file), "TOML", "'lab'"], profile="lab")
            self.assertRaises(palpate.InvalidArgument, palpate.profiles)
        self.file.unlink()
        self.file.mkdir()
        self.refused(palpate.NotFound, "clients.toml", profile="lab")

    def test_names(self):
        name = "aZ09._-" + "x" * 57
        self.file.write_text(f'["{name}"]\nserver = "h"\n')
        self.refused(palpate.InvalidArgument, "HOST:PORT", profile=name)
        for wrong in ("", "x" * 65, "a b", "a\nb", "é", "a/b", 7):
            self.refused(palpate.InvalidArgument, "letters", profile=wrong)

    def test_only_the_wanted_profile_must_be_right(self):
        path = self.home / "none.sock"
        self.file.write_text(f'stray = 1\n[bad]\nserver = 1\n[good]\nsocket = "{path}"\n')
        self.refused(palpate.Unavailable, str(path), profile="good")

    def test_a_profile_comes_alone(self):
        self.file.write_text('[lab]\nserver = "localhost:1"\n')
        for more in ({"address": "localhost:1"}, {"tls_ca": "c"}, {"tls_cert": "c"},
                     {"tls_key": "k"}, {"token_file": "t"}):
            self.refused(palpate.InvalidArgument, "profile", profile="lab", **more)

    def test_the_folder_of_the_file(self):
        below = self.home / ".config/palpate"
        below.mkdir(parents=True)
        (below / "clients.toml").write_text('[usual]\nserver = "h:1"\n')
        self.set(HOME=self.home)
        for folder in ("", "relative", None):
            if folder is None:
                del os.environ["XDG_CONFIG_HOME"]
            else:
                self.set(XDG_CONFIG_HOME=folder)
            self.assertEqual(list(palpate.profiles()), ["usual"])


class Plain(PlacesTest):
    def test_sockets_and_servers(self):
        port = free_port()
        with Daemon(listen=f"127.0.0.1:{port}") as daemon:
            relative = os.path.relpath(daemon.socket, self.file.parent)
            self.file.write_text(f'[near]\nsocket = "{relative}"\n'
                                 f'[tcp]\nserver = "localhost:{port}"\n')
            # A profile is whole: none of these adds to it.
            nowhere = self.home / "nowhere"
            self.set(PALPATE_SERVER="localhost:1", PALPATE_SOCKET=nowhere, PALPATE_TLS_CA=nowhere,
                     PALPATE_TOKEN_FILE=nowhere)
            for profile, address in (("near", f"unix:{daemon.socket}"),
                                     ("tcp", f"localhost:{port}")):
                with palpate.connect(profile=profile) as conn:
                    self.assertEqual(conn.address, address)
            # A socket has no use for the variables of TLS.
            for path in (daemon.socket, os.path.relpath(daemon.socket)):
                palpate.connect(path).close()
            self.set(PALPATE_SERVER="", PALPATE_SOCKET=daemon.socket)
            with palpate.connect() as conn:
                self.assertEqual(conn.address, f"unix:{daemon.socket}")
            self.set(PALPATE_SERVER=f"localhost:{port}", PALPATE_SOCKET=nowhere, PALPATE_TLS_CA="")
            with palpate.connect() as conn:
                self.assertEqual(conn.address, f"localhost:{port}")
                self.assertEqual(conn.volume.download().values.shape, (48, 48, 48))
                self.check_relative_paths_are_refused(conn)

    def test_relative_paths_are_those_of_our_folder(self):
        # Over a socket the daemon is on this machine, with another current folder.
        with Daemon() as daemon, daemon.connect() as conn:
            here = daemon.folder / "here"
            here.mkdir()
            self.enterContext(contextlib.chdir(here))
            conn.volume.save("a.nrrd")
            conn.volume.save(pathlib.Path("../here/b.nrrd"))
            self.assertEqual(sorted(path.name for path in here.iterdir()), ["a.nrrd", "b.nrrd"])
            self.assertEqual(conn.volume.load("a.nrrd").source, str(here / "a.nrrd"))
            self.assertEqual(conn.series.load("?.nrrd").frames, 2)
            conn.recording.start("c.mcap")
            self.assertEqual(conn.recording.stop().path, str(here / "c.mcap"))
            for call in (conn.volume.load, conn.volume.save, conn.recording.start,
                         conn.series.load):
                with self.assertRaises(palpate.InvalidArgument):
                    call("")

    def check_relative_paths_are_refused(self, conn):
        for call in (conn.volume.load, conn.volume.save, conn.recording.start, conn.series.load):
            with self.assertRaisesRegex(palpate.InvalidArgument, "a.nrrd"):
                call("a.nrrd")
        # A builtin volume is no path: it is asked for, and refused to who only watches.
        with self.assertRaises(palpate.PermissionDenied):
            conn.volume.load("builtin:sphere:16")

    def test_a_server_that_is_none(self):
        for server in ("localhost", "/run/palpate/palpated.sock", "localhost:x", " "):
            self.set(PALPATE_SERVER=server)
            self.refused(palpate.InvalidArgument, ["$PALPATE_SERVER", "HOST:PORT"])

    def test_nothing_listens(self):
        address = f"localhost:{free_port()}"
        for more in ({}, {"tls_ca": str(Authority(self.home, "lab").ca)}):
            self.refused(palpate.Unavailable, address, address, **more)

    def test_what_grpc_says_becomes_a_reason(self):
        # Its own line, without the wait for a name server.
        said = why_unreached("nobody.invalid:7400",
                             "DNS resolution failed for nobody.invalid:7400: C-ares status is not "
                             "ARES_SUCCESS", has_tls=False, ca_file=None)
        self.assertIn("nobody.invalid", said)
        self.assertNotIn("ARES", said)
        # gRPC tells of the last address of the host only: another one refused us.
        with socket.create_server(("127.0.0.1", 0)) as server:
            said = why_unreached(f"localhost:{server.getsockname()[1]}",
                                 "ipv6:[::1]:7: Connection refused", has_tls=True, ca_file="ca.pem")
        self.assertIn("its certificate", said)


class Secured(PlacesTest):
    @classmethod
    def setUpClass(cls):
        # Every address of the machine: the certificate does not name them all.
        cls.daemon = cls.enterClassContext(SecuredDaemon(host="0.0.0.0"))
        cls.ca = str(cls.daemon.authority.ca)
        cls.viewer = str(cls.daemon.tokens["viewer"])
        for token in cls.daemon.tokens.values():
            token.chmod(0o600)

    def test_profiles(self):
        for path in (self.daemon.authority.ca, self.daemon.tokens["viewer"],
                     *self.daemon.authority.issue("operator", "URI:spiffe://lab/operator")):
            (self.file.parent / path.name).symlink_to(path)
        server = f'server = "{self.daemon.address}"\ntls_ca = "lab-ca.pem"\n'
        self.file.write_text(f'[token]\n{server}token_file = "viewer.token"\n[alone]\n{server}'
                             f'[certificate]\n{server}tls_cert = "operator.pem"\n'
                             'tls_key = "operator.key"\n')
        # Not used, nor looked at.
        self.set(PALPATE_TOKEN_FILE=self.home / "none", PALPATE_TLS_CA=self.home / "none")
        with palpate.connect(profile="token") as conn:
            with self.assertRaises(palpate.PermissionDenied):
                conn.settings.stiffness_n_per_mm = 0.4
        with palpate.connect(profile="certificate") as conn:
            conn.settings.stiffness_n_per_mm = 0.4
        self.set(PALPATE_TOKEN_FILE=self.viewer)
        self.refused(palpate.PermissionDenied, "token", profile="alone")

    def test_variables(self):
        self.set(PALPATE_TLS_CA=self.ca)
        self.refused(palpate.PermissionDenied, "token", self.daemon.address)
        palpate.connect(self.daemon.address, token_file=self.viewer).close()
        self.set(PALPATE_TOKEN_FILE=self.viewer)
        palpate.connect(self.daemon.address).close()
        self.set(PALPATE_SERVER=self.daemon.address)
        palpate.connect().close()
        # An argument goes before its variable.
        self.set(PALPATE_TLS_CA=self.home / "none", PALPATE_TOKEN_FILE=self.home / "none")
        palpate.connect(tls_ca=self.ca, token_file=self.viewer).close()
        self.refused(palpate.NotFound, str(self.home / "none"))
        self.set(PALPATE_TLS_CA="")
        self.refused(palpate.Unavailable, "TLS")

    def test_who_is_refused_is_told_why(self):
        other = str(Authority(self.home, "other").ca)
        certificate, key = self.daemon.authority.issue("c", "DNS:viewer.lab.example")
        old_certificate, old_key = self.daemon.authority.issue("old", "DNS:viewer.lab.example",
                                                               days=-1)
        wrong = self.home / "wrong.token"
        wrong.write_text("palpate_" + "A" * 43)
        wrong.chmod(0o600)
        here = self.daemon.address
        for kind, parts, address, given in (
                # It does not prove itself: another authority, the machine's, another host.
                (palpate.Unavailable, [other, "tls_ca"], here, {"tls_ca": other}),
                (palpate.Unavailable, "authority", here, {"tls_cert": certificate, "tls_key": key}),
                (palpate.Unavailable, "127.0.0.2", f"127.0.0.2:{self.daemon.port}",
                 {"tls_ca": self.ca}),
                # It does not know us.
                (palpate.PermissionDenied, ["expired", "operator"], here,
                 {"tls_ca": self.ca, "tls_cert": old_certificate, "tls_key": old_key}),
                (palpate.PermissionDenied, ["unknown", "operator"], here,
                 {"tls_ca": self.ca, "token_file": wrong}),
                # Ours cannot be used.
                (palpate.InvalidArgument, "PRIVATE KEY", here,
                 {"tls_ca": self.ca, "tls_cert": certificate, "tls_key": certificate}),
                (palpate.InvalidArgument, "TLS", here, {"token_file": self.viewer})):
            with self.subTest(parts):
                self.refused(kind, parts, address,
                             **{name: str(value) for name, value in given.items()})
        with Daemon(listen=f"127.0.0.1:{(port := free_port())}"):
            self.refused(palpate.Unavailable, "TLS", f"localhost:{port}", tls_ca=self.ca)

    def test_a_token_that_others_may_read_is_warned_of(self):
        os.chmod(self.viewer, 0o644)
        with self.assertWarns(UserWarning) as warned:
            palpate.connect(self.daemon.address, tls_ca=self.ca, token_file=self.viewer).close()
        self.assertEqual(warned.filename, __file__)
        os.chmod(self.viewer, 0o640)
        with warnings.catch_warnings(action="error"):
            palpate.connect(self.daemon.address, tls_ca=self.ca, token_file=self.viewer).close()

    def with_new_token(self, name, role):
        token = self.daemon.add_token(name, role)
        token.chmod(0o600)
        found = []

        def connects():
            with contextlib.suppress(palpate.PermissionDenied):
                found.append(palpate.connect(self.daemon.address, tls_ca=self.ca,
                                             token_file=str(token)))
            return found

        wait_for(connects, "the new token")
        return self.enterContext(found[0])

    def test_a_revoked_token_ends_streams_and_loads_with_the_reason(self):
        conn = self.with_new_token("leaver", "viewer")
        with conn.poses() as stream:
            next(stream)
            self.daemon.revoke_token("leaver")
            with self.assertRaisesRegex(palpate.PermissionDenied, "revoked") as ended:
                for _ in stream:
                    pass
        self.assertNotIn("\n", str(ended.exception))
        for call in (conn.device.info, conn.volume.download, lambda: next(conn.poses())):
            with self.assertRaisesRegex(palpate.PermissionDenied, "revoked"):
                call()

        begun = []

        def progress(*what):
            if not begun:
                self.daemon.revoke_token("loader")
            begun.append(what)

        # Not at the start of the call, but while it runs.
        conn = self.with_new_token("loader", "operator")
        with self.assertRaisesRegex(palpate.PermissionDenied, "revoked"):
            conn.volume.load("builtin:gyroid:512", progress=progress)
        self.assertTrue(begun)


if __name__ == "__main__":
    unittest.main()
