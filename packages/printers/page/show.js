// Elements, numbers and tables. Texts of files become text nodes, never markup.
"use strict";

// An element, of a picture too; attributes in camel case are properties or handlers.
function h(tag, attributes = {}, ...children) {
  const drawn = /^(svg|line|polygon|rect|title)$/.test(tag);
  const made = drawn ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes))
    if (!drawn && name in made) made[name] = value;
    else made.setAttribute(name, value);
  made.append(...children.flat());
  return made;
}
const find = (id) => document.getElementById(id);
const button = (title, onclick) => h("button", { type: "button", onclick }, title);
const list = (lines) => h("ul", {}, lines.map((each) => h("li", {}, each)));
const details = (title, ...content) => h("details", {}, h("summary", {}, title), ...content);

const UNITS = { m: [1e3, "mm"], rad: [180 / Math.PI, "°"] };
const fixed = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1") : "–").replace("-", "−");
const inPrint = (value, unit, digits = 3) => {
  const [factor, name] = UNITS[unit] ?? [1, unit];
  return fixed(factor * value, digits) + (name && ` ${name}`);
};

// A table of rows of texts and numbers; an entry may be {text, kind}.
const KINDS = { identified: "good", "not identified": "bad", outlier: "bad" };
function table(heads, rows) {
  const text = (entry) => (typeof entry === "string" ? entry : entry?.text ?? fixed(entry, 3));
  const row = (tag) => (entries) => h("tr", {}, entries.map((entry) => h(tag, { className: entry?.kind ?? KINDS[entry] ?? "" }, text(entry))));
  return h("div", { className: "scroll", tabIndex: 0 }, h("table", {}, row("th")(heads), rows.map(row("td"))));
}

// A link that saves a text under a name.
function download(name, text, title) {
  return h("a", { className: "button", download: name, href: URL.createObjectURL(new Blob([text])) }, title);
}
