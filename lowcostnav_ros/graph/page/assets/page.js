// The page: events of the server in, instruments, map and tables out; buttons for services.
"use strict";

const STALE_S = 1.0, LEVELS = ["l0", "l1", "l2"];
const $ = (id) => document.getElementById(id);
const state = { flight: { navigators: {} }, tables: { nodes: {}, heard: {}, events: [] }, arrived: 0, chosen: "", lost: "", units: "aviation", isAsked: false };
try { state.units = localStorage.getItem("units") in UNITS ? localStorage.getItem("units") : "aviation"; } catch { /* storage may be off */ }
const map = new MovingMap($("map"), () => draw());

// An element with text that is never taken for markup: what a node reports is foreign.
function make(tag, text, className) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (className) element.className = className;
  return element;
}

function listen() {
  const events = new EventSource("/events");
  events.addEventListener("chart", (e) => { map.chart = JSON.parse(e.data); });
  events.addEventListener("flight", (e) => {
    state.flight = JSON.parse(e.data);
    state.arrived = performance.now();
    for (const [name, s] of Object.entries(state.flight.navigators)) if (s.age <= STALE_S) map.pass(name, s);
    if (state.flight.truth) map.pass("truth", state.flight.truth);
    draw();
  });
  events.addEventListener("tables", (e) => { state.tables = JSON.parse(e.data); fill(); });
}

// The solution that is flown, then whatever has a position, until somebody chooses.
function chosen() {
  const all = state.flight.navigators;
  if (state.chosen in all) return state.chosen;
  const names = Object.keys(all), placed = names.filter((name) => all[name].lat !== undefined);
  return names.find((name) => flownOn(name)) || placed[0] || names[0] || "";
}
const flownOn = (name) => (state.tables.nodes[name] || {}).flying_on || "";
const since = () => (performance.now() - state.arrived) / 1000;

// Why a solution may not be believed, empty where it may.
function stale(name) {
  const s = state.flight.navigators[name];
  if (!state.arrived) return "waiting for the graph";
  if (since() > STALE_S) return `no data for ${since().toFixed(0)} s`;
  if (!s) return "no navigator";
  if (s.age === undefined) return s.level === 2 ? s.message : "no solution yet";
  return silent(name) || (s.level === 2 ? s.message : "");
}

// Since when a navigator that had a solution has none, empty where it has; its own report would be missed seconds later.
function silent(name) {
  const s = state.flight.navigators[name], age = s && s.age !== undefined ? s.age + since() : 0;
  return age > STALE_S ? `${name}: no data for ${age.toFixed(age < 10 ? 1 : 0)} s` : "";
}

function draw() {
  const name = chosen(), why = stale(name), s = state.flight.navigators[name];
  drawInstruments($("pfd"), s, why, state.units);
  map.draw(state.flight, name, state.tables.heard, why, state.units);
  chips(name);
  const link = since() <= STALE_S && state.arrived;
  $("link").textContent = link ? "live" : state.arrived ? `no data for ${since().toFixed(0)} s` : "connecting";
  $("link").className = link ? "good" : "bad";
  $("centre").textContent = map.isCentred ? "centred" : "centre";
  $("centre").setAttribute("aria-pressed", map.isCentred);
  const banner = $("banner"), words = why || (s && s.level ? `${name}: ${s.message}` : "");
  banner.hidden = !words;
  if (banner.textContent !== words) banner.textContent = words;
  banner.className = why ? "l2" : LEVELS[s ? s.level : 2];
  const lost = Object.keys(state.flight.navigators).filter(silent).join();
  if (lost !== state.lost) { state.lost = lost; fill(); }
}

function chips(name) {
  const box = $("chips"), names = Object.keys(state.flight.navigators);
  const placed = [...names.filter((one) => state.flight.navigators[one].lat !== undefined), ...(state.flight.truth ? ["truth"] : [])];
  if (box.dataset.names !== names.join() + placed.join()) {
    box.dataset.names = names.join() + placed.join();
    box.replaceChildren(...names.map((one) => {
      const chip = make("button", undefined, "chip");
      chip.type = "button";
      chip.setAttribute("role", "tab");
      chip.append(make("b", one), make("span"));
      chip.addEventListener("click", () => { state.chosen = one; map.isCentred = true; draw(); fill(); });
      return chip;
    }));
    $("legend").replaceChildren(...placed.map((one) => {
      const line = make("div", one), mark = make("i");
      mark.style.background = one === "truth" ? "var(--truth)" : map.colour(one);
      line.prepend(mark);
      return line;
    }));
  }
  [...box.children].forEach((chip, k) => {
    const s = state.flight.navigators[names[k]], why = stale(names[k]);
    chip.className = `chip ${why ? "l2" : LEVELS[s.level || 0]}`;
    chip.setAttribute("aria-selected", names[k] === name);
    const words = why || s.message || "";
    if (chip.lastChild.textContent !== words) chip.lastChild.textContent = words;
  });
}

