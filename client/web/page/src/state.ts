// What the page knows: the newest message of each topic, the newest poses, the link and the view. Whoever
// changes a member emits its topic, and whoever shows it listens.
import { norm, subtract } from "./view/geometry";
import { kFacts, memberOf } from "./wire/contract";
import type { GuestFacts, NewFact, Pose } from "./wire/contract";
import { kTopics } from "./wire/messages";
import type * as wire from "./wire/messages";

export type Link = "login" | "connecting" | "open" | "lost"; // to the gateway
export type Theme = "system" | "dark" | "light";

// Topics of messages, and the page's own.
type StateTopic = wire.Topic | keyof GuestFacts | "pose" | "link" | "events" | "view" | "copyProgress" | "copyShown" | "picture";

export class View {
  azimuthDeg = 30;
  elevationDeg = 20;
  distanceMm = 300;
  target: wire.Vec3 = [0, 0, 0]; // D
  follow = false; // the target follows SCP_H
  veil: number | null = null; // the isovalue of the transparent surface
  veilOpacity = 0.3; // 0 to 1
  slices = false;
  cross: wire.Vec3 | null = null; // where the guest put the slices, in voxels; null: in the middle, or through the proxy
  theme: Theme = "system";
}

export interface PoseSample {
  timeMs: number; // palpated's clock
  forceN: number;
  penetrationMm: number; // |HIP - SCP_H|, 0 without contact
  ageMs: number; // when it arrived
}

export const kHistoryMs = 10_000;
const kClockDrift = 1e-4; // clocks of two machines may drift apart this much
const kMaxEvents = 50;

// The newest of each topic and of each fact; null: none yet.
type Newest = { [T in wire.Topic]: wire.Messages[T] | null } & { [F in keyof GuestFacts]: GuestFacts[F] | null };
export interface State extends Newest {}

export class State {
  link: Link = "login";
  linkWhy = "";
  // What happened meanwhile, in plain words, newest last.
  events: string[] = [];
  // Why there is no three-dimensional view; "": there is one.
  whyNoPicture = "";
  // The isovalue stated by the link that opened the page. Null: none, or already handled.
  linkIsovalue: number | null = null;
  // The volume that this isovalue and view.cross are of. Null: of any.
  linkVolume: string | null = null;

  pose: Pose | null = null;
  readonly samples: PoseSample[] = []; // of the last kHistoryMs, oldest first

  readonly view = new View();

  private readonly listeners = new Map<StateTopic, (() => void)[]>();
  // The least of (time of arrival - sentMs): the offset of the clocks and the shortest way.
  private clockOffsetMs = Infinity;
  private offsetTakenMs = 0;

  constructor() {
    for (const name of [...kTopics, ...kFacts]) this[name] = null;
  }

  on(topics: StateTopic | StateTopic[], listener: () => void): void {
    for (const topic of [topics].flat()) this.listeners.set(topic, [...(this.listeners.get(topic) ?? []), listener]);
  }

  // As `on`, and calls the listener now, too.
  watch(topics: StateTopic | StateTopic[], listener: () => void): void {
    this.on(topics, listener);
    listener();
  }

  emit(topic: StateTopic): void {
    for (const listener of this.listeners.get(topic) ?? []) listener();
  }

  setView(changes: Partial<View>): void {
    Object.assign(this.view, changes);
    this.emit("view");
  }

  // Returns false if no topic has the message's type.
  receive(message: { type: string }): boolean {
    const topic = kTopics.find((t) => t === message.type);
    if (!topic) return false;
    Object.assign(this, { [topic]: message });
    this.emit(topic);
    return true;
  }

  receiveFact(fact: NewFact): void {
    for (const name of kFacts) {
      if (fact[name] === undefined) continue;
      Object.assign(this, { [name]: fact[name] });
      this.emit(name);
    }
  }

  receivePose(pose: Pose): void {
    const now = performance.now();
    const drift = kClockDrift * (now - this.offsetTakenMs);
    this.clockOffsetMs = Math.min(this.clockOffsetMs + drift, now - pose.sentMs);
    this.offsetTakenMs = now;
    this.pose = pose;
    this.addSample(pose);
    this.emit("pose");
  }

  private addSample({ timeNs, forceN, contact, hipMm, scpHMm }: Pose): void {
    const { samples } = this;
    const timeMs = 1e-6 * timeNs;
    if (samples.length > 0 && timeMs < samples.at(-1)!.timeMs) samples.length = 0; // another clock
    const penetrationMm = contact ? norm(subtract(hipMm, scpHMm)) : 0;
    samples.push({ timeMs, forceN: norm(forceN), penetrationMm, ageMs: this.poseAgeMs() });
    while (samples[0].timeMs < timeMs - kHistoryMs) samples.shift();
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

  // What of the volume is missing, in plain words; "": nothing.
  missingVolume(): string {
    const { copy, volume, manifest } = this;
    if (copy?.loading) return `palpated loads: ${copy.problem}`;
    if (copy?.problem) return `the volume does not follow: ${copy.problem}`;
    return volume || manifest ? "" : "no volume yet";
  }

  // Everybody's: of the surface that is drawn, which is the innermost one of layers. Null: not known.
  isovalue(): number | null {
    return this.settings?.settings.layers?.layer.at(-1)?.isovalue ?? this.settings?.settings.isovalue ?? this.pose?.isovalue ?? null;
  }

  // Everybody's value of a setting, by its name in palpate/v1: a choice's number begins at 1. Undefined: not known.
  setting(key: string): number | boolean | undefined {
    const settings: Partial<Record<string, unknown>> = this.settings?.settings ?? {};
    const value = settings[memberOf(key)];
    return typeof value === "number" || typeof value === "boolean" ? value : undefined;
  }

  tell(event: string): void {
    this.events.push(event);
    this.events.splice(0, this.events.length - kMaxEvents);
    this.emit("events");
  }
}
