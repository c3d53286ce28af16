// Takes the pictures of the guides: node pictures.mjs FOLDER, with the environment of CMakeLists.txt.
import path from "node:path";

import { Room, awaitPage, awaitWhole, dataFile } from "./support.mjs";

const folder = process.argv[2];
const PICTURES = [
  {
    name: "web-head", volume: "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", size: [1200, 750],
    isovalue: "300", set: { veil: -300, slices: true, azimuthDeg: 150, elevationDeg: 15 },
  },
  { name: "web-lobster-phone", volume: "paper/lobster_301x324x56_uint8.nhdr", size: [390, 720], isovalue: "60", set: {} },
];

for (const { name, volume, isovalue, size, set } of PICTURES) {
  const room = new Room();
  await room.startDaemon(dataFile(volume), "--isovalue", isovalue);
  await room.startGateway();
  const tab = await room.openBrowser({ width: size[0], height: size[1] });
  await awaitWhole(tab);
  await tab.evaluate((view) => window.palpate.setView(view), set);
  await awaitPage(tab, "p.isFine() && p.state.pose?.contact");
  await tab.screenshot({ path: path.join(folder, `${name}.png`) });
  await room.end();
}
