// Browsers round their clocks, to 0.005 ms or to 100 ms: a block must be long beside a tick.

const LEAST_MS = 50;
const LONGEST_MS = 2000;
const TICKS_PER_BLOCK = 200;

/**
 * Return the smallest step that a clock makes, in ms.
 * @param {() => number} now in ms
 * @returns {number}
 */
export function clockTick(now) {
  let smallest = Infinity;
  for (let i = 0; i < 10; i++) {
    const begin = now();
    let end = begin;
    while (end === begin) end = now();
    smallest = Math.min(smallest, end - begin);
  }
  return smallest;
}

/**
 * Return how long a block is to be, in ms.
 * @param {number} tick of the clock, in ms
 * @returns {number}
 */
export function blockLength(tick) {
  return Math.min(Math.max(LEAST_MS, TICKS_PER_BLOCK * tick), LONGEST_MS);
}
