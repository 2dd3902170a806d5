// What the parts of the page share: its elements, what is announced, and what failed.

import { messageOf } from "./engine.mjs";

/**
 * Return an element of the page.
 * @template {Element} [T=HTMLElement]
 * @param {string} id
 * @returns {T}
 */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no #${id}`);
  return /** @type {T} */ (/** @type {unknown} */ (element));
}

/**
 * Have a screen reader say something.
 * @param {string} text
 */
export function announce(text) {
  byId("announcement").textContent = text;
}

/**
 * Show what failed, in place of a console that nobody has open.
 * @param {unknown} error
 */
export function showFailure(error) {
  const box = byId("failure");
  box.textContent = messageOf(error);
  box.hidden = false;
}

/**
 * Return what does some work, and shows how it failed.
 * @template {unknown[]} A
 * @param {(...args: A) => unknown} work
 * @returns {(...args: A) => Promise<void>}
 */
export function guarded(work) {
  return async (...args) => {
    try {
      await work(...args);
    } catch (error) {
      showFailure(error);
    }
  };
}

/**
 * Return a number with four decimal places; a dead view has none.
 * @param {number | undefined} value
 * @returns {string}
 */
export function digits(value) {
  return value === undefined || Number.isNaN(value) ? "undefined" : value.toFixed(4);
}

/**
 * Return a length with its unit.
 * @param {number | undefined} value in m
 * @returns {string}
 */
export function metres(value) {
  const text = digits(value);
  return text === "undefined" ? text : `${text} m`;
}

/**
 * Show the rows of a table's body.
 * @param {HTMLTableElement} table
 * @param {readonly (readonly string[])[]} rows the first cell of each is its heading
 */
export function fill(table, rows) {
  const body = table.tBodies[0] ?? table.createTBody();
  rows.forEach((texts, i) => {
    const row = body.rows[i] ?? body.insertRow();
    texts.forEach((text, j) => {
      let cell = row.cells[j];
      if (!cell) {
        cell = document.createElement(j ? "td" : "th");
        if (!j) cell.scope = "row";
        row.append(cell);
      }
      if (cell.textContent !== text) cell.textContent = text;
    });
  });
  while (body.rows.length > rows.length) body.deleteRow(-1);
}