const cell = (text, className) => make("td", text, className);
const shown = (value, digits, unit) => (value === null || value === undefined ? "\u2013" : `${value.toFixed(digits)}${unit}`);

function table(id, titles, rows, empty) {
  const head = make("tr");
  head.append(...titles.map(([title, isNumber]) => make("th", title, isNumber ? "n" : "")));
  if (!rows.length) { const row = make("tr"), only = cell(empty); only.colSpan = titles.length; row.append(only); rows = [row]; }
  $(id).replaceChildren(head, ...rows);
}

function line(...cells) { const row = make("tr"); row.append(...cells); return row; }

function bar(ratio) {
  const td = make("td"), outer = make("span", undefined, "bar"), inner = make("i", undefined, ratio > 1 ? "out" : "");
  inner.style.width = `${Math.min(Math.max(ratio || 0, 0), 2) * 50}%`;
  outer.append(inner); outer.title = "the line in the middle is the gate";
  td.append(outer);
  return td;
}

function fill() {
  for (const [node, n] of Object.entries(state.tables.nodes)) if (n.colour) map.colours[node] = n.colour;
  const nodes = state.tables.nodes, name = chosen(), filter = flownOn(name) in nodes ? flownOn(name) : name;
  const own = nodes[filter] || { aids: [], inputs: [] };
  $("aids-of").textContent = filter ? `of ${filter}: test ratio, 1 is the gate` : "";
  table("aids", [["aid"], ["test ratio"], ["", true], ["age", true], ["used", true], ["refused", true], [""]], own.aids.map((a) => line(
    cell(a.aid), bar(a.ratio), cell(shown(a.ratio, 2, ""), `n t${a.ratio > 1 ? 2 : 0}`), cell(shown(a.age, 1, " s"), "n"), cell(a.fused, "n"), cell(a.rejected, "n"), cell(a.why, `words t${a.level}`))), "this navigator has no aids");
  $("inputs-of").textContent = filter ? `of ${filter}` : "";
  table("inputs", [["topic"], ["rate", true], ["age", true], ["refused", true], [""]], own.inputs.map((i) => line(
    cell(i.topic), cell(shown(i.rate, 1, " Hz"), "n"), cell(shown(i.age, 1, " s"), `n t${i.level}`), cell(i.rejected, "n"), cell(i.level ? i.message : i.why, `words t${i.level}`))), "no inputs");
  table("nodes", [["node"], ["state"]], Object.entries(nodes).map(([node, n]) => {
    const lost = silent(node), words = cell(lost ? `\u2715 ${lost}` : n.message || "ok", `words t${lost ? 2 : n.level}`);
    if (n.does.length) words.append(buttons(node, n.does));
    return line(cell(node), words);
  }), "nobody reports");
  $("events").replaceChildren(...state.tables.events.slice().reverse().map((e) => {
    const item = make("li", undefined, `t${e.level}`), time = make("time", new Date(e.at * 1000).toLocaleTimeString());
    item.append(time, `${e.node}: ${e.text}`);
    return item;
  }));
}

const WORDS = { reset: "reset", calibrate_start: "calibrate magnetometer", calibrate_stop: "end calibration" };

function buttons(node, verbs) {
  const box = make("div");
  for (const verb of verbs) {
    const button = make("button", WORDS[verb]);
    button.type = "button";
    button.addEventListener("click", () => press(node, verb));
    box.append(button, " ");
  }
  return box;
}

async function press(node, verb) {
  if (verb === "reset" && !await confirmed(`Reset ${node}? It starts over, and is without a solution until it has aligned again.`, "Reset")) return;
  say("asked \u2026");
  try {
    const reply = await fetch("/do", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ node, verb }) });
    say(reply.ok ? (await reply.json()).message : await reply.text());
  } catch (error) { say(`not sent: ${error.message}`); }
}

function confirmed(text, verb) {
  const dialog = $("ask");
  $("ask-text").textContent = text;
  $("ask-yes").textContent = verb;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((done) => dialog.addEventListener("close", () => done(dialog.returnValue === "yes"), { once: true }));
}

function say(text) {
  const box = $("answer");
  box.textContent = text; box.hidden = false;
  clearTimeout(say.timer);
  say.timer = setTimeout(() => { box.hidden = true; }, 8000);
}

function units() { $("units").textContent = UNITS[state.units].name; }
$("units").addEventListener("click", () => {
  state.units = state.units === "si" ? "aviation" : "si";
  try { localStorage.setItem("units", state.units); } catch { /* not kept, then */ }
  units(); draw();
});
$("closer").addEventListener("click", () => map.zoom(0.6));
$("farther").addEventListener("click", () => map.zoom(1.7));
$("centre").addEventListener("click", () => { map.isCentred = true; draw(); });
addEventListener("resize", draw);
setInterval(() => { if (since() > STALE_S) draw(); }, 250); // what has stopped coming must look so
units(); draw(); fill(); listen();
