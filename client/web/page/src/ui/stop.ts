// The emergency stop, for everybody who is logged in. It acts at the press, and says what came of it.
import type { State } from "../state";
import type { Room } from "../wire/room";
import { find, setAttribute, setText } from "./dom";

export const kStopKey = "stop"; // stands for a setting's key

const kPatienceMs = 1500;
const kDoneMs = 8000; // the state of the forces says it, too

export function showStop(state: State, room: Room): void {
  const button = find<HTMLButtonElement>("stop");
  const result = find("stop-result");
  let timer = 0;
  const say = (text: string, tone: string) => {
    clearTimeout(timer);
    result.hidden = text === "";
    setText(result, text);
    setAttribute(result, "data-tone", tone);
  };
  const stop = () => {
    say("stopping…", "caution");
    timer = window.setTimeout(() => say("no answer yet: switch the device off if in doubt", "alarm"), kPatienceMs);
    room.steer(kStopKey, 0).then(
      () => {
        say("forces stopped", "acting");
        timer = window.setTimeout(() => say("", "idle"), kDoneMs);
      },
      (refusal: Error) => say(`STOP NOT CONFIRMED: ${refusal.message}; switch the device off`, "alarm"),
    );
  };
  button.addEventListener("pointerdown", (event) => {
    if (event.button === 0) stop();
  });
  // By the keyboard; a pointer has stopped at its press.
  button.addEventListener("click", (event) => {
    if (event.detail === 0) stop();
  });
  state.watch("hello", () => {
    button.hidden = !(state.hello?.may_stop ?? false);
  });
}
