// Makes and updates elements. Whatever comes over the network goes in as text, never as markup.

const SVG = "http://www.w3.org/2000/svg";

export function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "class") made.className = value;
    else if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Makes the children of `parent` those of `items`, in order; an item keeps its element from one time to the next. */
export function keyed(parent, items, key, create, update) {
  const known = parent.keyedElements ?? (parent.keyedElements = new Map());
  const wanted = new Set(items.map(key));
  for (const [name, element] of known) {
    if (!wanted.has(name)) {
      element.remove();
      known.delete(name);
    }
  }
  let place = parent.firstElementChild;
  for (const item of items) {
    let element = known.get(key(item));
    if (!element) known.set(key(item), (element = create(item)));
    if (element === place) place = place.nextElementSibling;
    else parent.insertBefore(element, place);
    update(element, item);
  }
}

// Every tone has a shape of its own, so that none is told by its colour alone.
const SHAPES = {
  good: [["circle", { cx: 12, cy: 12, r: 10 }], ["path", { d: "M7 12.5l3.5 3.5L17 8.5" }]],
  unsure: [
    ["circle", { cx: 12, cy: 12, r: 10, "stroke-dasharray": "3.4 2.9" }],
    ["path", { d: "M9 9.5a3 3 0 1 1 4.2 2.8c-.9.4-1.2.9-1.2 1.9M12 17.2v.1" }],
  ],
  warn: [["path", { d: "M12 2.5L22.5 21h-21z" }], ["path", { d: "M12 9v5.5M12 17.7v.1" }]],
  bad: [["path", { d: "M7.9 2h8.2L22 7.9v8.2L16.1 22H7.9L2 16.1V7.9z" }], ["path", { d: "M8 8l8 8M16 8l-8 8" }]],
  away: [["path", { d: "M5 5.5a9.5 9.5 0 0 1 14 0M8 9a5.5 5.5 0 0 1 8 0M12 13v7M3 21L21 3" }]],
  ended: [["circle", { cx: 12, cy: 12, r: 4 }]],
};

export function icon(tone) {
  const made = svg("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" });
  return drawIcon(made, tone);
}

export function drawIcon(element, tone) {
  if (element.dataset.tone !== tone) {
    element.dataset.tone = tone;
    element.replaceChildren(...SHAPES[tone].map(([tag, attributes]) => svg(tag, attributes)));
  }
  return element;
}
