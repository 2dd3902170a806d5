// The program of the worker that measures: the page stays responsive, and its drawing costs no block any time.

import { blockLength, clockTick } from "./clock.mjs";
import { instantiate, messageOf } from "./engine.mjs";
import { BLOCKS, measure } from "./stepping.mjs";

/**
 * @typedef {object} MeasureRequest
 * @property {WebAssembly.Module} compiled
 * @property {readonly {name: string, xml: string}[]} models
 */

/**
 * What the worker answers: a message for every block, one for each model, and one at the end.
 * @typedef {{type: "block", model: string, share: number}
 *   | {type: "speed", model: string, stepsPerSecond: number[], contacts: number}
 *   | {type: "refused", model: string, message: string}
 *   | {type: "end", tickMs: number, blockMs: number}
 *   | {type: "failed", message: string}} MeasureAnswer
 */

/**
 * Answer the request of the page.
 * @param {(options: object) => Promise<import("@mujoco/mujoco").MainModule>} load what mujoco.js exports
 */
export function serve(load) {
  const answer = (/** @type {MeasureAnswer} */ message) => postMessage(message);
  const now = () => performance.now();
  onmessage = async (
    /** @type {MessageEvent<MeasureRequest>} */ { data: { compiled, models } },
  ) => {
    try {
      const mujoco = await instantiate(load, compiled);
      const tickMs = clockTick(now);
      const blockMs = blockLength(tickMs);
      models.forEach(({ name, xml }, i) => {
        const onBlock = (/** @type {number} */ done) =>
          answer({ type: "block", model: name, share: (i + done / BLOCKS) / models.length });
        try {
          answer({
            type: "speed",
            model: name,
            ...measure(mujoco, xml, { now, blockMs, onBlock }),
          });
        } catch (error) {
          answer({ type: "refused", model: name, message: messageOf(error) });
        }
      });
      answer({ type: "end", tickMs, blockMs });
    } catch (error) {
      answer({ type: "failed", message: messageOf(error) });
    }
  };
}
