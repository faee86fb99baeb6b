// A moving map, north up: stations, tracks, aircraft with the ellipse of two sigmas, wind, a scale.  No tiles: nothing is fetched.
"use strict";

const PALETTE = ["#1b9e77", "#7570b3", "#d95f02", "#e7298a", "#66a61e", "#a6761d"];
const TRACK_STEP_M = 15, TRACK_MOST = 4000, ROUND_M = 6371000;

class MovingMap {
  constructor(canvas, onMoved) {
    this.canvas = canvas;
    this.onMoved = onMoved;
    this.metresPerPixel = 75;
    this.isCentred = true;
    this.middle = null; // lat, lon in degrees
    this.chart = { stations: [], tracks: {} };
    this.ground = { coast: [], airports: [] };
    this.asked = null; // where the ground was asked for
    this.colours = {};
    this.pointers = new Map();
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.0015)); }, { passive: false });
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); this.pointers.set(e.pointerId, [e.clientX, e.clientY]); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => this.pointers.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => this.dragged(e));
  }

  dragged(e) {
    const before = this.pointers.get(e.pointerId);
    if (!before || !this.middle) return;
    const others = [...this.pointers.entries()].filter(([id]) => id !== e.pointerId).map(([, p]) => p);
    if (others.length) {
      const far = (p) => Math.hypot(p[0] - others[0][0], p[1] - others[0][1]);
      this.zoom(far(before) / Math.max(far([e.clientX, e.clientY]), 1));
    } else {
      const k = 180 / Math.PI / ROUND_M * this.metresPerPixel;
      this.middle = [this.middle[0] + (e.clientY - before[1]) * k, this.middle[1] - (e.clientX - before[0]) * k / Math.cos(this.middle[0] * Math.PI / 180)];
      this.isCentred = false;
    }
    this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    this.onMoved();
  }

  zoom(factor) {
    this.metresPerPixel = Math.min(Math.max(this.metresPerPixel * factor, 0.2), 3000);
    this.onMoved();
  }

  colour(name) {
    const names = Object.keys(this.chart.tracks);
    return this.colours[name] || PALETTE[Math.max(names.indexOf(name), 0) % PALETTE.length];
  }

  // Remember where everybody is; `navigators` as the server sends them.
  pass(name, s) {
    if (s.lat === undefined) return;
    const track = this.chart.tracks[name] || (this.chart.tracks[name] = []), last = track[track.length - 1];
    if (last && this.metres(last, [s.lat, s.lon]) < TRACK_STEP_M) return;
    track.push([s.lat, s.lon]);
    if (track.length > TRACK_MOST) this.chart.tracks[name] = track.filter((_, k) => k % 2 === 0);
  }

  metres(a, b) {
    const k = Math.PI / 180 * ROUND_M;
    return Math.hypot((a[0] - b[0]) * k, (((a[1] - b[1] + 540) % 360) - 180) * k * Math.cos(a[0] * Math.PI / 180));
  }

  at(lat, lon, w, h) {
    const k = Math.PI / 180 * ROUND_M / this.metresPerPixel;
    const east = ((lon - this.middle[1] + 540) % 360) - 180;
    return [w / 2 + east * k * Math.cos(this.middle[0] * Math.PI / 180), h / 2 - (lat - this.middle[0]) * k];
  }

  // `flight` as the server sends it, `chosen` the navigator in the middle, `heard` seconds since each station was heard.
  draw(flight, chosen, heard, stale, unitsName) {
    const [c, w, h] = prepared(this.canvas), css = getComputedStyle(document.documentElement), of = (name) => css.getPropertyValue(name).trim();
    c.fillStyle = of("--map"); c.fillRect(0, 0, w, h);
    const own = flight.navigators[chosen] || {};
    if (own.lat !== undefined && (this.isCentred || !this.middle)) this.middle = [own.lat, own.lon];
    if (!this.middle) {
      c.fillStyle = of("--faint"); c.font = "14px system-ui, sans-serif"; c.textAlign = "center";
      c.fillText(chosen ? `no position from ${chosen} yet` : "no navigator yet", w / 2, h / 2);
      return;
    }
    this.look();
    this.under(c, w, h, of);
    this.scale(c, w, h, of, unitsName);
    this.stations(c, w, h, of, heard);
    for (const [name, track] of Object.entries(this.chart.tracks)) this.track(c, w, h, track, name === "truth" ? of("--truth") : this.colour(name), name === chosen, name === "truth");
    for (const [name, s] of Object.entries(flight.navigators)) {
      if (s.lat !== undefined && name !== chosen && s.age <= 1) this.other(c, w, h, s, this.colour(name));
    }
    if (own.lat !== undefined) this.aircraft(c, w, h, own, this.colour(chosen), stale);
    if (own.wind !== undefined && !stale) this.wind(c, w, own, of, unitsName);
    if (stale) redCross(c, 0, 0, w, h, stale);
  }

  // Coast and airports around the middle, from the server's own file.
  look() {
    if (this.asked && this.metres(this.asked, this.middle) < 80000) return;
    this.asked = [...this.middle];
    fetch(`/background?lat=${this.middle[0]}&lon=${this.middle[1]}`).then((r) => r.json()).then((ground) => { this.ground = ground; this.onMoved(); }).catch(() => { this.asked = null; });
  }

  under(c, w, h, of) {
    c.strokeStyle = of("--coast"); c.lineWidth = 1.4;
    c.beginPath();
    for (const line of this.ground.coast) line.forEach(([lat, lon], k) => { const [x, y] = this.at(lat, lon, w, h); if (k) c.lineTo(x, y); else c.moveTo(x, y); });
    c.stroke();
    c.strokeStyle = c.fillStyle = of("--faint"); c.lineWidth = 1; c.font = "10px system-ui, sans-serif"; c.textAlign = "left"; c.textBaseline = "middle";
    for (const a of this.ground.airports) {
      const [x, y] = this.at(a.lat, a.lon, w, h);
      if (x < 0 || y < 0 || x > w || y > h) continue;
      c.beginPath(); c.arc(x, y, 3.5, 0, 2 * Math.PI); c.moveTo(x - 5, y); c.lineTo(x + 5, y); c.stroke();
      if (this.metresPerPixel < 300) c.fillText(a.ident, x + 7, y + 4);
    }
  }

  scale(c, w, h, of, unitsName) {
    const [perMetre, unit] = UNITS[unitsName].far;
    const target = 0.28 * Math.min(w, h) * this.metresPerPixel * perMetre, power = 10 ** Math.floor(Math.log10(target));
    const step = [5, 2, 1].map((k) => k * power).find((v) => v <= target) || power, radius = step / perMetre / this.metresPerPixel;
    c.strokeStyle = of("--grid"); c.fillStyle = of("--faint"); c.lineWidth = 1; c.font = "11px system-ui, sans-serif"; c.textAlign = "left"; c.textBaseline = "middle";
    for (let k = 1; k <= 6; k++) {
      c.beginPath(); c.arc(w / 2, h / 2, k * radius, 0, 2 * Math.PI); c.stroke();
      if (k * radius < w / 2 - 30) c.fillText(`${+(k * step).toPrecision(3)} ${unit}`, w / 2 + k * radius + 3, h / 2);
    }
    c.textAlign = "center"; c.fillText("N \u2191", w - 18, h - 14);
  }

  stations(c, w, h, of, heard) {
    c.font = "11px system-ui, sans-serif"; c.textAlign = "left"; c.textBaseline = "middle";
    for (const s of this.chart.stations) {
      const [x, y] = this.at(s.lat, s.lon, w, h), isHeard = heard[s.ident] !== undefined && heard[s.ident] < 60;
      if (x < -20 || y < -20 || x > w + 20 || y > h + 20) continue;
      c.strokeStyle = c.fillStyle = of(isHeard ? "--heard" : "--station"); c.lineWidth = isHeard ? 2.5 : 1.2;
      c.beginPath();
      for (let k = 0; k < 6; k++) c.lineTo(x + 6 * Math.cos(k * Math.PI / 3), y + 6 * Math.sin(k * Math.PI / 3));
      c.closePath(); c.stroke();
      c.beginPath(); c.arc(x, y, 1.5, 0, 7); c.fill();
      c.fillText(s.ident, x + 9, y);
    }
  }

  track(c, w, h, track, colour, isChosen, isDashed) {
    c.strokeStyle = colour; c.lineWidth = isChosen ? 2.2 : 1.1; c.setLineDash(isDashed ? [5, 4] : []);
    c.beginPath();
    for (const [lat, lon] of track) c.lineTo(...this.at(lat, lon, w, h));
    c.stroke(); c.setLineDash([]);
  }

  ellipse(c, x, y, s, colour) {
    if (!s.ellipse) return;
    const [major, minor, bearing] = s.ellipse, k = 1 / this.metresPerPixel;
    c.strokeStyle = colour; c.fillStyle = colour; c.lineWidth = 1.5;
    c.beginPath(); c.ellipse(x, y, Math.min(major * k, 1e5), Math.min(minor * k, 1e5), (bearing - 90) * Math.PI / 180, 0, 2 * Math.PI);
    c.globalAlpha = 0.13; c.fill(); c.globalAlpha = 1; c.stroke();
  }

  other(c, w, h, s, colour) {
    const [x, y] = this.at(s.lat, s.lon, w, h);
    this.ellipse(c, x, y, s, colour);
    c.fillStyle = colour; c.beginPath(); c.arc(x, y, 3.5, 0, 7); c.fill();
  }

  aircraft(c, w, h, s, colour, stale) {
    const [x, y] = this.at(s.lat, s.lon, w, h), turn = s.heading !== undefined ? s.heading : s.track;
    if (!stale) this.ellipse(c, x, y, s, colour);
    c.save(); c.translate(x, y); c.rotate((turn || 0) * Math.PI / 180);
    c.fillStyle = colour; c.strokeStyle = "#fff"; c.lineWidth = 1.5;
    c.beginPath();
    if (turn === undefined) c.arc(0, 0, 6, 0, 7);
    else for (const [px, py] of [[0, -12], [2, -4], [13, 3], [13, 6], [2, 3], [1.5, 9], [5, 12], [5, 14], [0, 12], [-5, 14], [-5, 12], [-1.5, 9], [-2, 3], [-13, 6], [-13, 3], [-2, -4]]) c.lineTo(px, py);
    c.closePath(); c.fill(); c.stroke(); c.restore();
  }

  wind(c, w, s, of, unitsName) {
    const [k, unit] = UNITS[unitsName].speed, x = w - 34, y = 76;
    c.save(); c.translate(x, y);
    c.strokeStyle = c.fillStyle = of("--ink"); c.lineWidth = 2;
    c.save(); c.rotate((s.wind_from + 180) * Math.PI / 180);
    c.beginPath(); c.moveTo(0, 15); c.lineTo(0, -13); c.moveTo(-5, -7); c.lineTo(0, -14); c.lineTo(5, -7); c.stroke(); c.restore();
    c.font = "12px system-ui, sans-serif"; c.textAlign = "right"; c.textBaseline = "top";
    c.fillText(`${String(s.wind_from).padStart(3, "0")}\u00b0 / ${(s.wind * k).toFixed(0)} ${unit}`, 26, 22);
    c.fillText(`\u00b1${(s.wind_bound * k).toFixed(0)} (2\u03c3)`, 26, 37);
    c.restore();
  }
}
