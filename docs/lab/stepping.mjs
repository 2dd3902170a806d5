// Steps per second of one model.

import { LabError, messageOf } from "./engine.mjs";

/** Steps from a start, after which the start is restored: every block does the same work. */
export const NSTEP = 100;
/** Simulated seconds before the start, as mjbench lets a model settle: with a keyframe, and without one. */
const SETTLE_S = { keyframe: 0.1, defaults: 1 };
export const WARM_UP_MS = 1000;
export const BLOCKS = 20;

/**
 * @typedef {object} Speed
 * @property {number[]} stepsPerSecond of each block
 * @property {number} contacts of a step, in the mean
 */

/**
 * Measure a model: warm up, then time blocks of whole runs.
 * @param {import("@mujoco/mujoco").MainModule} mujoco
 * @param {string} xml MJCF that includes no other file
 * @param {{now: () => number, blockMs: number, onBlock: (done: number) => void}} options `now` in ms
 * @returns {Speed}
 * @throws {LabError} the model does not compile, or diverges
 */
export function measure(mujoco, xml, { now, blockMs, onBlock }) {
  const run = prepare(mujoco, xml);
  try {
    repeat(run.steps, now, WARM_UP_MS / 2); // the browser compiles what is hot
    const runsPerBlock = Math.ceil(blockMs / repeat(run.steps, now, WARM_UP_MS / 2));
    run.check();
    const stepsPerSecond = [];
    for (let block = 0; block < BLOCKS; block++) {
      const begin = now();
      for (let i = 0; i < runsPerBlock; i++) run.steps();
      stepsPerSecond.push((1000 * runsPerBlock * NSTEP) / (now() - begin));
      onBlock(block + 1);
    }
    return { stepsPerSecond, contacts: run.contacts() };
  } finally {
    run.delete();
  }
}

/**
 * Repeat some work for a while; return how long it takes, in ms.
 * @param {() => void} work
 * @param {() => number} now in ms
 * @param {number} forMs
 * @returns {number}
 */
function repeat(work, now, forMs) {
  const begin = now();
  let times = 0;
  for (; now() - begin < forMs; times++) work();
  return (now() - begin) / times;
}

/**
 * @param {import("@mujoco/mujoco").MainModule} mujoco
 * @param {string} xml
 */
function prepare(mujoco, xml) {
  const [model, data] = compile(mujoco, xml);
  if (model.nkey) mujoco.mj_resetDataKeyframe(model, data, 0);
  const settling = Math.round(
    (model.nkey ? SETTLE_S.keyframe : SETTLE_S.defaults) / model.opt.timestep,
  );
  for (let i = 0; i < settling; i++) mujoco.mj_step(model, data);
  const spec = mujoco.mjtState.mjSTATE_INTEGRATION.value;
  const state = new mujoco.DoubleBuffer(mujoco.mj_stateSize(model, spec));
  mujoco.mj_getState(model, data, state, spec);
  const start = Array.from(state.GetView());
  state.delete();
  const end = data.time + NSTEP * model.opt.timestep;
  // which bodies sleep is no part of the state
  const hasSleep = (model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP.value) !== 0;
  const restore = () => {
    if (hasSleep) mujoco.mj_resetData(model, data);
    mujoco.mj_setState(model, data, start, spec);
  };
  return {
    steps() {
      restore();
      for (let i = 0; i < NSTEP; i++) mujoco.mj_step(model, data);
    },
    contacts() {
      let sum = 0;
      restore();
      for (let i = 0; i < NSTEP; i++) {
        mujoco.mj_step(model, data);
        sum += data.ncon;
      }
      return sum / NSTEP;
    },
    check() {
      // MuJoCo resets a simulation that diverges, and its time with it
      if (Math.abs(data.time - end) > model.opt.timestep / 2) {
        throw new LabError("The simulation diverges: its speed would mean nothing.");
      }
    },
    delete() {
      data.delete();
      model.delete();
    },
  };
}

/**
 * @param {import("@mujoco/mujoco").MainModule} mujoco
 * @param {string} xml
 * @returns {[import("@mujoco/mujoco").MjModel, import("@mujoco/mujoco").MjData]}
 */
function compile(mujoco, xml) {
  let model;
  try {
    model = mujoco.MjModel.from_xml_string(xml);
    return [model, new mujoco.MjData(model)];
  } catch (error) {
    model?.delete();
    throw new LabError(`MuJoCo cannot load this model: ${messageOf(error)}`);
  }
}
