"""A connection to palpated."""

import collections.abc
import types

from palpate._activity import Activity, activity_of
from palpate._address import is_tcp, server_of_environment
from palpate._credentials import Credentials
from palpate._device import Device
from palpate._edits import Edits
from palpate._errors import Error, InvalidArgument
from palpate._facts import Facts, follow_facts
from palpate._html import numbers, table
from palpate._link import Link
from palpate._poses import PoseStream
from palpate._profiles import place_of_profile
from palpate._recording import Recording
from palpate._series import Series
from palpate._settings import Settings
from palpate._values import text_of
from palpate._volume import VolumeAccess
from palpate.v1 import activity_pb2, activity_pb2_grpc


class Connection:
    """A connection to palpated; connect() makes one. A `with` block closes it.

    Example: with palpate.connect() as conn: print(conn.volume.info().shape)
    If the daemon goes away, calls and streams raise Unavailable. When the daemon is back, calls
    and new streams of the same connection work again. Any thread.
    """

    def __init__(self, address: str | None, credentials: Credentials = Credentials(),
                 role: str | None = None) -> None:
        self._link = Link(address, credentials, role)
        try:
            self._link.check()
        except BaseException:
            self._link.close()
            raise
        self._settings = Settings(self._link)
        self._edit = Edits(self._link)
        self._volume = VolumeAccess(self._link)
        self._device = Device(self._link)
        self._series = Series(self._link)
        self._recording = Recording(self._link)
        self._activity = self._link.stub(activity_pb2_grpc.ActivityServiceStub)

    @property
    def address(self) -> str:
        """The address of palpated, for people, such as "unix:/run/palpate/palpated.sock"."""
        return self._link.name

    @property
    def settings(self) -> Settings:
        """The settings: isovalue, stiffness, effects. See help(palpate.Settings).

        Example: conn.settings.stiffness_n_per_mm = 0.8
        """
        return self._settings

    @settings.setter
    def settings(self, value: object) -> None:
        raise AttributeError("set one of the settings, as in conn.settings.isovalue = 300")

    @property
    def edit(self) -> Edits:
        """Changes of the volume's voxels. See help(palpate.Edits).

        Example: conn.edit.sphere((10, -4, 52), 3.0, "set", -1000)
        """
        return self._edit

    @property
    def volume(self) -> VolumeAccess:
        """The volume under the stylus: load, upload, download, save, place, follow.

        See help(palpate.VolumeAccess). Example: conn.volume.load("/data/head.nrrd")
        """
        return self._volume

    @property
    def device(self) -> Device:
        """The device and its forces. See help(palpate.Device).

        Example: conn.device.stop()
        """
        return self._device

    @property
    def series(self) -> Series:
        """Time series. See help(palpate.Series).

        Example: conn.series.load("/data/heart-*.nrrd")
        """
        return self._series

    @property
    def recording(self) -> Recording:
        """Recordings on the daemon's machine: make them, and replay them.

        See help(palpate.Recording). Example: conn.recording.start("/data/trial-7.mcap")
        """
        return self._recording

    def activity(self) -> Activity:
        """Returns who is connected, and who changed what last.

        Errors: Unavailable. See help(palpate.Activity).
        Example: [caller.identity for caller in conn.activity().callers]
        """
        return activity_of(self._link.call(self._activity.GetActivity,
                                           activity_pb2.GetActivityRequest()))

    def end_caller(self, identity: str) -> int:
        """Ends all calls of an identity, such as "token ada". Returns how many ran.

        Its next calls are not refused: that is its door's part.

        Errors: PermissionDenied (needs the role admin), Unavailable.
        """
        return self._link.call(self._activity.EndCaller,
                               activity_pb2.EndCallerRequest(identity=identity)).ended_calls

    def facts(self) -> collections.abc.Iterator[Facts]:
        """Follows what is true of the daemon, as an endless iterator of Facts.

        The first has all of now. Each later one comes when something is new, at least once a
        second, with all that is known then. A slow loop skips what was overtaken. Asks nothing
        meanwhile.
        Errors: in the iteration Unavailable (the daemon went away, or gives us another role),
        TooLarge (too many streams).
        Example: for facts in conn.facts(): print(facts.settings["isovalue"])
        """
        return follow_facts(self._link)

    def poses(self, rate_hz: float = 60.0, batch: int = 1, *, waiting: int = 1) -> PoseStream:
        """Streams what the servo computes, as an endless iterator of Poses.

        rate_hz: samples per second of loop time, above 0 to 1000; one tick in
        round(1000 / rate_hz) is sampled.
        batch: samples per Poses, 1 to 256; above 200 Hz choose 8 or more.
        waiting: the most batches that wait if your loop is slower than the stream, at least 1.
        With 1, the loop always gets the newest batch; Poses.dropped_samples counts the samples in
        between. Choose a larger number to get every sample in spite of pauses.
        Errors: InvalidArgument (at the call); in the iteration TooLarge (all streams together ask
        for more samples than the daemon sends), Unavailable (the daemon went away).
        Example: poses = next(conn.poses(rate_hz=1000, batch=50))
        """
        return PoseStream(self._link, rate_hz, batch, waiting)

    def close(self) -> None:
        """Closes the connection. Its calls and streams raise Unavailable from then on.

        Closing twice is no error. Example: conn.close()
        """
        self._link.close()

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: types.TracebackType | None) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<palpate connection to {self.address}>"

    def _repr_html_(self) -> str:
        rows: list[tuple[str, object]] = [("palpated at", self.address)]
        try:
            device, volume = self._device.info(), self._volume.info()
        except Error as failed:
            # A notebook that shows an old connection must not raise an exception.
            return table("palpate connection", [*rows, ("not reached", failed)])
        rows += [("version", device.version), ("device", device.model),
                 ("forces", f"{device.forces.state} ({device.forces.reason})"),
                 ("volume", volume.source), ("voxels", numbers(volume.shape)),
                 ("revision", volume.volume_revision)]
        return table("palpate connection", rows)


