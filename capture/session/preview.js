"use strict";

const POLL_MS = 250;
const TIMEOUT_MS = 3000; // the least age at which an image is blanked

const figures = [];
let state = null;
let receivedMs = 0;
let linkError = null;

const byId = (id) => document.getElementById(id);

// `age_s` is the age when the answer was sent.
const age = (light) => light.age_s + (performance.now() - receivedMs) / 1000;

// As the lights stand around the part; without places, in rows.
function place() {
  const { places } = state;
  const area = byId("lights");
  area.classList.toggle("placed", places !== null);
  if (places === null) return;
  const boxes = [...figures.map(({ figure }) => figure), byId("part")];
  for (const box of boxes) box.style.width = `calc(${100 * places.size}% - 1rem)`;
  const height = Math.max(...boxes.map((box) => box.offsetHeight)) + 16;
  const corners = [...places.lights, places.part];
  const lowest = Math.max(...corners.map(([, top]) => top));
  const highest = Math.min(...corners.map(([, top]) => top));
  boxes.forEach((box, index) => {
    const [left, top] = corners[index];
    box.style.left = `${100 * left}%`;
    box.style.top = `${((top - highest) / places.size) * height}px`;
  });
  area.style.height = `${((lowest - highest) / places.size + 1) * height}px`;
}

function showGuide() {
  for (const name of ["guide", "found", "captured"]) byId(name).textContent = state[name] ?? "";
  for (const { figure } of figures) {
    const overlay = figure.querySelector(".overlay");
    overlay.hidden = state.overlay === null;
    const address = `overlay.svg?${state.overlay}`;
    if (!overlay.hidden && overlay.getAttribute("src") !== address) overlay.src = address;
  }
}

function figureOf(index) {
  while (figures.length <= index) {
    const figure = byId("light").content.cloneNode(true).firstElementChild;
    byId("lights").append(figure);
    figures.push({ figure, sequence: null });
  }
  return figures[index];
}

function drawHistogram(canvas, shares) {
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  // Square roots keep bins of few pixels visible.
  const most = Math.sqrt(Math.max(...shares, 1e-9));
  const width = canvas.width / shares.length;
  shares.forEach((share, bin) => {
    const height = (Math.sqrt(share) / most) * canvas.height;
    context.fillStyle = bin === shares.length - 1 ? "#ff5252" : "#8ab4f8";
    context.fillRect(bin * width, canvas.height - height, width - 0.5, height);
  });
}

function show(light, index) {
  const entry = figureOf(index);
  const find = (selector) => entry.figure.querySelector(selector);
  find(".name").textContent = light.name;
  if (light.sequence === null || light.sequence === entry.sequence) return;
  entry.sequence = light.sequence;
  find(".light").src = `light/${index}.png?${light.sequence}`;
  find(".light").alt = light.name;
  drawHistogram(find("canvas"), light.histogram);
  find(".mean").textContent = `${(100 * light.mean_share).toFixed(1)} %`;
  find(".saturated").textContent = `${(100 * light.saturated_share).toFixed(2)} %`;
  find(".saturated").classList.toggle("too-much", light.saturated_share > state.max_saturated_share);
  find(".focus").textContent = light.focus.toPrecision(3);
}

// Also runs when the server does not answer, so that its last images age and are blanked.
function refreshAges() {
  const error = linkError ?? state?.error;
  byId("error").hidden = !error;
  if (error) byId("error").textContent = `${error} (trying again)`;
  if (!state) return;
  state.lights.forEach((light, index) => {
    if (light.sequence === null) return;
    const { figure } = figureOf(index);
    const stale = age(light) > state.stale_after_s;
    figure.classList.toggle("stale", stale);
    figure.querySelector(".age").textContent = `${age(light).toFixed(1)} s old`;
    figure.querySelector(".light").hidden = stale;
    figure.querySelector("p").hidden = !stale;
    figure.querySelector("p").textContent = "no new image: the last one is too old to be shown";
  });
}

async function poll() {
  try {
    const answer = await fetch("state.json", { signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    state = await answer.json();
    receivedMs = performance.now();
    linkError = null;
    byId("camera").textContent = state.camera || "waiting for the rig";
    byId("simulated").hidden = !state.simulated;
    state.lights.forEach(show);
    showGuide();
    place();
  } catch (error) {
    linkError = "No answer from ps4rig: the preview has ended, or the computer is busy";
  }
  refreshAges();
  setTimeout(poll, POLL_MS);
}

setInterval(refreshAges, 100);
poll();
