// Pictures of the last part, and thumbnails of rejected ones, one request after the other: a trigger
// never waits behind them for a connection. A picture that is older than its part is blanked.
import { asked, picturesOf, shownIn, waitMs } from "/static/requests.js";

const LEFT_OUT = "normals"; // for the page of the part
const REST_MS = 1500; // until the last part of a fast line counts as the last
const THUMBNAIL_MS = 250; // between two thumbnails
const byId = (id) => document.getElementById(id);

let wanted = null; // the last part
let tried = null; // the part whose pictures were asked for last
let triedMs = 0;
let shown = null; // the part of the pictures, which may be older
let problem = "";
let failures = 0; // attempts since the last success
let isGivenUp = false; // another attempt for the wanted part cannot succeed
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
const telling = (part) => (part.defects.length > 0 ? "defects" : "relief");
const now = () => performance.now();
const second = (part) => Math.floor(Date.parse(part.decided_utc) / 1000);

export function showPictures(part) {
  if (part === null || part.part_id === wanted?.part_id) return;
  wanted = part;
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
  const isFresh = shown !== null && shown.part_id === wanted?.part_id && !isOld;
  const made = shown === null ? "" : `picture of ${shown.part_id}, ${age(shown.decided_utc)} old`;
  const text = shown === null ? problem || "no picture" : [made, problem].filter(Boolean).join("; ");
  for (const figure of figures.values()) {
    figure.classList.toggle("blank", !isFresh);
    figure.querySelector(".age").textContent = isFresh ? "" : text;
  }
  byId("pictures").setAttribute("aria-busy", String(!isFresh && problem === "" && wanted !== null));
}

// Returns the element of a rejected part, which stays the same.
export function thumbnail(part) {
  let found = thumbnails.get(part.part_id);
  if (found === undefined) {
    const image = new Image(96, 96);
    image.alt = "";
    image.className = "thumbnail";
    image.hidden = true;
    found = { part, image, failures: 0, dueMs: part.set_file === null ? Infinity : 0 };
    thumbnails.set(part.part_id, found);
    plan();
  }
  return found.image;
}

export function forgetThumbnails(parts) {
  const kept = new Set(parts.map((part) => part.part_id));
  for (const partId of thumbnails.keys()) if (!kept.has(partId)) thumbnails.delete(partId);
}

// When the pictures of the last part are due. All pages choose the same parts, so that the station
// makes their pictures once: the first that is judged in a second, and the last before a pause.
function lastDueMs() {
  if (wanted === null || isGivenUp || shown?.part_id === wanted.part_id) return Infinity;
  if (failures > 0) return triedMs + waitMs(failures);
  return tried === null || second(wanted) !== second(tried) ? 0 : triedMs + REST_MS;
}

function next() {
  let [dueMs, load] = [lastDueMs(), loadLast];
  for (const each of thumbnails.values()) {
    const thumbnailDueMs = Math.max(each.dueMs, thumbnailMs + THUMBNAIL_MS);
    if (thumbnailDueMs < dueMs) [dueMs, load] = [thumbnailDueMs, () => loadThumbnail(each)];
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
  const part = wanted;
  const isWanted = () => part.part_id === wanted.part_id;
  [tried, triedMs] = [part, now()];
  try {
    const answer = await asked(`${picturesOf(part.part_id)}?content=yes&without=${LEFT_OUT}`);
    const about = await answer.json();
    failures = 0;
    if (!isWanted()) return;
    const images = [];
    for (const each of about.pictures) {
      if (each.content === undefined) continue;
      const image = new Image();
      image.src = `data:${each.media_type};base64,${each.content}`; // decoded by the browser itself
      await image.decode();
      images.push([each, image]);
    }
    if (!isWanted()) return;
    [shown, problem] = [part, ""];
    const names = about.pictures.map((each) => each.name);
    for (const [name, figure] of figures) if (!names.includes(name)) forget(name, figure);
    for (const [each, image] of images) place(each, image, part);
  } catch (error) {
    failures = error.isFinal ? 0 : failures + 1;
    if (!isWanted()) return;
    isGivenUp = Boolean(error.isFinal);
    problem = error.message;
  }
  showAges();
}

function forget(name, figure) {
  figure.remove();
  figures.delete(name);
}

function place(about, image, part) {
  let figure = figures.get(about.name);
  if (figure === undefined) {
    figure = document.createElement("figure");
    figure.className = "picture";
    figure.dataset.name = about.name;
    const link = document.createElement("a");
    const old = document.createElement("span");
    const caption = document.createElement("figcaption");
    old.className = "age";
    link.append(new Image(), old);
    figure.append(link, caption);
    figures.set(about.name, figure);
  }
  byId(about.name === telling(part) ? "main-picture" : "pictures").append(figure);
  const link = figure.querySelector("a");
  image.alt = `${about.title} of ${part.part_id}`;
  image.title = about.caption;
  link.href = `/parts/${encodeURIComponent(part.part_id)}`;
  link.querySelector("img").replaceWith(image);
  figure.querySelector("figcaption").textContent = about.title;
}

async function loadThumbnail(each) {
  thumbnailMs = now();
  try {
    const answer = await asked(`${picturesOf(each.part.part_id)}/${telling(each.part)}`);
    await shownIn(each.image, await answer.blob());
    each.image.hidden = false;
    each.dueMs = Infinity;
  } catch (error) {
    each.failures += 1;
    each.dueMs = error.isFinal ? Infinity : now() + waitMs(each.failures); // its page says why
  }
}

document.addEventListener("visibilitychange", plan);
