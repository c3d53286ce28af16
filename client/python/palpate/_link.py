"""One channel to palpated, with its errors and its acknowledged streams."""

import collections.abc
import logging
import os
import queue
import time
import typing

import grpc

from palpate._address import target_of
from palpate._credentials import Credentials
from palpate._errors import (Error, FailedPrecondition, InvalidArgument, Unavailable, error_of,
                             is_loading, is_stalled, was_not_sent)
from palpate._unreached import why_unreached
from palpate._values import path_text
from palpate.v1 import device_pb2, device_pb2_grpc

_CONNECT_TIMEOUT_S = 3.0
CALL_TIMEOUT_S = 30.0
_SMALL_BYTES = 32 << 10
# A palpated that is just being started is there by then.
_START_S = 2.0
_THIS_MACHINE = ("localhost", "127.0.0.1", "[::1]", "::1")
_LOADING_PAUSE_S = 0.2
_SAY_LOADING_S = 5.0
_GREET_AGAIN_S = 300.0

# Longer than gRPC's pause between two attempts to connect. See _is_back().
_BACK_S = 0.5

_OPTIONS = [
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 300),
    # A proxy for web pages must not carry haptic streams.
    ("grpc.enable_http_proxy", 0),
]
# Finds within 4 s that the network is gone, and ends the calls. client/sdk/channel.cpp has the same.
_NETWORK_OPTIONS = _OPTIONS + [
    ("grpc.keepalive_time_ms", 1000),
    ("grpc.keepalive_timeout_ms", 2500),
    ("grpc.keepalive_permit_without_calls", 1),
    ("grpc.http2.max_pings_without_data", 0),
]


_LOG = logging.getLogger("palpate")


def forget_in_child(running: set[typing.Any]) -> None:
    """Empties the set in a forked child: threads of the parent do not run there."""
    if hasattr(os, "register_at_fork"):  # not on Windows, which does not fork
        os.register_at_fork(after_in_child=running.clear)


