// One rig: how it stands, the offset of each pair over time, its cameras, and what has happened.

import { Chart } from "./chart.js";
import { drawIcon, el, icon, keyed, say } from "./dom.js";
import { GLYPHS, clock, duration, offset, pairName, plain, signed } from "./words.js";

const LEAST_PPM = 0.1;
const TONE_OF = { sync: "good", async: "bad", unknown: "unsure" };
const SAID = { sync: "in sync", async: "out of sync", unknown: "cannot tell" };

export class RigPage {
  constructor(main, name) {
    this.name = name;
    this.hero = {
      box: el("section", { class: "hero" }),
      icon: icon("unsure"),
      name: el("p", { class: "name" }, name),
      word: el("span", { role: "status" }, "…"), // read aloud when it changes; what counts seconds is not
      since: el("p", { class: "since" }),
      detail: el("p", { class: "detail" }),
    };
    const { box, ...parts } = this.hero;
    box.append(parts.icon, el("div", {}, parts.name, el("h1", { class: "word" }, parts.word), parts.since, parts.detail));
    this.pairs = el("section", { class: "plots" });
    this.cameras = el("section", { class: "cameras" });
    this.events = el("ol", { class: "events" });
    this.quiet = el("p", { class: "muted" }, "Nothing has happened since this monitor was started.");
    this.monitor = el("footer", { class: "note" });
    this.below = el("div", { class: "below" }, el("section", {}, el("h2", {}, "Cameras"), this.cameras), el("section", { class: "log" }, el("h2", {}, "What happened"), this.quiet, this.events));
    main.append(box, this.pairs, this.below, this.monitor);
    this.charts = new Map();
    this.handlers = {
      rig: (message) => this.show(message),
      offsets: (message) => this.plot(message),
      tick: (message) => this.charts.forEach((chart) => chart.tick(message.now_ms)),
    };
  }

  opened() {
    this.charts.forEach((chart) => chart.clear());
  }

  show(rig) {
    const { hero } = this;
    const tone = rig.unheard_of ? "unsure" : rig.tone;
    hero.box.dataset.tone = tone;
    drawIcon(hero.icon, tone);
    say(hero.word, rig.unheard_of ? "Never heard" : rig.word);
    say(hero.detail, rig.unheard_of ? "No rig of this name has been heard yet." : rig.detail);
    this.title = `${GLYPHS[tone]} ${hero.word.textContent}: ${this.name}`;
    this.below.hidden = this.pairs.hidden = !rig.status;
    say(hero.since, rig.status && rig.presence === "alive" ? since(rig) : "");
    if (!rig.status) return;
    document.documentElement.dataset.presence = rig.presence;
    const pairs = Object.entries(rig.status.pairs);
    keyed(this.pairs, pairs, ([name]) => name, ([name]) => this.makePair(name), (made, [, pair]) => updatePair(made, pair, rig.presence));
    const cameras = Object.entries(rig.status.cameras);
    keyed(this.cameras, cameras, ([name]) => name, makeCamera, (made, [name, camera]) =>
      updateCamera(made, camera, rig.presence, rig.previews[name], `rig=${encodeURIComponent(this.name)}&camera=${encodeURIComponent(name)}`),
    );
    this.quiet.hidden = rig.events.length > 0;
    keyed(this.events, rig.events, (event) => event.id, makeEvent, updateEvent);
    say(this.monitor, monitorText(rig.status.monitor));
  }

  makePair(name) {
    const canvas = el("canvas", { class: "chart", role: "img" });
    const readout = el("p", { class: "readout" });
    const parts = { icon: icon("unsure"), state: el("span", { class: "state" }), offset: el("b", { class: "offset" }), more: el("p", { class: "more" }) };
    const head = el("header", {}, el("h2", {}, pairName(name)), el("span", { class: "badge" }, parts.icon, parts.state), parts.offset);
    const made = el("article", { class: "panel plot" }, head, parts.more, canvas, readout);
    made.parts = parts;
    this.charts.set(name, new Chart(canvas, readout, pairName(name)));
    return made;
  }

  plot(message) {
    for (const [pair, rows] of Object.entries(message.pairs)) this.charts.get(pair)?.add(rows, message.kept_s);
  }
}

function monitorText({ version, uptime_s, dropped_windows, latency_p99_ms, memory_bytes }) {
  const said = [
    `syncwatch ${version}, watching for ${duration(uptime_s)}`,
    latency_p99_ms === null ? null : `99 % of verdicts within ${Math.round(latency_p99_ms)} ms`,
    memory_bytes === null ? null : `${Math.round(memory_bytes / 1e6)} MB`,
    dropped_windows ? `${dropped_windows} windows dropped under load` : null,
  ];
  return said.filter(Boolean).join(", ");
}

