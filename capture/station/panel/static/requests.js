// Requests to the station: each ends in a time, and says whether another attempt may succeed.
export const ANSWER_MS = 10000; // of a call that the station answers at once
const PICTURES_MS = 40000; // the station itself gives up after 30 s
const FIRST_WAIT_MS = 1000;
const LONGEST_WAIT_MS = 30000;

export const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
// Before the next attempt, after so many that failed.
export const waitMs = (failures) => Math.min(FIRST_WAIT_MS * 2 ** (failures - 1), LONGEST_WAIT_MS);
export const picturesOf = (partId) => `/api/v1/parts/${encodeURIComponent(partId)}/pictures`;

// The answer to a request for pictures. An error is final if another attempt cannot succeed: the
// set was removed, or is damaged.
export async function fetched(path) {
  const answer = await fetch(path, {
    headers: { Accept: "application/json" },
    signal: AbortSignal.timeout(PICTURES_MS),
  });
  if (answer.ok) return answer;
  const error = new Error((await answer.json()).error);
  error.isFinal = answer.status < 500;
  throw error;
}

// An element with the picture of a blob.
export async function showBlob(image, blob) {
  const url = URL.createObjectURL(blob);
  try {
    image.src = url;
    await image.decode();
  } finally {
    URL.revokeObjectURL(url);
  }
  return image;
}

// Let an element that cannot load its picture try again, until the answer is final: the element
// itself does not say why it failed.
export function retrying(image) {
  let failures = 0;
  image.addEventListener("load", () => { failures = 0; });
  image.addEventListener("error", async () => {
    const url = image.src;
    failures += 1;
    await pause(waitMs(failures));
    if (image.src !== url) return;
    try {
      await (await fetched(url)).blob();
    } catch (error) {
      if (error.isFinal) return;
    }
    if (image.src === url) image.src = url;
  });
  return image;
}
