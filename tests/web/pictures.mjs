// Takes the pictures of the guides: node pictures.mjs FOLDER [NAME...], with the environment of
// CMakeLists.txt. NAME: one of the pictures; default: all.
import path from "node:path";

import { Room, awaitPage, awaitWhole, dataFile } from "./support.mjs";

const [, , folder, ...names] = process.argv;
const HEAD = {
  volume: "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", isovalue: "300",
  set: { veil: -300, slices: true, azimuthDeg: 150, elevationDeg: 15 },
};
const PICTURES = [
  { ...HEAD, name: "web-head", size: [1200, 750] },
  { name: "web-lobster-phone", volume: "paper/lobster_301x324x56_uint8.nhdr", size: [390, 720], isovalue: "60", set: {} },
  { ...HEAD, name: "web-layers", size: [1000, 700], layers: "skin-bone", set: { ...HEAD.set, veil: null } },
  // To be looked at; the guides do not have them.
  { ...HEAD, name: "ball", size: [1000, 700], ball: "2.5" },
  ...[[800, 600], [1280, 800], [2560, 1440], [390, 844]].map((size) => ({ ...HEAD, name: `tour-${size.join("x")}`, size })),
];

for (const { name, volume, isovalue, layers, ball, size, set } of PICTURES.filter(({ name }) => names.length === 0 || names.includes(name))) {
  const room = new Room();
  await room.startDaemon(dataFile(volume), "--isovalue", isovalue);
  if (layers) await room.palpate("layers", layers);
  if (ball) await room.palpate("set", "tool_radius", ball);
  await room.startGateway();
  const tab = await room.openBrowser({ width: size[0], height: size[1] });
  await awaitWhole(tab);
  await tab.evaluate((view) => window.palpate.state.setView(view), set);
  // In software, a fine picture of four million pixels takes minutes.
  const isDrawn = size[0] > 2000 ? "p.viewport.caster.isCurrent" : "p.viewport.isFine()";
  await awaitPage(tab, `${isDrawn} && p.state.pose?.contact`);
  await tab.screenshot({ path: path.join(folder, `${name}.png`) });
  await room.end();
}
