import { State } from "./state";
import { buildInterface } from "./ui/index";
import { VolumeCopy } from "./volume/copy";
import { Room } from "./wire/room";

const state = new State();
buildInterface(document.body, state, new Room(state), new VolumeCopy(state), {
  resetView() {},
  savePng() {},
  shareLink: () => location.href,
});
