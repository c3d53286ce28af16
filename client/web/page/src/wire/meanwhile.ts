// Says in plain words what happened while the page or the gateway was cut off, and when a new volume comes.
import type { State } from "../state";
import type { Pose } from "./pose";

interface Away {
  sinceMs: number;
  pose: Pose | null; // the last one before
  gateway: boolean; // the gateway was lost, not only palpated
}

const inDigits = (value: number) => String(Number(value.toPrecision(6)));

export class Meanwhile {
  private away: Away | null = null;
  private wasWell = false;
  private heardMs = 0; // of the newest pose
  private volume: string | null = null;

  constructor(private readonly state: State) {
    state.on("link", () => this.look());
    state.on("connection", () => this.look());
    state.on("volume", () => this.lookAtVolume());
    state.on("pose", () => this.compare());
  }

  private isWell(): boolean {
    return this.state.link === "open" && this.state.connection?.state === "connected";
  }

  private look(): void {
    if (this.isWell()) {
      this.wasWell = true;
      return;
    }
    if (!this.wasWell) return;
    this.away ??= { sinceMs: this.heardMs, pose: this.state.pose, gateway: false };
    if (this.state.link === "lost") this.away.gateway = true;
  }

  // All is well again with the first fresh pose.
  private compare(): void {
    const now = this.state.pose!;
    if (!this.away) this.heardMs = performance.now();
    if (!this.away || !now.fresh || !this.isWell()) return;
    const { sinceMs, pose: before, gateway } = this.away;
    this.away = null;
    const seconds = Math.max(1, Math.round((performance.now() - sinceMs) / 1000));
    this.state.tell(gateway ? `connection lost ${seconds} s` : `palpated was away for ${seconds} s`);
    if (before && now.tick < before.tick) this.state.tell("palpated was restarted");
    this.lookAtVolume();
    if (before && now.isovalue !== before.isovalue) {
      this.state.tell(`isovalue changed from ${inDigits(before.isovalue)} to ${inDigits(now.isovalue)}`);
    }
  }

  private lookAtVolume(): void {
    const name = this.state.volume?.name;
    if (name === undefined || this.away) return;
    const known = `${name} ${this.state.volume?.size?.join("×")}`;
    if (this.volume !== null && this.volume !== known) this.state.tell(`a new volume: ${name}`);
    this.volume = known;
  }
}
