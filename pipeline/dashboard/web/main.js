// Chooses the page by the address, keeps it live, and says above it whether it is.

import { drawIcon, el, icon, keyed, say } from "./dom.js";
import { FleetPage } from "./fleet.js";
import { Live } from "./live.js";
import { RigPage } from "./rig.js";
import { TONES, duration } from "./words.js";

const asked = new URLSearchParams(location.search).get("name");
const rig = location.pathname === "/rig" ? asked : null;
const main = document.getElementById("main");
document.getElementById("back").hidden = rig === null;
const page = rig === null ? new FleetPage(main) : new RigPage(main, rig);

const link = document.getElementById("link");
const banner = document.getElementById("banner");
const counts = document.getElementById("counts");

function showSummary(summary) {
  keyed(counts, summary.counts, ([tone]) => tone, makeCount, (made, [tone, count]) => {
    drawIcon(made.firstChild, tone);
    say(made.lastChild, `${count} ${TONES[tone]}`);
  });
  showLink(true, 0, summary.problem);
}

function makeCount([tone]) {
  return el("a", { href: `/#${tone}`, class: "count", "data-tone": tone }, icon(tone), el("span"));
}

function showLink(here, silentS, problem) {
  const lost = !here;
  document.documentElement.dataset.link = lost ? "lost" : "live";
  say(link, lost ? "not live" : "live");
  const since = !lost || silentS === null ? "" : `What is below is ${duration(silentS)} old.`;
  const said = lost ? "Connection to the dashboard lost, trying again." : problem && `Nothing can be heard: ${problem}.`;
  banner.hidden = !said;
  say(banner.firstElementChild, said || ""); // read aloud when it changes, which the age beside it must not be
  say(banner.lastElementChild, since);
  const title = lost ? "⊘ not live" : page.title;
  document.title = `${title ?? "…"} · syncwatch`;
}

let problem = null;
const handlers = Object.fromEntries(
  Object.entries({ summary: () => {}, ...page.handlers }).map(([name, handle]) => [
    name,
    (message) => {
      handle(message);
      const summary = name === "summary" ? message : page.summary;
      if (summary) {
        problem = summary.problem;
        showSummary(summary);
      }
    },
  ]),
);

const stream = rig === null ? "/stream" : `/stream?rig=${encodeURIComponent(rig)}`;
new Live(stream, handlers, () => page.opened(), (here, silentS) => showLink(here, silentS, problem));
