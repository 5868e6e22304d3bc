"use strict";
// Asks for the newest state again and again, and draws it. A page that is not seen does not ask.
const $ = id => document.getElementById(id);
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const PERIOD_MS = 40, PHASES = ["Training: it teaches itself, on a bright spot that stands still", "Going home", "Following what moves"];
let shown = -1, grey = null;

function context(id) {
  const canvas = $(id), pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  return [pen, canvas.width, canvas.height];
}

function drawImage(live, pixels) {
  const { columns, rows, scale } = live.image;
  if (!columns || pixels.length < columns * rows) return;
  if (!grey || grey.width !== columns || grey.height !== rows) {
    grey = new OffscreenCanvas(columns, rows);
    $("image").height = Math.round($("image").width * rows / columns);
  }
  const picture = new ImageData(columns, rows);
  for (let i = 0; i < columns * rows; i++) {
    picture.data[4 * i] = picture.data[4 * i + 1] = picture.data[4 * i + 2] = pixels[i];
    picture.data[4 * i + 3] = 255;
  }
  grey.getContext("2d").putImageData(picture, 0, 0);
  const [pen, width, height] = context("image");
  pen.drawImage(grey, 0, 0, width, height);
  const k = width / (columns * scale);
  pen.strokeStyle = "#fff8"; pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(width / 2 - 10, height / 2); pen.lineTo(width / 2 + 10, height / 2);
  pen.moveTo(width / 2, height / 2 - 10); pen.lineTo(width / 2, height / 2 + 10);
  pen.stroke();
  const seen = aim(live);
  if (!seen) return;
  pen.strokeStyle = colour("--target"); pen.lineWidth = 3;
  pen.setLineDash(live.target.coasting ? [6, 6] : []);
  const u = (seen.u + .5) * k, v = (seen.v + .5) * k, radius = Math.max(8, Math.sqrt(seen.area / Math.PI) * k);
  pen.beginPath(); pen.arc(u, v, radius, 0, 7); pen.stroke(); pen.setLineDash([]);
  pen.beginPath(); pen.moveTo(u, v); pen.lineTo(u + 12 * seen.vu * k, v + 12 * seen.vv * k); pen.stroke();
  const text = `${Math.round(100 * seen.confidence)} %`;
  pen.font = "600 15px system-ui"; pen.fillStyle = "#000b";
  pen.fillRect(u + radius + 4, v - 12, pen.measureText(text).width + 10, 22);
  pen.fillStyle = "#fff"; pen.fillText(text, u + radius + 9, v + 4);
}

// What is followed: while it trains the bright spot, later what moves.
function aim(live) {
  const target = live.target;
  if (!target) return null;
  if (live.learner && live.learner.phase === 0 && target.blob) return { vu: 0, vv: 0, ...target.blob, confidence: 1 };
  return target.motion || target.track;
}

function drawFields({ columns, rows, values } = {}) {
  const [pen, width, height] = context("fields");
  if (!values || !columns) return;
  const gap = 8, wide = (width - 3 * gap) / 4, high = (height - 2 * gap) / 3;
  values.forEach((field, i) => {
    const left = (i % 4) * (wide + gap), top = Math.floor(i / 4) * (high + gap);
    const tile = new ImageData(columns, rows);
    field.forEach((value, c) => {
      const light = Math.max(0, Math.min(255, 128 + 1.27 * value));
      tile.data.set([light, light, light, 255], 4 * c);
    });
    const small = new OffscreenCanvas(columns, rows);
    small.getContext("2d").putImageData(tile, 0, 0);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(small, left, top, wide, high);
  });
}

function axes(pen, width, height) {
  pen.strokeStyle = colour("--line"); pen.lineWidth = 1;
  pen.strokeRect(.5, .5, width - 1, height - 1);
}