/** For how long the pairs that decide the headline have been so, by the monitor's own clock. */
function since(rig) {
  const state = { bad: "async", unsure: "unknown", good: "sync" }[rig.tone];
  const begun = Object.values(rig.status.pairs).filter((pair) => pair.state === state).map((pair) => pair.since_ms);
  if (!begun.length) return "";
  const at = rig.tone === "good" ? Math.max(...begun) : Math.min(...begun);
  return `for ${duration((rig.status.at_ms - at) / 1000)}, since ${clock(at)}`;
}

function updatePair({ parts, dataset }, pair, presence) {
  const now = presence === "alive";
  const tone = now ? TONE_OF[pair.state] : "ended";
  dataset.tone = tone;
  drawIcon(parts.icon, tone);
  const state = pair.cause ? `${SAID[pair.state]}: ${plain(pair.cause)}` : SAID[pair.state];
  say(parts.state, now ? state : `last known: ${state}`);
  say(parts.offset, offset(pair.offset_ms, pair.offset_sigma_ms));
  const pace = pair.drift.stamps_ppm ?? pair.drift.pictures_ppm;
  const more = [
    pair.cause_words,
    pace === null || Math.abs(pace) < LEAST_PPM ? null : `drifts by ${signed(pace)} ppm`,
    pair.skew_p99_ms === null ? null : `99 % within ${pair.skew_p99_ms.toFixed(1)} ms over the last minute`,
    `${Math.round(100 * pair.coverage)} % of frames decided`,
  ];
  say(parts.more, more.filter(Boolean).join("; "));
}

const VALUES = [
  ["fps", (c) => `${c.fps === null ? "?" : c.fps.toFixed(1)} of ${Number(c.expected_fps.toFixed(1))}`, (c) => c.fps !== null && Math.abs(c.fps / c.expected_fps - 1) > 0.05],
  ["dropped", (c) => c.drops, (c) => c.drops > 0],
  ["unpaired", (c) => c.unpaired, (c) => c.unpaired > 0],
  ["doubled", (c) => c.duplicates, (c) => c.duplicates > 0],
  ["stalls", (c) => c.stalls, (c) => c.stalls > 0],
  ["restarts", (c) => c.restarts, (c) => c.restarts > 0],
  ["jitter (99 %)", (c) => (c.jitter_p99_ms === null ? "–" : `${c.jitter_p99_ms.toFixed(2)} ms`), () => false],
];

function makeCamera([name]) {
  const parts = {
    picture: el("img", { class: "preview", alt: `what ${name} sees`, hidden: true }),
    conditions: el("p", { class: "conditions" }),
    values: VALUES.map(([label]) => [el("dt", {}, label), el("dd")]),
  };
  const list = el("dl", {}, ...parts.values.map(([label, value]) => el("div", {}, label, value)));
  const made = el("article", { class: "panel camera" }, parts.picture, el("h3", {}, name), parts.conditions, list);
  made.parts = parts;
  return made;
}

function updateCamera({ parts }, camera, presence, number, address) {
  for (const [index, [, text, odd]] of VALUES.entries()) {
    say(parts.values[index][1], String(text(camera)));
    parts.values[index][1].className = odd(camera) ? "odd" : "";
  }
  const tone = presence !== "alive" ? "ended" : camera.conditions.length ? "warn" : "good";
  parts.conditions.dataset.tone = tone;
  if (!parts.icon) parts.conditions.append((parts.icon = icon(tone)), (parts.text = el("span")));
  drawIcon(parts.icon, tone);
  const state = camera.conditions.length ? camera.conditions.map(plain).join(", ") : "well";
  say(parts.text, presence === "alive" ? state : `last known: ${state}`);
  if (number && parts.number !== number) {
    parts.number = number;
    const next = new Image();
    next.onload = () => {
      parts.picture.src = next.src;
      parts.picture.hidden = false;
    };
    next.src = `/preview?${address}&number=${number}`;
  }
}

function makeEvent() {
  const parts = { icon: icon("ended"), what: el("b"), when: el("span", { class: "when" }), text: el("p"), end: el("p", { class: "muted" }) };
  const made = el("li", { class: "event" }, parts.icon, el("div", {}, el("header", {}, parts.what, parts.when), parts.text, parts.end));
  made.parts = parts;
  return made;
}

function updateEvent({ parts, dataset }, event) {
  const tone = event.open ? (event.kind === "async" ? "bad" : "warn") : "ended";
  dataset.tone = tone;
  drawIcon(parts.icon, tone);
  const kind = event.kind === "async" ? "out of sync" : plain(event.kind);
  say(parts.what, [event.where && pairName(event.where), event.cause ? `${kind}: ${plain(event.cause)}` : kind].filter(Boolean).join(", "));
  const lasted = event.until_ms === null ? "" : `, for ${duration((event.until_ms - event.since_ms) / 1000)}`;
  say(parts.when, `${clock(event.since_ms)}${event.open ? ", still so" : lasted}`);
  say(parts.text, event.text);
  say(parts.end, event.open ? "" : event.end_text);
}
