// The part of the page in which an index of qpos and the name of a joint mean two things.

import { announce, byId, guarded } from "./page.mjs";
import { Robot } from "./robot.mjs";
import { Scene } from "./scene.mjs";

export class Naming {
  /**
   * @param {import("@mujoco/mujoco").MainModule} mujoco an engine that nothing else uses
   * @param {string} xml models/cartpole.xml
   */
  constructor(mujoco, xml) {
    this.robot = new Robot(mujoco, xml);
    this.scene = new Scene(byId("robot"), mujoco);
    this.ball = /** @type {HTMLInputElement} */ (byId("ball"));
    this.byName = /** @type {HTMLInputElement} */ (byId("by-name"));
    this.x = /** @type {HTMLInputElement} */ (byId("x"));
    const compile = guarded(() => {
      this.robot.compile(this.ball.checked);
      this.update();
      announce(
        `The model is compiled anew. data.qpos[0] is ${this.robot.labels[0]}. ${this.outcome}`,
      );
    });
    const update = guarded(() => this.update());
    const say = guarded(() => announce(this.outcome));
    this.ball.addEventListener("change", compile);
    for (const input of [this.byName, byId("by-index"), this.x]) {
      input.addEventListener("input", update);
      input.addEventListener("change", say);
    }
    for (const control of byId("naming").querySelectorAll("input")) control.disabled = false;
    this.update();
  }

  /** Move what the program names, and show where it is. */
  update() {
    const x = Number(this.x.value);
    this.robot.move(this.byName.checked, x);
    const { model, data, slider } = this.robot.parts;
    this.scene.draw(model, data);
    byId("x-shown").textContent = `${x.toFixed(2)} m`;
    const { labels, sliderIndex } = this.robot;
    const cells = labels.map((label, i) => {
      const cell = document.createElement("li");
      cell.className = [i === 0 ? "index" : "", i === sliderIndex ? "name" : ""].join(" ");
      for (const text of [`[${i}]`, label, data.qpos[i].toFixed(2)]) {
        const part = document.createElement("span");
        part.textContent = text;
        cell.append(part);
      }
      return cell;
    });
    byId("qpos").replaceChildren(...cells);
    showRead("index", labels[0], data.qpos[0]);
    showRead("name", labels[sliderIndex], slider.qpos[0]);
    byId("outcome").textContent = this.outcome;
    byId("robot").setAttribute(
      "aria-label",
      `Cart-pole from the side${this.robot.hasBall ? ", and a ball" : ""}. ${this.outcome}`,
    );
  }

  /** @returns {string} what moved */
  get outcome() {
    const { labels, sliderIndex } = this.robot;
    const moved = this.byName.checked ? labels[sliderIndex] : labels[0];
    return moved === "slider"
      ? "Right: the cart moves."
      : `Wrong: ${moved} changes, and the cart stays where it is.`;
  }
}

/**
 * Show what an expression reads.
 * @param {"index" | "name"} way
 * @param {string} label of the number
 * @param {number} value in m
 */
function showRead(way, label, value) {
  byId(`${way}-codes`).classList.toggle("wrong", label !== "slider");
  byId(`${way}-value`).textContent = `${value.toFixed(2)} m, ${label}`;
}
