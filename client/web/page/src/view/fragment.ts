// The state of the view in the URL's fragment: room=KEY&view=AZ,EL,DISTANCE,X,Y,Z&veil=VALUE,OPACITY&follow=1&slices=1,
// and budget=MIB for the memory that the volume may take.
import type { View } from "../state";
import type { Vec3 } from "../wire/messages";

export interface Fragment {
  room: string | null;
  budgetMiB: number | null;
  view: Partial<View>; // what the fragment states of it
}

const inDigits = (value: number) => String(Number(value.toPrecision(6)));

export function readFragment(hash: string): Fragment {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const numbers = (key: string) => (parts.get(key) || "x").split(",").map(Number);
  const view: Partial<View> = {};
  const look = numbers("view");
  if (look.length === 6 && look.every(Number.isFinite) && look[2] > 0) {
    [view.azimuthDeg, view.elevationDeg, view.distanceMm] = look;
    view.target = look.slice(3) as Vec3;
  }
  const [veil, opacity] = numbers("veil");
  if (Number.isFinite(veil)) view.veil = veil;
  if (Number.isFinite(veil) && opacity > 0 && opacity <= 1) view.veilOpacity = opacity;
  if (parts.get("follow") === "1") view.follow = true;
  if (parts.get("slices") === "1") view.slices = true;
  const [budget] = numbers("budget");
  return { room: parts.get("room") || null, budgetMiB: budget > 0 ? budget : null, view };
}

// `isAimed`: the camera has been aimed at a volume, so where it looks is worth keeping.
export function writeFragment(room: string | null, budgetMiB: number | null, view: View, isAimed: boolean): string {
  const { azimuthDeg, elevationDeg, distanceMm, target } = view;
  const parts = [];
  if (room !== null) parts.push(`room=${encodeURIComponent(room)}`);
  if (isAimed) parts.push(`view=${[azimuthDeg, elevationDeg, distanceMm, ...target].map(inDigits).join()}`);
  if (view.veil !== null) parts.push(`veil=${[view.veil, view.veilOpacity].map(inDigits).join()}`);
  if (view.follow) parts.push("follow=1");
  if (view.slices) parts.push("slices=1");
  if (budgetMiB !== null) parts.push(`budget=${budgetMiB}`);
  return `#${parts.join("&")}`;
}
