// The lab's logic, without a browser and without an engine; run by test_lab_modules.py under Node.

import assert from "node:assert/strict";
import fs from "node:fs";
import test from "node:test";

const SOURCES = new URL("../../docs/lab/", import.meta.url);
const from = (name) => import(new URL(`${name}.mjs`, SOURCES).href);
const { quantile, range } = await from("statistics");
const { Playback } = await from("playback");
const { blockLength, clockTick } = await from("clock");
const { withBallFirst } = await from("models");
const { ticks } = await from("traces");
const { points, scale } = await from("svg");
const { figureOf, shape, shown } = await from("speed");
const { BLOCKS, measure, NSTEP } = await from("stepping");
const { messageOf } = await from("engine");

test("quantiles are between the nearest values", () => {
  assert.equal(quantile([3, 1, 2], 0.5), 2);
  assert.equal(quantile([1, 2, 3, 4], 0.25), 1.75);
  assert.equal(quantile([5], 0.75), 5);
});

test("the range of nothing is zero", () => {
  assert.equal(range([2, -1, 5]), 6);
  assert.equal(range([]), 0);
});

test("steps are due by the time that passed, none is lost, and a hidden tab owes nothing", () => {
  const playback = new Playback(0.002);
  playback.speed = 0.1;
  assert.equal(playback.due(0), 0);
  playback.play();
  let steps = playback.due(10);
  assert.equal(steps, 0);
  for (let frame = 1; frame <= 60; frame++) steps += playback.due(10 + frame / 60);
  assert.ok(steps === 49 || steps === 50); // a tenth of a second, by steps of 2 ms, rounded
  assert.ok(playback.due(1000) <= 5);
  playback.pause();
  assert.equal(playback.due(1001), 0);
});

test("a block is long beside a tick of the clock, and never endless", () => {
  let time = 0;
  const coarse = () => Math.floor((time += 0.3));
  assert.equal(clockTick(coarse), 1);
  assert.equal(blockLength(0.005), 50);
  assert.equal(blockLength(1), 200);
  assert.equal(blockLength(100), 2000);
});

test("the ball is the first body, and the keyframe grows by its seven numbers", () => {
  const xml = fs.readFileSync(new URL("../../models/cartpole.xml", SOURCES), "utf8");
  const changed = withBallFirst(xml);
  assert.ok(changed.indexOf('<body name="ball"') < changed.indexOf('<body name="cart"'));
  const [, qpos] = changed.match(/<key name="tilted" qpos="([^"]*)"/);
  assert.equal(qpos, "-0.4 0 1.3 1 0 0 0 0 0.14986");
});

test("axes have the multiples of a tenth, and dead values are not drawn", () => {
  assert.deepEqual(ticks([0, 0.4]), [0, 0.1, 0.2, 0.3, 0.4]);
  const x = scale([0, 1], [0, 10]);
  assert.equal(x(0.25), 2.5);
  assert.equal(
    points([0, 1, 2], [1, undefined, 0.5], (v) => v, x),
    "0.00,10.00 2.00,5.00",
  );
});

test("a figure has the median and the middle half", () => {
  const here = figureOf("cartpole", [100, 400, 200, 300]);
  assert.equal(here.stepsPerSecond, 250);
  assert.equal(here.note, "middle half 175 to 325");
  assert.equal(shown(1234567), "1,230,000");
  assert.equal(shown(0.01234), "0.01");
});

test("the shape compares two models that were measured", () => {
  const figures = [figureOf("a", [300]), figureOf("b", [20])];
  assert.equal(shape(figures, "b", "a"), "Steps of a in the time of one of b: 15.0.");
  assert.equal(shape(figures.slice(1), "b", "a"), "");
});

test("a message of MuJoCo is one line, without its prefix", () => {
  const error = new Error(
    "MuJoCo Error: Loading error: XML Error: Schema violation\nElement 'x'\n",
  );
  assert.equal(messageOf(error), "Loading error: XML Error: Schema violation Element 'x'");
  assert.equal(messageOf("out of memory"), "out of memory");
});

/** An engine whose step takes a time, which its clock shows. */
function engine({ stepMs, diverges = false, enableflags = 0 }) {
  const state = { ms: 0, steps: 0, resets: 0, restores: 0, deleted: 0 };
  const model = { nkey: 1, opt: { timestep: 0.002, enableflags }, delete: () => state.deleted++ };
  class MjData {
    time = 0;
    ncon = 2;
    delete() {
      state.deleted++;
    }
  }
  const mujoco = {
    MjModel: { from_xml_string: () => model },
    MjData,
    DoubleBuffer: class {
      GetView = () => [7];
      delete() {}
    },
    mjtState: { mjSTATE_INTEGRATION: { value: 1 } },
    mjtEnableBit: { mjENBL_SLEEP: { value: 16 } },
    mj_stateSize: () => 1,
    mj_resetData: () => state.resets++,
    mj_resetDataKeyframe: () => {},
    mj_getState: (_model, data) => (state.start = data.time),
    mj_setState: (_model, data) => {
      state.restores++;
      data.time = state.start;
    },
    mj_step: (_model, data) => {
      state.steps++;
      state.ms += stepMs;
      data.time = diverges ? 0 : data.time + model.opt.timestep;
    },
  };
  return { mujoco, state, now: () => state.ms };
}

test("blocks are whole runs of the same work, as long as was asked", () => {
  const { mujoco, state, now } = engine({ stepMs: 0.1 });
  const blocks = [];
  const speed = measure(mujoco, "", { now, blockMs: 25, onBlock: (done) => blocks.push(done) });
  assert.equal(speed.contacts, 2);
  assert.equal(speed.stepsPerSecond.length, BLOCKS);
  for (const value of speed.stepsPerSecond) assert.ok(Math.abs(value - 10000) < 1e-6);
  assert.deepEqual(
    blocks,
    Array.from({ length: BLOCKS }, (_, i) => i + 1),
  );
  // 0.1 s to settle; runs of 10 ms: a second of them, then three for each block, and one for contacts
  const runs = state.restores;
  assert.equal(state.steps, 50 + runs * NSTEP);
  assert.ok(Math.abs(runs - (100 + 3 * BLOCKS + 1)) <= 1);
  assert.equal(state.deleted, 2);
});

test("what the state leaves out is reset where bodies sleep, and only there", () => {
  for (const [enableflags, perRun] of [[16 + 2, 1], [2, 0]]) {
    const { mujoco, state, now } = engine({ stepMs: 0.1, enableflags });
    measure(mujoco, "", { now, blockMs: 25, onBlock: () => {} });
    assert.equal(state.resets, perRun * state.restores);
  }
});

test("a simulation that diverges has no speed", () => {
  const { mujoco, state, now } = engine({ stepMs: 0.1, diverges: true });
  const options = { now, blockMs: 50, onBlock: () => {} };
  assert.throws(() => measure(mujoco, "", options), /diverges: its speed would mean nothing/);
  assert.equal(state.deleted, 2);
});
