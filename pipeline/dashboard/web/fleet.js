// All rigs, the worst first.

import { drawIcon, el, icon, keyed, say } from "./dom.js";
import { drawTrail, makeTrail } from "./trail.js";
import { GLYPHS, offset, pairName } from "./words.js";

const PAIRS_SHOWN = 3;
const FEW = 6;

export class FleetPage {
  constructor(main) {
    this.empty = el("p", { class: "empty" });
    this.cards = el("ul", { class: "cards" });
    this.note = el("p", { class: "note" });
    main.append(this.empty, this.cards, this.note);
    this.handlers = { fleet: (message) => this.show(message), tick: () => {} };
  }

  opened() {}

  show(fleet) {
    this.empty.hidden = fleet.rigs.length > 0;
    say(this.empty, `No rig has been heard yet under ${fleet.prefix}/, listening at ${fleet.where}.`);
    this.note.hidden = fleet.left_out === 0;
    say(this.note, "There are more rigs than this page can hold: some are not shown.");
    this.cards.dataset.few = fleet.rigs.length <= FEW;
    this.cards.dataset.many = fleet.rigs.some((rig) => rig.small);
    keyed(this.cards, fleet.rigs, (rig) => rig.name, makeCard, updateCard);
    this.nameFirsts();
    const tones = new Map();
    for (const rig of fleet.rigs) tones.set(rig.tone, (tones.get(rig.tone) ?? 0) + 1);
    this.summary = { problem: fleet.problem, counts: [...tones] };
    const worst = fleet.rigs[0];
    this.title = worst ? `${GLYPHS[worst.tone]} ${worst.word}: ${worst.name}` : "no rigs";
  }

  /** The first card of each tone can be gone to by its name; where the page was opened to do so, it is. */
  nameFirsts() {
    const named = new Set();
    for (const { dataset, firstElementChild: link } of this.cards.children) {
      link.id = named.has(dataset.tone) ? "" : dataset.tone;
      named.add(dataset.tone);
    }
    if (!this.arrived && named.size) document.getElementById(location.hash.slice(1))?.focus();
    this.arrived = named.size > 0;
  }
}

function makeCard(rig) {
  const parts = {
    icon: icon(rig.tone),
    word: el("strong", { class: "word" }),
    name: el("span", { class: "name" }),
    detail: el("p", { class: "detail" }),
    pairs: el("ul", { class: "pairs" }),
    trail: makeTrail(),
  };
  const head = el("div", { class: "head" }, parts.icon, el("div", {}, parts.word, parts.name));
  const made = el("li", { class: "card" }, el("a", { href: `/rig?name=${encodeURIComponent(rig.name)}` }, head, parts.detail, parts.pairs, parts.trail));
  made.parts = parts;
  return made;
}

function updateCard(card, rig) {
  const { parts } = card;
  card.dataset.tone = rig.tone;
  card.dataset.small = rig.small;
  drawIcon(parts.icon, rig.tone);
  say(parts.word, rig.word);
  say(parts.name, rig.name);
  say(parts.detail, rig.small ? "" : rig.detail);
  if (rig.small) return;
  const shown = rig.pairs.slice(0, PAIRS_SHOWN).map((pair) => [pairName(pair.name), offset(pair.offset_ms, pair.sigma_ms)]);
  if (rig.pairs.length > PAIRS_SHOWN) shown.push([`and ${rig.pairs.length - PAIRS_SHOWN} more pairs`, ""]);
  keyed(parts.pairs, shown, ([name]) => name, makePair, (made, [name, text]) => {
    say(made.firstChild, name);
    say(made.lastChild, text);
  });
  drawTrail(parts.trail, rig.trail, rig.slot_s);
}

function makePair() {
  return el("li", {}, el("span"), el("b"));
}
