// The values that slices show from black to white (client/view/drawing/value_window.h).
import { clamp } from "../view/geometry";
import type { Volume } from "../wire/contract";
import type { ValueWindow } from "../wire/messages";

export interface NamedWindow {
  name: string;
  window: ValueWindow;
}

const kOfHounsfieldUnits: NamedWindow[] = [
  { name: "Soft tissue and bone", window: { level: 240, width: 800 } },
  { name: "Bone", window: { level: 400, width: 1800 } },
  { name: "Soft tissue", window: { level: 40, width: 400 } },
  { name: "Lung", window: { level: -600, width: 1500 } },
  { name: "Brain", window: { level: 40, width: 80 } },
];

function wholeRange({ valueMin: min, valueMax: max }: Volume): ValueWindow {
  return { level: (min + max) / 2, width: max - min || 1 };
}

// The file says so, or states no unit and has the values of air and of bone.
function hasHounsfieldUnits({ unit, type, valueMin, valueMax }: Volume): boolean {
  if (unit) return unit === "HU";
  return type === "int16" && valueMin <= -900 && valueMin >= -4096 && valueMax >= 300;
}

// A volume begins with the first: the file's, if it proposes one that shows anything.
export function windowsOf(volume: Volume): NamedWindow[] {
  const whole = wholeRange(volume);
  const window = { level: volume.windowLevel, width: volume.windowWidth };
  const isUseful = window.width > 0 && Math.abs(window.level - whole.level) < (window.width + whole.width) / 2;
  return [
    ...(isUseful ? [{ name: "As in the file", window }] : []),
    ...(hasHounsfieldUnits(volume) ? kOfHounsfieldUnits : []),
    { name: "Whole range", window: whole },
  ];
}

// A drag to the right widens, up raises the level, by the width over a quarter of the picture.
export function dragged(volume: Volume, window: ValueWindow, right: number, down: number, picturePx: number): ValueWindow {
  const whole = wholeRange(volume);
  const widthsPerPx = 4 / Math.max(picturePx, 1);
  return {
    level: clamp(window.level - down * widthsPerPx * window.width, whole.level - whole.width, whole.level + whole.width),
    width: clamp(window.width * Math.exp(right * widthsPerPx), 1e-3 * whole.width, 4 * whole.width),
  };
}
