// Attitude, tapes, heading: drawn on one canvas from one solution.  What is not known is not drawn, and what is stale is crossed out.
"use strict";

const AVIONICS = { sky: "#1f6fb5", ground: "#7a5230", ink: "#ffffff", dim: "#9fb0bf", tape: "#0d141bd9", ok: "#3ddc84", warn: "#ffb000", bad: "#ff3b30", magenta: "#ff5cf4" };
const UNITS = {
  aviation: { name: "kt ft NM", speed: [1.943844, "kt"], height: [3.28084, "ft"], climb: [196.8504, "ft/min"], far: [1 / 1852, "NM"] },
  si: { name: "m/s m km", speed: [1, "m/s"], height: [1, "m"], climb: [1, "m/s"], far: [0.001, "km"] },
};

// A canvas as large as it is shown, with its context in CSS pixels.
function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [c, w, h];
}

function redCross(c, x, y, w, h, words) {
  c.save();
  c.strokeStyle = AVIONICS.bad;
  c.lineWidth = 5;
  c.beginPath();
  c.moveTo(x + 4, y + 4); c.lineTo(x + w - 4, y + h - 4);
  c.moveTo(x + w - 4, y + 4); c.lineTo(x + 4, y + h - 4);
  c.stroke();
  if (words) {
    c.font = "600 14px system-ui, sans-serif";
    c.textAlign = "center"; c.textBaseline = "middle";
    const half = c.measureText(words).width / 2 + 8;
    c.fillStyle = "#000d";
    c.fillRect(x + w / 2 - half, y + h / 2 - 14, 2 * half, 28);
    c.fillStyle = "#ff8f88";
    c.fillText(words, x + w / 2, y + h / 2);
  }
  c.restore();
}

// An attitude indicator in a rectangle: horizon, pitch ladder, bank scale.
function attitudeIndicator(c, x, y, w, h, roll, pitch, bound) {
  const cx = x + w / 2, cy = y + h / 2, perDegree = h / 50, far = 2 * (w + h);
  c.save();
  c.beginPath(); c.rect(x, y, w, h); c.clip();
  c.translate(cx, cy);
  c.rotate(-roll * Math.PI / 180);
  c.translate(0, pitch * perDegree);
  c.fillStyle = AVIONICS.sky; c.fillRect(-far, -far, 2 * far, far);
  c.fillStyle = AVIONICS.ground; c.fillRect(-far, 0, 2 * far, far);
  c.strokeStyle = c.fillStyle = AVIONICS.ink;
  c.lineWidth = 2;
  c.beginPath(); c.moveTo(-far, 0); c.lineTo(far, 0); c.stroke();
  c.lineWidth = 1.5;
  c.font = "11px system-ui, sans-serif"; c.textBaseline = "middle";
  for (let p = -90; p <= 90; p += 5) {
    if (!p || Math.abs(p - pitch) > 22) continue;
    const half = (p % 10 ? 0.07 : 0.14) * Math.min(w, h);
    c.beginPath(); c.moveTo(-half, -p * perDegree); c.lineTo(half, -p * perDegree); c.stroke();
    if (p % 10 === 0) {
      c.textAlign = "right"; c.fillText(Math.abs(p), -half - 4, -p * perDegree);
      c.textAlign = "left"; c.fillText(Math.abs(p), half + 4, -p * perDegree);
    }
  }
  c.restore();
  c.save();
  c.translate(cx, cy);
  c.strokeStyle = c.fillStyle = AVIONICS.ink;
  const r = 0.43 * Math.min(w, h);
  for (const mark of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]) {
    c.save(); c.rotate((mark - roll) * Math.PI / 180);
    c.lineWidth = mark % 30 ? 1 : 2.5;
    c.beginPath(); c.moveTo(0, -r); c.lineTo(0, -r - (mark % 30 ? 6 : 11)); c.stroke();
    c.restore();
  }
  c.beginPath(); c.moveTo(0, -r + 2); c.lineTo(-7, -r + 14); c.lineTo(7, -r + 14); c.closePath(); c.fill();
  c.strokeStyle = "#000"; c.lineWidth = 7;
  const wings = () => {
    c.beginPath(); c.moveTo(-0.3 * r - 40, 0); c.lineTo(-0.3 * r, 0); c.lineTo(-0.3 * r, 8);
    c.moveTo(0.3 * r + 40, 0); c.lineTo(0.3 * r, 0); c.lineTo(0.3 * r, 8);
    c.moveTo(-1, 0); c.lineTo(1, 0); c.stroke();
  };
  wings(); c.strokeStyle = AVIONICS.warn; c.lineWidth = 4; wings();
  c.restore();
  if (bound > 2) label(c, `\u00b1${bound.toFixed(0)}\u00b0 tilt`, cx, y + h - 46, bound > 5 ? AVIONICS.bad : AVIONICS.warn);
}

