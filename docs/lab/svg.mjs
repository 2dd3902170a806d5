// SVG by hand: elements, a linear scale, a line.

/**
 * Append an SVG element to another; return it.
 * @param {Element} parent
 * @param {string} name
 * @param {Record<string, string | number>} [attributes]
 * @param {string} [text]
 * @returns {SVGElement}
 */
export function add(parent, name, attributes = {}, text = "") {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  set(element, attributes);
  element.textContent = text;
  parent.append(element);
  return element;
}

/**
 * Set attributes.
 * @param {Element} element
 * @param {Record<string, string | number>} attributes
 */
export function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
}

/**
 * Return the function that maps one interval onto another.
 * @param {readonly [number, number]} from
 * @param {readonly [number, number]} to
 * @returns {(value: number) => number}
 */
export function scale([from0, from1], [to0, to1]) {
  return (value) => to0 + ((value - from0) / (from1 - from0)) * (to1 - to0);
}

/**
 * Return the `points` of a polyline; values that are not finite are left out.
 * @param {readonly number[]} xs
 * @param {readonly number[]} ys
 * @param {(value: number) => number} x
 * @param {(value: number) => number} y
 * @returns {string}
 */
export function points(xs, ys, x, y) {
  return ys
    .map((value, i) =>
      Number.isFinite(value) ? `${x(xs[i]).toFixed(2)},${y(value).toFixed(2)}` : "",
    )
    .filter(Boolean)
    .join(" ");
}

/**
 * Call a function with the width of an element, at the frame after it is known or changes.
 * @param {Element} element
 * @param {(width: number) => void} draw width in CSS pixels
 */
export function onWidth(element, draw) {
  let drawn = 0;
  const update = () => {
    const width = Math.round(element.getBoundingClientRect().width);
    if (width > 0 && width !== drawn) draw((drawn = width));
  };
  // not at once: drawing changes the height, which an observer must not do
  new ResizeObserver(() => requestAnimationFrame(update)).observe(element);
}
