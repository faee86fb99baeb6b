// An attitude indicator drawn into an element: attitudeIndicator(element).set(roll, pitch, heading, left, right), degrees and two texts.
// null where an angle is not known: a red cross.
function attitudeIndicator(host) {
  const ns = 'http://www.w3.org/2000/svg', R = 92;
  const make = (name, attributes, parent, text) => {
    const e = document.createElementNS(ns, name);
    for (const k in attributes) e.setAttribute(k, attributes[k]);
    if (text != null) e.textContent = text;
    if (parent) parent.appendChild(e);
    return e;
  };
  const svg = make('svg', {viewBox: '-110 -110 220 240', class: 'attitude', role: 'img', 'aria-label': 'attitude indicator'}, host);
  const id = 'ai' + Math.random().toString(36).slice(2);
  make('circle', {r: R}, make('clipPath', {id}, svg));
  const ball = make('g', {}, make('g', {'clip-path': `url(#${id})`}, svg)), up = 2.6;
  make('rect', {x: -300, y: -600, width: 600, height: 600, fill: '#3b8fd4'}, ball);
  make('rect', {x: -300, y: 0, width: 600, height: 600, fill: '#8a5a2b'}, ball);
  make('line', {x1: -300, x2: 300, y1: 0, y2: 0, stroke: '#fff', 'stroke-width': 2}, ball);
  const white = {fill: '#fff', 'font-size': 10, 'font-family': 'system-ui,sans-serif', 'text-anchor': 'middle'};
  for (let p = -80; p <= 80; p += 5) {
    if (!p) continue;
    const w = p % 10 ? 10 : 24;
    make('line', {x1: -w, x2: w, y1: -p * up, y2: -p * up, stroke: '#fff', 'stroke-width': 1.2}, ball);
    if (p % 20 === 0) make('text', {...white, x: w + 11, y: -p * up + 3.5}, ball, Math.abs(p));
  }
  const scale = make('g', {}, svg);
  for (const a of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60])
    make('line', {y1: -R, y2: a % 30 ? -R + 6 : -R + 10, stroke: '#fff', 'stroke-width': 1.6, transform: `rotate(${a})`}, scale);
  make('circle', {r: R, fill: 'none', stroke: '#39434b', 'stroke-width': 4}, svg);
  make('path', {d: `M0 ${-R + 11}l-6 10h12z`, fill: '#ffd23f'}, svg);
  make('path', {d: 'M-58 0h34l8 9M58 0h-34l-8 9', fill: 'none', stroke: '#ffd23f', 'stroke-width': 4}, svg);
  make('circle', {r: 3, fill: '#ffd23f'}, svg);
  const cross = make('path', {d: 'M-64-64L64 64M64-64L-64 64', stroke: '#d7263d', 'stroke-width': 8, display: 'none'}, svg);
  const words = {fill: 'currentColor', 'font-size': 13, 'font-family': 'system-ui,sans-serif'};
  const heading = make('text', {...words, y: 112, 'text-anchor': 'middle', 'font-weight': 600}, svg);
  const left = make('text', {...words, x: -108, y: 128}, svg), right = make('text', {...words, x: 108, y: 128, 'text-anchor': 'end'}, svg);
  return {set(roll, pitch, course, leftText, rightText) {
    const known = roll != null && pitch != null;
    cross.setAttribute('display', known ? 'none' : 'inline');
    if (known) {
      ball.setAttribute('transform', `rotate(${-roll}) translate(0 ${pitch * up})`);
      scale.setAttribute('transform', `rotate(${-roll})`);
    }
    heading.textContent = course == null ? '' : String(Math.round(((course % 360) + 360) % 360) % 360).padStart(3, '0') + '\u00b0';
    left.textContent = leftText || '';
    right.textContent = rightText || '';
  }};
}
