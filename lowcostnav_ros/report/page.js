// The page's behaviour.  Charts are whole without it, but for those far down a long page, which are packed; here they fit the window, zoom,
// and share a cursor with the map and the player.
window.pageReady = (async () => {
  const packed = document.querySelectorAll('[data-packed]');
  if (packed.length) await Promise.all([...packed].map(async e => {
    const bytes = Uint8Array.from(atob(e.dataset.packed), c => c.charCodeAt(0));
    const text = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))).text();
    e.removeAttribute('data-packed');
    if (e.tagName === 'SCRIPT') e.textContent = text; else e.innerHTML = text;
  }));
  const NS = 'http://www.w3.org/2000/svg', UNITS = 1e4, LEVELS = 4000, RIGHT = 12, TOP = 20, BOTTOM = 20;
  const all = (what, where = document) => [...where.querySelectorAll(what)];
  const make = (name, attributes, parent, text) => {
    const e = document.createElementNS(NS, name);
    for (const k in attributes) e.setAttribute(k, attributes[k]);
    if (text != null) e.textContent = text;
    if (parent) parent.appendChild(e);
    return e;
  };
  const clamp = (v, a, b) => Math.min(Math.max(v, a), b);

  function ticks(low, high, count) {
    const power = 10 ** Math.floor(Math.log10((high - low) / (count + 1)));
    const step = [1, 2, 5, 10].map(s => s * power).find(s => (high - low) / s <= count + 1) || 10 * power, out = [];
    for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k++) out.push(k * step);
    out.step = step;
    return out;
  }
  const shown = (v, step) => v.toFixed(clamp(-Math.floor(Math.log10(step) + 1e-9), 0, 6)).replace('-', '\u2212').replace(/^\u2212(0(\.0*)?)$/, '$1');
  const marks = (low, high, count, isLog) => { // places of ticks and their words; of logarithms to base ten those of the numbers
    if (!isLog) { const found = ticks(low, high, count); return found.map(v => [v, shown(v, found.step)]); }
    if (high - low < 1) return marks(10 ** low, 10 ** high, count).filter(([v]) => v > 0).map(([v, text]) => [Math.log10(v), text]);
    const each = Math.max(1, Math.round((high - low) / 10)), out = [];
    for (let k = Math.ceil(low - 1e-9); k <= high + 1e-9; k += each) out.push([k, Math.abs(k) > 4 ? `1e${k}`.replace('-', '\u2212') : String(+(10 ** k).toPrecision(1))]);
    return out;
  };
  const digits = v => {
    const size = Math.abs(v);
    if (size && size < 1e-3) return v.toExponential(2).replace(/-/g, '\u2212');
    return v.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 1 ? 2 : size >= 0.01 ? 4 : 6).replace('-', '\u2212');
  };

  // A path of whole numbers in relative steps, as the page's writer makes it, to stretches of absolute points; of dots, to one stretch.
  function points(data, areDots) {
    const out = [];
    for (const part of areDots ? [data.replace(/h0/g, '')] : data.split('M').slice(1)) {
      const numbers = part.match(/-?\d+/g).map(Number), xs = [numbers[0]], ys = [numbers[1]];
      for (let k = 2; k + 1 < numbers.length; k += 2) {
        xs.push(xs[xs.length - 1] + numbers[k]);
        ys.push(ys[ys.length - 1] + numbers[k + 1]);
      }
      out.push([xs, ys]);
    }
    return out;
  }
  function last(sorted, value) { // index of the last that is not above a value
    let a = 0, b = sorted.length;
    while (a < b) { const m = (a + b) >> 1; if (sorted[m] <= value) a = m + 1; else b = m; }
    return a - 1;
  }

  // ---- units: SI as written, or those of the cockpit
  const stored = document.getElementById('flight'), flight = stored && JSON.parse(stored.textContent), unitsChanged = [];
  let units = 'si';
  try { if (localStorage.getItem('units') === 'aviation') units = 'aviation'; } catch { /* storage may be off */ }
  const FOOT = 3.28084, NM = 1 / 1852, KNOT = 1.943844, upright = /height|altitude|down|vertical|climb|msl/i;
  function cockpit(unit, title, size) { // factor, what is added, and the unit that a pilot reads
    if (unit === 'm/s') return upright.test(title) ? [60 * FOOT, 0, 'ft/min'] : [KNOT, 0, 'kt'];
    if (unit === 'm') return upright.test(title) || size < 926 ? [FOOT, 0, 'ft'] : [NM, 0, 'NM'];
    if (unit === 'km') return [1000 * NM, 0, 'NM'];
    if (unit === 'deg' && /^true heading/i.test(title) && flight?.declination_deg != null) return [1, -flight.declination_deg, 'deg'];
    return null;
  }
  const rounded = (v, f) => { const size = Math.abs(v *= f); return v.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : 2); };
  const number = /[-\u2212]?\d+(?:\.\d+)?/g, toNumber = text => +text.replace('\u2212', '-');
  const inWords = text => units === 'si' ? text : text.replace(/(km) \([\d.]+ NM\)/g, '$1').replace(/([-\u2212]?\d+(?:\.\d+)?) (m\/s|km|m)(?![\w/^\u00b2])/g, (whole, v, unit) => {
    const [f, , shown] = cockpit(unit, '', Math.abs(toNumber(v)));
    return `${rounded(toNumber(v), f)} ${shown}`;
  });
  function rewrite(node, how) { // the text nodes below, from what was written first
    const walk = document.createTreeWalker(node, NodeFilter.SHOW_TEXT);
    for (let t; (t = walk.nextNode());) { t.written ??= t.data; t.data = units === 'si' ? t.written : how(t.written); }
  }
  function restate() {
    all('.findings,.sentences,.note,.facts,header dd').forEach(e => rewrite(e, inWords));
    for (const table of all('table')) {
      const heads = all('thead th', table), rows = all('tbody tr', table);
      heads.forEach((head, k) => {
        const cells = rows.map(r => r.children[k]).filter(Boolean), title = head.written ??= head.textContent, unit = (title.match(/\[(m\/s|km|m)\]/) || [])[1];
        if (!unit) { cells.forEach(c => rewrite(c, inWords)); return; }
        const size = Math.max(0, ...cells.flatMap(c => ((c.firstChild?.written ?? c.textContent).match(number) || []).map(v => Math.abs(toNumber(v)))));
        const [f, , shown] = cockpit(unit, title, size);
        rewrite(head, text => text.replace(`[${unit}]`, `[${shown}]`));
        cells.forEach(c => rewrite(c, text => text.replace(number, v => rounded(toNumber(v), f))));
      });
    }
  }
  function setUnits(name) {
    units = name;
    try { localStorage.setItem('units', name); } catch { /* not kept, then */ }
    const button = document.getElementById('units');
    button.textContent = name === 'si' ? 'm \u00b7 m/s' : 'ft \u00b7 kt \u00b7 NM';
    button.hidden = !charts.length && !all('table').length;
    restate();
    for (const chart of charts) { chart.retitle(); if (chart.inner) chart.draw(); }
    for (const changed of unitsChanged) changed();
  }

  // ---- charts: those of the same axis of time show the same part of it
  const views = {};
  class Chart {
    constructor(svg) {
      this.svg = svg;
      const d = svg.dataset, box = svg.viewBox.baseVal, plot = this.plot = svg.querySelector('svg.plot');
      this.t0 = +d.start; this.t1 = +d.end; this.unit = d.unit || '';
      this.across = d.across; this.logX = (d.log || '').includes('x'); this.logY = (d.log || '').includes('y');
      this.scaled = 'low' in d; this.low0 = this.low = +d.low; this.high0 = this.high = +d.high;
      this.left0 = this.left = +plot.getAttribute('x'); this.width0 = box.width; this.height = box.height;
      this.axes = svg.querySelector('.axes'); this.frame = svg.querySelector('.frame');
      this.keys = all('.key', svg).reverse().map(g => ({g, x: +g.querySelector('text').getAttribute('x'), label: g.dataset.label, width: 34 + 6.2 * g.dataset.label.length}));
      this.modes = all('[data-from]', svg);
      this.lanes = all('.lane,.refusal', svg);
      this.hidden = new Set();
      this.line = make('line', {class: 'cursor', y1: TOP, y2: this.height - BOTTOM, visibility: 'hidden'}, svg);
      const key = [d.start, d.end, d.across].join('/');
      this.view = views[key] = views[key] || {t0: this.t0, t1: this.t1, a: this.t0, b: this.t1, across: d.across, isLog: this.logX, charts: []};
      this.view.charts.push(this);
      for (const k of this.keys) k.g.addEventListener('click', () => this.toggle(k));
      this.title = svg.querySelector('.title'); this.said = this.title?.textContent || '';
      this.retitle();
      this.listen();
    }
    retitle() { // what is drawn, in the units that are shown
      this.shown = units === 'aviation' && !this.logY && cockpit(this.unit, this.said, Math.max(Math.abs(this.low0), Math.abs(this.high0))) || [1, 0, this.unit];
      this.words = units === 'si' ? this.said : this.said.replace(`[${this.unit}`, `[${this.shown[2]}`).replace('True heading', this.shown[1] ? 'Magnetic heading' : 'True heading');
      if (this.width) this.entitle();
    }
    entitle() { // title and names of the curves side by side, or below each other in as many lines as the width asks for
      const rows = [], lines = [''], wide = text => 7.1 * text.length;
      let used = Infinity, x = 0, k = 0;
      for (const key of this.keys) {
        if (used + key.width > this.width) { rows.push([]); used = 0; }
        rows[rows.length - 1].push(key);
        used += key.width;
      }
      const room = rows.length === 1 && used < this.width / 2 ? this.width - used : this.width;
      for (const word of this.title ? this.words.split(' ') : []) {
        const joined = `${lines[k]} ${word}`.trim();
        if (wide(joined) <= room || !lines[k]) lines[k] = joined; else { lines.push(word); k++; }
      }
      const beside = rows.length < 2 && wide(lines[k]) + used <= this.width, under = beside ? 0 : rows.length, more = k + under;
      this.title?.replaceChildren();
      if (this.title) lines.forEach((line, i) => make('tspan', {x: 2, y: 13 - 14 * (more - i)}, this.title, `${line} `));
      rows.forEach((row, i) => {
        x = beside ? this.width - used : 2;
        for (const key of row) {
          key.g.setAttribute('transform', `translate(${x + 22 - key.x} ${-14 * (rows.length - 1 - i)})`);
          x += key.width;
        }
      });
      this.svg.style.overflow = more ? 'visible' : '';
      this.svg.style.marginTop = more ? `${14 * more + 4}px` : '';
    }
    items() { // what is drawn, as times and values, worked out when first asked for
      const t = x => this.t0 + x / UNITS * (this.t1 - this.t0), v = y => this.high0 - y / LEVELS * (this.high0 - this.low0);
      return this.parsed = this.parsed || all('[data-kind]', this.plot).map(p => {
        const kind = p.dataset.kind;
        let parts = points(p.getAttribute('d'), kind === 'dots');
        if (kind === 'band') parts = parts.map(([x, y]) => [x.slice(0, -2), y.slice(0, -2)]);
        return {kind, label: p.dataset.label || '', colour: p.getAttribute('stroke'), parts: parts.map(([x, y]) => [x.map(t), y.map(v)])};
      });
    }
    at(time) { // values at a time: a curve's between its points, the nearest dot within a hundredth of what is shown
      const out = [], near = (this.view.b - this.view.a) / 100;
      for (const item of this.items()) {
        if (this.hidden.has(item.label)) continue;
        for (const [t, v] of item.parts) {
          const k = last(t, time);
          if (item.kind === 'dots') {
            const n = [k, k + 1].filter(i => t[i] !== undefined && Math.abs(t[i] - time) <= near).sort((i, j) => Math.abs(t[i] - time) - Math.abs(t[j] - time))[0];
            if (n !== undefined) out.push([item, v[n]]);
          } else if (k >= 0 && k < t.length - 1 || k === t.length - 1 && t[k] === time) {
            const f = k < t.length - 1 ? (time - t[k]) / Math.max(t[k + 1] - t[k], 1e-9) : 0;
            out.push([item, v[k] + f * ((v[k + 1] ?? v[k]) - v[k])]);
            break;
          }
        }
      }
      return out;
    }
    fit() { // values of what is shown of the time
      const {a, b, t0, t1} = this.view;
      this.low = this.low0; this.high = this.high0;
      if (!this.scaled || a <= t0 && b >= t1) return;
      let low = Infinity, high = -Infinity, reach = 0;
      for (const item of this.items()) {
        if (this.hidden.has(item.label)) continue;
        for (const [t, v] of item.parts) for (let k = Math.max(0, last(t, a)); k < t.length && t[k] <= b; k++) {
          if (t[k] < a && item.kind === 'dots') continue;
          if (item.kind === 'band') reach = Math.max(reach, 2 * v[k]); else { low = Math.min(low, v[k]); high = Math.max(high, v[k]); }
        }
      }
      if (low > high) { if (!reach) return; low = high = 0; }
      if (reach) { reach = Math.min(reach, 4 * Math.max(Math.abs(low), Math.abs(high), 1e-9)); low = Math.min(low, -reach); high = Math.max(high, reach); }
      const margin = 0.06 * (high - low) || 0.05 * Math.abs(high) || (this.high0 - this.low0) / 100;
      this.low = low - margin; this.high = high + margin;
    }
    layout(width) {
      this.width = width;
      this.left = this.scaled ? this.left0 : Math.min(this.left0, 0.4 * width);
      this.svg.setAttribute('viewBox', `0 0 ${width} ${this.height}`);
      this.inner = Math.max(width - this.left - RIGHT, 10);
      for (const e of [this.plot, this.frame]) { e.setAttribute('x', this.left); e.setAttribute('width', this.inner); }
      this.entitle();
      for (const e of this.lanes) e.setAttribute('x', this.left - 8);
      this.draw();
    }
    x(t) { return this.left + (t - this.view.a) / (this.view.b - this.view.a) * this.inner; }
    time(clientX) {
      const r = this.svg.getBoundingClientRect(), x = (clientX - r.left) / r.width * this.width;
      return this.view.a + (x - this.left) / this.inner * (this.view.b - this.view.a);
    }
    draw() {
      const {a, b, t0, t1} = this.view, base = this.height - BOTTOM, u = t => (t - t0) / (t1 - t0) * UNITS;
      this.fit();
      const span = this.high0 - this.low0, rows = this.scaled ? [(this.high0 - this.high) / span * LEVELS, (this.high - this.low) / span * LEVELS] : [0, base - TOP];
      this.plot.setAttribute('viewBox', `${u(a)} ${rows[0]} ${Math.max(u(b) - u(a), 1e-3)} ${rows[1]}`);
      this.axes.replaceChildren();
      if (this.scaled) {
        const [f, more] = this.shown;
        for (const [u, text] of marks(this.low * f + more, this.high * f + more, 4, this.logY)) {
          const v = (u - more) / f, y = TOP + (this.high - v) / (this.high - this.low) * (base - TOP);
          make('path', {d: `M${this.left} ${y}h${this.inner}`, class: u === 0 && !this.logY ? 'zero' : 'grid'}, this.axes);
          make('text', {x: this.left - 6, y: y + 3.5, class: 'tick end'}, this.axes, text);
        }
      }
      const [unit, name] = this.across != null ? [1, this.across] : b - a > 10800 ? [3600, 'h'] : b - a > 600 ? [60, 'min'] : [1, 's'];
      const zero = this.across != null ? 0 : t0, along = marks((a - zero) / unit, (b - zero) / unit, clamp(this.inner / 80, 2, 12), this.logX);
      along.forEach(([v, text], k) => {
        const x = this.x(zero + v * unit);
        make('path', {d: `M${x} ${TOP}V${base}`, class: 'grid'}, this.axes);
        const said = text + (k === along.length - 1 ? ' ' + name : ''), fits = x + 3.2 * said.length < this.width;
        make('text', {x: fits ? x : this.width, y: base + 13, class: fits ? 'tick mid' : 'tick end'}, this.axes, said);
      });
      for (const e of this.modes) {
        const from = this.x(Math.max(+e.dataset.from, a)), to = this.x(Math.min(+e.dataset.to, b));
        e.setAttribute('x', from + 6);
        e.setAttribute('visibility', to - from > 7 * e.textContent.length + 8 ? 'visible' : 'hidden');
      }
      this.point(this.pointed);
    }
    toggle(key) {
      const off = !this.hidden.has(key.label);
      this.hidden[off ? 'add' : 'delete'](key.label);
      key.g.classList.toggle('off', off);
      for (const p of all('[data-kind]', this.plot)) if (p.dataset.label === key.label) p.style.display = off ? 'none' : '';
      this.draw();
    }
    point(time) {
      this.pointed = time;
      if (!this.inner) return;
      const on = time != null && time >= this.view.a && time <= this.view.b;
      this.line.setAttribute('visibility', on ? 'visible' : 'hidden');
      if (on) for (const k of ['x1', 'x2']) this.line.setAttribute(k, this.x(time));
    }
    listen() {
      const svg = this.svg, down = new Map();
      let from = null, box = null, pinch = null;
      const inside = e => { const t = this.time(e.clientX); return clamp(t, this.view.a, this.view.b); };
      const stop = () => { box && box.remove(); from = box = null; };
      svg.addEventListener('pointerdown', e => {
        down.set(e.pointerId, e.clientX);
        if (down.size === 2) { pinch = {at: [...down.values()].map(x => this.time(x)), view: [this.view.a, this.view.b]}; stop(); }
        else if (e.pointerType === 'mouse' && !e.button && !e.target.closest('.key')) {
          from = inside(e);
          svg.setPointerCapture(e.pointerId);
          e.preventDefault();
        }
      });
      svg.addEventListener('pointermove', e => {
        if (down.has(e.pointerId)) down.set(e.pointerId, e.clientX);
        if (pinch && down.size === 2) {
          const r = svg.getBoundingClientRect(), share = [...down.values()].map(x => ((x - r.left) / r.width * this.width - this.left) / this.inner);
          const rate = (pinch.at[1] - pinch.at[0]) / (share[1] - share[0]);
          if (rate > 0) show(this.view, pinch.at[0] - share[0] * rate, pinch.at[0] + (1 - share[0]) * rate);
          return;
        }
        point(inside(e), this.view, this, e);
        if (from == null) return;
        const x = [this.x(from), this.x(inside(e))].sort((p, q) => p - q);
        box = box || make('rect', {class: 'chosen', y: TOP, height: this.height - TOP - BOTTOM}, svg);
        box.setAttribute('x', x[0]); box.setAttribute('width', x[1] - x[0]);
      });
      svg.addEventListener('pointerup', e => {
        down.delete(e.pointerId); pinch = null;
        if (from != null) {
          const to = inside(e), wide = Math.abs(this.x(to) - this.x(from)) > 6;
          const ends = [from, to].sort((p, q) => p - q);
          stop();
          if (wide) show(this.view, ...ends);
        }
      });
      svg.addEventListener('pointercancel', e => { down.delete(e.pointerId); pinch = null; stop(); });
      svg.addEventListener('pointerleave', () => { box || point(held, this.view); });
      svg.addEventListener('dblclick', () => show(this.view, this.view.t0, this.view.t1));
      svg.addEventListener('wheel', e => {
        if (!e.ctrlKey && !e.shiftKey) return;
        e.preventDefault();
        const t = inside(e), f = Math.exp((e.deltaY || e.deltaX) * 0.003), {a, b} = this.view;
        show(this.view, t - (t - a) * f, t + (b - t) * f);
      }, {passive: false});
    }
  }
  function show(view, a, b) {
    const least = (view.t1 - view.t0) * 1e-4, width = clamp(b - a, least, view.t1 - view.t0);
    view.a = clamp(a, view.t0, view.t1 - width); view.b = view.a + width;
    for (const chart of view.charts) chart.seen ? chart.draw() : chart.stale = true;
    document.body.classList.toggle('zoomed', Object.values(views).some(v => v.a > v.t0 || v.b < v.t1));
  }
  let held = null; // the time of the player, to which the cursor falls back
  const box = document.getElementById('when');
  function point(time, view, chart, event) {
    for (const c of view.charts) c.point(time);
    for (const listener of listeners) if (view === main) listener(time);
    box.style.display = chart ? 'block' : 'none';
    if (!chart) return;
    const values = chart.scaled ? chart.at(time) : [], rows = [words(time, view)];
    const names = {};
    for (const [item, v] of values) {
      const label = item.kind === 'band' ? item.label : item.label || 'value';
      if (!names[label]) rows.push(`${label}: ${digits(chart.logY ? 10 ** v : chart.shown[1] ? (v + chart.shown[1] + 360) % 360 : v * chart.shown[0])} ${chart.shown[2]}`);
      names[label] = 1;
    }
    box.replaceChildren(...rows.map(text => Object.assign(document.createElement('div'), {textContent: text})));
    const right = event.clientX > innerWidth - box.offsetWidth - 30;
    box.style.left = (right ? event.clientX - box.offsetWidth - 14 : event.clientX + 14) + 'px';
    box.style.top = clamp(event.clientY + 12, 4, innerHeight - box.offsetHeight - 60) + 'px';
  }
  const clock = s => s < 3600 ? `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, '0')}` : `${Math.floor(s / 3600)}:${clock(s % 3600).padStart(7, '0')}`;
  const words = (time, view) => view.across != null ? `${digits(view.isLog ? 10 ** time : time)} ${view.across}` : clock(time - view.t0) + (time > 1e8 ? `  ${new Date(time * 1e3).toISOString().slice(11, 21)} UTC` : '');
  const listeners = [];
  const charts = all('svg.chart').map(svg => new Chart(svg));
  const isFlight = v => flight && Math.abs(v.t0 - flight.start) < 0.01;
  const main = Object.values(views).sort((p, q) => isFlight(q) - isFlight(p) || q.charts.length - p.charts.length)[0];

  // ---- maps: drag, pinch, buttons; the wheel with ctrl or shift
  class Ground {
    constructor(svg) {
      const d = svg.dataset, box = svg.viewBox.baseVal;
      this.svg = svg; this.plot = svg.querySelector('svg.plot'); this.margin = +d.margin;
      this.perMetre = +d.perMetre; this.west = +d.west; this.north = +d.north;
      this.size0 = [box.width, box.height];
      this.full = this.plot.getAttribute('viewBox').split(' ').map(Number); this.shown = [...this.full];
      this.pins = all('.pin', svg);
      this.axes = svg.querySelector('.axes');
      this.extra = make('g', {}, this.plot); this.over = make('g', {}, svg);
      const buttons = document.createElement('div');
      buttons.className = 'buttons';
      for (const [text, title, act] of [['+', 'closer', () => this.zoom(0.6)], ['\u2212', 'wider', () => this.zoom(1 / 0.6)], ['\u21ba', 'all', () => this.reset()]]) {
        const b = document.createElement('button');
        b.textContent = text; b.title = b.ariaLabel = title; b.onclick = act;
        buttons.append(b);
      }
      const host = document.createElement('div');
      host.className = 'ground';
      svg.replaceWith(host); host.append(svg, buttons);
      this.host = host;
      this.listen();
    }
    layout(width) {
      const height = Math.max(Math.min(this.size0[1], width), 0.7 * width * this.size0[1] / this.size0[0]), m = this.margin;
      this.width = width; this.height = Math.min(height, this.size0[1]);
      this.svg.setAttribute('viewBox', `0 0 ${width} ${this.height}`);
      this.plot.setAttribute('width', width - 2 * m); this.plot.setAttribute('height', this.height - 2 * m);
      this.svg.querySelector('.names')?.setAttribute('transform', `translate(${(width - this.size0[0]) / 2} ${this.height - this.size0[1]})`);
      this.svg.querySelector('.north').setAttribute('transform', `translate(${width - this.size0[0]})`);
      this.draw();
    }
    scale() { // pixels to a unit, and the unit at the corner: the drawing is fitted into its box, in the middle
      const w = this.width - 2 * this.margin, h = this.height - 2 * this.margin, [x, y, sw, sh] = this.shown, k = Math.min(w / sw, h / sh);
      return {k, x0: x + sw / 2 - w / 2 / k, y0: y + sh / 2 - h / 2 / k, w, h};
    }
    pixel(x, y) { const s = this.scale(); return [this.margin + (x - s.x0) * s.k, this.margin + (y - s.y0) * s.k]; }
    holds(x, y) { const m = this.margin; return x >= m && x <= this.width - m && y >= m && y <= this.height - m; }
    place(pin) {
      const [x, y] = this.pixel(+pin.dataset.x, +pin.dataset.y);
      pin.setAttribute('transform', `translate(${x} ${y})`);
      pin.setAttribute('visibility', this.holds(x, y) ? 'visible' : 'hidden');
    }
    draw() {
      this.plot.setAttribute('viewBox', this.shown.join(' '));
      this.pins.forEach(p => this.place(p));
      const g = this.axes, s = this.scale(), m = this.margin, right = m + s.w, base = m + s.h, perPixel = 1 / (s.k * this.perMetre);
      g.replaceChildren();
      const small = s.w * perPixel < 500, NM = small ? 1 : 1852, said = this.svg.querySelector('.names text');
      if (said) said.textContent = said.textContent.replace(/\[(NM|m)\]/, small ? '[m]' : '[NM]');
      const west = this.west + s.x0 / this.perMetre, north = this.north - s.y0 / this.perMetre;
      const xs = ticks(west / NM, (west + s.w * perPixel) / NM, s.w / 110), ys = ticks((north - s.h * perPixel) / NM, north / NM, s.w / 110);
      for (const v of xs) {
        const x = m + (v * NM - west) / perPixel;
        make('line', {x1: x, x2: x, y1: m, y2: base, class: 'grid'}, g);
        make('text', {x, y: base + 14, class: 'tick', 'text-anchor': 'middle'}, g, shown(v, xs.step));
      }
      for (const v of ys) {
        const y = m + (north - v * NM) / perPixel;
        make('line', {x1: m, x2: right, y1: y, y2: y, class: 'grid'}, g);
        make('text', {x: m - 6, y: y + 3.5, class: 'tick', 'text-anchor': 'end'}, g, shown(v, ys.step));
      }
      make('rect', {x: m, y: m, width: s.w, height: s.h, class: 'frame'}, g);
      (small ? [['ft', 0.3048], ['m', 1]] : [['NM', NM], ['km', 1000]]).forEach(([unit, metres], row) => {
        const longest = s.w * perPixel / metres / 6, power = 10 ** Math.floor(Math.log10(longest));
        const length = [5, 2, 1].map(k => k * power).find(k => k <= longest), y = base - 14 - 18 * row, w = length * metres / perPixel;
        make('path', {d: `M${m + 14} ${y - 4}v4h${w}v-4`, class: 'scale'}, g);
        make('text', {x: m + 20 + w, y: y + 1, class: 'tick'}, g, `${+length.toPrecision(2)} ${unit}`);
      });
      this.moved?.();
    }
    zoom(f, at) {
      const [x, y, w, h] = this.shown, [cx, cy] = at || [x + w / 2, y + h / 2];
      f = clamp(f, this.full[2] / 2000 / w, 6 * this.full[2] / w);
      this.shown = [cx - (cx - x) * f, cy - (cy - y) * f, w * f, h * f];
      this.draw();
    }
    reset() { this.shown = [...this.full]; this.draw(); }
    unit(e) {
      const r = this.svg.getBoundingClientRect(), q = this.width / r.width, s = this.scale();
      return [s.x0 + ((e.clientX - r.left) * q - this.margin) / s.k, s.y0 + ((e.clientY - r.top) * q - this.margin) / s.k];
    }
    listen() {
      const svg = this.svg, down = new Map();
      const spread = () => { const [p, q] = [...down.values()]; return Math.hypot(p.clientX - q.clientX, p.clientY - q.clientY); };
      svg.addEventListener('pointerdown', e => { down.set(e.pointerId, e); if (e.pointerType === 'mouse') svg.setPointerCapture(e.pointerId); });
      svg.addEventListener('pointermove', e => {
        if (!down.has(e.pointerId)) { this.hover?.(e); return; }
        const before = down.size === 2 ? spread() : 0, a = this.unit(down.get(e.pointerId)), b = this.unit(e);
        down.set(e.pointerId, e);
        if (down.size === 2) {
          this.shown[0] += (a[0] - b[0]) / 2; this.shown[1] += (a[1] - b[1]) / 2;
          this.zoom(before / Math.max(spread(), 1), b);
          return;
        }
        if (e.pointerType !== 'mouse') return;
        this.shown[0] += a[0] - b[0]; this.shown[1] += a[1] - b[1];
        this.draw();
      });
      for (const name of ['pointerup', 'pointercancel']) svg.addEventListener(name, e => down.delete(e.pointerId));
      svg.addEventListener('dblclick', () => this.reset());
      svg.addEventListener('wheel', e => {
        if (!e.ctrlKey && !e.shiftKey) return;
        e.preventDefault();
        this.zoom(Math.exp((e.deltaY || e.deltaX) * 0.003), this.unit(e));
      }, {passive: false});
    }
  }
  const grounds = all('svg.map').map(svg => new Ground(svg));

  // ---- the player: an aircraft on the map, an attitude indicator, a track coloured by what is asked
  if (flight && main) {
    const whole = ['x', 'y', ...Object.keys(flight.scales), 'mode'];
    for (const way of flight.ways) for (const key of whole) if (way[key]) {
      let sum = 0;
      way[key] = way[key].map(v => v == null ? null : (sum += v) / (flight.scales[key] || 1));
    }
    const count = Math.max(...flight.ways.map(w => (w.roll_deg || w.x || w.height_m || []).length)), ground = grounds[0];
    const bar = document.getElementById('player'), find = name => bar.querySelector('.' + name);
    const [play, speed, slide, when, who, colour] = ['play', 'speed', 'slide', 'time', 'who', 'by'].map(find);
    const panel = find('horizon').firstElementChild;
    slide.max = main.t1 - main.t0;
    for (const w of flight.ways) who.add(new Option(w.name, w.name));
    const flown = flight.ways.filter(w => !w.given).sort((p, q) => !!q.roll_deg - !!p.roll_deg || !!q.x - !!p.x)[0] || flight.ways[0];
    who.value = (flight.ways.find(w => w.name === 'supervisor' && w.roll_deg) || flown).name;
    const way = () => flight.ways.find(w => w.name === who.value);
    const value = (w, key, t) => {
      const q = clamp((t - flight.start) / flight.step, 0, count - 1), k = Math.floor(q), a = w[key]?.[k], b = w[key]?.[k + 1];
      return a == null ? null : b == null ? a : a + (q - k) * (b - a);
    };
    const crafts = ground ? flight.ways.filter(w => w.x).map(w => {
      const g = make('g', {class: 'craft'}, ground.over);
      make('path', {d: 'M0-9l2 6 8 4v2l-8-2-1 6 3 2v1l-4-1-4 1v-1l3-2-1-6-8 2v-2l8-4z', style: `fill:${w.colour}`, stroke: '#fff', 'stroke-width': 0.8}, g);
      make('title', {}, g, w.name);
      return {w, g};
    }) : [];
    const region = ground && make('ellipse', {class: 'region'}, ground.extra);
    let now = main.t0, going = false, before = 0;
    const render = time => {
      const t = time ?? now, w = way();
      for (const {w, g} of crafts) {
        const x = value(w, 'x', t), y = value(w, 'y', t), p = x == null || y == null ? null : ground.pixel(x, y);
        g.setAttribute('visibility', p && ground.holds(...p) ? 'visible' : 'hidden');
        if (p && ground.width) g.setAttribute('transform', `translate(${p}) rotate(${value(w, 'heading_deg', t) ?? 0})`);
      }
      if (region) {
        const at = ['x', 'y', 'sigma_east_m', 'sigma_north_m'].map(key => value(w, key, t)), k = 2 * ground.perMetre;
        region.setAttribute('visibility', at.includes(null) ? 'hidden' : 'visible');
        if (!at.includes(null)) ['cx', 'cy', 'rx', 'ry'].forEach((name, i) => region.setAttribute(name, i < 2 ? at[i] : at[i] * k));
        region.style.stroke = w.colour;
      }
      const height = value(w, 'height_m', t), fast = value(w, 'speed_mps', t), mode = w.words?.[w.mode[clamp(Math.floor((t - flight.start) / flight.step), 0, count - 1)]];
      const twice = v => v == null ? undefined : 2 * v, turned = v => v == null ? undefined : (v % 360 + 360) % 360;
      const given = {roll: value(w, 'roll_deg', t) ?? undefined, pitch: value(w, 'pitch_deg', t) ?? undefined, heading: turned(value(w, 'heading_deg', t)), track: turned(value(w, 'track_deg', t))};
      Object.assign(given, {speed: fast ?? undefined, climb: value(w, 'climb_mps', t) ?? undefined, msl: height == null ? undefined : height - (flight.undulation_m || 0)});
      Object.assign(given, {declination: flight.declination_deg, heading_bound: twice(value(w, 'sigma_heading_deg', t)), height_bound: twice(value(w, 'sigma_down_m', t))});
      if (!bar.classList.contains('folded')) drawInstruments(panel, given, height == null && given.roll === undefined && given.heading === undefined ? 'no solution' : '', units);
      const error = value(w, 'error_m', t);
      when.textContent = `${words(t, main)}  ${mode || ''}${error == null ? '' : `  ${inWords(`${digits(error)} m`)} off`}`;
      if (time == null || time === held) slide.value = t - main.t0;
    };
    listeners.push(render);
    if (ground) ground.moved = () => render();
    const go = t => { now = held = clamp(t, main.t0, main.t1); for (const c of main.charts) c.point(now); render(now); };
    const frame = stamp => {
      if (!going) return;
      go(now + (before ? Math.min((stamp - before) * 1e-3, 0.2) * speed.value : 0));
      before = stamp;
      if (now >= main.t1) start(false); else requestAnimationFrame(frame);
    };
    const start = on => { going = on; before = 0; play.textContent = on ? '\u275a\u275a' : '\u25b6'; if (on) { if (now >= main.t1) now = main.t0; requestAnimationFrame(frame); } };
    play.onclick = () => start(!going);
    slide.oninput = () => go(main.t0 + +slide.value);
    who.onchange = () => { paint(); render(); };
    find('fold').onclick = () => { bar.classList.toggle('folded'); render(); };
    unitsChanged.push(() => render());
    document.addEventListener('keydown', e => {
      if (/INPUT|SELECT|BUTTON|TEXTAREA|SUMMARY/.test(e.target.tagName) || e.ctrlKey || e.metaKey || e.altKey) return;
      const step = (main.b - main.a) / 200;
      if (e.key === ' ') { e.preventDefault(); start(!going); }
      if (e.key === 'ArrowLeft') go(now - step);
      if (e.key === 'ArrowRight') go(now + step);
    });
    window.goTo = t => { go(t); const c = main; if (t < c.a || t > c.b) show(c, t - (c.b - c.a) / 2, t + (c.b - c.a) / 2); };
    const scale = ['#1a9850', '#91cf60', '#fdbf2f', '#f46d43', '#d73027', '#6a0f1f'];
    let painted = null;
    const key = document.createElement('p');
    key.className = 'note colours';
    ground?.host.after(key);
    const paint = () => { // the track of the chosen navigator in a colour for each class of values
      painted?.remove(); painted = null; key.replaceChildren();
      const w = way(), column = colour.value;
      for (const p of ground ? all('path[data-label]', ground.plot) : []) p.style.opacity = column && w.x ? 0.25 : '';
      if (!ground || !column || !w.x || !w[column]) { if (column) key.textContent = `${w.name} has no such values.`; return; }
      let classes, names, colours;
      if (column === 'mode') { classes = w.mode; names = w.words; colours = names.map((n, k) => flight.modes[n] || ['#7f8fa6', '#9b8579', '#6c8e8e', '#a17fa6'][k % 4]); } else {
        const steps = column === 'ratio' ? [0.5, 1, 2, 3, 4] : ticks(0, Math.max(...w[column].filter(v => v != null)) || 1, 5).filter(v => v > 0);
        classes = w[column].map(v => v == null ? null : steps.filter(s => s < v).length);
        names = [...steps.map(s => `to ${+s.toPrecision(3)}`), `above ${+steps[steps.length - 1].toPrecision(3)}`].map(n => column === 'ratio' ? n + ' sigma' : n + ' m');
        colours = names.map((n, k) => scale[Math.round(k * 5 / (names.length - 1))]);
      }
      const lines = names.map(() => '');
      for (let k = 0; k + 1 < count; k++) if (classes[k] != null && w.x[k] != null && w.x[k + 1] != null) lines[classes[k]] += `M${w.x[k]} ${w.y[k]}L${w.x[k + 1]} ${w.y[k + 1]}`;
      painted = make('g', {class: 'painted'}, ground.extra);
      lines.forEach((d, k) => {
        if (!d) return;
        make('path', {d, stroke: colours[k], 'stroke-width': 4, 'stroke-linecap': 'round', fill: 'none'}, painted);
        const span = document.createElement('span');
        span.textContent = names[k]; span.style.borderColor = colours[k];
        key.append(span);
      });
    };
    colour.onchange = paint;
    bar.hidden = false;
    bar.classList.toggle('folded', innerWidth < 500);
    document.body.classList.add('playing');
    const known = (way().roll_deg || way().x || []).findIndex(v => v != null);
    go(flight.start + Math.max(known, 0) * flight.step);
  }
  document.addEventListener('keydown', e => { if (e.key === 'Escape') for (const v of Object.values(views)) show(v, v.t0, v.t1); });
  for (const a of all('[data-go]')) a.onclick = e => { e.preventDefault(); window.goTo?.(+a.dataset.go); };
  document.getElementById('unzoom').onclick = () => { for (const v of Object.values(views)) show(v, v.t0, v.t1); };

  // ---- as wide as the window, drawn when seen; on paper as written
  const drawn = [...charts, ...grounds];
  const add = chart => { drawn.push(chart); charts.push(chart); seen.observe(chart.svg); fitted(chart); };
  const remove = chart => {
    seen.unobserve(chart.svg); chart.svg.remove();
    for (const list of [drawn, charts, chart.view.charts]) list.splice(list.indexOf(chart), 1);
  };
  const fitted = one => { const w = one.svg.getBoundingClientRect().width; if (w) { one.svg.style.height = (one.height || 0) + 'px'; one.layout(w); one.svg.style.height = one.height + 'px'; one.stale = false; } };
  const seen = new IntersectionObserver(entries => entries.forEach(e => {
    const one = drawn.find(d => d.svg === e.target);
    one.seen = e.isIntersecting;
    if (one.seen && (one.stale || one.width !== e.boundingClientRect.width)) fitted(one);
  }), {rootMargin: '300px'});
  drawn.forEach(d => seen.observe(d.svg));
  addEventListener('resize', () => drawn.forEach(d => d.seen ? fitted(d) : d.stale = true));
  const paper = on => {
    if (on) { all('details').forEach(d => { if (!d.open) { d.open = true; d.dataset.folded = 1; } }); }
    else all('details[data-folded]').forEach(d => { d.open = false; delete d.dataset.folded; });
    drawn.forEach(d => { if (on) { d.layout(d.width0 || d.size0[0]); d.svg.style.height = 'auto'; } else fitted(d); });
  };
  addEventListener('beforeprint', () => paper(true));
  addEventListener('afterprint', () => paper(false));
  document.getElementById('units').onclick = () => setUnits(units === 'si' ? 'aviation' : 'si');
  setUnits(units);
  document.getElementById('theme').onclick = () => {
    const dark = (document.documentElement.dataset.theme || (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light')) === 'dark';
    document.documentElement.dataset.theme = dark ? 'light' : 'dark';
  };
  window.page = {Chart, add, remove, make, digits, charts, grounds, views, main, show, flight, point, fit: () => drawn.forEach(fitted)};
})();