function label(c, words, x, y, colour) {
  c.save();
  c.font = "600 12px system-ui, sans-serif"; c.textAlign = "center"; c.textBaseline = "middle";
  const half = c.measureText(words).width / 2 + 5;
  c.fillStyle = "#000b"; c.fillRect(x - half, y - 9, 2 * half, 18);
  c.fillStyle = colour || AVIONICS.ink; c.fillText(words, x, y);
  c.restore();
}

// A vertical tape around a value, with what bounds it as a bar at its edge.
function tape(c, x, y, w, h, value, bound, step, onRight, title, unit) {
  const perUnit = h / (step * 8), cy = y + h / 2;
  c.save();
  c.beginPath(); c.rect(x, y, w, h); c.clip();
  c.fillStyle = AVIONICS.tape; c.fillRect(x, y, w, h);
  c.strokeStyle = c.fillStyle = AVIONICS.ink;
  c.font = "12px system-ui, sans-serif"; c.textBaseline = "middle"; c.textAlign = onRight ? "left" : "right";
  const edge = onRight ? x : x + w, into = onRight ? 1 : -1;
  for (let v = Math.ceil((value - 4 * step) / step) * step; v <= value + 4 * step; v += step) {
    const at = cy - (v - value) * perUnit;
    c.beginPath(); c.moveTo(edge, at); c.lineTo(edge + into * 7, at); c.stroke();
    c.fillText(Math.round(v), edge + into * 12, at);
  }
  if (bound !== undefined) {
    const half = Math.min(bound * perUnit, h);
    c.fillStyle = AVIONICS.magenta;
    c.fillRect(onRight ? x : x + w - 4, cy - half, 4, 2 * half);
  }
  c.fillStyle = "#000"; c.strokeStyle = AVIONICS.ink; c.lineWidth = 1.5;
  c.beginPath(); c.rect(x + 1, cy - 14, w - 2, 28); c.fill(); c.stroke();
  c.fillStyle = AVIONICS.ink; c.font = "600 19px system-ui, sans-serif"; c.textAlign = "center";
  c.fillText(Math.round(value), x + w / 2, cy + 1);
  c.restore();
  label(c, `${title} ${unit}`, x + w / 2, y + h - 12, AVIONICS.dim);
}

