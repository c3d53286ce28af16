"""An emulator of Haply's Inverse service, for tests of kind = "haply".

The first line on standard output is {"port": N, "events_port": M}. Port N serves the WebSocket at
"/" and HTTP; port M serves the events at "/". Each line on standard input is one command, and gets
one line as its answer, {"error": TEXT} if the command is wrong:

    {"set": {...}}            changes STATE, or starts one of the ACTIONS; an object is merged into
                              the old one
    {"report": {}}            what was seen; {"report": {"messages": N}} with the last N messages
    {"event": {...}}          sends this event to all clients of the events port
    {"restart": SECONDS}      ends all connections; listens again on the same ports after this time
    {"drop": {}}              ends all connections without a close frame

The program ends at the end of standard input.

It proves no timing and no filter of the vendor. Our documents do not tell, and these are guesses:
the paths "/", the text of force_scale, a scale with three numbers, the values of preset,
device_info and control_domain, the config of a grip, and that a service before 3.5 has no basis,
mount, filters and transform."""

import asyncio
import collections
import functools
import gc
import json
import math
import socket
import struct
import sys
import time

from aiohttp import WSMsgType, web

from free_port import free_port

ZERO = [0.0, 0.0, 0.0]
IDENTITY = {"position": {"x": 0.0, "y": 0.0, "z": 0.0},
            "rotation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
            "scale": {"x": 1.0, "y": 1.0, "z": 1.0}}

STATE = {
    # Devices. An inverse3 without a type of its own has `device_type`.
    "devices": [{"family": "inverse3", "device_id": "049D"},
                {"family": "grip", "device_id": "61F7"}],
    "device_type": "inverse3", "device_present": True,
    "second_device": False,         # adds the inverse3 "0B2C"
    "grip": "wireless",             # or "wired", "none", "asleep"
    "cursor_position": [0.0, -0.16, 0.16], "cursor_velocity": [0.0, 0.0, 0.0],
    "orientation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
    "buttons": {"a": False, "b": False, "c": False},
    "status": {"calibrated": True, "in_use": False, "power_supply": True, "ready": True,
               "started": True},
    "control_mode": "idle",         # while no force is commanded
    "needs_probes": False,          # old values if there was neither a force nor a probe
    "ignores_forces": False,        # current_cursor_force and felt_force stay zero
    # The service. With None, GET gives 404.
    "version": "3.5.2", "force_scale": 1.0,
    "http_text": None,              # a path's body, instead of the usual one
    "gravity_compensation": {"enabled": True, "scaling_factor": 1.0},
    "torque_scaling": {"enabled": True}, "handedness": "right",
    # What a session starts with.
    "preset": "defaults", "basis": "XYZ", "mount": IDENTITY, "damping": 0.0, "force_gate": 0.3,
    # What another program has changed: this is told instead of what the session configured.
    "foreign_basis": None, "foreign_mount": None, "foreign_damping": None, "transform_scale": 1.0,
    # Faults of connections.
    "refuse_upgrade": False, "no_upgrade": False, "http_silent": False, "no_inventory": False,
    "inventory_text": None, "close_after_inventory": False, "events_refused": False,
    # Faults of the next replies. Numbers: for how many replies.
    "reply_delay_ms": {"ms": 0, "count": 0},
    "drop_replies": 0, "double_replies": 0, "fragment": 0, "single_bytes": 0, "binary": 0,
    "huge": 0,
    "text": None,                   # the next reply is this text
    "replace": None,                # [old, new] in the next reply that has the old text
}
ACTIONS = ("unasked", "ping")       # sent at once in the newest session, so many times


def refuse(number):
    raise ValueError("a number that is not finite")


def finite(text):
    number = float(text)
    return number if math.isfinite(number) else refuse(text)


DECODER = json.JSONDecoder(parse_float=finite, parse_constant=refuse)


def xyz(three):
    return dict(zip("xyz", three))


def frame(opcode, payload, is_last=True):
    first = opcode | (0x80 if is_last else 0)
    if len(payload) < 126:
        return struct.pack("!BB", first, len(payload)) + payload
    if len(payload) < 1 << 16:
        return struct.pack("!BBH", first, 126, len(payload)) + payload
    return struct.pack("!BBQ", first, 127, len(payload)) + payload


