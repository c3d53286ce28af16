import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import type { Room } from "../wire/room";

export interface Actions {
  resetView(): void;
  savePng(): void;
  shareLink(): string;
}

export function buildInterface(_root: HTMLElement, _state: State, _room: Room, _copy: VolumeCopy, _actions: Actions): void {}
