// Order statistics of a few numbers.

/**
 * Return a quantile, interpolated linearly between the two nearest values (type 7 of Hyndman and Fan, 1996).
 * @param {readonly number[]} values at least one, in any order
 * @param {number} share 0 for the smallest, 1 for the largest
 * @returns {number}
 */
export function quantile(values, share) {
  const sorted = [...values].sort((a, b) => a - b);
  const position = share * (sorted.length - 1);
  const below = Math.floor(position);
  const above = Math.min(below + 1, sorted.length - 1);
  return sorted[below] + (position - below) * (sorted[above] - sorted[below]);
}

/**
 * Return the largest value minus the smallest.
 * @param {readonly number[]} values
 * @returns {number} 0 without values
 */
export function range(values) {
  return values.length ? Math.max(...values) - Math.min(...values) : 0;
}
