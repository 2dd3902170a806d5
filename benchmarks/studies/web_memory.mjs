/**
 * What goes wrong with the memory of MuJoCo's WebAssembly builds, each tried on the build itself.
 *
 *     node --expose-gc web_memory.mjs OUTPUT examine SCRIPT CARTPOLE ANGLES
 *     node --expose-gc web_memory.mjs OUTPUT fill SCRIPT
 *
 * SCRIPT is the module of a build, CARTPOLE the MJCF of the model whose pole falls from keyframe 0,
 * ANGLES are in rad, as JSON. It writes one value to OUTPUT, as JSON.
 */

import fs from 'node:fs';
import { pathToFileURL } from 'node:url';

/** The size of MjData that people get, and one that they can ask for. */
const SIZES = ['', '<size memory="1M"/>'];
/** A box that rests on a plane, with four contacts. */
const box = (size) => `<mujoco>${size}<worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>`;

/** Objects that are created to see what they take of the heap. */
const DATA_COUNT = 20, READ_COUNT = 20000;
/** So many MjData grow any heap that Emscripten begins with, and fill any that it ends with. */
const MOST_COUNT = 10000;
/** Turns of the event loop in which the garbage collector may call finalizers. */
const TURNS = 20;

/**
 * Fill the heap, once with MjData of each size.
 * @param {any} mujoco a module that was just instantiated
 */
function fill(mujoco) {
  return { limits: SIZES.map((size) => examineLimit(mujoco, size)) };
}

/**
 * Try everything else.
 * @param {any} mujoco an instantiated module
 * @param {string} cartpole a file
 * @param {string} angles
 */
async function examine(mujoco, cartpole, angles) {
  const tools = { mujoco, heapBytes: () => heapBytes(mujoco) };
  const model = mujoco.MjModel.from_xml_string(box(SIZES[0]));
  try {
    return {
      growth: examineGrowth(tools, model),
      snapshot: examineSnapshot(tools, fs.readFileSync(cartpole, 'utf8')),
      data: await examineObjects(tools, DATA_COUNT, () => new mujoco.MjData(model)),
      contact: await examineContacts(tools, model),
      state: examineState(tools, model),
      quaternions: rotate(tools, JSON.parse(angles)),
    };
  } finally {
    model.delete();
  }
}

/** What becomes of a stored view when the heap grows. */
function examineGrowth({ mujoco, heapBytes }, model) {
  const data = new mujoco.MjData(model);
  const view = data.qpos;
  const before = { bytes: heapBytes(), length: view.length };
  const others = [];
  while (heapBytes() === before.bytes && others.length < MOST_COUNT) {
    others.push(new mujoco.MjData(model));
  }
  data.qpos[0] = 42; // through a new view
  const result = {
    created: others.length,
    heap_bytes: before.bytes,
    grown_bytes: heapBytes(),
    length: before.length,
    grown_length: view.length,
    is_live: view[0] === 42,
    new_length: data.qpos.length,
  };
  for (const each of [data, ...others]) each.delete();
  return result;
}

/** How far the tip of the pole moves, in stored views and in stored copies, in 0.4 s. */
function examineSnapshot({ mujoco }, cartpole) {
  const model = mujoco.MjModel.from_xml_string(cartpole);
  const data = new mujoco.MjData(model);
  mujoco.mj_resetDataKeyframe(model, data, 0);
  const views = [], copies = [], nstep = 200;
  for (let i = 0; i < nstep; i++) {
    mujoco.mj_step(model, data);
    views.push(data.site_xpos);
    copies.push(data.site_xpos.slice());
  }
  const range = (rows) => {
    const x = rows.map((row) => row[0]);
    return Math.max(...x) - Math.min(...x);
  };
  const result = { nstep, views_range_m: range(views), copies_range_m: range(copies) };
  data.delete();
  model.delete();
  return result;
}

/** What copies of contacts take, of a box that rests. */
async function examineContacts(tools, model) {
  const data = new tools.mujoco.MjData(model);
  for (let i = 0; i < 10; i++) tools.mujoco.mj_step(model, data);
  const result = await examineObjects(tools, READ_COUNT, () => data.contact);
  const { ncon } = data;
  data.delete();
  return { ...result, ncon };
}

/**
 * What objects take of the heap: deleted, not deleted, and again after a garbage collection.
 * @param {() => any} create
 */
async function examineObjects({ heapBytes }, count, create) {
  const growth = (work) => {
    const before = heapBytes();
    for (let i = 0; i < count; i++) work();
    return heapBytes() - before;
  };
  const deleted_bytes = growth(() => create().delete());
  const undeleted_bytes = growth(() => { create(); });
  for (let i = 0; i < TURNS; i++) {
    globalThis.gc?.();
    await new Promise((resolve) => setTimeout(resolve));
  }
  return { count, deleted_bytes, undeleted_bytes, again_bytes: growth(() => { create(); }) };
}

/** How many MjData fit into the largest heap that the module may have. */
function examineLimit(mujoco, size) {
  const model = mujoco.MjModel.from_xml_string(box(size));
  const datas = [];
  let error = '';
  try {
    while (datas.length < MOST_COUNT) datas.push(new mujoco.MjData(model));
  } catch (thrown) {
    error = String(thrown.message ?? thrown);
  }
  const result = { size, count: datas.length, heap_bytes: heapBytes(mujoco), error };
  for (const each of datas) each.delete();
  model.delete();
  return result;
}

/** Whether mj_getState writes to a Float64Array, and to a DoubleBuffer. */
function examineState({ mujoco }, model) {
  const data = new mujoco.MjData(model);
  data.qpos[0] = 42;
  const sig = mujoco.mjtState.mjSTATE_QPOS.value;
  const size = mujoco.mj_stateSize(model, sig);
  const array = new Float64Array(size), buffer = new mujoco.DoubleBuffer(size);
  let error = '';
  try {
    mujoco.mj_getState(model, data, array, sig);
  } catch (thrown) {
    error = String(thrown.message ?? thrown);
  }
  mujoco.mj_getState(model, data, buffer, sig);
  const result = {
    is_array_written: array[0] === 42,
    is_buffer_written: buffer.GetView()[0] === 42,
    error,
  };
  buffer.delete();
  data.delete();
  return result;
}

/** Return quaternions of rotations about z: the cosine and the sine of half of each angle. */
function rotate({ mujoco }, angles) {
  const buffer = new mujoco.DoubleBuffer(4);
  const quaternions = angles.map((angle) => {
    mujoco.mju_axisAngle2Quat(buffer, [0, 0, 1], angle);
    return Array.from(buffer.GetView());
  });
  buffer.delete();
  return quaternions;
}

function heapBytes(mujoco) {
  const buffer = new mujoco.DoubleBuffer(1);
  const bytes = buffer.GetView().buffer.byteLength;
  buffer.delete();
  return bytes;
}

const [output, action, script, ...rest] = process.argv.slice(2);
// Node has it since version 21; the build with threads reads it, and starts as many workers
globalThis.navigator ??= /** @type {any} */ ({ hardwareConcurrency: 2 });
const { default: loadMujoco } = await import(pathToFileURL(script).href);
const mujoco = await loadMujoco({ print: console.error, printErr: console.error });
fs.writeFileSync(output, JSON.stringify(await { examine, fill }[action](mujoco, ...rest)));
process.exit(0); // the workers of the build with threads would keep it alive