class Link:
    """A channel. Any thread may call. close() ends the running calls."""

    def __init__(self, address: str | None, credentials: Credentials,
                 role: str | None = None) -> None:
        target, self.name = target_of(address, role)
        self._is_local = target == self.name
        self._credentials = credentials
        tls = credentials.channel_credentials(is_tcp=not self._is_local)
        options = _OPTIONS if self._is_local else _NETWORK_OPTIONS
        # Each with a connection of its own.
        self._channel, self._stop_channel = (
            grpc.insecure_channel(target, options=options) if tls is None else
            grpc.secure_channel(target, tls, options=options) for _ in range(2))
        self._is_open = True
        self._pid = os.getpid()
        self._greeted = -_GREET_AGAIN_S
        self._greeting: typing.Any = None
        self._said = 0.0  # when it was last said that palpated loads its first volume

    def stub(self, kind: typing.Any) -> typing.Any:
        """Returns a generated stub for calls through this class."""
        return kind(self._channel)

    def stop_stub(self, kind: typing.Any) -> typing.Any:
        """As stub(), on a connection for the emergency stop alone."""
        return kind(self._stop_channel)

    @property
    def socket_path(self) -> str:
        """Empty over TCP."""
        return self.name.removeprefix("unix:") if self._is_local else ""

    def close(self) -> None:
        self._is_open = False
        if os.getpid() == self._pid:  # a forked child would close the parent's connection
            self._channel.close()
            self._stop_channel.close()

    def path(self, path: str | os.PathLike[str]) -> str:
        """Returns a path for the daemon, whose current folder is not ours.

        Errors: InvalidArgument (empty; or relative, and the daemon may be on another machine).
        """
        text = path_text(path)
        if os.path.isabs(text):
            return text
        if not self._is_local:
            raise InvalidArgument(f"{text!r} is a relative path, and palpated at {self.name} may "
                                  "be on another machine: give the absolute path there")
        return os.path.join(os.getcwd(), text)

    def check(self) -> None:
        """Checks with a first call that palpated answers."""
        is_here = self._is_local or self.name.rpartition(":")[0] in _THIS_MACHINE
        started_by = time.monotonic() + (_START_S if is_here else 0.0)
        while True:
            try:
                self._greet()
                return self._connect_stop()
            except grpc.RpcError as failed:
                error = self._connect_error(failed)
                if not isinstance(error, Unavailable) or time.monotonic() > started_by:
                    raise error from None
            time.sleep(0.05)

    def _greet(self) -> None:
        """Makes a cheap call that every client may make."""
        stub = self.stub(device_pb2_grpc.DeviceServiceStub)
        stub.GetDevice(device_pb2.GetDeviceRequest(), timeout=_CONNECT_TIMEOUT_S)

    def _connect_stop(self) -> None:
        """Over the network, begins to connect the stop's connection, and keeps it from being idle.

        Until its first call, palpated takes a connection for a stranger's; and it closes one
        without a call for ten minutes.
        """
        now = time.monotonic()
        if self._is_local or now - self._greeted < _GREET_AGAIN_S:
            return
        self._greeted = now
        # Held: gRPC cancels a call that nobody holds.
        self._greeting = self.stop_stub(device_pb2_grpc.DeviceServiceStub).GetDevice.future(
            device_pb2.GetDeviceRequest(), timeout=CALL_TIMEOUT_S, wait_for_ready=True)

    def _is_back(self) -> bool:
        """Waits a moment for a palpated that was started again.

        gRPC connects while a call waits for the connection, and otherwise only every 5 s. Without
        this, a program that tries again and again would find palpated only after up to 5 s.
        """
        stub = self.stub(device_pb2_grpc.DeviceServiceStub)
        try:
            stub.GetDevice(device_pb2.GetDeviceRequest(), timeout=_BACK_S, wait_for_ready=True)
        except (grpc.RpcError, ValueError):
            return False
        return True

    def _connect_error(self, failed: grpc.RpcError) -> Error:
        if failed.code() == grpc.StatusCode.UNAVAILABLE:
            return Unavailable(why_unreached(self.name, failed.details() or "",
                                             has_tls=self._credentials.has_tls,
                                             ca_file=self._credentials.ca_file))
        if failed.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
            return Unavailable(f"no answer from {self.name} within {_CONNECT_TIMEOUT_S:g} s: palpated "
                               "hangs, or another program listens there")
        return error_of(self.name, failed)

    def call(self, method: typing.Any, request: typing.Any,
             timeout_s: float = CALL_TIMEOUT_S) -> typing.Any:
        """Returns the answer to one request. Waits while palpated loads its first volume.

        Errors: palpate.Error.
        """
        while True:
            self.check_open()
            self._connect_stop()
            try:
                # palpated takes only a small first call of a connection.
                if not self._is_local and request.ByteSize() > _SMALL_BYTES:
                    self._greet()
                return method(request, timeout=timeout_s)
            except grpc.RpcError as failed:
                if not self.waits_for(failed):
                    raise self._error_of(failed) from None
            except ValueError:
                self._raise_if_closed()
                raise

    def waits_for(self, failed: grpc.RpcError) -> bool:
        """Waits a moment, and returns whether to make the failed call once more.

        Yes, if palpated loads its first volume, or if the call was not sent and palpated is back.
        """
        if not is_loading(failed):
            self._said = 0.0
            return was_not_sent(failed) and self._is_back()
        now = time.monotonic()
        if now - self._said > _SAY_LOADING_S:
            self._said = now
            _LOG.warning("palpated: %s", failed.details())
        time.sleep(_LOADING_PAUSE_S)
        return True

    def begin(self, method: typing.Any, request: typing.Any) -> typing.Any:
        """Begins a call and returns gRPC's object."""
        self.check_open()
        try:
            return method(request)
        except ValueError:
            self._raise_if_closed()
            raise

    def result_of(self, call: typing.Any) -> typing.Any:
        """Returns the answer to a call of begin(). Errors: palpate.Error."""
        try:
            return call.result()
        except grpc.RpcError as failed:
            raise self._error_of(failed) from None

    def events(self, method: typing.Any, request: typing.Any) -> collections.abc.Generator[
            typing.Any, None, None]:
        """Yields the daemon's answers to one request. A break ends the call."""
        while True:
            call = self.begin(method, request)
            try:
                yield from call
                return
            except grpc.RpcError as failed:
                # palpated refuses so before the first event.
                if not self.waits_for(failed):
                    raise self._error_of(failed) from None
            finally:
                call.cancel()

    def check_process(self) -> None:
        """In a forked child, gRPC's threads are missing, and messages would go onto the parent's
        connection."""
        if os.getpid() != self._pid:
            raise FailedPrecondition("this process was forked from the one that connected: call "
                                     "palpate.connect() in this process")

    def check_open(self) -> None:
        self.check_process()
        if not self._is_open:
            raise Unavailable(f"the connection to {self.name} was closed")

    def _raise_if_closed(self) -> None:
        """gRPC raises ValueError if another thread has closed the channel; this raises ours."""
        if not self._is_open:
            raise Unavailable(f"the connection to {self.name} was closed") from None

    def error_of_end(self, failed: grpc.RpcError | None) -> Error:
        """Returns the error of a stream that ended although it was still read.

        Even an end without an error means that the daemon or this connection went away.
        """
        gone = (None, grpc.StatusCode.OK, grpc.StatusCode.CANCELLED, grpc.StatusCode.UNAVAILABLE)
        code = None if failed is None else failed.code()
        if failed is not None and (code not in gone or is_stalled(failed)):
            return error_of(self.name, failed)
        refusal = self._refusal()
        if not self._is_open:
            return Unavailable(f"the connection to {self.name} was closed")
        return refusal or Unavailable(f"palpated at {self.name} went away")

    def _error_of(self, failed: grpc.RpcError) -> Error:
        # Whoever cancels a call of ours does not ask for its error.
        if failed.code() == grpc.StatusCode.CANCELLED:
            return self.error_of_end(failed)
        return error_of(self.name, failed)

    def _refusal(self) -> Error | None:
        """Returns why the daemon refuses us now; None: it serves us, or does not answer.

        If a token is revoked, the daemon ends the running calls without a reason. So this makes
        another call to get the reason.
        """
        strangers = (grpc.StatusCode.UNAUTHENTICATED, grpc.StatusCode.PERMISSION_DENIED)
        try:
            if self._is_open:
                self._greet()
        except grpc.RpcError as failed:
            if failed.code() in strangers:
                return error_of(self.name, failed)
            if was_not_sent(failed):
                self._is_back()  # so that the next stream finds it
        except ValueError:
            # Another thread closed the channel meanwhile.
            pass
        return None


