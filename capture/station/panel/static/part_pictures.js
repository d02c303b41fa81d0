// Pictures of the last part, and thumbnails of rejected ones, one request after the other: a trigger
// never waits behind them for a connection. A picture that is older than its part is blanked.
const LEFT_OUT = ["normals"]; // for the page of the part
const PAUSE_MS = 1000; // between two parts of a fast line; people do not see more
const byId = (id) => document.getElementById(id);

let wanted = null; // the last part
let shown = null; // the part of the pictures, which may be older
let problem = "";
let isOld = false; // another part is in the station, or the station is silent
let isDue = false;
let isWorking = false;
let startedMs = 0;
const figures = new Map(); // by name of the picture
const thumbnails = new Map(); // by part
let waiting = []; // thumbnails to load

export function age(utc) {
  const seconds = Math.max(0, Math.round((Date.now() - Date.parse(utc)) / 1000));
  if (seconds < 60) return `${seconds} s`;
  const hours = Math.floor(seconds / 3600);
  return hours === 0 ? `${Math.floor(seconds / 60)} min` : `${hours} h`;
}

const partPath = (partId) => `/api/v1/parts/${encodeURIComponent(partId)}/pictures`;
// The picture that says most of a part.
const telling = (part) => (part.defects.length > 0 ? "defects" : "relief");
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// After the verdict is on the screen; in a hidden page not before it is seen.
function soon() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => setTimeout(() => {
    isDue = false;
    work();
  }));
}

export function showPictures(part) {
  if (part === null || part.part_id === wanted?.part_id) return;
  wanted = part;
  isOld = false;
  problem = part.set_file === null ? "no set was captured" : "";
  showAges();
  soon();
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

export function thumbnail(part) {
  let image = thumbnails.get(part.part_id);
  if (image === undefined) {
    image = new Image(96, 96);
    image.alt = "";
    image.className = "thumbnail";
    image.hidden = true;
    thumbnails.set(part.part_id, image);
    if (part.set_file !== null) waiting.push([part.part_id, telling(part)]);
    soon();
  }
  return image;
}

export function forgetThumbnails(parts) {
  const kept = new Set(parts.map((part) => part.part_id));
  for (const partId of thumbnails.keys()) if (!kept.has(partId)) thumbnails.delete(partId);
  waiting = waiting.filter(([partId]) => kept.has(partId));
}

async function work() {
  if (isWorking) return;
  isWorking = true;
  try {
    for (;;) {
      if (wanted !== null && problem === "" && shown?.part_id !== wanted.part_id) await loadLast();
      else if (waiting.length > 0) await loadThumbnail(...waiting.shift());
      else return;
    }
  } finally {
    isWorking = false;
  }
}

async function loadLast() {
  await pause(Math.max(0, startedMs + PAUSE_MS - Date.now()));
  startedMs = Date.now();
  const part = wanted;
  const isWanted = () => part.part_id === wanted.part_id;
  try {
    const answer = await fetch(partPath(part.part_id), { headers: { Accept: "application/json" } });
    const about = await answer.json();
    if (answer.status === 503) return; // tried again after the pause
    if (!answer.ok) throw new Error(about.error);
    const images = [];
    for (const each of about.pictures.filter((picture) => !LEFT_OUT.includes(picture.name))) {
      if (!isWanted()) return;
      images.push([each, await loaded(each.url)]);
    }
    if (!isWanted()) return;
    shown = part;
    const names = about.pictures.map((each) => each.name);
    for (const [name, figure] of figures) if (!names.includes(name)) forget(name, figure);
    for (const [each, image] of images) place(each, image, part);
  } catch (error) {
    if (isWanted()) problem = error.message;
  }
  showAges();
}

function forget(name, figure) {
  figure.remove();
  figures.delete(name);
}

async function loaded(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  return image;
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

async function loadThumbnail(partId, name) {
  const image = thumbnails.get(partId);
  image.src = `${partPath(partId)}/${name}`;
  try {
    await image.decode();
    image.hidden = false;
  } catch {
    image.hidden = true; // its page says why
  }
}