class Session:
    def __init__(self, number, ws, transport, service):
        self.number, self.ws, self.transport = number, ws, transport
        # aiohttp reads the transport's own socket; this one is for looking ahead only.
        self.peek = transport.get_extra_info("socket").dup()
        self.received = self.answered = 0
        self.has_overtaken = False  # the next message came before the last one's reply
        self.pending = collections.deque()  # delayed replies: when, frames, number of the message
        self.sender = None
        self.force, self.at_ns, self.first, self.profile = None, 0, [], None
        self.shown_force, self.wants_full = None, False
        self.target = None          # the arm that was commanded last
        for key in ("preset", "basis", "mount", "damping", "force_gate"):
            setattr(self, key, service.state[key])
        self.view = (service.state, service.state)  # what the replies tell of arm and grip
        self.built = self.parts = None

    def is_overtaking(self):
        """Whether a further message has arrived, in aiohttp's queue or in the socket's."""
        if any(m.type in (WSMsgType.TEXT, WSMsgType.BINARY) for m, _ in self.ws._reader._buffer):
            return True
        try:
            first = self.peek.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except OSError:
            return False
        return bool(first) and first[0] & 15 < 3

    def write(self, *frames):
        if not self.transport.is_closing():
            for one in frames:
                self.transport.write(one)


