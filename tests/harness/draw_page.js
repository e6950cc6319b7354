// SPDX-License-Identifier: Apache-2.0
// draw_page.js PAGE.html: runs a report's scripts on a small stand-in for a browser's document and
// prints what they drew as JSON: {ids: {ID: {text, children...}}}. An error in a script ends it.
"use strict";
const fs = require("fs");
const vm = require("vm");
const html = fs.readFileSync(process.argv[2], "utf8");

class Node {
  constructor(tag) {
    Object.assign(this, {tag, attributes: {}, children: [], own: "", style: {}, className: "", listeners: {}});
  }
  setAttribute(key, value) { this.attributes[key] = String(value); }
  getAttribute(key) { return this.attributes[key]; }
  appendChild(child) { this.children.push(child); return child; }
  append(...children) {
    for (const c of children) this.children.push(typeof c === "string" ? Object.assign(new Node("#text"), {own: c}) : c);
  }
  get textContent() { return this.own + this.children.map(c => c.textContent).join(""); }
  set textContent(text) { this.own = String(text); this.children = []; }
  addEventListener(name, call) { this.listeners[name] = call; }
  createTHead() { return this.appendChild(new Node("thead")); }
  createTBody() { return this.appendChild(new Node("tbody")); }
  insertRow() { return this.appendChild(new Node("tr")); }
  insertCell() { return this.appendChild(new Node("td")); }
  getBoundingClientRect() { return {left: 0, right: 0, top: 0}; }
  toJSON() {
    return {tag: this.tag, attributes: this.attributes, class: this.className, hidden: this.style.display === "none",
      text: this.textContent, children: this.children};
  }
}

const ids = {};
for (const [, tag, id] of html.matchAll(/<(\w+)[^>]*\sid="([^"]+)"/g)) ids[id] = new Node(tag);
for (const [, id, inner] of html.matchAll(/<select id="([^"]+)">(.*?)<\/select>/gs)) {
  ids[id].options = [...inner.matchAll(/<option value="([^"]*)">([^<]*)/g)].map(m => ({value: m[1], text: m[2]}));
  ids[id].selectedIndex = 0;
  ids[id].value = ids[id].options[0].value;
}
ids.data.own = html.match(/<script id="data"[^>]*>(.*?)<\/script>/s)[1];
const context = vm.createContext({
  document: {
    getElementById: id => ids[id] || null,
    createElement: tag => new Node(tag),
    createElementNS: (_, tag) => new Node(tag),
  },
  innerWidth: 1000, innerHeight: 800, console,
});
for (const [, script] of html.matchAll(/<script>(.*?)<\/script>/gs)) vm.runInContext(script, context);
delete ids.data;
console.log(JSON.stringify({ids}));
