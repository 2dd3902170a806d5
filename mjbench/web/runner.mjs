/**
 * Steps a WebAssembly build of MuJoCo under Node, as `mjbench web` asks.
 *
 *     node runner.mjs DESCRIPTOR
 *
 * DESCRIPTOR is a connection to the parent. Each message is JSON, after its length in four bytes.
 * Of a request, `action` names a function of ACTIONS, the rest is its argument; the answer is
 * `{"value": …}`, or `{"error": "…"}`. Arrays are in files, as float64 of this processor, row by
 * row. The end of the connection ends the process. Python's side of this is node_process.py.
 */

import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

/**
 * A workload in arrays.
 * @typedef {object} Workload
 * @property {Float64Array[]} starts of each simulation, a row of mjSTATE_INTEGRATION
 * @property {Float64Array[][]} controls of each simulation, one row after the other
 * @property {number} hold steps for which each control is held
 * @property {boolean} hasReset whether the state leaves something out, which a reset sets
 */

/** The module of MuJoCo, once it is instantiated. @type {any} */
let mujoco;
/** The compiled model, and the MjData that steps. @type {any} */
let model, data;
/** What a block steps. @type {Workload} */
let workload;
/** A state on the heap: mj_getState writes to nothing else. @type {any} */
let stateBuffer;
/** Final states of the last block, one row after the other. @type {Float64Array} */
let finalStates;
/** The bits of mjSTATE_INTEGRATION. */
let integration = 0;

const ACTIONS = { instantiate, load, record, prepare, block, save, memory };

/** Import and instantiate a build. */
async function instantiate({ script, nthread }) {
  // Node has it since version 21; the build with threads reads it, and starts as many workers
  globalThis.navigator ??= /** @type {any} */ ({ hardwareConcurrency: nthread });
  const begin = performance.now();
  const { default: loadMujoco } = await import(pathToFileURL(script).href);
  const imported = performance.now();
  // what the engine prints goes to the log that standard error is
  mujoco = await loadMujoco({ print: console.error, printErr: console.error });
  const ready = performance.now();
  return {
    version: mujoco.mj_versionString(),
    import_ms: imported - begin,
    instantiate_ms: ready - imported,
    heap_bytes: heapBytes(),
    has_threadpool: 'mju_threadpool' in mujoco,
  };
}

/**
 * Compile a model from files, which are put into the module's own file system first.
 * @param {{ files: [string, string][], model: string, engine_threads: number }} request pairs of a
 *   path there and a file here, the path of the model, and threads of the engine's own pool or 0
 */
function load(request) {
  for (const [there, here] of request.files) {
    mujoco.FS.mkdirTree(path.posix.dirname(there));
    mujoco.FS.writeFile(there, fs.readFileSync(here));
  }
  const begin = performance.now();
  model = request.model.endsWith('.mjb')
    ? mujoco.MjModel.from_binary_path(request.model, new mujoco.MjVFS())
    : mujoco.MjModel.from_xml_path(request.model);
  const compile_ms = performance.now() - begin;
  data = new mujoco.MjData(model);
  if (request.engine_threads) mujoco.mju_threadpool(data, request.engine_threads);
  integration = mujoco.mjtState.mjSTATE_INTEGRATION.value;
  stateBuffer = new mujoco.DoubleBuffer(mujoco.mj_stateSize(model, integration));
  return compile_ms;
}

/** Step a workload once, and write the states after some numbers of steps to a file. */
function record(request) {
  const { starts, controls, hold } = readWorkload(request);
  const nstate = starts[0].length;
  const wanted = new Map(request.points.map((step, index) => [step, index]));
  const states = new Float64Array(wanted.size * starts.length * nstate);
  const keep = (step, i) => {
    if (wanted.has(step)) getState(states, wanted.get(step) * starts.length + i);
  };
  starts.forEach((start, i) => {
    mujoco.mj_resetData(model, data);
    mujoco.mj_setState(model, data, start, integration);
    keep(0, i);
    let step = 0;
    for (const control of controls[i]) {
      data.ctrl.set(control); // a new view each time: the heap may have grown
      for (let k = 0; k < hold; k++) {
        mujoco.mj_step(model, data);
        keep(++step, i);
      }
    }
  });
  writeArray(request.states_file, states);
}

