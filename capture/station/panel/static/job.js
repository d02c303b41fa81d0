// The page of a running job: asks for its progress, and loads itself again at its end.
import { ANSWER_MS } from "/static/requests.js";

const POLL_MS = 1000;
const byId = (id) => document.getElementById(id);

async function poll() {
  try {
    const answer = await fetch("/api/v1/job", {
      headers: { Accept: "application/json" },
      signal: AbortSignal.timeout(ANSWER_MS),
    });
    const job = await answer.json();
    if (!answer.ok) throw new Error(job.error);
    if (job.status !== "running") {
      location.reload();
      return;
    }
    byId("problem").hidden = true;
    byId("step").textContent = job.step;
    byId("count").textContent = job.total ? `${job.taken} of ${job.total}` : "";
    if (job.total) byId("progress").value = job.taken / job.total;
  } catch (error) {
    byId("problem").hidden = false;
    byId("problem").textContent = `No answer from the station: ${error.message}`;
  }
  setTimeout(poll, POLL_MS);
}

poll();
