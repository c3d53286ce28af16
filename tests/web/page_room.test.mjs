// The page's connection: login, acknowledgements, steering, and coming back.
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { envelope, modules, somePose } from "./page_harness.mjs";

const { Room, State } = await modules("wire/room.ts", "state.ts");

globalThis.location = { href: "https://lab.example/palpate/#room=KEY" };
let logins; // bodies
let answer; // to a login
let sockets;

// A gateway's end of a WebSocket.
globalThis.WebSocket = class {
  static OPEN = 1;
  readyState = 1;
  sent = [];
  constructor(url) {
    this.url = String(url);
    sockets.push(this);
  }
  send(text) { this.sent.push(JSON.parse(text)); }
  close() { this.readyState = 3; }
  lose() { this.onclose?.({ reason: "" }); }
  give(message) { this.onmessage({ data: typeof message === "object" && message.type ? JSON.stringify(message) : message }); }
  hello() { this.give({ type: "hello", version: "1", may_steer: [] }); }
};

beforeEach(() => {
  [logins, sockets, answer] = [[], [], { status: 200 }];
  globalThis.fetch = async (url, { body }) => {
    assert.equal(url, "login");
    logins.push(JSON.parse(body));
    return (answer.response = new Response(answer.text ?? "{}", { status: answer.status }));
  };
});

async function until(condition) {
  while (!condition()) await new Promise((resume) => setTimeout(resume, 5));
}

async function joined() {
  const state = new State();
  const room = new Room(state);
  await room.login({ room: "KEY" });
  await until(() => sockets.length === 1);
  sockets[0].hello();
  return { state, room, end: () => { room.secret = null; sockets.at(-1).lose(); } };
}

test("a login opens the stream", async () => {
  const { state, room, end } = await joined();
  assert.deepEqual(logins, [{ room: "KEY" }]);
  assert.equal(sockets[0].url, "wss://lab.example/palpate/stream");
  assert.equal(state.link, "open");
  assert.equal(room.roomKey, "KEY");
  assert.ok(answer.response.bodyUsed);
  end();
});

test("a refused login says why and is not tried again", async () => {
  answer = { status: 403, text: "wrong key\n" };
  const state = new State();
  await assert.rejects(new Room(state).login({ token: "T" }), /wrong key/);
  assert.deepEqual([state.link, sockets.length], ["login", 0]);
  const room = new Room(state);
  room.start({ room: "OLD" });
  assert.equal(room.roomKey, "OLD");
  await until(() => state.link === "login");
  assert.equal(room.roomKey, null); // nobody shares a wrong key
  assert.match(state.linkWhy, /wrong key/);
  assert.equal(logins.length, 2);
});

test("every eighth pose is acknowledged; other bytes are ignored", async () => {
  const { state, end } = await joined();
  for (let n = 1; n <= 17; ++n) sockets[0].give(envelope({ pose: somePose, sequence: n }));
  sockets[0].give(new ArrayBuffer(5));
  assert.deepEqual(sockets[0].sent, [{ type: "ack", sequence: 8 }, { type: "ack", sequence: 16 }]);
  assert.equal(state.pose.sequence, 17);
  end();
});

test("a change is done when the gateway says so, and fails with the connection", async () => {
  const { room, end } = await joined();
  const [done, refused, lost] = [room.steer("isovalue", 5), room.steer("isovalue", 6), room.steer("isovalue", 7)];
  assert.deepEqual(sockets[0].sent[0], { type: "steer", id: 1, key: "isovalue", value: 5 });
  sockets[0].give({ type: "steered", id: 2, error: "too fast" });
  sockets[0].give({ type: "steered", id: 1, error: "" });
  await done;
  await assert.rejects(refused, /too fast/);
  end();
  await assert.rejects(lost);
});

test("a lost stream comes back: by its session, or by a new login if that has ended", async () => {
  const { state, end } = await joined();
  sockets[0].lose();
  await until(() => sockets.length === 2);
  assert.deepEqual([logins.length, state.link], [1, "lost"]);
  await assert.rejects(new Room(state).steer("isovalue", 1));
  sockets[1].lose(); // refused: the session has ended
  await until(() => sockets.length === 3);
  assert.equal(logins.length, 2);
  sockets[2].hello();
  assert.equal(state.link, "open");
  end();
});

test("topics without a meaning and texts that are none change nothing", async () => {
  const { state, end } = await joined();
  sockets[0].give({ type: "constructor" });
  sockets[0].give({ type: "listeners" });
  sockets[0].give({ type: "guests", count: 3 });
  assert.deepEqual(state.guests, { type: "guests", count: 3 });
  assert.ok(state.constructor === State);
  end();
});
