// When steps are due: a clock that can be paused, whose speed can change.

/** The longest time between two frames that counts, in s: more is a tab that was hidden. */
const LONGEST_FRAME_S = 0.1;

export class Playback {
  /** @param {number} timestep simulated seconds of a step */
  constructor(timestep) {
    this.timestep = timestep;
    /** simulated seconds per second */
    this.speed = 0.1;
    this.isPlaying = false;
    this.lastFrame = NaN;
    this.owed = 0;
  }

  play() {
    this.isPlaying = true;
    this.lastFrame = NaN;
    this.owed = 0;
  }

  pause() {
    this.isPlaying = false;
  }

  /**
   * Return how many steps are due at a frame.
   * @param {number} now in s
   * @returns {number}
   */
  due(now) {
    if (!this.isPlaying) return 0;
    const elapsed = Number.isNaN(this.lastFrame)
      ? 0
      : Math.min(now - this.lastFrame, LONGEST_FRAME_S);
    this.lastFrame = now;
    this.owed += (elapsed * this.speed) / this.timestep;
    const steps = Math.floor(this.owed);
    this.owed -= steps;
    return steps;
  }
}
