// Dark, light, or as the system has it. style.css has the colours for both values of data-theme.
import type { State, Theme } from "../state";
import { find, setText } from "./dom";

const kNext: Record<Theme, Theme> = { system: "dark", dark: "light", light: "system" };
const kWords: Record<Theme, string> = { system: "auto", dark: "dark", light: "light" };

export function nextTheme(state: State): void {
  state.view.theme = kNext[state.view.theme];
  state.emit("view");
}

export function showTheme(root: HTMLElement, state: State): void {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const button = find(root, "theme");
  const update = () => {
    const { theme } = state.view;
    const shown = theme === "system" ? (system.matches ? "dark" : "light") : theme;
    setText(find(root, "theme-words"), `Theme: ${kWords[theme]}`);
    if (document.documentElement.dataset.theme === shown) return;
    document.documentElement.dataset.theme = shown;
    state.emit("view"); // canvases take their colours anew
  };
  button.addEventListener("click", () => nextTheme(state));
  system.addEventListener("change", update);
  state.on("view", update);
  update();
}
