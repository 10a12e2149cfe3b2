"use strict";
const byId = id => document.getElementById(id);
// Colour of the style in the current colour scheme.
const styleColour = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const colours = () => [styleColour("blue"), "#E69F00", "#009E73", "#CC79A7"];
// Magma of matplotlib (CC0), nine of its colours.
const MAGMA = [[0,0,4],[29,17,71],[81,18,124],[131,38,129],[183,55,121],[229,81,100],[251,136,97],[254,194,135],[252,253,191]];
const RAMP = Array.from({length: 255}, (_, i) => {
  const x = i / 254 * 8, k = Math.min(Math.floor(x), 7), t = x - k;
  return MAGMA[k].map((c, j) => Math.round(c + t * (MAGMA[k + 1][j] - c)));
});
const fig = (v, digits = 2) => v === null || v === undefined ? "–" : v.toFixed(digits).replace("-", "−");
let unfit = "", chosen = "", about = null, last = null, shown = null, trace = [], loading = false, paused = false;

function canvas(id, aspect) {
  const c = byId(id), w = c.clientWidth, h = aspect ? Math.round(w / aspect) : c.clientHeight, r = devicePixelRatio || 1;
  if (aspect) c.style.height = h + "px";
  if (c.width !== Math.round(w * r) || c.height !== Math.round(h * r)) { c.width = Math.round(w * r); c.height = Math.round(h * r); }
  const g = c.getContext("2d");
  g.setTransform(r, 0, 0, r, 0, 0); g.clearRect(0, 0, w, h);
  return [g, w, h];
}
// The content policy allows no style in markup: fills are set one by one.
function legend(id, html) {
  byId(id).innerHTML = html;
  for (const e of byId(id).querySelectorAll("[data-fill]")) e.style.background = e.dataset.fill;
}
function bytes(text) { return Uint8Array.from(atob(text), c => c.charCodeAt(0)); }
function floats(text) { return new Float32Array(bytes(text).buffer); }

