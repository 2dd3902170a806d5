// What an index of qpos means, with a ball before the robot and without.

import { withBallFirst } from "./models.mjs";

/** What a joint's numbers are called, by the joint's type (mjJNT_FREE, _BALL, _SLIDE, _HINGE). */
const NUMBERS = [
  [" x", " y", " z", " qw", " qx", " qy", " qz"],
  [" qw", " qx", " qy", " qz"],
  [""],
  [""],
];

export class Robot {
  /**
   * @param {import("@mujoco/mujoco").MainModule} mujoco
   * @param {string} xml models/cartpole.xml
   */
  constructor(mujoco, xml) {
    this.mujoco = mujoco;
    this.xml = xml;
    this.compile(false);
  }

  /**
   * Compile the model anew.
   * @param {boolean} hasBall whether a ball is before the robot
   */
  compile(hasBall) {
    const { mujoco } = this;
    const model = mujoco.MjModel.from_xml_string(hasBall ? withBallFirst(this.xml) : this.xml);
    this.slider?.delete();
    this.data?.delete();
    this.model?.delete();
    this.hasBall = hasBall;
    this.model = model;
    this.data = new mujoco.MjData(model);
    this.slider = this.data.jnt("slider");
    this.reset();
  }

  /** Go back to the keyframe. */
  reset() {
    const { mujoco, model, data } = this.parts;
    mujoco.mj_resetDataKeyframe(model, data, 0);
    mujoco.mj_forward(model, data);
  }

  /**
   * From the keyframe, move what a program takes for the cart.
   * @param {boolean} byName whether the program uses the joint's name, or index 0
   * @param {number} x in m
   */
  move(byName, x) {
    const { mujoco, model, data, slider } = this.parts;
    this.reset();
    if (byName) slider.qpos[0] = x;
    else data.qpos[0] = x;
    mujoco.mj_forward(model, data);
  }

  /** @returns {string[]} what each number of qpos is, such as `ball x` or `slider` */
  get labels() {
    const { mujoco, model } = this.parts;
    /** @type {string[]} */
    const labels = [];
    for (let joint = 0; joint < model.njnt; joint++) {
      const name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT.value, joint);
      labels.push(...NUMBERS[model.jnt_type[joint]].map((number) => name + number));
    }
    return labels;
  }

  /** @returns {number} where the slider's number is in qpos */
  get sliderIndex() {
    const { mujoco, model } = this.parts;
    return model.jnt_qposadr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT.value, "slider")];
  }

  get parts() {
    const { mujoco, model, data, slider } = this;
    if (!model || !data || !slider) throw new Error("no model");
    return { mujoco, model, data, slider };
  }
}
