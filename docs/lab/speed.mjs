// The table of speeds, and the worker that measures.

import { LabError } from "./engine.mjs";
import { fill } from "./page.mjs";
import { quantile } from "./statistics.mjs";

/**
 * A measured speed.
 * @typedef {object} Figure
 * @property {string} model
 * @property {number} stepsPerSecond the median
 * @property {string} note its spread
 */

/**
 * Return the figure of some blocks.
 * @param {string} model
 * @param {readonly number[]} stepsPerSecond of each block
 * @returns {Figure}
 */
export function figureOf(model, stepsPerSecond) {
  const [low, median, high] = [0.25, 0.5, 0.75].map((share) => quantile(stepsPerSecond, share));
  const note = `middle half ${shown(low)} to ${shown(high)}`;
  return { model, stepsPerSecond: median, note };
}

/**
 * Compare two models: unlike speeds, this ratio may be compared between machines.
 * @param {readonly Figure[]} figures
 * @param {string} slow model
 * @param {string} fast model
 * @returns {string} a sentence; empty unless both were measured
 */
export function shape(figures, slow, fast) {
  const speeds = new Map(figures.map(({ model, stepsPerSecond }) => [model, stepsPerSecond]));
  const ratio = (speeds.get(fast) ?? NaN) / (speeds.get(slow) ?? NaN);
  return ratio ? `Steps of ${fast} in the time of one of ${slow}: ${ratio.toFixed(1)}.` : "";
}

/**
 * Return a number of steps per second with three digits that count.
 * @param {number} value
 * @returns {string}
 */
export function shown(value) {
  return Number(value.toPrecision(3)).toLocaleString("en", { maximumFractionDigits: 2 });
}

/** Measures models in a worker; one measurement at a time. */
export class Measurement {
  /** @param {string} program of the worker, after that of the engine */
  constructor(program) {
    this.url = URL.createObjectURL(new Blob([program], { type: "text/javascript" }));
    /** @type {Worker | undefined} */
    this.worker = undefined;
  }

  get isRunning() {
    return this.worker !== undefined;
  }

  /**
   * Measure; return when all is done. `onAnswer` gets every other answer as it comes.
   * @param {import("./worker.mjs").MeasureRequest} request
   * @param {(answer: import("./worker.mjs").MeasureAnswer) => void} onAnswer
   * @returns {Promise<{tickMs: number, blockMs: number} | undefined>} undefined where it was cancelled
   * @throws {LabError} the worker cannot start, or MuJoCo in it
   */
  start(request, onAnswer) {
    return new Promise((resolve, reject) => {
      this.onCancel = () => resolve(undefined);
      const worker = new Worker(this.url);
      this.worker = worker;
      worker.onmessage = ({ data: answer }) => {
        if (answer.type === "end") resolve(answer);
        else if (answer.type === "failed") reject(new LabError(answer.message));
        else onAnswer(answer);
      };
      worker.onerror = (event) => {
        event.preventDefault();
        reject(
          new LabError(
            `The measurement stopped: ${event.message || "the browser refused to start it"}.`,
          ),
        );
      };
      worker.postMessage(request);
    }).finally(() => this.cancel());
  }

  /** Stop, if a measurement is running. */
  cancel() {
    this.worker?.terminate();
    this.worker = undefined;
    this.onCancel?.();
  }
}

/**
 * Write the table: each model, how fast, and a bar; the fastest has the longest.
 * @param {Element} parent
 * @param {readonly Figure[]} figures
 */
export function writeTable(parent, figures) {
  const fastest = Math.max(...figures.map((figure) => figure.stepsPerSecond));
  const table = document.createElement("table");
  table.className = "speeds";
  const head = table.createTHead().insertRow();
  for (const title of ["model", "steps per second", "note"]) {
    const cell = document.createElement("th");
    cell.scope = "col";
    cell.textContent = title;
    head.append(cell);
  }
  fill(
    table,
    figures.map(({ model, stepsPerSecond, note }) => [model, shown(stepsPerSecond), note]),
  );
  figures.forEach(({ stepsPerSecond }, i) => {
    table.tBodies[0].rows[i].style.setProperty("--share", String(stepsPerSecond / fastest));
  });
  parent.append(table);
}
