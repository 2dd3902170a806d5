// Starts the parts of the page.

import { Engine } from "./engine.mjs";
import { Fall } from "./fall.mjs";
import { growHeap, showGrowth } from "./growth.mjs";
import { Measuring } from "./measuring.mjs";
import { Naming } from "./naming.mjs";
import { byId, guarded, showFailure } from "./page.mjs";

const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;

/** Start everything; what fails shows on the page. */
export const start = guarded(async () => {
  addEventListener("error", (event) => showFailure(event.error ?? event.message));
  addEventListener("unhandledrejection", (event) => showFailure(event.reason));
  followTheme();
  const models = JSON.parse(text("models"));
  const cartpole = models.find((/** @type {{name: string}} */ { name }) => name === "cartpole").xml;
  const engine = await Engine.load(text("engine-script"), text("engine-wasm"));
  const mujoco = await engine.start();
  const fall = new Fall(mujoco, cartpole);
  byId("loading").hidden = true;
  if (!isStill) fall.play();
  const naming = new Naming(await engine.start(), cartpole);
  const grow = /** @type {HTMLButtonElement} */ (byId("grow"));
  grow.addEventListener(
    "click",
    guarded(async () => showGrowth(growHeap(await engine.start(), cartpole))),
  );
  grow.disabled = false;
  const measuring = new Measuring(engine, text("worker"), models);
  measuring.onStart = () => fall.playback.isPlaying && fall.pause();
  followKeys({
    " ": fall.actions.play,
    s: fall.actions.step,
    e: fall.actions.end,
    r: fall.actions.restart,
    b: () => naming.ball.click(),
    n: () => byId(naming.byName.checked ? "by-index" : "by-name").click(),
    m: () => byId("measure").click(),
    d: () => byId("theme").click(),
  });
  Object.assign(globalThis, { lab: { mujoco, fall, naming, measuring } }); // to look at in the console
});

/**
 * Return what the page carries in a script element.
 * @param {string} id
 * @returns {string}
 */
function text(id) {
  return byId(id).textContent ?? "";
}

/** Follow the system's colours until the button says otherwise. */
function followTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);
  const update = () => byId("theme").setAttribute("aria-pressed", String(isDark()));
  byId("theme").addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    update();
  });
  dark.addEventListener("change", update);
  update();
}

/**
 * Call functions by single keys, unless the reader turned that off, or is typing.
 * @param {Record<string, () => unknown>} actions
 */
function followKeys(actions) {
  const isOn = /** @type {HTMLInputElement} */ (byId("shortcuts"));
  addEventListener("keydown", (event) => {
    const target = /** @type {Element} */ (event.target);
    const action = actions[event.key.toLowerCase()];
    if (!action || !isOn.checked || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.repeat && event.key !== "s") return;
    if (target.closest("select, textarea, input:not([type=checkbox], [type=radio], [type=range])"))
      return;
    // the space bar presses what has the focus
    if (event.key === " " && target.closest("button, summary, input, a")) return;
    event.preventDefault();
    guarded(action)();
  });
}
