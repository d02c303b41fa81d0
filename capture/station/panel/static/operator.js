// The operator's page: follows the events of the station, and never shows an old verdict as a new one.
import { ANSWER_MS } from "/static/requests.js";
import { age, blankPictures, forgetThumbnails, showAges, showPictures, thumbnail } from "/static/part_pictures.js";

const SILENCE_MS = 20000; // the page asks for the state every 5 s
const PATIENCE_MS = 2000; // a panel that is restarted is back before
const REFRESH_MS = 5000; // the rate falls without an event, and a proxy may hold events back
const RETRY_MS = 5000;
const REJECTED = 12;
const byId = (id) => document.getElementById(id);
const csrf = document.querySelector('meta[name="csrf"]').content;

let drawn = { run: "", id: 0 }; // the last event that the page shows
let last = null; // the last result
let lastNumber = 0; // of the last part, 5 s ago
let counts = { PASS: 0, FAIL: 0, UNKNOWN: 0, ERROR: 0 };
let refused = 0;
let rejected = []; // the newest first
let state = "";
let isStopped = false; // by errors in a row, until somebody acknowledges them
let inspected = null; // the part that has no verdict yet
let heardMs = Date.now();
let isConnected = true;
let source = null; // of the events; null while the page is hidden

function setText(id, text) {
  const element = byId(id);
  if (element.textContent !== text) element.textContent = text;
}

function shape(decision) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  svg.setAttribute("class", "shape");
  svg.setAttribute("aria-hidden", "true");
  use.setAttribute("href", `#shape-${decision}`);
  svg.append(use);
  return svg;
}

const partPage = (partId) => `/parts/${encodeURIComponent(partId)}`;

function showVerdict(isOld) {
  const isCollected = last !== null && last.causes.includes("collected"); // it was not judged
  const decision = last === null || isCollected ? "NONE" : last.decision;
  const block = byId("verdict");
  block.dataset.decision = decision;
  block.classList.toggle("old", isOld || !isConnected);
  block.querySelector("use").setAttribute("href", `#shape-${decision}`);
  setText("word", last === null ? "NO PART YET" : isCollected ? "COLLECTED" : decision);
  setText("name-UNKNOWN", isCollected ? "COLLECTED" : "UNKNOWN");
  setText("reason", last === null ? "" : last.reason);
  setText("part", last === null ? "" : last.part_id);
  if (last !== null) byId("part").href = partPage(last.part_id);
  showAge();
  showPictures(last);
  blankPictures(isOld || !isConnected);
}

function showAge() {
  setText("age", last === null ? "" : `${age(last.decided_utc)} ago`);
}

function showCounts() {
  for (const [decision, count] of Object.entries(counts)) setText(`count-${decision}`, String(count));
  setText("refused", String(refused));
}

function allowAcknowledge() {
  byId("acknowledge").disabled = !isConnected
    || !(isStopped || rejected.some((part) => !part.acknowledged_by));
}

function showState(name, reason, fault) {
  state = name;
  isStopped = fault !== null && fault.in_a_row > 0;
  allowAcknowledge();
  setText("now", inspected === null ? `${name}: ${reason}` : `inspecting ${inspected} (${name})`);
  byId("trigger").disabled = state !== "ready" || !isConnected;
}

function showRecipe(recipe) {
  setText("recipe", recipe === null ? "none" : `${recipe.name}, version ${recipe.version}`);
}

function showDevices(devices) {
  byId("devices").replaceChildren(...devices.map((device) => {
    const item = document.createElement("li");
    const name = document.createElement("b");
    const note = document.createElement("small");
    item.dataset.status = device.status;
    name.textContent = device.name;
    note.textContent = device.text;
    item.append(name, `: ${device.status} `, note);
    return item;
  }));
}

function updateRejectedTexts() {
  for (const [number, item] of [...byId("rejected").children].entries()) {
    const part = rejected[number];
    const acknowledged = part.acknowledged_by ? `seen by ${part.acknowledged_by}, ` : "";
    item.querySelector("p").textContent = `${acknowledged}${age(part.decided_utc)} ago: ${part.reason}`;
  }
}

function showRejected() {
  byId("rejected").replaceChildren(...rejected.map((part) => {
    const item = document.createElement("li");
    const link = document.createElement("a");
    const reason = document.createElement("p");
    reason.title = part.reason;
    item.dataset.decision = part.decision;
    link.href = partPage(part.part_id);
    link.append(shape(part.decision), ` ${part.decision} ${part.part_id}`);
    item.append(thumbnail(part), link, reason);
    return item;
  }));
  updateRejectedTexts();
  forgetThumbnails(rejected);
  allowAcknowledge();
}

function showSnapshot(all) {
  drawn = { run: all.run, id: all.event_id };
  last = all.last;
  inspected = all.inspected;
  counts = all.announced;
  refused = all.refused;
  rejected = all.rejected;
  showState(all.state, all.reason, all.fault);
  showRecipe(all.recipe);
  showVerdict(inspected !== null);
  showCounts();
  showDevices(all.devices);
  showRejected();
  setText("rate", String(all.parts_per_minute));
}

