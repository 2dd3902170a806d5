// The part of the page that measures this browser.

import { BLOCKS, NSTEP } from "./stepping.mjs";
import { announce, byId, guarded } from "./page.mjs";
import { figureOf, Measurement, shape, shown, writeTable } from "./speed.mjs";

export class Measuring {
  /**
   * @param {import("./engine.mjs").Engine} engine
   * @param {string} program of the worker
   * @param {readonly {name: string, xml: string}[]} models
   */
  constructor(engine, program, models) {
    this.engine = engine;
    this.models = models;
    this.measurement = new Measurement(`${engine.workerScript}\n${program}`);
    /** @type {Map<string, import("./speed.mjs").Figure>} */
    this.measured = new Map();
    /** @type {Map<string, number>} contacts of a step */
    this.contacts = new Map();
    /** @type {Map<string, string>} why models were not measured */
    this.refused = new Map();
    /** called before a measurement, which nothing is to disturb */
    this.onStart = () => {};
    byId("measure").addEventListener(
      "click",
      guarded(() => this.toggle()),
    );
    for (const id of ["measure", "own"])
      /** @type {HTMLButtonElement} */ (byId(id)).disabled = false;
    this.draw();
  }

  /** Measure, or cancel what is running. */
  async toggle() {
    if (this.measurement.isRunning) {
      this.measurement.cancel();
      return;
    }
    const models = [...this.models, ...(await ownModels())];
    if (this.measurement.isRunning) return; // a second click, while the file was read
    this.onStart();
    this.measured.clear();
    this.contacts.clear();
    this.refused.clear();
    let wasHidden = document.hidden;
    const onHidden = () => (wasHidden ||= document.hidden);
    document.addEventListener("visibilitychange", onHidden);
    this.showProgress(0);
    this.draw();
    announce("Measuring.");
    try {
      const { compiled } = this.engine;
      const end = await this.measurement.start({ compiled, models }, (answer) => {
        if (answer.type === "block") this.showProgress(answer.share);
        if (answer.type === "speed") {
          this.measured.set(answer.model, figureOf(answer.model, answer.stepsPerSecond));
          this.contacts.set(answer.model, answer.contacts);
        }
        if (answer.type === "refused") this.refused.set(answer.model, answer.message);
        if (answer.type !== "block") this.draw();
      });
      byId("conditions").textContent = end ? this.conditions(end, wasHidden) : "Cancelled.";
      announce(end ? `Measured. ${this.summary}` : "Cancelled.");
    } finally {
      document.removeEventListener("visibilitychange", onHidden);
      this.showProgress(null);
    }
  }

  /** @param {number | null} share of the work that is done; null where nothing runs */
  showProgress(share) {
    const progress = /** @type {HTMLProgressElement} */ (byId("progress"));
    progress.hidden = share === null;
    progress.value = share ?? 0;
    byId("measure").textContent = share === null ? "Measure" : "Cancel";
  }

  draw() {
    const parent = byId("speeds");
    parent.replaceChildren();
    const figures = [...this.measured.values()];
    if (figures.length) writeTable(parent, figures);
    const [fast, slow] = this.models.map(({ name }) => name);
    byId("shape").textContent = slow ? shape(figures, slow, fast) : "";
    const refusals = [...this.refused].map(([name, message]) => {
      const item = document.createElement("p");
      item.textContent = `${name}: ${message}`;
      return item;
    });
    byId("refused").replaceChildren(...refusals);
    byId("refused").hidden = !refusals.length;
  }

  /** @returns {string} the figures of this browser in a sentence */
  get summary() {
    const speeds = [...this.measured.values()].map(
      ({ model, stepsPerSecond }) => `${model}: ${shown(stepsPerSecond)} steps per second.`,
    );
    return [...speeds, ...[...this.refused].map(([name, message]) => `${name}: ${message}`)].join(
      " ",
    );
  }

  /**
   * Say how it was measured.
   * @param {{tickMs: number, blockMs: number}} end
   * @param {boolean} wasHidden
   * @returns {string}
   */
  conditions({ tickMs, blockMs }, wasHidden) {
    const tick = Number(tickMs.toPrecision(1));
    const error = (100 * tickMs) / blockMs;
    const models = [...this.contacts].map(([model, contacts]) => `${model} ${contacts.toFixed(1)}`);
    return (
      `The median of ${BLOCKS} blocks of about ${Math.round(blockMs)} ms, after a second of warm-up. The ` +
      `clock ticks every ${tick} ms, which is at most ${error < 0.1 ? "0.1" : error.toFixed(1)} % of a block. ` +
      `Blocks repeat ${NSTEP} steps from a settled state, without control. Contacts of a step: ${models.join("; ")}.` +
      (wasHidden
        ? " This page was in the background for a while, where browsers slow down: measure again."
        : "")
    );
  }
}

/** @returns {Promise<{name: string, xml: string}[]>} the model that the user chose, if any */
async function ownModels() {
  const { files } = /** @type {HTMLInputElement} */ (byId("own"));
  const file = files?.[0];
  return file ? [{ name: file.name, xml: await file.text() }] : [];
}
