// A plot of x over time, drawn at the size that it has on the screen.

import { add, onWidth, points, scale, set } from "./svg.mjs";

const HEIGHT = 196;
const MARGIN = { top: 8, right: 14, bottom: 38, left: 50 };

/**
 * @typedef {object} Trace
 * @property {string} name its class in the style sheet
 * @property {readonly number[]} times in s
 * @property {readonly number[]} values in m
 */

export class TracePlot {
  /**
   * @param {SVGElement} svg
   * @param {readonly [number, number]} seconds the axis of time
   * @param {readonly [number, number]} metres the axis of x
   */
  constructor(svg, seconds, metres) {
    this.svg = svg;
    this.seconds = seconds;
    this.metres = metres;
    this.x = scale(seconds, [0, 1]);
    this.y = scale(metres, [1, 0]);
    /** @type {readonly Trace[]} */
    this.traces = [];
    /** @type {Map<string, {line: SVGElement, dot: SVGElement}>} */
    this.marks = new Map();
    onWidth(svg, (width) => this.resize(width));
  }

  /** @param {number} width in CSS pixels */
  resize(width) {
    const right = width - MARGIN.right;
    const bottom = HEIGHT - MARGIN.bottom;
    this.x = scale(this.seconds, [MARGIN.left, right]);
    this.y = scale(this.metres, [bottom, MARGIN.top]);
    this.svg.replaceChildren();
    this.marks.clear();
    set(this.svg, { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT });
    for (const tick of ticks(this.metres)) {
      const at = this.y(tick);
      add(this.svg, "line", { class: "grid", x1: MARGIN.left, x2: right, y1: at, y2: at });
      add(
        this.svg,
        "text",
        { class: "tick", x: MARGIN.left - 6, y: at + 4, "text-anchor": "end" },
        tick.toFixed(1),
      );
    }
    for (const tick of ticks(this.seconds)) {
      const at = this.x(tick);
      add(
        this.svg,
        "text",
        { class: "tick", x: at, y: bottom + 16, "text-anchor": "middle" },
        tick.toFixed(1),
      );
    }
    add(
      this.svg,
      "text",
      { class: "tick", x: right, y: HEIGHT - 5, "text-anchor": "end" },
      "time in the simulation, s",
    );
    add(
      this.svg,
      "text",
      { class: "tick", x: 11, y: bottom, transform: `rotate(-90 11 ${bottom})` },
      "x of the tip, m",
    );
    this.draw(this.traces);
  }

  /**
   * Draw traces, the first at the bottom; each ends in a dot.
   * @param {readonly Trace[]} traces
   */
  draw(traces) {
    this.traces = traces;
    for (const { name, times, values } of traces) {
      const { line, dot } = this.marksOf(name);
      set(line, { points: points(times, values, this.x, this.y) });
      const last = values.length - 1;
      const isVisible = last >= 0 && Number.isFinite(values[last]);
      set(dot, {
        visibility: isVisible ? "visible" : "hidden",
        cx: isVisible ? this.x(times[last]) : 0,
        cy: isVisible ? this.y(values[last]) : 0,
      });
    }
  }

  /** @param {string} name */
  marksOf(name) {
    const marks = this.marks.get(name) ?? {
      line: add(this.svg, "polyline", { class: `trace ${name}` }),
      dot: add(this.svg, "circle", { class: `end ${name}`, r: 4 }),
    };
    this.marks.set(name, marks);
    return marks;
  }
}

/**
 * Return the multiples of 0.1 within an interval.
 * @param {readonly [number, number]} interval
 * @returns {number[]}
 */
export function ticks([low, high]) {
  const first = Math.ceil(low * 10 - 1e-9);
  const last = Math.floor(high * 10 + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => (first + i) / 10);
}
