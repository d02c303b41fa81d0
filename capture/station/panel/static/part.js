// The page of a part: its pictures, a light that the mouse moves, and outlines of its defects.
import { Relit } from "/static/relit.js";
import { fetched, pause, picturesOf, retrying, waitMs } from "/static/requests.js";

const STEP_DEG = 5; // of an arrow key
const byId = (id) => document.getElementById(id);
const holder = byId("pictures");
const canvas = byId("relit");
let relit = null;
let defects = [];
let isDue = false;

if (matchMedia("(max-width: 40rem)").matches) {
  for (const section of document.querySelectorAll(".fold")) section.open = section.querySelector(".problem") !== null;
}

async function loaded(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  return image;
}

// The list of the pictures, their addresses by name, and the two that the relit view is computed from.
async function loadPictures(partId) {
  const listing = await (await fetched(`${picturesOf(partId)}?size=large`)).json();
  const url = Object.fromEntries(listing.pictures.map((picture) => [picture.name, picture.url]));
  return [listing, url, await loaded(url.slopes), await loaded(url.albedo)];
}

async function loadPicturesWithRetries(partId) {
  for (let failures = 1; ; failures += 1) {
    try {
      return await loadPictures(partId);
    } catch (error) {
      byId("no-pictures").textContent = `No pictures: ${error.message}`;
      if (error.isFinal) return null;
    }
    await pause(waitMs(failures));
  }
}

function drawSoon() {
  if (isDue || relit === null) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    relit.draw();
    const tilt = ((Math.round(relit.tiltDeg) % 360) + 360) % 360;
    byId("light").textContent = `Light at tilt ${tilt}°, slant ${Math.round(relit.slantDeg)}°`;
  });
}

function view(title, caption, tileUrl, url) {
  const button = document.createElement("button");
  const label = document.createElement("span");
  button.type = "button";
  button.dataset.view = title;
  button.setAttribute("aria-pressed", "false");
  label.textContent = title;
  const tile = retrying(new Image());
  tile.alt = "";
  tile.loading = "lazy";
  tile.src = tileUrl;
  button.append(tile, label);
  button.addEventListener("click", () => {
    for (const other of byId("views").children) other.setAttribute("aria-pressed", String(other === button));
    canvas.hidden = url !== null;
    byId("shown").hidden = url === null;
    if (url !== null) {
      byId("shown").src = url;
      byId("shown").alt = `${title} of the part`;
    }
    byId("caption").textContent = caption;
  });
  return button;
}

function showDefect(number) {
  for (const button of document.querySelectorAll("#defects button")) {
    const isChosen = Number(button.dataset.defect) === number;
    button.setAttribute("aria-pressed", String(isChosen && button.getAttribute("aria-pressed") === "false"));
  }
  const pressed = document.querySelector('#defects button[aria-pressed="true"]');
  const corners = pressed === null ? [] : [defects[Number(pressed.dataset.defect)].outline];
  byId("outlines").replaceChildren(...corners.flatMap((outline) => ["under", "line"].map((kind) => {
    const polygon = document.createElementNS("http://www.w3.org/2000/svg", "polygon");
    polygon.setAttribute("class", kind);
    polygon.setAttribute("points", outline.map(([x, y]) => `${x + 0.5},${y + 0.5}`).join(" "));
    return polygon;
  })));
}

// The defect at a point of the picture, in pixels of the light images; -1 without one.
function defectAt(x, y) {
  return defects.findIndex((box) => x >= box.column && x < box.column + box.width
    && y >= box.row && y < box.row + box.height);
}

// The position of the pointer, as shares of the picture.
function positionOf(event) {
  const box = byId("stage").getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height, box];
}

function listen(widthPx, heightPx) {
  for (const kind of ["pointermove", "pointerdown"]) {
    canvas.addEventListener(kind, (event) => {
      const [across, down, box] = positionOf(event);
      const half = Math.min(box.width, box.height) / 2;
      relit.aim(((across - 0.5) * box.width) / half, ((0.5 - down) * box.height) / half);
      drawSoon();
    });
  }
  canvas.addEventListener("keydown", (event) => {
    const [tilt, slant] = { ArrowLeft: [STEP_DEG, 0], ArrowRight: [-STEP_DEG, 0], ArrowUp: [0, -STEP_DEG], ArrowDown: [0, STEP_DEG] }[event.key] ?? [0, 0];
    if (tilt === 0 && slant === 0) return;
    event.preventDefault();
    relit.turn(tilt, slant);
    drawSoon();
  });
  byId("stage").addEventListener("click", (event) => {
    const [across, down] = positionOf(event);
    const number = defectAt(across * widthPx, down * heightPx);
    if (number >= 0) showDefect(number);
  });
  byId("grey").addEventListener("change", (event) => {
    relit.isGrey = event.target.checked;
    drawSoon();
  });
  byId("slopes").addEventListener("input", (event) => {
    relit.times = Number(event.target.value);
    byId("times").textContent = `${relit.times} times`;
    drawSoon();
  });
  for (const button of document.querySelectorAll("#defects button")) {
    button.addEventListener("click", () => showDefect(Number(button.dataset.defect)));
  }
}

async function show(partId) {
  const loadedPictures = await loadPicturesWithRetries(partId);
  if (loadedPictures === null) return;
  const [listing, url, slopes, albedo] = loadedPictures;
  defects = listing.defects;
  relit = new Relit(canvas, slopes, albedo);
  byId("outlines").setAttribute("viewBox", `0 0 ${listing.width_px} ${listing.height_px}`);
  byId("stage").style.setProperty("--aspect", String(listing.width_px / listing.height_px));
  const first = view("relit", "Move the mouse over the picture, or press the arrow keys, to move the light. Press on a defect to outline it.", url.relief, null);
  const others = listing.pictures.filter((picture) => picture.name !== "slopes");
  byId("views").replaceChildren(first, ...others.map((picture) => view(picture.title, picture.caption, picture.url, picture.url)));
  byId("notes").replaceChildren(...listing.notes.map((note) => {
    const item = document.createElement("li");
    item.textContent = note;
    return item;
  }));
  listen(listing.width_px, listing.height_px);
  byId("no-pictures").hidden = true;
  holder.classList.remove("without");
  first.click();
  drawSoon();
}

retrying(byId("shown"));
if (holder.dataset.part) show(holder.dataset.part);
