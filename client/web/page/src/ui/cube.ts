// The orientation cube in the corner of the picture: its faces show where the volume's sides are, and a click on a face
// looks from there.
import type { State } from "../state";
import { column, dot, normalized, scale } from "../view/geometry";
import { cameraOf, lookFrom, sidesOf } from "../view/look";
import { kFaces, letterOf } from "../view/patient_axes";
import type { Vec3 } from "../wire/messages";
import { find, makeSvg, paced, setText } from "./dom";

const kHalf = 50 / Math.sqrt(3); // of an edge, so that a corner is 50 from the middle
const kLeastFacing = 0.05; // thinner faces cannot be read or hit

export function showCube(state: State): void {
  const cube = find("cube");
  const faces = kFaces.map((face) => {
    const [polygon, text] = [makeSvg("polygon"), makeSvg("text")];
    const group = cube.appendChild(makeSvg("g", {}, polygon, text));
    group.addEventListener("click", () => {
      const sides = sidesOf(state.volume, state.placement);
      if (sides) lookFrom(state, scale(face.sign, column(sides.deviceFromPatient, face.axis)));
    });
    return { ...face, group, polygon, text };
  });
  const update = paced(30, () => {
    const sides = sidesOf(state.volume, state.placement);
    cube.toggleAttribute("hidden", !sides);
    if (!sides) return;
    const axesOfView = cameraOf(state).axes();
    // The axes of P in V.
    const axes = [0, 1, 2].map((n) => axesOfView.map((of) => dot(of, normalized(column(sides.deviceFromPatient, n)))) as Vec3);
    for (const { axis, sign, group, polygon, text } of faces) {
      const [out, a, b] = [scale(sign, axes[axis]), axes[(axis + 1) % 3], axes[(axis + 2) % 3]];
      group.toggleAttribute("hidden", out[2] < kLeastFacing);
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([u, v]) =>
        [kHalf * (out[0] + u * a[0] + v * b[0]), -kHalf * (out[1] + u * a[1] + v * b[1])].map((n) => n.toFixed(1)).join());
      polygon.setAttribute("points", corners.join(" "));
      polygon.setAttribute("fill-opacity", String(0.4 + 0.5 * out[2])); // clearer the more it faces the viewer
      text.setAttribute("transform", `translate(${kHalf * out[0]} ${-kHalf * out[1]}) scale(${0.5 + 0.5 * out[2]})`);
      setText(text, sides.ofPatient ? letterOf({ axis, sign }) : (sign > 0 ? "+" : "−") + "xyz"[axis]);
    }
  });
  state.watch(["view", "volume", "placement"], update);
}