class Service:
    def __init__(self):
        self.state = dict(STATE)    # replaced at each change: sessions may keep an old one
        self.sessions, self.newest, self.opened, self.closed = {}, None, 0, 0
        self.counts = dict.fromkeys(("forces", "pushes", "replies"), 0)
        self.breaches, self.messages = [], collections.deque(maxlen=2000)
        self.last_force, self.last_ns, self.close_code = None, 0, None
        self.zero_repeats = self.most_unanswered = self.pongs = 0
        self.http_gets, self.events = [], set()
        self.listeners, self.port, self.events_port, self.again = [], 0, 0, None

    def breach(self, text):
        if len(self.breaches) < 100:
            self.breaches.append(text)

    # --- devices and versions

    def is_new(self):
        """Whether it has what came with 3.5: `vector`, and settings of a session."""
        version = self.state["version"] or "0.0"
        return tuple(int(part) for part in version.split(".")[:2]) >= (3, 5)

    def arms(self):
        if not self.state["device_present"]:
            return []
        second = [{"device_id": "0B2C", "type": "inverse3"}] if self.state["second_device"] else []
        return [d for d in self.state["devices"] if d["family"] == "inverse3"] + second

    def grips(self):
        grip = self.state["grip"]
        family = "verse_grip" if grip == "wired" else "wireless_verse_grip"
        wanted = None if grip == "none" else "grip"
        return family, [d for d in self.state["devices"] if d["family"] == wanted]

    # --- texts

    def arm(self, session, device, is_full):
        state, view, is_new = self.state, session.view[0], self.is_new()
        is_target = device["device_id"] == session.target
        told = {"device_id": device["device_id"]}
        if is_full:
            told["config"] = {
                "type": device.get("type", state["device_type"]), "port": "/dev/ttyACM0",
                "device_info": {"major_version": 6, "minor_version": 2, "id": 1181,
                                "device_type": 4, "uuid": "00000000-0000-4000-8000-00000000049d"},
                "extended_device_id": "0000000000" + device["device_id"],
                "extended_firmware_version": "6.2.0",
                "gravity_compensation": state["gravity_compensation"],
                "torque_scaling": state["torque_scaling"], "handedness": state["handedness"]}
            if is_new:
                damping, foreign = session.damping, state["foreign_damping"]
                told["config"].update({
                    "preset": session.preset,
                    "basis": {"permutation": state["foreign_basis"] or session.basis},
                    "mount": {**session.mount, **(state["foreign_mount"] or {})},
                    "filters": {"force_gate": {"gain": session.force_gate},
                                "damping": {"scalar": damping if foreign is None else foreign}}})
        told["state"] = {
            "cursor_position": xyz(view["cursor_position"]),
            "cursor_velocity": xyz(view["cursor_velocity"]),
            "angular_position": {"a0": 12.5, "a1": 40.25, "a2": 95.125},
            "body_orientation": IDENTITY["rotation"],
            "current_cursor_force": "@force@" if is_target else xyz(ZERO),
            "control_domain": "cartesian",
            "control_mode": "@mode@" if is_target else state["control_mode"]}
        if is_new:
            scale = state["transform_scale"]
            told["state"]["transform"] = {
                **IDENTITY, "scale": scale if isinstance(scale, dict) else xyz([scale] * 3)}
        else:
            told["state"]["mode"] = told["state"]["control_mode"]
        return {**told, "status": state["status"]}

    def grip(self, session, family, device, is_full):
        view, is_awake = session.view[1], self.state["grip"] != "asleep"
        told = {"device_id": device["device_id"]}
        if is_full:
            told["config"] = {"type": family}
        if family == "verse_grip":
            keys = {"button": view["buttons"]["a"], "hall": 0.0}
            status = {"ready": True, "error": False}
        else:
            keys = {"buttons": view["buttons"], "battery_level": 0.8, "battery_voltage": 3.9}
            status = {"connected": True, "awake": is_awake, "ready": is_awake}
        return {**told, "state": {"orientation": view["orientation"], **keys}, "status": status}

    def build(self, session, is_full):
        """The text, cut where the force and the mode go: only these change with each reply."""
        arms, (family, grips) = self.arms(), self.grips()
        ids = [arm["device_id"] for arm in arms]
        if ids and session.target not in ids:
            session.target = ids[0]
        text = json.dumps({
            "session_id": session.number,
            "inverse3": [self.arm(session, arm, is_full) for arm in arms],
            family: [self.grip(session, family, grip, is_full) for grip in grips]})
        return text.replace('"@mode@"', "\0").replace('"@force@"', "\1")

    def text(self, session, is_full):
        if is_full:
            text = self.build(session, True)
        else:
            key = (*session.view, self.state, session.target)
            if session.built != key:
                session.parts, session.built = self.build(session, False), key
            text = session.parts
        force = session.shown_force
        x, y, z = ZERO if force is None or self.state["ignores_forces"] else force
        mode = self.state["control_mode"] if force is None else "force"
        text = text.replace("\1", f'{{"x": {x!r}, "y": {y!r}, "z": {z!r}}}')
        return text.replace("\0", f'"{mode}"')

    # --- messages of clients

    def obey(self, session, message):
        """Returns the force, if there is one, and whether arm and grip were probed."""
        force, probed, is_new = None, [False, False], self.is_new()
        of_session = message.get("session", {})
        session.wants_full = "force_render_full_state" in of_session
        configure = of_session.get("configure", {})
        if "profile" in configure:
            if session.profile is not None:
                self.breach("a second profile in a session")
            session.profile = configure["profile"]["name"]
        if is_new and "basis" in configure:
            session.basis = configure["basis"]["permutation"]
        ids = [arm["device_id"] for arm in self.arms()]
        for device in message.get("inverse3", ()):
            configure, commands = device.get("configure", {}), device.get("commands", {})
            if "mount" in configure and "preset" in configure:
                self.breach("mount and preset in one message")
            if "set_cursor_position" in commands:
                self.breach("set_cursor_position")
            if device["device_id"] not in ids:
                continue
            if is_new and "mount" in configure:
                session.mount = {**IDENTITY, **configure["mount"]["transform"]}
            for key, member in (("preset", "preset"), ("basis", "permutation"),
                                ("damping", "scalar"), ("force_gate", "gain")):
                if is_new and key in configure:
                    setattr(session, key, configure[key][member])
            vector = commands.get("set_cursor_force", {}).get("vector" if is_new else "values")
            if vector is not None:
                if any(type(vector[axis]) not in (int, float) for axis in "xyz"):
                    raise TypeError("a force that is not three numbers")
                force = [float(vector[axis]) for axis in "xyz"]
                session.target = device["device_id"]
            probed[0] = probed[0] or "probe_position" in commands
        family, grips = self.grips()
        for device in message.get(family, ()):
            if any(device["device_id"] == grip["device_id"] for grip in grips):
                probed[1] = probed[1] or "probe_orientation" in device.get("commands", {})
        return force, probed

    def take(self, session, text):
        now = time.monotonic_ns()
        is_early = session.has_overtaken or session.answered < session.received
        session.has_overtaken = False
        session.received += 1
        self.most_unanswered = max(self.most_unanswered, session.received - session.answered)
        force, probed, session.wants_full = None, (False, False), False
        try:
            force, probed = self.obey(session, DECODER.decode(text))
        except Exception as odd:  # whatever a client may send: a breach, not the emulator's end
            self.breach(f"{type(odd).__name__} {odd}: {text[:300]}")
        if is_early and force == ZERO:
            self.zero_repeats += 1
        elif is_early:
            self.breach(f"session {session.number}: message {session.received} came before the "
                        f"reply to the one before: {text[:300]}")
        if len(session.first) < 5:
            session.first.append(text)
        session.force, session.at_ns, self.last_ns = force, now, now
        if force is not None:
            self.last_force = force
        self.counts["forces"] += force is not None
        self.counts["pushes"] += force not in (None, ZERO)
        self.messages.append((now, force))
        is_fresh = force is not None or not self.state["needs_probes"]
        session.view = tuple(self.state if is_fresh or one else old
                             for one, old in zip(probed, session.view))
        session.shown_force = force
        self.reply(session)

    # --- replies

    def use(self, fault):
        if self.state[fault] <= 0:
            return False
        self.state[fault] -= 1
        return True

    def reply(self, session):
        text = self.text(session, session.wants_full)
        if self.use("drop_replies"):
            return
        if self.state["text"] is not None:
            text, self.state["text"] = self.state["text"], None
        if self.state["replace"] is not None and self.state["replace"][0] in text:
            text, self.state["replace"] = text.replace(*self.state["replace"]), None
        if self.use("huge"):
            text = '{"padding": "' + "x" * (1 << 20) + '", ' + text[1:]
        payload, opcode = text.encode(), 2 if self.use("binary") else 1
        frames = [frame(opcode, payload)]
        if self.use("fragment"):
            third = len(payload) // 3
            frames = [frame(opcode, payload[:third], False),
                      frame(0, payload[third:2 * third], False), frame(0, payload[2 * third:])]
        if self.use("single_bytes"):
            frames = [bytes([byte]) for one in frames for byte in one]
        if self.use("double_replies"):
            frames *= 2
        delay = self.state["reply_delay_ms"]
        is_delayed = delay["count"] > 0
        if is_delayed:
            self.state["reply_delay_ms"] = {**delay, "count": delay["count"] - 1}
        if is_delayed or session.pending:  # replies keep their order
            due = time.monotonic() + (delay["ms"] / 1000 if is_delayed else 0)
            session.pending.append((due, frames, session.received))
            if session.sender is None:
                session.sender = asyncio.create_task(self.send_late(session))
        else:
            session.has_overtaken = session.is_overtaking()
            self.send(session, frames, session.received)

    def send(self, session, frames, number):
        session.answered = number
        session.write(*frames)
        self.counts["replies"] += 1

    async def send_late(self, session):
        while session.pending:
            due, frames, number = session.pending[0]
            await asyncio.sleep(max(0, due - time.monotonic()))
            if session.answered < session.received == number:
                session.has_overtaken = session.is_overtaking()
            self.send(session, frames, number)
            session.pending.popleft()
        session.sender = None

    # --- connections

    async def serve(self, is_events, request):
        state, path, transport = self.state, request.path, request.transport
        is_upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        if not is_upgrade and request.method == "GET":
            self.http_gets.append(path)
        elif not is_upgrade:
            self.breach(f"{request.method} {path}")
        if not is_events and state["no_upgrade" if is_upgrade else "http_silent"]:
            while request.transport is not None:
                await asyncio.sleep(0.02)
        elif is_upgrade and path == "/" and transport is not None:
            if state["events_refused" if is_events else "refuse_upgrade"]:
                return web.Response(status=403)
            return await (self.serve_events if is_events else self.serve_session)(
                request, transport)
        elif not is_upgrade and not is_events:
            bodies = {}
            if state["version"] is not None:
                bodies["/version"] = json.dumps({"project_version": state["version"]})
            if state["force_scale"] is not None:
                bodies["/settings/devices/force_scale"] = json.dumps(
                    {"force_scale": state["force_scale"]})
            bodies.update(state["http_text"] or {})
            if path in bodies:
                return web.Response(text=bodies[path], content_type="application/json")
        return web.Response(status=404)

    async def serve_session(self, request, transport):
        ws = web.WebSocketResponse(autoclose=False, autoping=False, compress=False)
        await ws.prepare(request)
        session = self.newest = Session(self.opened + 1, ws, transport, self)
        self.opened += 1
        self.sessions[session.number] = session
        close_code = None
        try:
            inventory = self.text(session, True)
            if self.state["inventory_text"] is not None:
                inventory = self.state["inventory_text"]
            if not self.state["no_inventory"]:
                session.write(frame(1, inventory.encode()))
            if self.state["close_after_inventory"]:
                session.transport.close()
            while True:
                message = await ws.receive()
                if message.type == WSMsgType.TEXT:
                    self.take(session, message.data)
                elif message.type == WSMsgType.PING:
                    session.write(frame(10, message.data))
                elif message.type == WSMsgType.PONG:
                    self.pongs += 1
                elif message.type == WSMsgType.CLOSE:
                    close_code = message.data or 1005
                    await ws.close()
                    break
                elif message.type in (WSMsgType.BINARY, WSMsgType.ERROR):
                    self.breach(f"{message.type.name}: {message.data!r}"[:300])
                    if message.type == WSMsgType.ERROR:
                        break
                else:
                    break
        finally:
            session.peek.close()
            if session.sender is not None:
                session.sender.cancel()
            del self.sessions[session.number]
            self.closed += 1
            self.close_code = close_code
        return ws

    async def serve_events(self, request, transport):
        ws = web.WebSocketResponse(compress=False)
        await ws.prepare(request)
        self.events.add(transport)
        try:
            async for message in ws:
                self.breach(f"a message on the events port: {message.data!r}"[:300])
        finally:
            self.events.discard(transport)
        return ws

    async def listen(self):
        loop = asyncio.get_running_loop()
        for server, port in zip(self.servers, (self.port, self.events_port)):
            self.listeners.append(await loop.create_server(server, "127.0.0.1", port))

    def stop_listening(self):
        while self.listeners:
            self.listeners.pop().close()

    def drop(self, transports):
        for transport in transports:
            # Shuts down itself: the transport would do it only after the answer to the command.
            try:
                transport.get_extra_info("socket").shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            transport.abort()

    async def listen_again(self, seconds):
        await asyncio.sleep(seconds)
        await self.listen()

    # --- commands of the test

    def set(self, changes):
        unknown = [key for key in changes if key not in STATE and key not in ACTIONS]
        if unknown:
            raise ValueError(f"unknown keys: {unknown}")
        self.state = dict(self.state)
        for key, value in changes.items():
            if key in STATE:
                old = self.state[key]
                both = isinstance(old, dict) and isinstance(value, dict)
                self.state[key] = {**old, **value} if both else value
        if changes.get("events_refused"):
            self.drop(self.events)
        for action in ACTIONS:
            for _ in range(changes.get(action, 0)):
                session = self.sessions[max(self.sessions)]
                session.write(frame(9, b"palpate") if action == "ping" else
                              frame(1, self.text(session, False).encode()))

    def report(self, wanted):
        now, newest, felt = time.monotonic_ns(), self.newest, ZERO
        live = [s for s in self.sessions.values() if s.force is not None]
        if live and not self.state["ignores_forces"]:
            felt = max(live, key=lambda session: session.at_ns).force
        count = wanted.get("messages", 0)
        return {
            "counts": self.counts, "breaches": self.breaches, "zero_repeats": self.zero_repeats,
            "most_unanswered": self.most_unanswered, "pongs": self.pongs,
            "sessions_opened": self.opened, "sessions_closed": self.closed,
            "close_code": self.close_code, "felt_force": felt, "last_force": self.last_force,
            "last_was_zero": newest is not None and newest.force == ZERO,
            "last_message_ns": self.last_ns, "now_ns": now,
            "first_messages": newest.first if newest else [],
            "profile": newest.profile if newest else None,
            "http_gets": self.http_gets, "events_clients": len(self.events),
            "messages": list(self.messages)[-count:] if count else []}

    def answer(self, command):
        (name, value), = command.items()
        if name == "set":
            self.set(value)
        elif name == "report":
            return self.report(value)
        elif name == "event":
            for transport in self.events:
                transport.write(frame(1, json.dumps(value).encode()))
        elif name in ("restart", "drop"):
            if name == "restart":
                self.stop_listening()
                if self.again is not None:
                    self.again.cancel()
                self.again = asyncio.create_task(self.listen_again(value))
            self.drop([one.transport for server in self.servers for one in server.connections
                       if one.transport is not None])
        else:
            raise ValueError(f"unknown command: {name}")
        return {"done": name}

    async def run(self):
        self.servers = [web.Server(functools.partial(self.serve, is_events), access_log=None)
                        for is_events in (False, True)]
        while not self.listeners:  # another program may take the port before it is used
            self.port, self.events_port = free_port(), free_port()
            try:
                await self.listen()
            except OSError:
                self.stop_listening()
        gc.freeze()  # shortens the pauses of the collector
        print(json.dumps({"port": self.port, "events_port": self.events_port}), flush=True)
        commands = asyncio.StreamReader(limit=1 << 24)
        await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(commands), sys.stdin)
        async for line in commands:
            try:
                answer = self.answer(json.loads(line))
            except Exception as wrong:
                answer = {"error": f"{type(wrong).__name__} {wrong}: {line.decode()[:300]}"}
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    asyncio.run(Service().run())
