// Pictures of the last part, and thumbnails of rejected ones, one request after the other: a trigger
// never waits behind them for a connection. A picture that is older than its part is blanked.
import { fetched, picturesOf, showBlob, waitMs } from "/static/requests.js";

const LEFT_OUT = "normals"; // for the page of the part
const REST_MS = 1500; // until the last part of a fast line counts as the last
const THUMBNAIL_MS = 250; // between two thumbnails
const byId = (id) => document.getElementById(id);

let lastPart = null;
let triedPart = null; // the part of the last request
let triedMs = 0;
let shownPart = null; // the part whose pictures the page shows, which may be older
let problem = "";
let failures = 0; // attempts since the last success
let isGivenUp = false; // another attempt for the last part cannot succeed
let isOld = false; // another part is in the station, or the station is silent
let isWorking = false;
let isDue = false;
let timer = null;
let thumbnailMs = 0;
const figures = new Map(); // by name of the picture
const thumbnails = new Map(); // by part

export function age(utc) {
  const seconds = Math.max(0, Math.round((Date.now() - Date.parse(utc)) / 1000));
  if (seconds < 60) return `${seconds} s`;
  const hours = Math.floor(seconds / 3600);
  return hours === 0 ? `${Math.floor(seconds / 60)} min` : `${hours} h`;
}

// The picture that says most of a part.
const mostTelling = (part) => (part.defects.length > 0 ? "defects" : "relief");
const now = () => performance.now();
const second = (part) => Math.floor(Date.parse(part.decided_utc) / 1000);

export function showPictures(part) {
  if (part === null || part.part_id === lastPart?.part_id) return;
  lastPart = part;
  isOld = false;
  isGivenUp = part.set_file === null;
  problem = isGivenUp ? "no set was captured" : "";
  showAges();
  plan();
}

export function blankPictures(isBlank) {
  isOld = isBlank;
  showAges();
}

export function showAges() {
  const isFresh = shownPart !== null && shownPart.part_id === lastPart?.part_id && !isOld;
  const made = shownPart === null ? "" : `picture of ${shownPart.part_id}, ${age(shownPart.decided_utc)} old`;
  const text = shownPart === null ? problem || "no picture" : [made, problem].filter(Boolean).join("; ");
  for (const figure of figures.values()) {
    figure.classList.toggle("blank", !isFresh);
    figure.querySelector(".age").textContent = isFresh ? "" : text;
  }
  byId("pictures").setAttribute("aria-busy", String(!isFresh && problem === "" && lastPart !== null));
}

// Returns the element of a rejected part, which stays the same.
export function thumbnail(part) {
  let entry = thumbnails.get(part.part_id);
  if (entry === undefined) {
    const image = new Image(96, 96);
    image.alt = "";
    image.className = "thumbnail";
    image.hidden = true;
    entry = { part, image, failures: 0, dueMs: part.set_file === null ? Infinity : 0 };
    thumbnails.set(part.part_id, entry);
    plan();
  }
  return entry.image;
}

export function forgetThumbnails(parts) {
  const partIds = new Set(parts.map((part) => part.part_id));
  for (const partId of thumbnails.keys()) if (!partIds.has(partId)) thumbnails.delete(partId);
}

// When the pictures of the last part are due. All pages choose the same parts, so that the station
// makes their pictures once: the first that is judged in a second, and the last before a pause.
function lastDueMs() {
  if (lastPart === null || isGivenUp || shownPart?.part_id === lastPart.part_id) return Infinity;
  if (failures > 0) return triedMs + waitMs(failures);
  return triedPart === null || second(lastPart) !== second(triedPart) ? 0 : triedMs + REST_MS;
}

function next() {
  let [dueMs, load] = [lastDueMs(), loadLast];
  for (const entry of thumbnails.values()) {
    const thumbnailDueMs = Math.max(entry.dueMs, thumbnailMs + THUMBNAIL_MS);
    if (thumbnailDueMs < dueMs) [dueMs, load] = [thumbnailDueMs, () => loadThumbnail(entry)];
  }
  return [dueMs, load];
}

// Work after the verdict is on the screen. A hidden page asks for nothing.
function plan() {
  clearTimeout(timer);
  const [dueMs] = next();
  if (isWorking || isDue || document.hidden || dueMs === Infinity) return;
  timer = setTimeout(() => {
    isDue = true;
    requestAnimationFrame(() => setTimeout(work));
  }, Math.max(0, dueMs - now()));
}

async function work() {
  isDue = false;
  const [dueMs, load] = next();
  if (!document.hidden && dueMs <= now()) {
    isWorking = true;
    await load();
    isWorking = false;
  }
  plan();
}

async function loadLast() {
  const part = lastPart;
  const isStillLast = () => part.part_id === lastPart.part_id;
  [triedPart, triedMs] = [part, now()];
  try {
    const answer = await fetched(`${picturesOf(part.part_id)}?content=yes&without=${LEFT_OUT}`);
    const { pictures } = await answer.json();
    failures = 0;
    if (!isStillLast()) return;
    const images = [];
    for (const picture of pictures) {
      if (picture.content === undefined) continue;
      const image = new Image();
      // Decoded by the browser itself.
      image.src = `data:${picture.media_type};base64,${picture.content}`;
      await image.decode();
      images.push([picture, image]);
    }
    if (!isStillLast()) return;
    [shownPart, problem] = [part, ""];
    const names = pictures.map((picture) => picture.name);
    for (const [name, figure] of figures) if (!names.includes(name)) forget(name, figure);
    for (const [picture, image] of images) place(picture, image, part);
  } catch (error) {
    failures = error.isFinal ? 0 : failures + 1;
    if (!isStillLast()) return;
    isGivenUp = Boolean(error.isFinal);
    problem = error.message;
  }
  showAges();
}

function forget(name, figure) {
  figure.remove();
  figures.delete(name);
}

function place(picture, image, part) {
  let figure = figures.get(picture.name);
  if (figure === undefined) {
    figure = document.createElement("figure");
    figure.className = "picture";
    figure.dataset.name = picture.name;
    const link = document.createElement("a");
    const old = document.createElement("span");
    const caption = document.createElement("figcaption");
    old.className = "age";
    link.append(new Image(), old);
    figure.append(link, caption);
    figures.set(picture.name, figure);
  }
  byId(picture.name === mostTelling(part) ? "main-picture" : "pictures").append(figure);
  const link = figure.querySelector("a");
  image.alt = `${picture.title} of ${part.part_id}`;
  image.title = picture.caption;
  link.href = `/parts/${encodeURIComponent(part.part_id)}`;
  link.querySelector("img").replaceWith(image);
  figure.querySelector("figcaption").textContent = picture.title;
}

async function loadThumbnail(entry) {
  thumbnailMs = now();
  try {
    const answer = await fetched(`${picturesOf(entry.part.part_id)}/${mostTelling(entry.part)}`);
    await showBlob(entry.image, await answer.blob());
    entry.image.hidden = false;
    entry.dueMs = Infinity;
  } catch (error) {
    entry.failures += 1;
    // The page of the part says why.
    entry.dueMs = error.isFinal ? Infinity : now() + waitMs(entry.failures);
  }
}

document.addEventListener("visibilitychange", plan);
