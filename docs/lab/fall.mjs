// The part of the page in which the pole falls: a drawing, two plots, a table of the two lists.

import { announce, byId, digits, fill, guarded, metres } from "./page.mjs";
import { Playback } from "./playback.mjs";
import { DURATION_S, Recording } from "./recording.mjs";
import { Scene } from "./scene.mjs";
import { range } from "./statistics.mjs";
import { TracePlot } from "./traces.mjs";

const SECONDS = /** @type {const} */ ([0, DURATION_S]);
const METRES = /** @type {const} */ ([0, 0.4]);
/** Every so many entries of a list, one is marked in the drawing. */
const MARKED = 5;

export class Fall {
  /**
   * @param {import("@mujoco/mujoco").MainModule} mujoco
   * @param {string} xml models/cartpole.xml
   */
  constructor(mujoco, xml) {
    this.recording = new Recording(mujoco, xml);
    this.playback = new Playback(this.recording.model.opt.timestep);
    this.scene = new Scene(byId("scene"), mujoco);
    this.readings = new TracePlot(byId("readings"), SECONDS, METRES);
    this.lists = new TracePlot(byId("lists"), SECONDS, METRES);
    const speed = byId("speed");
    const setSpeed = () =>
      (this.playback.speed = Number(/** @type {HTMLSelectElement} */ (speed).value));
    speed.addEventListener("change", setSpeed);
    setSpeed();
    for (const [id, action] of Object.entries(this.actions)) {
      const button = /** @type {HTMLButtonElement} */ (byId(id));
      button.addEventListener("click", guarded(action));
      button.disabled = false;
    }
    this.draw();
  }

  /** What the buttons do, by their ids. */
  get actions() {
    return {
      play: () => (this.playback.isPlaying ? this.pause() : this.play()),
      step: () => this.advance(1),
      end: () => this.advance(this.recording.steps),
      restart: () => this.restart(),
    };
  }

  /** Play on; from `tilted`, where the fall is over. */
  play() {
    if (this.recording.isComplete) this.recording.restart();
    this.playback.play();
    this.draw();
    const frame = guarded((/** @type {number} */ now) => {
      if (!this.playback.isPlaying) return;
      for (let steps = this.playback.due(now / 1000); steps > 0; steps--) this.recording.step();
      if (this.recording.isComplete) {
        this.pause();
        return;
      }
      this.draw();
      requestAnimationFrame(frame);
    });
    requestAnimationFrame(frame);
  }

  pause() {
    this.playback.pause();
    this.draw();
    announce(this.summary);
  }

  /** @param {number} steps */
  advance(steps) {
    for (let i = 0; i < steps; i++) this.recording.step();
    this.pause();
  }

  restart() {
    this.recording.restart();
    this.pause();
  }

  /** @returns {string} what the two lists hold, in words */
  get summary() {
    const { views, viewed, copied, steps, live } = this.recording;
    if (!views.length)
      return `The pole is at tilted, x of its tip is ${metres(live)}. Both lists are empty.`;
    return (
      `Step ${views.length} of ${steps}. Stored views: all ${metres(viewed[0])}, range ${metres(range(viewed))}. ` +
      `Stored copies: from ${metres(copied[0])} to ${metres(copied.at(-1))}, range ${metres(range(copied))}.`
    );
  }

  draw() {
    const { model, data, views, copies, readings, times, viewed, copied, live, steps } =
      this.recording;
    const marked = (/** @type {Float64Array[]} */ list) => list.filter((_, i) => i % MARKED === 0);
    this.scene.draw(model, data, [
      { name: "copies", points: marked(copies) },
      { name: "views", points: marked(views) },
    ]);
    this.readings.draw([{ name: "reading", times, values: readings }]);
    this.lists.draw([
      { name: "copies", times, values: copied },
      { name: "views", times, values: viewed },
    ]);
    const row = (/** @type {string} */ name, /** @type {number[]} */ list) =>
      list.length
        ? [name, String(list.length), ...[list[0], list[list.length - 1], range(list)].map(digits)]
        : [name, "0", "", "", ""];
    fill(byId("entries"), [row("views", viewed), row("copies", copied)]);
    byId("time").textContent =
      `${(views.length * model.opt.timestep).toFixed(3)} s, step ${views.length} of ${steps}`;
    byId("live").textContent = metres(live);
    const { isPlaying } = this.playback;
    byId("play").textContent = isPlaying ? "Pause" : "Play";
    if (!isPlaying) this.describe();
  }

  /** Say in words what the drawings show. */
  describe() {
    const { live, readings, viewed, copied } = this.recording;
    const from = (/** @type {number[]} */ values) =>
      values.length ? `from ${metres(values[0])} to ${metres(values.at(-1))}` : "nothing yet";
    byId("scene").setAttribute(
      "aria-label",
      `Cart-pole from the side; x of the pole's tip is ${metres(live)}`,
    );
    byId("readings").setAttribute(
      "aria-label",
      `Plot of x of the tip as it was read at each step: ${from(readings)}`,
    );
    byId("lists").setAttribute(
      "aria-label",
      `Plot of x of the tip in the two lists: stored views, one flat line, ${from(viewed)}; stored copies, ${from(copied)}`,
    );
  }
}
