// The bar, the line at the bottom, and the list of what happened.
import type { State } from "../state";
import { find, make, setText } from "./dom";
import { kFacingKey } from "./facing";
import { kStopKey } from "./stop";
import { kTicksPerS } from "./words";

export function showHeader(state: State): void {
  const name = find("volume-name");
  const facts = find("volume-facts");
  const guests = find("guests");
  const recording = find("recording");
  state.on("volume", () => {
    const { volume } = state;
    setText(name, volume?.name || "Palpate");
    name.title = volume?.name ?? "";
    setText(facts, volume ? `${volume.size.join(" × ")} · ${volume.type}` : "");
    document.title = volume?.name ? `${volume.name} – Palpate` : "Palpate";
  });
  state.on("guests", () => {
    const count = state.guests?.count ?? 0;
    guests.hidden = count === 0;
    setText(guests, count === 1 ? "1 guest" : `${count} guests`);
  });
  state.on("recording", () => {
    recording.hidden = !state.recording?.running;
    setText(recording, `● REC ${Math.round((state.recording?.ticks ?? 0) / kTicksPerS)} s`);
    recording.title = "palpated records";
  });
  const server = find("server");
  state.on(["connection", "hello"], () => {
    const palpated = state.connection?.palpated ? `palpated at ${state.connection.palpated}` : "";
    setText(server, [palpated, state.hello ? `palpate-web ${state.hello.version}` : ""].filter(Boolean).join(" · "));
  });
}

const kNextTheme = { system: "dark", dark: "light", light: "system" } as const;

export function nextTheme(state: State): void {
  state.setView({ theme: kNextTheme[state.view.theme] });
}

// Dark, light, or as the system has it. style.css has the colours for both values of data-theme.
export function showTheme(state: State): void {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const words = find("theme-words");
  const { dataset } = document.documentElement;
  const update = () => {
    const { theme } = state.view;
    setText(words, `Theme: ${theme === "system" ? "auto" : theme}`);
    const shown = theme !== "system" ? theme : system.matches ? "dark" : "light";
    if (dataset.theme === shown) return;
    dataset.theme = shown;
    state.emit("view"); // the picture takes its colours anew
  };
  system.addEventListener("change", update);
  state.watch("view", update);
}

const kSameChangeMs = 10_000; // a drag is one change

// The newest first, each with the time at which this page heard of it.
export function showEvents(state: State): void {
  const list = find("events");
  const add = (event: string) => {
    const time = new Date().toLocaleTimeString([], { hour12: false });
    list.prepend(make("li", {}, make("time", {}, time), ` ${event}`));
    while (list.children.length > state.events.length) list.lastElementChild!.remove();
  };
  state.events.forEach(add);
  state.on("events", () => add(state.events.at(-1)!));
}

// Tells who steers. What was steered before this page came is not news.
export function tellSteering(state: State): void {
  let newestMs: number | null = null;
  let toldText = "";
  let toldMs = 0;
  state.on("steering", () => {
    const change = state.steering?.changes.at(-1);
    const isNews = newestMs !== null && change !== undefined && change.time_ms > newestMs;
    newestMs = change?.time_ms ?? newestMs ?? 0;
    if (!isNews) return;
    const setting = state.hello?.settings.find(({ key }) => key === change.key);
    const label = change.key === kFacingKey ? "Where it faces" : (setting?.label ?? change.key);
    const text = change.key === kStopKey ? `Forces stopped by ${change.user}` : `${label} set by ${change.user}`;
    if (text !== toldText || change.time_ms - toldMs > kSameChangeMs) state.tell(text);
    [toldText, toldMs] = [text, change.time_ms];
  });
}
