// Controls for the settings that this user may steer, beside the isovalue. They change for everyone.
import type { State } from "../state";
import type { SettingInfo } from "../wire/messages";
import type { Room } from "../wire/room";
import { find, make, setText } from "./dom";
import { Steered } from "./steered";
import { lastChangeText } from "./words";

type Value = number | boolean | string;

interface Control {
  row: HTMLElement;
  show(value: Value): void; // palpated's
}

function numberControl(setting: SettingInfo, describedBy: string, set: (value: number) => void): Control {
  const { minimum, maximum, unit, label } = setting;
  const bounds = { ...(minimum !== null && { min: minimum }), ...(maximum !== null && { max: maximum }) };
  const id = `steer-${setting.key}`;
  const number = make("input", { id, type: "number", step: "any", "aria-describedby": describedBy, ...bounds });
  const pair = make("div", { class: "pair" });
  const inputs = [number];
  if (minimum !== null && maximum !== null) {
    const slider = make("input", {
      type: "range", ...bounds, step: (maximum - minimum) / 200, "aria-label": unit ? `${label}, ${unit}` : label,
    });
    inputs.unshift(slider);
    slider.addEventListener("input", () => set(slider.valueAsNumber));
  }
  number.addEventListener("change", () => {
    if (Number.isFinite(number.valueAsNumber)) set(number.valueAsNumber);
  });
  pair.append(...inputs, unit);
  return {
    row: make("div", { class: "field" }, make("label", { for: id }, label), pair),
    show: (value) => {
      for (const input of inputs) {
        if (document.activeElement !== number || input !== number) input.value = String(Number(Number(value).toPrecision(6)));
      }
    },
  };
}

function flagControl(setting: SettingInfo, describedBy: string, set: (value: number) => void): Control {
  const box = make("input", { type: "checkbox", "aria-describedby": describedBy });
  box.addEventListener("change", () => set(box.checked ? 1 : 0));
  return {
    row: make("div", { class: "field" }, make("label", { class: "check" }, box, setting.label)),
    show: (value) => (box.checked = Boolean(value)),
  };
}

function choiceControl(setting: SettingInfo, describedBy: string, set: (value: number) => void): Control {
  const id = `steer-${setting.key}`;
  const select = make("select", { id, "aria-describedby": describedBy });
  select.append(...setting.words.map((word, index) => make("option", { value: index }, word)));
  select.addEventListener("change", () => set(select.selectedIndex));
  return {
    row: make("div", { class: "field" }, make("label", { for: id }, setting.label), select),
    show: (value) => (select.selectedIndex = typeof value === "string" ? setting.words.indexOf(value) : Number(value)),
  };
}

const kControls = { number: numberControl, flag: flagControl, choice: choiceControl };

// Returns a function that shows palpated's value.
function addControl(body: HTMLElement, setting: SettingInfo, state: State, room: Room): () => void {
  const error = make("p", { class: "error", role: "alert" });
  const helpId = `help-${setting.key}`;
  const who = make("span");
  const steered = new Steered((value) => room.steer(setting.key, value), (why) => {
    setText(error, why);
    update();
  });
  const set = (value: number) => {
    steered.set(value);
    control.show(value);
  };
  const control = kControls[setting.kind](setting, helpId, set);
  control.row.append(make("p", { class: "help" }, make("span", { id: helpId }, setting.help), " ", who), error);
  body.append(control.row);
  const update = () => {
    const value = state.settings?.values[setting.key];
    if (value !== undefined && steered.own === null) control.show(value);
    const change = lastChangeText(state.steering, setting.key);
    setText(who, change ? `· ${change}` : "");
  };
  update();
  return update;
}

export function showControls(root: HTMLElement, state: State, room: Room): void {
  const section = find(root, "steer-section");
  const body = find(root, "steer");
  let updates: (() => void)[] = [];
  let shown = "";
  state.on("hello", () => {
    const settings = (state.hello?.settings ?? []).filter(
      ({ key }) => key !== "isovalue" && state.hello?.may_steer.includes(key),
    );
    // A new connection says the same again; the controls keep the focus.
    if (JSON.stringify(settings) === shown) return;
    shown = JSON.stringify(settings);
    section.hidden = settings.length === 0;
    body.replaceChildren();
    updates = settings.map((setting) => addControl(body, setting, state, room));
  });
  for (const topic of ["settings", "steering"] as const) state.on(topic, () => updates.forEach((update) => update()));
}
