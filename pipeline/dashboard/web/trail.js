// The last minutes of a rig as a strip: low where in sync, middling where it cannot tell, high where out of sync.

import { svg } from "./dom.js";

const HEIGHT = 12;
const SHAPES = { s: { y: 8, height: 4 }, u: { y: 5, height: 7 }, a: { y: 0, height: 12 } };

export function makeTrail() {
  return svg("svg", { class: "trail", preserveAspectRatio: "none", role: "img" });
}

export function drawTrail(element, trail, slotS) {
  if (element.dataset.trail === trail) return;
  element.dataset.trail = trail;
  element.setAttribute("viewBox", `0 0 ${trail.length} ${HEIGHT}`);
  const out = (trail.split("a").length - 1) * slotS;
  element.setAttribute("aria-label", `out of sync for ${out} s of the last ${(trail.length * slotS) / 60} minutes`);
  const runs = [];
  for (let begin = 0; begin < trail.length; ) {
    let end = begin + 1;
    while (trail[end] === trail[begin]) end += 1;
    const shape = SHAPES[trail[begin]];
    if (shape) runs.push(svg("rect", { x: begin, width: end - begin, ...shape, class: `state-${trail[begin]}` }));
    begin = end;
  }
  element.replaceChildren(svg("rect", { x: 0, width: trail.length, y: 11, height: 1, class: "ground" }), ...runs);
}