function drawPlane(live) {
  const [pen, width, height] = context("plane");
  axes(pen, width, height);
  pen.beginPath(); pen.moveTo(width / 2, 0); pen.lineTo(width / 2, height); pen.moveTo(0, height / 2); pen.lineTo(width, height / 2); pen.stroke();
  const seen = aim(live), background = live.target ? live.target.background : [0, 0];
  const reach = Math.max(4, ...background.map(Math.abs), ...(seen ? [Math.abs(seen.vu), Math.abs(seen.vv)] : [])) * 1.25;
  const at = ([u, v]) => [width / 2 * (1 + u / reach), height / 2 * (1 + v / reach)];
  pen.fillStyle = colour("--pale"); pen.font = "13px system-ui";
  pen.fillText(`${reach.toFixed(1)} px`, width - 52, height / 2 - 5);
  const [x, y] = at(background);
  pen.fillStyle = colour("--hand"); pen.fillRect(x - 5, y - 5, 10, 10);
  if (seen) {
    const [u, v] = at([seen.vu, seen.vv]);
    pen.strokeStyle = colour("--target"); pen.lineWidth = 3;
    pen.beginPath(); pen.arc(u, v, 7, 0, 7); pen.stroke();
  }
}

function drawAbove(way) {
  const [pen, width, height] = context("above");
  axes(pen, width, height);
  if (way.length < 2) return;
  const all = way.flatMap(([a, b, c, d]) => [[a, b], [c, d]]);
  const low = [0, 1].map(k => Math.min(...all.map(p => p[k]))), high = [0, 1].map(k => Math.max(...all.map(p => p[k])));
  const span = Math.max(.1, high[0] - low[0], high[1] - low[1]) * 1.1;
  const at = (x, y) => [width / 2 + (y - (low[1] + high[1]) / 2) / span * -width, height / 2 - (x - (low[0] + high[0]) / 2) / span * height];
  const line = (k, name, thick) => {
    pen.strokeStyle = colour(name); pen.lineWidth = thick; pen.beginPath();
    // Where the target was put elsewhere, or the hand started anew, there is no way in between.
    way.forEach((point, i) => {
      const far = i > 0 && Math.hypot(point[k] - way[i - 1][k], point[k + 1] - way[i - 1][k + 1]) > .1;
      pen[far ? "moveTo" : "lineTo"](...at(point[k], point[k + 1]));
    });
    pen.stroke();
    const last = way[way.length - 1];
    pen.fillStyle = colour(name); pen.beginPath(); pen.arc(...at(last[k], last[k + 1]), 5, 0, 7); pen.fill();
  };
  line(0, "--hand", 3); line(2, "--target", 1.5);
  pen.fillStyle = colour("--pale"); pen.font = "13px system-ui";
  pen.fillText(`${(100 * span).toFixed(0)} cm across`, 8, height - 8);
}

function drawTime(way) {
  const [pen, width, height] = context("time");
  axes(pen, width, height);
  const distances = way.map(([a, b, c, d]) => 100 * Math.hypot(a - c, b - d));
  if (distances.length < 2) return null;
  const most = Math.max(2, ...distances) * 1.1;
  pen.fillStyle = colour("--pale"); pen.font = "13px system-ui";
  for (const share of [.5, 1]) pen.fillText(`${(share * most / 1.1).toFixed(1)} cm`, 6, height * (1 - share / 1.1) + 14);
  pen.strokeStyle = colour("--hand"); pen.lineWidth = 2; pen.beginPath();
  distances.forEach((d, i) => pen.lineTo(i / (distances.length - 1) * width, height * (1 - d / most)));
  pen.stroke();
  return distances[distances.length - 1];
}

function element(name, text, kind) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function showHops(hops) {
  const most = Math.max(1, ...hops.map(hop => hop.wait_us + hop.compute_us));
  $("hops").replaceChildren(...hops.map(hop => {
    const row = element("div", undefined, "hop"), bar = element("span", undefined, "bar");
    const wait = element("i"), compute = element("b");
    wait.style.width = `${100 * hop.wait_us / most}%`; compute.style.width = `${100 * hop.compute_us / most}%`;
    bar.append(wait, compute);
    row.append(element("span", hop.name), bar, element("span", `${(hop.p99_us / 1000).toFixed(1)} ms`));
    return row;
  }));
}

const rows = new Map();

// Rows stay the same elements: a button that is replaced between press and release is never clicked.
function rowOf(name) {
  if (!rows.has(name)) {
    const row = element("tr"), button = element("button", "restart");
    button.dataset.do = `restart/${name}`;
    button.dataset.token = "";
    button.setAttribute("aria-label", `restart ${name}`);
    row.append(element("td", name), ...Array.from({ length: 4 }, () => element("td")), element("td"));
    row.lastChild.append(button);
    $("services").append(row);
    rows.set(name, row);
    lock(row);
  }
  return rows.get(name);
}