const handlers = {
  snapshot: showSnapshot,
  state: (event) => showState(event.state, event.reason, event.fault),
  recipe: showRecipe,
  devices: (event) => showDevices(event.devices),
  begun: (event) => {
    inspected = event.part_id;
    setText("now", `inspecting ${inspected}`);
    showVerdict(true);
  },
  part: (event) => {
    last = event;
    if (inspected === event.part_id) inspected = null;
    counts[event.decision] += 1;
    if (event.decision !== "PASS" && !event.causes.includes("collected")) {
      rejected = [{ ...event, acknowledged_by: null }, ...rejected].slice(0, REJECTED);
      showRejected();
    }
    setText("now", `${state}: ${event.part_id} took ${Math.round(event.latency_ms)} ms`);
    showVerdict(false);
    showCounts();
  },
  refused: (event) => {
    refused += event.triggers;
    showCounts();
    setText("message", `trigger refused: ${event.reason}`);
  },
  acknowledged: (event) => {
    for (const part of rejected) if (part.part_id === event.part_id) part.acknowledged_by = event.by;
    showRejected();
  },
  warning: (event) => setText("message", `warning: ${event.text}`),
  stopped: (event) => setText("message", `stopped: ${event.reason}`),
};

function heard() {
  heardMs = Date.now();
  if (isConnected) return;
  isConnected = true;
  byId("lost").hidden = true;
}

function disconnect() {
  if (!isConnected) return;
  isConnected = false;
  showVerdict(true);
  showRejected();
  byId("trigger").disabled = true;
}

// The verdict counts as old at once; the page says why if that lasts.
function lost() {
  disconnect();
  const silentMs = Date.now() - heardMs;
  if (silentMs < PATIENCE_MS) return;
  byId("lost").textContent = `No connection to the station for ${Math.round(silentMs / 1000)} s. What is below is old.`;
  byId("lost").hidden = false;
}

function follow() {
  const stream = new EventSource("/api/v1/events");
  source = stream;
  for (const [kind, handle] of Object.entries(handlers)) {
    stream.addEventListener(kind, (message) => {
      const [run, id] = message.lastEventId.split(".");
      const wasLost = !isConnected;
      heard();
      // An event that was held back may be older than a whole state that is drawn. The events after
      // a snapshot follow it.
      if (kind === "snapshot" || run !== drawn.run || Number(id) > drawn.id) {
        drawn = { run, id: Number(id) };
        handle(JSON.parse(message.data));
      }
      if (wasLost && kind !== "snapshot") refresh(true);
    });
  }
  stream.addEventListener("error", () => {
    lost();
    if (stream.readyState !== EventSource.CLOSED) return;
    // The browser does not retry a refused stream, such as after the end of a session.
    setTimeout(() => {
      if (source === stream) follow();
    }, RETRY_MS);
  });
}

async function refresh(isWhole = false) {
  try {
    const answer = await fetch("/api/v1/state", {
      headers: { Accept: "application/json" },
      signal: AbortSignal.timeout(REFRESH_MS), // before the next one
    });
    if (answer.status === 401) window.location.reload();
    if (!answer.ok) return;
    const all = await answer.json();
    if (source === null) return;
    const wasLost = !isConnected;
    heard();
    const isBehind = lastNumber > (last?.number ?? 0);
    lastNumber = all.last?.number ?? 0;
    if (!wasLost && !isWhole && !isBehind) setText("rate", String(all.parts_per_minute));
    else if (all.run === drawn.run && all.event_id < drawn.id) refresh(true); // events overtook it
    else showSnapshot(all);
  } catch {
    lost();
  }
}

async function change(path) {
  setText("message", "");
  try {
    const answer = await fetch(path, {
      method: "POST",
      headers: { "X-CSRF-Token": csrf, Accept: "application/json" },
      signal: AbortSignal.timeout(ANSWER_MS),
    });
    if (!answer.ok) setText("message", (await answer.json()).error);
  } catch {
    lost();
  }
}

function trigger() {
  if (!byId("trigger").disabled) change("/api/v1/trigger");
}

function acknowledge() {
  const part = rejected.find((rejectedPart) => !rejectedPart.acknowledged_by);
  if (!isConnected) return;
  if (part) change(`/api/v1/parts/${encodeURIComponent(part.part_id)}/acknowledge`);
  else if (isStopped) change("/api/v1/acknowledge");
}

byId("trigger").addEventListener("click", trigger);
byId("acknowledge").addEventListener("click", acknowledge);
document.addEventListener("keydown", (event) => {
  const action = { F8: trigger, F9: acknowledge }[event.key];
  if (action === undefined || event.repeat) return;
  event.preventDefault();
  action();
});
setInterval(() => {
  showAge();
  showAges();
  updateRejectedTexts();
  if (source !== null && (!isConnected || Date.now() - heardMs > SILENCE_MS)) lost();
}, 1000);
setInterval(() => {
  if (source !== null) refresh();
}, REFRESH_MS);
// A hidden page costs the station nothing; the stream begins with the whole state.
document.addEventListener("visibilitychange", () => {
  if (!document.hidden) {
    heardMs = Date.now();
    follow();
    return;
  }
  source?.close();
  source = null;
  disconnect();
});
if (!document.hidden) follow();
