// Controls for the settings that this user may steer, beside the isovalue. They change for everyone.
import type { State } from "../state";
import type { SettingInfo } from "../wire/messages";
import type { Room } from "../wire/room";
import { find, make, setText } from "./dom";
import { Steered } from "./steered";
import { lastChangeText } from "./words";

type Value = number | boolean;

interface Control {
  parts: (Node | string)[];
  show(value: Value): void; // palpated's
}

// `id`: of the element with the label. `set` steers.
type Builder = (setting: SettingInfo, id: string, set: (value: number) => void) => Control;

const numberControl: Builder = ({ label, unit, minimum, maximum, whole }, id, set) => {
  const bounds = { ...(minimum !== null && { min: minimum }), ...(maximum !== null && { max: maximum }) };
  const inputs = [make("input", { id, type: "number", step: whole ? 1 : "any", ...bounds })];
  if (minimum !== null && maximum !== null) {
    const name = unit ? `${label}, ${unit}` : label;
    inputs.unshift(make("input", { type: "range", step: whole ? 1 : (maximum - minimum) / 200, "aria-label": name, ...bounds }));
  }
  for (const input of inputs) {
    input.addEventListener(input.type === "range" ? "input" : "change", () => {
      if (Number.isFinite(input.valueAsNumber)) set(input.valueAsNumber);
    });
  }
  return {
    parts: [make("label", { for: id }, label), make("div", { class: "pair" }, ...inputs, unit)],
    show: (value) => {
      const text = String(Number(Number(value).toPrecision(6)));
      for (const input of inputs) if (input.type === "range" || document.activeElement !== input) input.value = text;
    },
  };
};

const flagControl: Builder = ({ label }, id, set) => {
  const box = make("input", { id, type: "checkbox" });
  box.addEventListener("change", () => set(box.checked ? 1 : 0));
  return { parts: [make("label", { class: "check" }, box, label)], show: (value) => (box.checked = Boolean(value)) };
};

const choiceControl: Builder = ({ label, words }, id, set) => {
  const select = make("select", { id }, ...words.map((word, value) => make("option", { value }, word)));
  select.addEventListener("change", () => set(select.selectedIndex));
  return {
    parts: [make("label", { for: id }, label), select],
    show: (value) => (select.selectedIndex = Number(value)),
  };
};

const kBuilders = { number: numberControl, flag: flagControl, choice: choiceControl };

// Returns a function that shows palpated's value.
function addControl(body: HTMLElement, setting: SettingInfo, state: State, room: Room): () => void {
  const { key, kind, help } = setting;
  const who = make("span");
  const steered = new Steered(room, key, () => update());
  const control = kBuilders[kind](setting, `steer-${key}`, (value) => {
    steered.set(value);
    control.show(value);
  });
  const helpText = make("span", { id: `help-${key}` }, help);
  body.append(make("div", { class: "field" }, ...control.parts, make("p", { class: "help" }, helpText, who), steered.error));
  const input = find(`steer-${key}`);
  input.setAttribute("aria-describedby", helpText.id);
  input.addEventListener("blur", () => update()); // palpated's value is back if it refused the typed one
  const update = () => {
    const value = state.setting(key);
    // Choices are steered by the numbers of their words, from 0.
    if (value !== undefined && steered.own === null) control.show(kind === "choice" ? Number(value) - 1 : value);
    const change = lastChangeText(state.steering, key);
    setText(who, change && ` · ${change}`);
  };
  update();
  return update;
}

export function showControls(state: State, room: Room): void {
  const section = find("steer-section");
  const body = find("steer");
  const note = make("p", { class: "note", hidden: "" }, "these are the replay's until it ends");
  body.before(note);
  let updates: (() => void)[] = [];
  let shown = "";
  state.on("hello", () => {
    const { settings = [], may_steer = [] } = state.hello ?? {};
    const mine = settings.filter(({ key }) => key !== "isovalue" && may_steer.includes(key));
    // A new connection says the same again; the controls keep the focus.
    if (JSON.stringify(mine) === shown) return;
    shown = JSON.stringify(mine);
    section.hidden = mine.length === 0;
    body.replaceChildren();
    updates = mine.map((setting) => addControl(body, setting, state, room));
  });
  state.on(["settings", "steering"], () => {
    updates.forEach((update) => update());
    body.inert = state.settings?.replayed ?? false;
    note.hidden = !body.inert;
  });
}
