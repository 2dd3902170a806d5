// The cart-pole from the side, at the places that MuJoCo's arrays have.

import { add, onWidth, scale, set } from "./svg.mjs";

/** What is seen, in m: x, and z, the height. */
const X = /** @type {const} */ ([-0.62, 0.72]);
const Z = /** @type {const} */ ([0.93, 1.72]);
/** Room for the numbers below, in CSS pixels. */
const SCALE_HEIGHT = 28;

/**
 * @typedef {object} Trail
 * @property {string} name its class in the style sheet
 * @property {readonly (readonly number[] | Float64Array)[]} points (x, y, z) of each, in m
 */

export class Scene {
  /**
   * @param {SVGElement} svg
   * @param {import("@mujoco/mujoco").MainModule} mujoco
   */
  constructor(svg, mujoco) {
    this.svg = svg;
    this.mujoco = mujoco;
    /** @type {(() => void) | undefined} */
    this.redraw = undefined;
    this.width = 0;
    onWidth(svg, (width) => {
      this.width = width;
      this.redraw?.();
    });
  }

  /**
   * Draw a state; mj_forward or mj_step has been called.
   * @param {import("@mujoco/mujoco").MjModel} model with the geoms cart, pole and, perhaps, ball
   * @param {import("@mujoco/mujoco").MjData} data
   * @param {readonly Trail[]} [trails] points to mark
   */
  draw(model, data, trails = []) {
    this.redraw = () => this.draw(model, data, trails);
    if (!this.width) return;
    const width = this.width;
    const metre = width / (X[1] - X[0]);
    const bottom = Math.round((Z[1] - Z[0]) * metre);
    const height = bottom + SCALE_HEIGHT;
    const x = scale(X, [0, width]);
    const z = scale(Z, [bottom, 0]);
    const svg = this.svg;
    svg.replaceChildren();
    set(svg, { viewBox: `0 0 ${width} ${height}`, height });

    add(svg, "line", { class: "rail", x1: 0, x2: width, y1: z(1), y2: z(1) });
    for (let tick = -6; tick <= 7; tick++) {
      const at = x(tick / 10);
      add(svg, "line", {
        class: "rail-tick",
        x1: at,
        x2: at,
        y1: bottom,
        y2: bottom + (tick % 5 ? 4 : 8),
      });
      if (tick % 5 === 0) {
        const label = `${(tick / 10).toFixed(1)}${tick ? "" : " m"}`;
        add(svg, "text", { class: "tick", x: at, y: bottom + 21, "text-anchor": "middle" }, label);
      }
    }

    const { mjOBJ_BODY, mjOBJ_GEOM, mjOBJ_SITE } = this.mujoco.mjtObj;
    const find = (/** @type {{value: number}} */ type, /** @type {string} */ name) =>
      this.mujoco.mj_name2id(model, type.value, name);
    const cart = geom(model, data, find(mjOBJ_GEOM, "cart"));
    const [halfLength, , halfHeight] = cart.size;
    add(svg, "rect", {
      class: "cart",
      x: x(cart.x - halfLength),
      y: z(cart.z + halfHeight),
      width: 2 * halfLength * metre,
      height: 2 * halfHeight * metre,
      rx: 4,
    });
    const hinge = row(data.xpos, find(mjOBJ_BODY, "pole"));
    const tip = row(data.site_xpos, find(mjOBJ_SITE, "pole_tip"));
    const thickness = 2 * geom(model, data, find(mjOBJ_GEOM, "pole")).size[0] * metre;
    add(svg, "line", {
      class: "pole",
      x1: x(hinge[0]),
      y1: z(hinge[2]),
      x2: x(tip[0]),
      y2: z(tip[2]),
      "stroke-width": thickness,
    });
    add(svg, "circle", { class: "hinge", cx: x(hinge[0]), cy: z(hinge[2]), r: 3 });

    const ballId = find(mjOBJ_GEOM, "ball");
    if (ballId >= 0) {
      const ball = geom(model, data, ballId);
      add(svg, "circle", { class: "ball", cx: x(ball.x), cy: z(ball.z), r: ball.size[0] * metre });
      add(
        svg,
        "text",
        { class: "label", x: x(ball.x), y: z(ball.z + ball.size[0]) - 6, "text-anchor": "middle" },
        "ball",
      );
    }
    for (const { name, points } of trails) {
      for (const [px, , pz] of points) {
        if (px !== undefined) add(svg, "circle", { class: `trail ${name}`, cx: x(px), cy: z(pz) });
      }
    }
    add(svg, "circle", {
      class: "tip",
      cx: x(tip[0]),
      cy: z(tip[2]),
      r: Math.max(3, thickness / 3),
    });
  }
}

/**
 * Return where a geom is, and its size, in m. Handles such as `data.geom(name)` would have to be deleted at
 * every frame; arrays need not.
 * @param {import("@mujoco/mujoco").MjModel} model
 * @param {import("@mujoco/mujoco").MjData} data
 * @param {number} id
 */
function geom(model, data, id) {
  const [x, , z] = row(data.geom_xpos, id);
  return { x, z, size: row(model.geom_size, id) };
}

/**
 * Return a row of an (n, 3) array.
 * @param {Float64Array} array
 * @param {number} id
 * @returns {Float64Array}
 */
function row(array, id) {
  return array.subarray(3 * id, 3 * id + 3);
}
