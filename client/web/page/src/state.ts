// What the page knows: the newest message of each topic, the newest poses, the link and the view. Whoever
// changes a member emits its topic, and whoever shows it listens.
import { kTopics } from "./wire/messages";
import type * as wire from "./wire/messages";
import { distance, length } from "./wire/pose";
import type { Pose, Vec3 } from "./wire/pose";

export type Link = "login" | "connecting" | "open" | "lost"; // to the gateway
export type Theme = "system" | "dark" | "light";

// Topics of messages, and the page's own.
export type StateTopic = wire.Topic | "pose" | "link" | "events" | "view" | "copyProgress" | "picture";

export interface View {
  azimuthDeg: number;
  elevationDeg: number;
  distanceMm: number;
  target: Vec3; // D
  follow: boolean; // the target follows SCP_H
  veil: number | null; // the isovalue of the transparent surface
  veilOpacity: number; // 0 to 1
  slices: boolean;
  theme: Theme;
}

export interface PoseSample {
  timeMs: number; // palpated's clock
  forceN: number;
  penetrationMm: number; // |HIP - SCP_H|, 0 without contact
  ageMs: number; // when it arrived
}

// The poses of the last 10 s.
export class PoseHistory {
  static readonly kSpanMs = 10_000;
  readonly samples: PoseSample[] = []; // oldest first

  add(pose: Pose, ageMs: number): void {
    const newest = this.samples.at(-1);
    if (newest && pose.timeMs < newest.timeMs) this.samples.length = 0; // another clock
    this.samples.push({
      timeMs: pose.timeMs,
      forceN: length(pose.force),
      penetrationMm: pose.contact ? distance(pose.hip, pose.scpH) : 0,
      ageMs,
    });
    const old = this.samples.findIndex((s) => s.timeMs >= pose.timeMs - PoseHistory.kSpanMs);
    if (old > 0) this.samples.splice(0, old);
  }
}

// Clocks of two machines may drift apart this much.
const kClockDrift = 1e-4;
const kMaxEvents = 50;

// The newest message of each topic; null: none yet.
type Newest = { [T in wire.Topic]: wire.Messages[T] | null };
export interface State extends Newest {}

export class State {
  link: Link = "login";
  linkWhy = "";
  // What happened meanwhile, in plain words, newest last.
  events: string[] = [];
  // Why there is no three-dimensional view; "": there is one.
  whyNoPicture = "";

  pose: Pose | null = null;
  readonly poses = new PoseHistory();

  view: View = {
    azimuthDeg: 30,
    elevationDeg: 20,
    distanceMm: 300,
    target: [0, 0, 0],
    follow: false,
    veil: null,
    veilOpacity: 0.3,
    slices: false,
    theme: "system",
  };

  private readonly listeners = new Map<StateTopic, (() => void)[]>();
  // The least of (time of arrival - sentMs): the offset of the clocks and the shortest way.
  private clockOffsetMs = Infinity;
  private offsetTakenMs = 0;

  constructor() {
    for (const topic of kTopics) this[topic] = null;
  }

  on(topic: StateTopic, listener: () => void): void {
    this.listeners.set(topic, [...(this.listeners.get(topic) ?? []), listener]);
  }

  emit(topic: StateTopic): void {
    for (const listener of this.listeners.get(topic) ?? []) listener();
  }

  // Returns false if no topic has the message's type.
  receive(message: { type: string }): boolean {
    const topic = kTopics.find((t) => t === message.type);
    if (!topic) return false;
    Object.assign(this, { [topic]: message });
    this.emit(topic);
    return true;
  }

  receivePose(pose: Pose): void {
    const now = performance.now();
    const drift = kClockDrift * (now - this.offsetTakenMs);
    this.clockOffsetMs = Math.min(this.clockOffsetMs + drift, now - pose.sentMs);
    this.offsetTakenMs = now;
    this.pose = pose;
    this.poses.add(pose, this.poseAgeMs());
    this.emit("pose");
  }

  // After a new connection: another gateway may have another clock.
  forgetClock(): void {
    this.clockOffsetMs = Infinity;
  }

  // The newest pose's age now. Infinity: no pose yet. It does not count the shortest way from the
  // gateway to here, which cannot be measured, nor that from palpated if that is on another machine.
  poseAgeMs(): number {
    if (!this.pose) return Infinity;
    const way = performance.now() - this.pose.sentMs - this.clockOffsetMs;
    return (Number.isNaN(this.pose.ageMs) ? 0 : this.pose.ageMs) + Math.max(0, way);
  }

  tell(event: string): void {
    this.events.push(event);
    this.events.splice(0, this.events.length - kMaxEvents);
    this.emit("events");
  }
}