def connect(address: str | None = None, *, profile: str | None = None,
            tls_ca: str | None = None, tls_cert: str | None = None, tls_key: str | None = None,
            token_file: str | None = None, role: str | None = None) -> Connection:
    """Connects to palpated.

    address: path of a Unix socket, with a slash in it, or "HOST:PORT". None: $PALPATE_SERVER
    (HOST:PORT), or else the default socket of the daemon and all clients: $PALPATE_SOCKET,
    /run/palpate/palpated.sock, or the user's own.
    role: "viewer", "editor", "operator" or "admin", as in Role: the socket of this role beside that
    socket. None: the highest that this program may open.
    profile: a name in $XDG_CONFIG_HOME/palpate/clients.toml (~/.config/palpate/clients.toml),
    instead of all other arguments; profiles() lists the names. A profile is complete: no
    environment variable adds to it.

    Over TCP, TLS is used if tls_ca or tls_cert is given. A socket uses none of these:
    tls_ca: the daemon's certificate authority, PEM; None: $PALPATE_TLS_CA, or the system's.
    tls_cert, tls_key: our certificate and its key, PEM.
    token_file: a file with a token; None: $PALPATE_TOKEN_FILE, if TLS is used. A token is never
    sent without TLS. If all accounts may read the file, there is a UserWarning.

    Errors: Unavailable (no palpated there), PermissionDenied (the socket; or palpated does not
    know us), InvalidArgument, NotFound (a file, a profile).
    Example: conn = palpate.connect("lab.example:7400", tls_ca="lab-ca.pem", token_file="me.token")
    """
    if address is not None:
        text_of("address", address)
    credentials = Credentials(tls_ca, tls_cert, tls_key, token_file)
    if profile is not None:
        if address is not None or role is not None or credentials != Credentials():
            raise InvalidArgument("a profile is whole: give the profile alone, or no profile")
        return Connection(*place_of_profile(profile))
    if address is None and role is None:
        address = server_of_environment()
    if address is not None and is_tcp(address):
        credentials = credentials.with_environment()
    return Connection(address, credentials, role)
