// The state of the view in the URL's fragment:
// room=KEY&view=AZ,EL,DISTANCE,X,Y,Z&veil=VALUE,OPACITY&follow=1&slices=1&cross=I,J,K&isovalue=VALUE&volume=NAME,
// and budget=MIB for the memory that the volume may take.
import type { View } from "../state";
import type { Vec3 } from "../wire/messages";

export interface Fragment {
  room: string | null;
  budgetMiB: number | null;
  volume: string | null; // that the isovalue and the cross-hair are of
  isovalue: number | null; // everybody's when the link was made
  view: Partial<View>; // what the fragment states of it
}

// "": one of them is none.
function inDigits(...values: (number | null | undefined)[]): string {
  return values.every((value) => typeof value === "number") ? values.map((v) => Number(v!.toPrecision(6))).join() : "";
}

export function readFragment(hash: string): Fragment {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const numbers = (key: string) => (parts.get(key) || "x").split(",").map(Number);
  const view: Partial<View> = {};
  const look = numbers("view");
  if (look.length === 6 && look.every(Number.isFinite) && look[2] > 0) {
    [view.azimuthDeg, view.elevationDeg, view.distanceMm] = look;
    view.target = look.slice(3) as Vec3;
  }
  const cross = numbers("cross");
  if (cross.length === 3 && cross.every(Number.isFinite)) view.cross = cross as Vec3;
  const [veil, opacity] = numbers("veil");
  if (Number.isFinite(veil)) view.veil = veil;
  if (Number.isFinite(veil) && opacity > 0 && opacity <= 1) view.veilOpacity = opacity;
  if (parts.get("follow") === "1") view.follow = true;
  if (parts.get("slices") === "1") view.slices = true;
  const [[budget], [isovalue]] = [numbers("budget"), numbers("isovalue")];
  const [room, volume] = [parts.get("room") || null, parts.get("volume") || null];
  return { room, budgetMiB: budget > 0 ? budget : null, volume, isovalue: Number.isFinite(isovalue) ? isovalue : null, view };
}

// `isovalue`: in links that are shared. `isAimed`: the camera has been aimed at a volume, so where it looks is
// worth keeping.
export function writeFragment({ room, budgetMiB, volume, isovalue, view }: Fragment, isAimed: boolean): string {
  const { azimuthDeg, elevationDeg, distanceMm, target = [], cross, veil, veilOpacity, follow, slices } = view;
  const texts: [string, string | null | undefined | false][] = [
    ["room", room !== null && encodeURIComponent(room)],
    ["view", isAimed && inDigits(azimuthDeg, elevationDeg, distanceMm, ...target)],
    ["veil", inDigits(veil, veilOpacity)],
    ["follow", follow && "1"],
    ["slices", slices && "1"],
    ["cross", cross && inDigits(...cross)],
    ["isovalue", inDigits(isovalue)],
    ["volume", (cross || isovalue !== null) && volume && encodeURIComponent(volume)],
    ["budget", inDigits(budgetMiB)],
  ];
  return `#${texts.filter(([, text]) => text).map(([key, text]) => `${key}=${text}`).join("&")}`;
}
