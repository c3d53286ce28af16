// The connection to the gateway: logs in, follows the stream, and comes back by itself when it is lost.
import type { State } from "../state";
import { decode } from "./contract";

export type Secret = { room: string } | { token: string };

const kFirstWaitMs = 200;
const kMostWaitMs = 5000;
const kTooManyWaitMs = 10_000; // after "too many attempts"
const kSilenceMs = 5000;
const kProbeMs = 3000;
const kWatchMs = 500;
const kPosesPerAck = 8;

// The secret is wrong: trying again is of no use.
class Refused extends Error {}
class TooMany extends Error {}
const kErrors: Record<number, new (why: string) => Error> = { 403: Refused, 429: TooMany };

const pause = (ms: number) => new Promise<void>((resolve) => setTimeout(resolve, ms));

async function postLogin(secret: Secret): Promise<void> {
  const response = await fetch("login", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(secret),
    signal: AbortSignal.timeout(kSilenceMs),
  }).catch(() => {
    throw new Error("the gateway does not answer");
  });
  if (response.ok) return void (await response.text()); // Chromium tells of a body that is not read as of an error
  const why = (await response.text()).trim() || `the gateway answers ${response.status}`;
  throw new (kErrors[response.status] ?? Error)(why);
}

export class Room {
  private secret: Secret | null = null;
  private socket: WebSocket | null = null;
  private posesSinceAck = 0;
  private steers = 0;
  private readonly pending = new Map<number, (error: string) => void>(); // ends the steering of this number

  constructor(private readonly state: State) {}

  // Logs in and stays connected. Rejects, and does not try again, if the gateway refuses or does not answer.
  async login(secret: Secret): Promise<void> {
    await postLogin(secret);
    this.start(secret, true);
  }

  // As login, but tries until the gateway answers.
  start(secret: Secret, isLoggedIn = false): void {
    this.secret = secret;
    this.socket?.close();
    void this.stayConnected(secret, isLoggedIn);
  }

  // The room's key if the guest came by one, to share it in a link.
  get roomKey(): string | null {
    return this.secret && "room" in this.secret ? this.secret.room : null;
  }

  // Flags: 0 or 1. Choices: the word's number. Rejects with the gateway's error.
  async steer(key: string, value: number): Promise<void> {
    if (this.state.link !== "open" || !this.socket) throw new Error("not connected");
    const id = ++this.steers;
    this.socket.send(JSON.stringify({ type: "steer", id, key, value }));
    return new Promise((resolve, reject) => {
      this.pending.set(id, (error) => (error ? reject(new Error(error)) : resolve()));
    });
  }

  private setLink(link: State["link"], why = ""): void {
    this.state.link = link;
    this.state.linkWhy = why;
    this.state.emit("link");
  }

  // Until the secret is another one or is refused.
  private async stayConnected(secret: Secret, isLoggedIn: boolean): Promise<void> {
    let waitMs = kFirstWaitMs;
    let wasOpen = false;
    this.setLink("connecting");
    while (this.secret === secret) {
      let why: string;
      try {
        if (!isLoggedIn) await postLogin(secret);
        why = await this.follow();
      } catch (error) {
        why = (error as Error).message;
        if (error instanceof TooMany) waitMs = kTooManyWaitMs;
        if (error instanceof Refused && this.secret === secret) {
          this.secret = null;
          this.setLink("login", why);
        }
      }
      if (this.secret !== secret) return;
      // The session may have ended if the stream did not open at all.
      isLoggedIn = this.state.link === "open";
      if (isLoggedIn) waitMs = kFirstWaitMs;
      wasOpen ||= isLoggedIn;
      this.setLink(wasOpen ? "lost" : "connecting", why);
      await pause(waitMs * (0.5 + Math.random()));
      waitMs = Math.min(2 * waitMs, kMostWaitMs);
    }
  }

  // Follows the stream to its end. Returns why it ended.
  private follow(): Promise<string> {
    const url = new URL("stream", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = "";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.posesSinceAck = 0;
    this.state.forgetClock();
    return new Promise((resolve) => {
      let heardMs = performance.now();
      const end = (why: string) => {
        clearInterval(watch);
        socket.onmessage = socket.onclose = null;
        socket.close();
        for (const id of this.pending.keys()) this.steered(id, "the connection was lost");
        resolve(why);
      };
      const watch = setInterval(async () => {
        if (performance.now() - heardMs < kSilenceMs) return;
        heardMs = performance.now();
        if (!(await this.mayBeSilent(socket))) end("the gateway is silent");
      }, kWatchMs);
      socket.onclose = (event) => end(event.reason || "the connection was closed");
      socket.onmessage = (event) => {
        heardMs = performance.now();
        if (typeof event.data === "string") this.receive(event.data);
        else this.receiveBytes(event.data);
      };
    });
  }

  // Without palpated there are no poses, and the browser does not tell of the gateway's pings.
  private async mayBeSilent(socket: WebSocket): Promise<boolean> {
    const { pose, connection } = this.state;
    if ((pose && connection?.state === "connected") || socket.readyState !== WebSocket.OPEN) return false;
    // A gateway that does not know this socket closes it.
    if (pose) socket.send(JSON.stringify({ type: "ack", sequence: pose.sequence }));
    return fetch("health", { signal: AbortSignal.timeout(kProbeMs) }).then(() => true, () => false);
  }

  private receive(text: string): void {
    const message = JSON.parse(text);
    if (message.type === "steered") return this.steered(message.id, message.error);
    const before = this.state.hello?.version;
    if (message.type === "hello" && before && before !== message.version) {
      this.state.tell("the gateway has another version: reload the page");
    }
    this.state.receive(message);
    if (message.type === "hello") this.setLink("open");
  }

  private steered(id: number, error: string): void {
    this.pending.get(id)?.(error);
    this.pending.delete(id);
  }

  private receiveBytes(bytes: ArrayBuffer): void {
    const received = decode(bytes);
    if (!received) return;
    if ("fact" in received) return this.state.receiveFact(received.fact);
    const { pose } = received;
    if (++this.posesSinceAck >= kPosesPerAck) {
      this.posesSinceAck = 0;
      this.socket?.send(JSON.stringify({ type: "ack", sequence: pose.sequence }));
    }
    this.state.receivePose(pose);
  }
}
