// What becomes of a stored view when the heap grows.

import { byId, fill, metres } from "./page.mjs";
import { Recording } from "./recording.mjs";

/** So many MjData grow any heap. */
const MOST_DATA = 100;

/**
 * Store a view and a copy, create further MjData until the heap grows, and look at both again.
 * @param {import("@mujoco/mujoco").MainModule} mujoco an engine that nothing else uses
 * @param {string} xml models/cartpole.xml
 */
export function growHeap(mujoco, xml) {
  const recording = new Recording(mujoco, xml);
  while (!recording.isComplete) recording.step();
  const { model, tip } = recording;
  const view = recording.views[recording.steps - 1];
  const copy = recording.copies[recording.steps - 1];
  const look = () => ({
    bytes: tip.xpos.buffer.byteLength,
    view: { length: view.length, x: view[0] },
    copy: { length: copy.length, x: copy[0] },
  });
  const before = look();
  let created = 0;
  while (tip.xpos.buffer.byteLength === before.bytes && created < MOST_DATA) {
    new mujoco.MjData(model);
    created++;
  }
  return { created, before, after: look() };
}

/**
 * Show what growHeap returned.
 * @param {ReturnType<typeof growHeap>} growth
 */
export function showGrowth({ created, before, after }) {
  const megabytes = (/** @type {number} */ bytes) => `${(bytes / 1e6).toFixed(1)} MB`;
  const described = (/** @type {{length: number, x: number | undefined}} */ { length, x }) =>
    `length ${length}, x ${metres(x)}`;
  fill(byId("growth"), [
    ["stored view", described(before.view), described(after.view)],
    ["stored copy", described(before.copy), described(after.copy)],
  ]);
  const number = created === 1 ? "One more MjData" : `${created} more MjData`;
  byId("growth-summary").textContent =
    before.bytes === after.bytes
      ? `${number}: the heap did not grow, so the view is still valid.`
      : `${number}: the heap grew from ${megabytes(before.bytes)} to ${megabytes(after.bytes)}.` +
        (after.view.length ? "" : " The stored view is invalid: its length is 0.");
  byId("growth-result").hidden = false;
}
