// Any logged quantity, or a formula of some, as a further chart under the common zoom and cursor.
(async () => {
  await window.pageReady;
  const {Chart, add, remove, make, main} = window.page, $ = id => document.getElementById(id);
  const STEPS = 65534, FUNCTIONS = ['abs', 'sqrt', 'hypot', 'sin', 'cos', 'tan', 'atan2', 'min', 'max', 'sign', 'exp', 'log', 'PI'];
  const COLOURS = ['#1f77b4', '#d95f02', '#2a9d5c', '#7a5195', '#8c6d31', '#56b4e9'];
  let unpacked = null;
  const known = () => unpacked = unpacked || (async () => { // name to {t, v, unit}, read when first asked for
    const bytes = Uint8Array.from(atob($('fields-data').textContent), c => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
    const all = new Uint16Array(await new Response(stream).arrayBuffer()), out = {};
    let at = 0;
    const next = n => { const part = new Uint16Array(n); let sum = 0; for (let k = 0; k < n; k++) part[k] = sum = (sum + all[at + k]) & 65535; at += n; return part; };
    for (const [n, entries] of JSON.parse($('fields').textContent)) {
      const t = Array.from(next(n), v => main.t0 + v / STEPS * (main.t1 - main.t0));
      for (const [name, unit, low, high] of entries) out[name] = {t, unit, v: Array.from(next(n), v => v ? low + (v - 1) / STEPS * ((high - low) || 1) : NaN)};
    }
    return out;
  })();
  function valueAt({t, v}, time) {
    let a = 0, b = t.length;
    while (a < b) { const m = (a + b) >> 1; if (t[m] <= time) a = m + 1; else b = m; }
    if (!a || a === t.length && t[a - 1] !== time) return NaN;
    return a === t.length ? v[a - 1] : v[a - 1] + (time - t[a - 1]) / (t[a] - t[a - 1]) * (v[a] - v[a - 1]);
  }
  // A formula over names, at the times of the one that has most of them.
  function evaluated(text, all) {
    if (all[text]) return all[text];
    if (!/^[\w\s.+\-*/%(),]+$/.test(text)) throw Error(`"${text}" holds a sign that is not known`);
    const names = [], code = text.replace(/[A-Za-z_][\w.]*/g, word => {
      if (FUNCTIONS.includes(word)) return 'Math.' + word;
      if (!all[word]) {
        const near = Object.keys(all).filter(name => name.includes(word)).slice(0, 3);
        throw Error(`"${word}" is not known` + (near.length ? `; there is ${near.join(', ')}` : ''));
      }
      if (!names.includes(word)) names.push(word);
      return `p[${names.indexOf(word)}]`;
    });
    if (!names.length) throw Error('name at least one quantity');
    let f;
    try { f = new Function('p', `"use strict"; return (${code})`); } catch { throw Error(`"${text}" is no formula`); }
    const columns = names.map(name => all[name]), t = columns.reduce((p, q) => q.t.length > p.t.length ? q : p).t;
    const units = [...new Set(columns.map(c => c.unit))];
    return {t, v: t.map(time => f(columns.map(c => valueAt(c, time)))), unit: units.length === 1 && !/[*/]|sin|cos|tan|sqrt|exp|log/.test(text) ? units[0] : ''};
  }
  function chart(text, curves) {
    const width = 960, height = 170, left = 62, start = main.t0, span = main.t1 - main.t0;
    let values = curves.flatMap(c => c.v.filter(Number.isFinite)), low = values.reduce((p, v) => Math.min(p, v), Infinity), high = values.reduce((p, v) => Math.max(p, v), -Infinity);
    if (!values.length) throw Error(`"${text}" has no values`);
    const margin = 0.06 * (high - low) || 0.5 * Math.max(Math.abs(high), 1e-6);
    low -= margin; high += margin;
    const like = main.charts[0].svg.dataset, units = [...new Set(curves.map(c => c.unit))], unit = units.length === 1 ? units[0] : '';
    const svg = make('svg', {class: 'chart', role: 'img', 'aria-label': text, viewBox: `0 0 ${width} ${height}`, width, height});
    Object.assign(svg.dataset, {start: like.start, end: like.end, low, high, unit});
    make('g', {class: 'axes'}, svg);
    make('rect', {class: 'frame', x: left, y: 20, width: width - left - 12, height: height - 40}, svg);
    const plot = make('svg', {class: 'plot', x: left, y: 20, width: width - left - 12, height: height - 40, viewBox: '0 0 10000 4000', preserveAspectRatio: 'none'}, svg);
    let x = width - 12;
    const words = [];
    curves.forEach((c, k) => {
      let data = '', last = null;
      c.t.forEach((time, i) => {
        if (!Number.isFinite(c.v[i])) { last = null; return; }
        const point = [Math.round((time - start) / span * 1e4), Math.round((high - c.v[i]) / (high - low) * 4000)];
        data += last ? ` ${point[0] - last[0]} ${point[1] - last[1]}` : `M${point.join(' ')}l`;
        last = point;
      });
      make('path', {d: data.replace(/l(?=M|$)/g, ''), fill: 'none', stroke: COLOURS[k % 6], 'stroke-width': 1.4, 'data-kind': 'curve', 'data-label': c.name}, plot);
      words.push([c.name, COLOURS[k % 6]]);
    });
    make('text', {x: 2, y: 13, class: 'title'}, svg, (curves.length > 1 ? '' : text) + (unit ? ` [${unit}]` : ''));
    if (curves.length > 1) for (const [name, colour] of words.reverse()) {
      x -= 6.2 * name.length;
      const key = make('g', {class: 'key', 'data-label': name}, svg);
      make('line', {x1: x - 20, x2: x - 5, y1: 9, y2: 9, stroke: colour, 'stroke-width': 2.5}, key);
      make('text', {x, y: 13, class: 'legend'}, key, name);
      x -= 34;
    }
    return svg;
  }
  async function draw() {
    const text = $('formula').value.trim(), said = $('not-drawn');
    said.textContent = '';
    try {
      if (!text) throw Error('choose a quantity by its name');
      const all = await known(), parts = text.split(';').map(part => part.trim()).filter(Boolean);
      const svg = chart(text, parts.map(part => ({name: part, ...evaluated(part, all)})));
      const host = document.createElement('div'), close = document.createElement('button');
      host.className = 'one-drawn'; close.textContent = '\u00d7'; close.title = close.ariaLabel = 'take away';
      host.append(svg, close);
      $('drawn').append(host);
      const one = new Chart(svg);
      close.onclick = () => { remove(one); host.remove(); };
      add(one);
    } catch (error) { said.textContent = `Not drawn: ${error.message}.`; }
  }
  $('draw').onclick = draw;
  $('formula').addEventListener('keydown', e => { if (e.key === 'Enter') draw(); });
  window.page.drawField = text => { $('formula').value = text; return draw(); };
})();
