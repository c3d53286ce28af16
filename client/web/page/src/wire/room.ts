// The connection to the gateway.
import type { State } from "../state";

export class Room {
  constructor(private readonly state: State) {}

  // Logs in and connects. `secret`: the room's key, or a user's token. Rejects with what the gateway says.
  login(_secret: { room: string } | { token: string }): Promise<void> {
    this.state.link = "connecting";
    return Promise.resolve();
  }

  // The room's key if the guest came by one, to share it in a link.
  get roomKey(): string | null {
    return null;
  }

  // Flags: 0 or 1. Choices: the word's number. Rejects with the gateway's error.
  steer(_key: string, _value: number): Promise<void> {
    return Promise.reject(new Error("not connected"));
  }
}
