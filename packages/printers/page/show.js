// Elements, numbers and tables. Texts of files become text nodes, never markup.
"use strict";

// An element; attributes in camel case are properties or handlers.
function h(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes))
    if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  made.append(...children.flat());
  return made;
}
function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children.flat());
  return made;
}
const find = (id) => document.getElementById(id);

const UNITS = { m: [1e3, "mm"], rad: [180 / Math.PI, "°"], "": [1, ""] };
const fixed = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1") : "–").replace("-", "−");
const inPrint = (value, unit, digits = 3) => {
  const [factor, name] = UNITS[unit] ?? [1, unit];
  return fixed(factor * value, digits) + (name && ` ${name}`);
};

// A table of rows of texts; an entry may be {text, kind}. Numbers stand to the right, under their heads.
function table(heads, rows) {
  const text = (entry) => String(entry?.text ?? entry ?? ""), number = (entry) => /^([−+]?\d|–$)/.test(text(entry));
  const cell = (tag, entry, right) => h(tag, { className: `${right ? "number" : ""} ${entry?.kind ?? ""}` }, text(entry));
  return h("div", { className: "scroll", tabIndex: 0 }, h("table", {},
    h("thead", {}, h("tr", {}, heads.map((head, k) => cell("th", head, rows.some((row) => number(row[k])))))),
    h("tbody", {}, rows.map((row) => h("tr", {}, row.map((entry) => cell("td", entry, number(entry))))))));
}

function verdict(ratio) {
  if (ratio <= 0.3) return { text: "identified", kind: "good" };
  return ratio <= 0.9 ? "barely" : { text: "not identified", kind: "bad" };
}

// A link that saves a text under a name.
function download(name, text, title) {
  return h("a", { className: "button", download: name, href: URL.createObjectURL(new Blob([text])) }, title);
}

function copyButton(text) {
  const button = h("button", { type: "button", onclick: async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      button.textContent = "Not allowed: select and copy";
    }
  } }, "Copy");
  return button;
}