function showServices(services) {
  for (const service of services) {
    const cells = rowOf(service.name).children, silent = service.silent_ms > 1000;
    const state = silent ? `silent for ${(service.silent_ms / 1000).toFixed(0)} s` : service.lack || "running";
    const texts = [service.name, state, service.answered, service.skipped, service.refused];
    texts.forEach((text, k) => { if (cells[k].textContent !== String(text)) cells[k].textContent = text; });
    cells[1].className = silent || service.lack ? "bad" : "good";
  }
}

function showArm(arm) {
  if (!arm) return;
  $("arm").textContent = `${arm.state.replace("_", " ")}, ${arm.at_rest ? "at rest" : "moving"}: ${arm.cause}.`;
  $("arm").className = arm.state === "active" || arm.state === "holding" ? "" : "bad";
}

// The link that `pursuit up` prints carries the token; it is kept for this tab alone, and out of its address.
const KEY = "pursuit-token";
if (location.hash.length > 1) {
  sessionStorage.setItem(KEY, location.hash.slice(1));
  history.replaceState(null, "", location.pathname);
}

function lock(within) {
  for (const button of within.querySelectorAll("[data-token]")) {
    button.disabled = !sessionStorage.getItem(KEY);
    button.title = button.disabled ? "open the link that pursuit up printed: it carries the token" : "";
  }
}

async function act(button) {
  $("done").textContent = `${button.dataset.do.replace("/", " ")} …`;
  button.disabled = true;
  try {
    const answer = await fetch(`/do/${button.dataset.do}`, { method: "POST", body: "{}", headers: {
      "Content-Type": "application/json", "X-Pursuit-Token": sessionStorage.getItem(KEY) || "" } });
    $("done").textContent = `${button.dataset.do.replace("/", " ")}: ${(await answer.text()).trim()}`;
  } catch (error) {
    $("done").textContent = `${button.dataset.do.replace("/", " ")}: nobody answers`;
  }
  button.disabled = false;
}

document.addEventListener("click", event => {
  const button = event.target.closest("[data-do]");
  if (button) act(button);
});
lock(document);

function showLearner(learner) {
  if (!learner) return;
  const facts = [["samples in memory", learner.ring], ["samples in all", learner.samples], ["refits taken / refused", `${learner.refits} / ${learner.refits_rejected}`],
    ["changes noticed", learner.changes], ["map fits", learner.consistent ? "yes" : "no"], ["uncertainty", `${learner.uncertainty_deg.toFixed(2)}°`],
    ["delay predicted over", `${learner.lead_ms.toFixed(0)} ms`], ["clock offset", `${learner.offset_ms.toFixed(1)} ms`], ["samples refused", learner.refused]];
  $("learner").replaceChildren(...facts.map(([name, value]) => {
    const row = element("div");
    row.append(element("dt", name), element("dd", String(value)));
    return row;
  }));
}

function show(live, pixels) {
  drawImage(live, pixels); drawFields(live.fields || {}); drawPlane(live); drawAbove(live.way);
  const off = drawTime(live.way);
  $("frame").textContent = live.frame;
  $("off").textContent = off === null ? "–" : `${off.toFixed(1)} cm`;
  $("moves").textContent = live.learner ? live.learner.moves : "–";
  $("end").textContent = `${live.end_to_end_ms[0].toFixed(1)} ms`;
  const phase = live.learner ? PHASES[live.learner.phase] : "Watching";
  $("said").textContent = aim(live) ? `${phase}.` : `${phase}. Nothing is seen that moves on its own.`;
  $("restarts").textContent = live.restarts || "no";
  showHops(live.hops); showLearner(live.learner);
}

async function ask() {
  const begun = performance.now();
  try {
    if (!document.hidden) {
      const answer = await fetch("/live", { cache: "no-store" });
      const bytes = new Uint8Array(await answer.arrayBuffer()), end = bytes.indexOf(10);
      const live = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
      showServices(live.services); showArm(live.arm);
      if (live.frame !== shown && live.image.columns) { shown = live.frame; show(live, bytes.subarray(end + 1)); }
    }
  } catch (error) {
    $("said").textContent = "The system does not answer. Is it still running? (pursuit status)";
  }
  setTimeout(ask, Math.max(5, PERIOD_MS - (performance.now() - begun)));
}
ask();
