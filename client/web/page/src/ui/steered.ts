// Sends the newest value of one setting to the gateway: one call at a time, at most 8 a second. The
// gateway refuses more than ten.

const kPauseMs = 125;

export class Steered {
  // What the user set and palpated does not state yet; null: palpated's value counts.
  own: number | null = null;
  private isDue = false;
  private isBusy = false;

  // `send` rejects with the gateway's error. `onChange` is told it, "" after success.
  constructor(
    private readonly send: (value: number) => Promise<void>,
    private readonly onChange: (error: string) => void,
  ) {}

  set(value: number): void {
    this.own = value;
    this.isDue = true;
    if (!this.isBusy) void this.run();
  }

  private async run(): Promise<void> {
    this.isBusy = true;
    let error = "";
    while (this.isDue && this.own !== null) {
      this.isDue = false;
      try {
        await this.send(this.own);
        error = "";
      } catch (refusal) {
        error = refusal instanceof Error ? refusal.message : String(refusal);
      }
      await new Promise((resume) => setTimeout(resume, kPauseMs));
    }
    this.isBusy = false;
    this.own = null;
    this.onChange(error);
  }
}