class AcknowledgedCall:
    """A stream of messages. Each message is acknowledged when it is taken.

    The daemon sends only a few unacknowledged messages, so messages are fresh. The call begins
    with the iteration. Iterate only once. Call finish() and cancel() on any thread.
    """

    def __init__(self, method: typing.Any, start: typing.Any) -> None:
        self._method = method
        self._request = type(start)
        self._requests: queue.SimpleQueue[typing.Any] = queue.SimpleQueue()
        self._requests.put(start)
        self._call: typing.Any = None

    def __iter__(self) -> collections.abc.Generator[typing.Any, None, None]:
        # gRPC reads the requests on a thread of its own. None ends that thread.
        self._call = self._method(iter(self._requests.get, None))
        try:
            for message in self._call:
                acknowledgement = self._request()
                acknowledgement.acknowledgement.message_number = message.message_number
                self._requests.put(acknowledgement)
                yield message
        finally:
            self.cancel()
            # gRPC's destructor takes a lock, which at the interpreter's end may be one of a thread
            # that is gone.
            self._call = None

    def finish(self) -> None:
        """Tells the daemon to send no more. Does not wait.

        This is a single step that no signal can interrupt, so __del__ may call it. After a
        KeyboardInterrupt within gRPC's cancel(), gRPC's locks would stay held.
        """
        self._requests.put(None)

    def cancel(self) -> None:
        self._requests.put(None)
        if (call := self._call) is not None:
            call.cancel()