/** Prepare blocks that step a workload. */
function prepare(request) {
  workload = readWorkload(request);
  finalStates = new Float64Array(workload.starts.length * workload.starts[0].length);
}

/** Step the prepared workload once: exactly this is timed. */
function block() {
  const { starts, controls, hold, hasReset } = workload;
  const { mj_step } = mujoco;
  const begin = process.hrtime.bigint();
  for (let i = 0; i < starts.length; i++) {
    if (hasReset) mujoco.mj_resetData(model, data);
    mujoco.mj_setState(model, data, starts[i], integration);
    const ctrl = data.ctrl; // valid until the heap grows, which no step makes it do
    for (const control of controls[i]) {
      ctrl.set(control);
      for (let k = 0; k < hold; k++) mj_step(model, data);
    }
    getState(finalStates, i);
  }
  return Number(process.hrtime.bigint() - begin);
}

/** Write the final states of the last block to a file. */
function save({ states_file }) {
  writeArray(states_file, finalStates);
}

/** Say how much memory the module and this process take. */
function memory() {
  return { heap_bytes: heapBytes(), rss_bytes: process.memoryUsage.rss() };
}

/** Copy the whole state of `data` to a row of an array. */
function getState(states, row) {
  mujoco.mj_getState(model, data, stateBuffer, integration);
  const state = stateBuffer.GetView(); // a new view each time: the heap may have grown
  states.set(state, row * state.length);
}

/** Return how large the module's heap is. */
function heapBytes() {
  const buffer = new mujoco.DoubleBuffer(1);
  const bytes = buffer.GetView().buffer.byteLength;
  buffer.delete();
  return bytes;
}

/** @returns {Workload} */
function readWorkload({ starts_file, control_file, nbatch, ncontrol, hold, has_reset }) {
  const starts = readArray(starts_file);
  const control = readArray(control_file);
  const nstate = starts.length / nbatch;
  if (nstate !== mujoco.mj_stateSize(model, integration)) {
    throw new Error(`a state has ${mujoco.mj_stateSize(model, integration)} numbers, not ${nstate}`);
  }
  const rows = (array, count, size) =>
    Array.from({ length: count }, (_, i) => array.subarray(i * size, (i + 1) * size));
  const perSimulation = control.length / nbatch;
  return {
    starts: rows(starts, nbatch, nstate),
    controls: rows(control, nbatch, perSimulation).map((all) => rows(all, ncontrol, model.nu)),
    hold,
    hasReset: has_reset,
  };
}

function readArray(file) {
  return new Float64Array(new Uint8Array(fs.readFileSync(file)).buffer);
}

function writeArray(file, array) {
  fs.writeFileSync(file, new Uint8Array(array.buffer));
}

/** Return an error's message, whatever was thrown: C++ throws objects of its own. */
function messageOf(error) {
  if (error instanceof Error) return error.message || String(error);
  try {
    return mujoco.getExceptionMessage(error).join(': ');
  } catch {
    return String(error);
  }
}

/** Yield the requests of the parent, each as it comes; nothing else runs meanwhile. */
function* requests() {
  for (let header; (header = read(4)) !== null; ) {
    yield JSON.parse(read(header.readInt32BE()).toString());
  }
}

/** Return the next bytes of the parent; null where there are no more. */
function read(size) {
  const content = Buffer.alloc(size);
  for (let begin = 0, count; begin < size; begin += count) {
    count = fs.readSync(descriptor, content, begin, size - begin, null);
    if (count === 0) return null;
  }
  return content;
}

const descriptor = Number(process.argv[2]);
for (const { action, ...request } of requests()) {
  let answer;
  try {
    answer = { value: (await ACTIONS[action](request)) ?? null };
  } catch (error) {
    answer = { error: messageOf(error) };
  }
  const content = Buffer.from(JSON.stringify(answer));
  const length = Buffer.alloc(4);
  length.writeInt32BE(content.length);
  fs.writeSync(descriptor, Buffer.concat([length, content]));
}
process.exit(0); // the workers of the build with threads would keep it alive