// Round to 1, 2 or 5 times a power of ten.
function round(v) {
  if (!(v > 0)) return 1;
  const p = 10 ** Math.floor(Math.log10(v)), m = v / p;
  return (m < 1.5 ? 1 : m < 3.5 ? 2 : m < 7.5 ? 5 : 10) * p;
}
const scales = {};
// Round full scale that changes rarely.
function steadyScale(name, most, above) {
  let r = round(most);
  if (above && r < most) r = round(1.8 * most);
  if (!(name in scales) || r > scales[name] || most < scales[name] / 4) scales[name] = r;
  return scales[name];
}
function arrow(g, x, y, dx, dy, head) {
  const l = Math.hypot(dx, dy); if (l < 1.2) return;
  const k = Math.min(head, 0.45 * l) / l, ex = x + dx, ey = y + dy;
  g.beginPath(); g.moveTo(x, y); g.lineTo(ex, ey);
  g.moveTo(ex - k * (dx + 0.6 * dy), ey - k * (dy - 0.6 * dx)); g.lineTo(ex, ey); g.lineTo(ex - k * (dx - 0.6 * dy), ey - k * (dy + 0.6 * dx));
  g.stroke();
}
function arrows(g, a, to, size, colour, width) {
  const v = floats(a.data), pitch = Math.abs(to(a.x_mm[0] + a.step_mm, 0)[0] - to(a.x_mm[0], 0)[0]);
  const scale = steadyScale(a.name, a.most), k = 1.6 * pitch / scale;
  g.lineCap = g.lineJoin = "round"; g.strokeStyle = colour; g.lineWidth = width; let n = 0;
  for (const y of a.y_mm) for (const x of a.x_mm) {
    const u = v[n++], w = v[n++];
    if (u === u) { const p = to(x, y); arrow(g, p[0], p[1], k * u, k * w, size); }
  }
  return `<span><svg width="${Math.min(1.6 * pitch, 80)}" height="9"><path d="M1 4.5H${Math.min(1.6 * pitch, 80) - 2}m-5-3.5l5 3.5l-5 3.5" fill="none" stroke="currentColor" stroke-width="1.6"/></svg> ${+(scale * a.times).toPrecision(2)} ${a.unit} ${a.words}</span>`;
}
function outlines(g, to, rings) {
  g.lineJoin = "round";
  for (const [width, colour] of [[4, "rgba(0,0,0,0.55)"], [2, "#fff"]]) {
    g.lineWidth = width; g.strokeStyle = colour;
    for (const ring of rings) {
      if (!ring || ring.length < 2) continue;
      g.beginPath(); ring.forEach((p, i) => { const q = to(p[0], p[1]); i ? g.lineTo(q[0], q[1]) : g.moveTo(q[0], q[1]); });
      g.closePath(); g.stroke();
    }
  }
}
function place(d, w, h) {
  const [x0, x1, y0, y1] = d.view_mm;
  return (x, y) => [(x - x0) / (x1 - x0) * w, (y - y0) / (y1 - y0) * h];
}
function face(d, image) {
  const v = d.view_mm, [g, w, h] = canvas("face", (v[1] - v[0]) / (v[3] - v[2])), to = place(d, w, h);
  if (image) { g.globalAlpha = 0.62; g.drawImage(image, 0, 0, w, h); g.globalAlpha = 1; }
  let key = "";
  if (d.flow) key += arrows(g, d.flow, to, 5, "#ffe14d", 1.7);
  outlines(g, to, d.contacts.map(c => c.seen_mm || c.outline_mm));
  if (d.contacts.length) key += "<span>○ white: contact</span>";
  if (d.cover < 0.98) key += `<span>no arrow: unknown</span>`;
  legend("facekey", key);
}
let sheet = document.createElement("canvas");
function map(d) {
  const v = d.view_mm, [g, w, h] = canvas("map", (v[1] - v[0]) / (v[3] - v[2])), to = place(d, w, h);
  let key = "";
  const m = d.maps.find(m => m.name === chosen) || d.maps[0];
  const names = d.maps.map(m => m.name).join();
  if (byId("maps").dataset.names !== names) {
    byId("maps").dataset.names = names;
    byId("maps").innerHTML = d.maps.length > 1 ? d.maps.map(m => `<button data-map="${m.name}">${m.name}</button>`).join("") : "";
  }
  for (const b of byId("maps").children) b.setAttribute("aria-pressed", m && b.dataset.map === m.name);
  if (m) {
    const top = steadyScale(m.name, m.most, true), data = bytes(m.data), f = m.most / top;
    sheet.width = m.width; sheet.height = m.height;
    const s = sheet.getContext("2d"), pixels = s.createImageData(m.width, m.height);
    for (let i = 0; i < data.length; i++) {
      const c = data[i] === 255 ? [70, 74, 84] : RAMP[Math.min(254, Math.round(data[i] * f))];
      pixels.data.set([c[0], c[1], c[2], 255], 4 * i);
    }
    s.putImageData(pixels, 0, 0);
    g.imageSmoothingEnabled = true; g.imageSmoothingQuality = "high";
    const a = to(m.x_mm[0], m.y_mm[0]), b = to(m.x_mm[1], m.y_mm[1]);
    g.drawImage(sheet, a[0], a[1], b[0] - a[0], b[1] - a[1]);
    key += `<span>${m.name} 0<span class="ramp" data-fill="linear-gradient(90deg,${MAGMA.map(c => `rgb(${c})`).join()})"></span>${+(top * m.times).toPrecision(2)} ${m.unit}</span>`;
  }
  if (d.shear) key += arrows(g, d.shear, to, 5, "#7fe0ff", 1.6);
  outlines(g, to, d.contacts.map(c => c.outline_mm));
  if (d.force_n && d.contacts.length) {
    const c = d.contacts[0].centroid_mm, p = to(c[0], c[1]), top = steadyScale("force", Math.hypot(...d.force_n));
    g.lineCap = "round";
    for (const [colour, width] of [["rgba(0,0,0,0.6)", 7], ["#ff9d2e", 4]]) {
      g.strokeStyle = colour; g.lineWidth = width;
      arrow(g, p[0], p[1], d.force_n[0] / top * w / 5, d.force_n[1] / top * w / 5, 13);
      g.beginPath(); g.arc(p[0], p[1], 4, 0, 7); g.stroke();
    }
    key += `<span><i class="dot thick" data-fill="#ff9d2e"></i>total shear force</span>`;
  }
  if (m && m.lost) key += `<span><i class="dot area" data-fill="#464a54"></i>unknown</span>`;
  legend("mapkey", key);
}
function plot() {
  const [g, w, h] = canvas("plot"), names = about.trace_names, left = 46, low = 20, line = colours();
  byId("plottitle").textContent = about.trace_title;
  legend("plotkey", names.map((n, i) => `<span><i class="dot" data-fill="${line[i]}"></i>${n}</span>`).join("")
    + `<span><i class="dot thick" data-fill="#d55e00"></i>not trusted</span>`);
  if (trace.length < 2) return;
  const t1 = trace[trace.length - 1][0], t0 = about.window_s ? Math.max(trace[0][0], t1 - about.window_s) : trace[0][0], visible = trace.filter(p => p[0] >= t0);
  const values = visible.flatMap(p => p.slice(1, 1 + names.length)).filter(v => v !== null);
  let lo = Math.min(0, ...values), hi = Math.max(0, ...values);
  if (hi - lo < about.trace_least) { hi = Math.max(hi, about.trace_least / 2); lo = Math.min(lo, -about.trace_least / 2); }
  const room = 0.06 * (hi - lo); lo -= room; hi += room;
  const x = t => left + (t - t0) / Math.max(t1 - t0, 1e-9) * (w - left - 8), y = v => 6 + (hi - v) / (hi - lo) * (h - low - 8);
  g.font = "12px system-ui, sans-serif"; g.fillStyle = styleColour("soft"); g.lineWidth = 1;
  const step = round((hi - lo) / 4.5), digits = Math.max(0, -Math.floor(Math.log10(step)));
  g.textAlign = "right"; g.textBaseline = "middle";
  for (let v = Math.ceil(lo / step) * step; v <= hi; v += step) {
    g.strokeStyle = Math.abs(v) < step / 2 ? styleColour("edge") : styleColour("line"); g.beginPath(); g.moveTo(left, y(v)); g.lineTo(w - 8, y(v)); g.stroke();
    g.fillText(fig(Math.abs(v) < step / 2 ? 0 : v, digits), left - 6, y(v));
  }
  g.textAlign = "center"; g.textBaseline = "top";
  const ts = round((t1 - t0) / 6);
  for (let t = Math.ceil(t0 / ts) * ts; t <= t1; t += ts) g.fillText(`${+t.toFixed(3)} s`, Math.min(Math.max(x(t), left + 8), w - 22), h - low + 5);
  g.fillStyle = "#d55e00";
  visible.forEach((p, i) => { if (!p[names.length + 1]) { const a = x(p[0]), b = i + 1 < visible.length ? x(visible[i + 1][0]) : a + 3; g.fillRect(a, h - low - 3, Math.max(b - a, 2), 4); } });
  g.lineWidth = 1.8; g.lineJoin = "round";
  names.forEach((_, k) => {
    g.strokeStyle = line[k]; g.beginPath(); let pen = false;
    for (const p of visible) { const v = p[k + 1]; if (v === null) { pen = false; continue; } pen ? g.lineTo(x(p[0]), y(v)) : g.moveTo(x(p[0]), y(v)); pen = true; }
    g.stroke();
  });
}
function tiles(d) {
  const f = d.force_n, rows = [];
  if (f) {
    rows.push(["normal force Fz", fig(f[2]), "N", d.extrapolated ? "unreliable" : "press: negative", d.extrapolated]);
    rows.push(["shear force", fig(f[0] === null ? null : Math.hypot(f[0], f[1])), "N", `x ${fig(f[0])}, y ${fig(f[1])}`]);
    if (d.torque_nmm) rows.push(["torque about z", fig(d.torque_nmm[2], 1), "N mm", `x ${fig(d.torque_nmm[0], 0)}, y ${fig(d.torque_nmm[1], 0)}`]);
  } else rows.push(["force", "not measured", "", "no force calibration"]);
  rows.push(["max displacement", fig(d.motion, 2), d.unit, d.markers === null ? "of the visible pattern" : `${d.markers_held} of ${d.markers} markers found`]);
  rows.push(["cover", fig(100 * d.cover, 1), "%", d.trusted ? "flow trusted" : "flow NOT trusted", !d.trusted]);
  rows.push(["rate", fig(d.hz, 1), "Hz", d.dropped ? `${d.dropped} images dropped` : "no images dropped"]);
  rows.push(["age", fig(d.age_ms, 0), "ms", `image ${d.frame}`]);
  byId("tiles").innerHTML = rows.map(([name, value, unit, note, doubt]) =>
    `<div class="tile${doubt ? " doubt" : ""}"><span class="soft small">${name}</span><b>${value} <span>${unit}</span></b><span class="soft small">${note || "&nbsp;"}</span></div>`).join("");
  contacts(d);
  verdict(d);
}
// Summary of the newest image: trusted or not, force, contacts, displacement.
function verdict(d) {
  const doubts = [d.trusted ? "" : "flow unreliable", d.extrapolated ? "force unreliable" : "", unfit].filter(Boolean);
  const parts = [];
  if (d.force_n) parts.push(`Fz ${fig(d.force_n[2])} N`);
  if (d.measured_contacts) parts.push(`contacts: ${d.contact_number}`);
  parts.push(`max displacement ${fig(d.motion)} ${d.unit}`);
  const words = parts.join(", ");
  byId("verdict").textContent = (doubts.length ? `Not trusted: ${doubts.join(", ")}. ` : "Trusted. ") + words + ".";
  byId("verdict").classList.toggle("warn", doubts.length > 0);
}
function contacts(d) {
  if (!d.contacts.length) { byId("contacts").textContent = d.measured_contacts ? "None." : "Not measured."; return; }
  const columns = [["position x, y", c => `${fig(c.place_mm[0], 1)}, ${fig(c.place_mm[1], 1)} mm`], ["area", c => `${fig(c.area_mm2, 1)} mm²`], ["number", c => c.count], ["resolution", c => `${fig(c.resolution_mm, 1)} mm`]];
  if (d.contacts.some(c => c.peak_depth_mm !== null)) columns.push(["peak depth", c => `${fig(c.peak_depth_mm)} mm`]);
  if (d.contacts.some(c => c.force_share !== null)) columns.push(["share of force", c => `${fig(100 * c.force_share, 0)} %`]);
  byId("contacts").innerHTML = `<table><thead><tr>${columns.map(([head]) => `<th>${head}</th>`).join("")}</tr></thead><tbody>`
    + d.contacts.map(c => `<tr>${columns.map(([, of]) => `<td>${of(c)}</td>`).join("")}</tr>`).join("") + "</tbody></table>";
}
function state(s) {
  byId("health").textContent = s.health; unfit = s.unfit; if (last) verdict(last);
  byId("state").textContent = paused ? "paused" : s.ended ?? "";
  byId("reference").disabled = s.ended !== null;
}
function take(d, isNew) {
  last = d;
  if (isNew) { trace.push(d.point); if (trace.length > 6000) trace.splice(0, 3000); }
  tiles(d); map(d); plot();
  if (loading) return;
  loading = true;
  const image = new Image();
  image.onload = () => { shown = image; loading = false; face(last, shown); };
  image.onerror = () => { loading = false; };
  image.src = "image.jpg?" + d.frame;
}
async function begin() {
  about = await (await fetch("about")).json(); trace = about.trace;
  byId("source").textContent = about.source; byId("simulated").textContent = about.simulated || "";
  document.title = "DelTact live: " + about.source;
  for (let number = -1; ;) {
    let wait = 100;
    try {
      const reply = await (await fetch("newest?" + number)).json(), d = reply.result;
      state(reply);
      if (d && !paused && reply.number >= 0) { number = reply.number; take(d, !trace.length || d.point[0] !== trace[trace.length - 1][0]); }
    } catch (error) { byId("state").textContent = "measurement disconnected"; wait = 3000; }
    await new Promise(done => setTimeout(done, wait));
  }
}
byId("maps").onclick = e => { if (e.target.dataset.map) { chosen = e.target.dataset.map; map(last); } };
byId("reference").onclick = () => fetch("reference", {method: "POST"});
byId("pause").onclick = e => { paused = !paused; e.target.setAttribute("aria-pressed", paused); e.target.textContent = paused ? "Resume" : "Pause"; };
matchMedia("(prefers-color-scheme: dark)").onchange = () => { if (last) plot(); };
addEventListener("resize", () => { if (last) { map(last); plot(); face(last, shown); } });
begin();
