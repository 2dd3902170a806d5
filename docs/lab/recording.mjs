// The pole's fall from `tilted`, logged twice: as views, which is the bug, and as copies.

/** How long the pole falls, in s. */
export const DURATION_S = 0.4;

export class Recording {
  /**
   * @param {import("@mujoco/mujoco").MainModule} mujoco
   * @param {string} xml the cart-pole, models/cartpole.xml
   */
  constructor(mujoco, xml) {
    this.mujoco = mujoco;
    this.model = mujoco.MjModel.from_xml_string(xml);
    this.data = new mujoco.MjData(this.model);
    this.steps = Math.round(DURATION_S / this.model.opt.timestep);
    this.tip = this.data.site("pole_tip");
    /** @type {Float64Array[]} */
    this.views = [];
    /** @type {Float64Array[]} */
    this.copies = [];
    /** @type {number[]} what `tip.xpos[0]` was at each step, in m */
    this.readings = [];
    /** @type {number[]} `data.time` at each step, in s */
    this.times = [];
    this.restart();
  }

  /** Put the pole back to `tilted`, and begin new lists. */
  restart() {
    const { mujoco, model, data } = this;
    mujoco.mj_resetDataKeyframe(
      model,
      data,
      mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY.value, "tilted"),
    );
    mujoco.mj_forward(model, data);
    this.views = [];
    this.copies = [];
    this.readings = [];
    this.times = [];
  }

  /** Step once, and append to every list. Nothing happens at the end. */
  step() {
    if (this.isComplete) return;
    const { mujoco, model, data, tip } = this;
    mujoco.mj_step(model, data);
    this.views.push(tip.xpos); // the bug: every entry is the same memory
    this.copies.push(tip.xpos.slice());
    this.readings.push(tip.xpos[0]);
    this.times.push(data.time);
  }

  /** @returns {boolean} whether all steps are done */
  get isComplete() {
    return this.views.length >= this.steps;
  }

  /** @returns {number} x of the tip in MuJoCo's memory now, in m */
  get live() {
    return this.tip.xpos[0];
  }

  /** @returns {number[]} x in every stored view, read now, in m */
  get viewed() {
    return this.views.map((view) => view[0]);
  }

  /** @returns {number[]} x in every stored copy, in m */
  get copied() {
    return this.copies.map((copy) => copy[0]);
  }
}
