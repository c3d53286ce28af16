// Says in plain words what happened while the page or the gateway was cut off, and when a new volume comes.
import type { State } from "../state";
import { valueText } from "../ui/words";
import { layersOf } from "../view/layers";

interface Away {
  sinceMs: number;
  tick: number; // the last one before
  why: string; // of the gateway's
  gateway: boolean; // the gateway was lost, not only what is behind it
}

export class Meanwhile {
  private away: Away | null = null;
  private wasWell = false;
  private heardMs = 0; // of the newest pose
  private volume: string | null = null;
  private isovalueBefore: number | null = null; // until it is compared

  constructor(private readonly state: State) {
    state.on(["link", "connection"], () => this.look());
    state.on("volume", () => this.lookAtVolume());
    state.on("pose", () => this.compare());
  }

  private isWell(): boolean {
    return this.state.link === "open" && this.state.connection?.state === "connected";
  }

  private isovalue(): number | null {
    return this.state.settings?.settings.isovalue ?? null;
  }

  private look(): void {
    this.wasWell ||= this.isWell();
    if (this.isWell() || !this.wasWell) return;
    const why = this.state.connection?.why ?? "";
    this.away ??= { sinceMs: this.heardMs, tick: this.state.pose?.tick ?? 0, why, gateway: false };
    this.isovalueBefore ??= this.isovalue();
    if (this.state.link === "lost") this.away.gateway = true;
  }

  // All is well again with the first fresh pose.
  private compare(): void {
    const now = this.state.pose!;
    if (!this.away) {
      this.heardMs = performance.now();
      this.compareIsovalue();
      return;
    }
    if (!now.fresh || !this.isWell()) return;
    const { sinceMs, tick, why, gateway } = this.away;
    this.away = null;
    const seconds = Math.max(1, Math.round((performance.now() - sinceMs) / 1000));
    this.state.tell(gateway ? `The connection was lost for ${seconds} s` : `${why}: for ${seconds} s`);
    if (now.tick < tick) this.state.tell("palpated was restarted");
    this.lookAtVolume();
    this.compareIsovalue();
  }

  // A palpated that was restarted has no isovalue until its volume is there, and the settings here are those
  // from before until it sends its own: both are right where they agree.
  private compareIsovalue(): void {
    if (layersOf(this.state).length > 0) this.isovalueBefore = null;
    const [before, now] = [this.isovalueBefore, this.isovalue()];
    if (before === null || now === null || !this.state.volume) return;
    if (now !== this.state.pose?.isovalue) return;
    this.isovalueBefore = null;
    if (now !== before) this.state.tell(`isovalue changed from ${valueText(before)} to ${valueText(now)}`);
  }

  private lookAtVolume(): void {
    const name = this.state.volume?.name;
    if (name === undefined || this.away) return;
    const known = `${name} ${this.state.volume?.size.join("×")}`;
    if (this.volume !== null && this.volume !== known) this.state.tell(`a new volume: ${name}`);
    this.volume = known;
  }
}
