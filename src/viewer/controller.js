// How many triangles are shown, so that the picture moves smoothly: a function of the times of
// frames alone. It knows neither a clock nor a mesh.
//
// While something moves, the count follows the time that frames take. At rest there is no hurry:
// everything is shown. Counts that were too many are remembered for a while, so that the count does
// not swing around the limit.

/** A frame may take so many times what is aimed at before anything is taken away… */
const SLOW = 1.2;
/** … and must take less than this share before anything is added. */
const FAST = 0.7;
/** Share of a new frame in the mean. Chosen by hand: about the last five frames count. */
const MEMORY = 0.3;
/** Frames that show what a change has brought before the next one. */
const SETTLING_FRAMES = 6;
/** A gap this long is no slow frame: the page was hidden. Software draws millions in seconds. */
const GAP_MS = 1e4;
/** How long a count that was too many is not tried again. */
const CAUTION_MS = 4000;
/** How long nothing must move before everything is shown. */
const REST_MS = 250;

export class LoadController {
  constructor({ targetFps = 30, trianglesMin = 1000 } = {}) {
    this.aimMs = 1000 / targetFps;
    this.trianglesMin = trianglesMin;
    /** What may be shown while something moves. */
    this.budget = Infinity;
    this.ceiling = Infinity;
    this.ceilingUntil = -Infinity;
    this.meanMs = null;
    this.settling = 0;
    /** When the last frame began, and how long the one before it took. */
    this.last = null;
    this.elapsed = 0;
    this.movedAt = -Infinity;
  }

  /** What to show at rest, or in motion: a number of triangles, `Infinity` for all of them. */
  allowed(now) {
    return this.isAtRest(now) ? Infinity : this.budget;
  }

  isAtRest(now) {
    // Where frames take longer than that, two of them have to pass.
    return now - this.movedAt > Math.max(REST_MS, 2 * this.elapsed);
  }

  /** When to look again for what is allowed, in milliseconds; 0 at rest. */
  restIn(now) {
    return this.isAtRest(now) ? 0 : Math.max(REST_MS, 2 * this.elapsed) - (now - this.movedAt) + 1;
  }

  /** Something is being moved. */
  moved(now) {
    if (this.isAtRest(now)) {
      this.meanMs = null;
      this.settling = 1;
    }
    this.movedAt = now;
  }

  /** The next frame will not follow at once: the time to it says nothing. */
  pause() {
    this.last = null;
  }

  /** A frame begins that follows one with `shown` triangles. */
  frame(now, shown) {
    const elapsed = this.last === null ? null : now - this.last;
    this.last = now;
    if (elapsed === null || elapsed > GAP_MS) return;
    this.elapsed = elapsed;
    if (this.isAtRest(now)) return;
    this.meanMs = this.meanMs === null ? elapsed : this.meanMs + MEMORY * (elapsed - this.meanMs);
    if (this.settling > 0) this.settling -= 1;
    else if (this.meanMs > SLOW * this.aimMs) this.reduce(now, shown);
    else if (this.meanMs < FAST * this.aimMs) this.raise(now, shown);
  }

  /** What is shown is too much. */
  reduce(now, shown) {
    const share = Math.min(0.9, Math.max(0.1, this.aimMs / this.meanMs));
    this.ceiling = Math.max(this.trianglesMin, 0.95 * shown);
    this.ceilingUntil = now + CAUTION_MS;
    this.change(Math.min(this.budget, Math.max(this.trianglesMin, share * shown)));
  }

  /** There is time for more, unless less than the budget is there to be shown. */
  raise(now, shown) {
    if (this.budget > 1.5 * shown) return;
    const ceiling = now < this.ceilingUntil ? this.ceiling : Infinity;
    const budget = Math.min(1.25 * shown, ceiling);
    if (budget > this.budget) this.change(budget);
  }

  change(budget) {
    this.budget = budget;
    this.meanMs = null;
    this.settling = SETTLING_FRAMES;
  }
}