function headingTape(c, x, y, w, h, s) {
  const perDegree = w / 70, cx = x + w / 2;
  c.save();
  c.beginPath(); c.rect(x, y, w, h); c.clip();
  c.fillStyle = AVIONICS.tape; c.fillRect(x, y, w, h);
  c.strokeStyle = c.fillStyle = AVIONICS.ink; c.font = "12px system-ui, sans-serif"; c.textAlign = "center"; c.textBaseline = "top";
  const names = { 0: "N", 90: "E", 180: "S", 270: "W" };
  for (let d = Math.ceil((s.heading - 36) / 5) * 5; d <= s.heading + 36; d += 5) {
    const at = cx + (d - s.heading) * perDegree, shown = ((d % 360) + 360) % 360;
    c.beginPath(); c.moveTo(at, y); c.lineTo(at, y + (d % 10 ? 5 : 9)); c.stroke();
    if (d % 10 === 0) c.fillText(names[shown] || String(shown / 10), at, y + 12);
  }
  if (s.track !== undefined) {
    const off = ((s.track - s.heading + 540) % 360) - 180;
    c.strokeStyle = AVIONICS.ok; c.lineWidth = 2;
    c.beginPath(); c.moveTo(cx + off * perDegree - 6, y + 9); c.lineTo(cx + off * perDegree, y + 1); c.lineTo(cx + off * perDegree + 6, y + 9); c.stroke();
  }
  if (s.heading_bound !== undefined) {
    const half = Math.min(s.heading_bound * perDegree, w / 2);
    c.fillStyle = AVIONICS.magenta; c.fillRect(cx - half, y, 2 * half, 4);
  }
  c.fillStyle = "#000"; c.strokeStyle = AVIONICS.ink; c.lineWidth = 1.5;
  c.beginPath(); c.rect(cx - 40, y + h - 23, 80, 22); c.fill(); c.stroke();
  c.fillStyle = AVIONICS.ink; c.font = "600 15px system-ui, sans-serif"; c.textBaseline = "middle";
  c.fillText(`${String(Math.round(s.heading) % 360).padStart(3, "0")}\u00b0 ${s.north || "T"}`, cx, y + h - 11);
  c.restore();
}

// The same angles from magnetic north, as pilots read them, where the declination is known.
function magnetic(s) {
  const turned = (angle) => (angle === undefined ? undefined : ((angle - s.declination) % 360 + 360) % 360);
  return { ...s, heading: turned(s.heading), track: turned(s.track), north: "M" };
}

// The whole panel.  `stale` is a sentence when nothing of it may be believed.
function drawInstruments(canvas, s, stale, unitsName) {
  if (s && s.declination !== undefined && unitsName === "aviation") s = magnetic(s);
  const [c, w, h] = prepared(canvas), u = UNITS[unitsName], side = Math.min(86, w * 0.19), foot = 50;
  c.clearRect(0, 0, w, h);
  c.fillStyle = "#05080b"; c.fillRect(0, 0, w, h);
  if (stale || !s) { redCross(c, 0, 0, w, h, stale || "no solution"); return; }
  if (s.roll !== undefined) attitudeIndicator(c, 0, 0, w, h, s.roll, s.pitch, s.tilt_bound);
  else redCross(c, side, 0, w - 2 * side, h - foot, "no attitude");
  if (s.heading !== undefined) headingTape(c, side, h - foot, w - 2 * side, foot, s);
  else redCross(c, side, h - foot, w - 2 * side, foot, "no heading");
  const [kSpeed, speedUnit] = u.speed, [kHeight, heightUnit] = u.height, [kClimb, climbUnit] = u.climb, si = unitsName === "si";
  if (s.speed !== undefined) {
    tape(c, 0, 0, side, h, s.speed * kSpeed, s.speed_bound === undefined ? undefined : s.speed_bound * kSpeed, si ? 5 : 10, false, "GS", speedUnit);
  } else redCross(c, 0, 0, side, h, "");
  if (s.msl !== undefined) {
    tape(c, w - side, 0, side, h, s.msl * kHeight, s.height_bound === undefined ? undefined : s.height_bound * kHeight, si ? 20 : 100, true, "MSL", heightUnit);
  } else redCross(c, w - side, 0, side, h, "");
  let row = 14;
  if (s.airspeed !== undefined) label(c, `TAS ${Math.round(s.airspeed * kSpeed)} ${speedUnit}`, side + 48, row);
  if (s.climb !== undefined) {
    const climb = s.climb * kClimb;
    label(c, `${climb >= 0 ? "\u2191" : "\u2193"} ${si ? Math.abs(climb).toFixed(1) : Math.round(Math.abs(climb) / 10) * 10} ${climbUnit}`, w - side - 52, row);
  }
  if (s.level === 2) { c.strokeStyle = AVIONICS.bad; c.lineWidth = 6; c.strokeRect(3, 3, w - 6, h - 6); }
  else if (s.level === 1) { c.strokeStyle = AVIONICS.warn; c.lineWidth = 4; c.strokeRect(2, 2, w - 4, h - 4); }
}
