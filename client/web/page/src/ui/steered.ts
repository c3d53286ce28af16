// Sends the newest value of one setting to the gateway: one call at a time, at most 8 a second. The
// gateway refuses more than ten.
import type { Room } from "../wire/room";
import { make, setText } from "./dom";

const kPauseMs = 125;

export class Steered {
  readonly error = make("p", { class: "error", role: "alert" }); // the gateway's, "" after success
  // What the user set and palpated does not state yet; null: palpated's value counts.
  own: number | null = null;
  private isDue = false;

  // `onEnd`: palpated's value counts again.
  constructor(
    private readonly room: Room,
    private readonly key: string,
    private readonly onEnd: () => void,
  ) {}

  set(value: number): void {
    const isBusy = this.own !== null;
    this.own = value;
    this.isDue = true;
    if (!isBusy) void this.run();
  }

  private async run(): Promise<void> {
    let error = "";
    while (this.isDue) {
      this.isDue = false;
      error = await this.room.steer(this.key, this.own!).then(() => "", (refusal: Error) => refusal.message);
      await new Promise((resume) => setTimeout(resume, kPauseMs));
    }
    this.own = null;
    setText(this.error, error);
    this.onEnd();
  }
}
