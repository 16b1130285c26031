// Where the viewer stands: turning, nearing and shifting a goal, which the camera follows gently.
// Models have no agreed upper side, so it turns about the axes of the screen, without a stop.

/** Full vertical angle of view, radians. */
const FIELD = 0.6;
/** Milliseconds in which two thirds of the way to the goal are gone. */
const EASE_MS = 70;

export class Camera {
  constructor() {
    // `home`: model directions to those of the screen (right, up, towards the viewer), rows of 3 × 3.
    this.setUp('y');
  }

  /** Looks from the front: `up` is the axis of the model that points up, `-z` for one that points down. */
  setUp(up) {
    const axes = { x: [0, 1, 0, 1, 0, 0, 0, 0, -1], z: [1, 0, 0, 0, 0, 1, 0, -1, 0] };
    const front = axes[up.at(-1)] ?? [1, 0, 0, 0, 1, 0, 0, 0, 1];
    const upright = about(2, up.length > 1 ? Math.PI : 0);
    this.home = [about(0, 0.14), about(1, -0.35), upright, front].reduce(multiply);
    this.reset();
    this.jump();
  }

  reset() {
    /** Distance in radii of the model; the shift in radii, in the plane of the screen. */
    this.goal = { turn: this.home, distance: 0.86 / Math.sin(FIELD / 2), x: 0, y: 0 };
  }

  /** Turns by angles about the upright and the level axis of the screen, and about the view. */
  turn(right, up, roll = 0) {
    const turned = multiply(about(2, roll), multiply(about(0, up), about(1, right)));
    this.goal = { ...this.goal, turn: orthonormal(multiply(turned, this.goal.turn)) };
  }

  /** Comes nearer by a factor, or goes back. */
  zoom(factor) {
    const distance = Math.min(200, Math.max(0.02, this.goal.distance / factor));
    this.goal = { ...this.goal, distance };
  }

  /** Shifts by shares of the height of the picture. */
  pan(x, y) {
    const height = 2 * this.goal.distance * Math.tan(FIELD / 2);
    const within = (value) => Math.min(4, Math.max(-4, value));
    const { goal } = this;
    this.goal = { ...goal, x: within(goal.x + x * height), y: within(goal.y + y * height) };
  }

  /** Follows the goal for some milliseconds; returns whether there is a way left to go. */
  follow(elapsed) {
    const { now, goal } = this;
    const share = 1 - Math.exp(-Math.min(elapsed, 100) / EASE_MS);
    const between = (from, to) => from + share * (to - from);
    const turn = now.turn.map((value, index) => between(value, goal.turn[index]));
    const ratio = (goal.distance / now.distance) ** share;
    this.now = {
      turn: orthonormal(turn),
      distance: now.distance * ratio,
      x: between(now.x, goal.x),
      y: between(now.y, goal.y),
    };
    const apart = Math.max(
      ...now.turn.map((value, index) => Math.abs(value - goal.turn[index])),
      Math.abs(Math.log(ratio)),
      Math.abs(now.x - goal.x) / now.distance,
      Math.abs(now.y - goal.y) / now.distance,
    );
    if (apart > 5e-4) return true;
    this.now = { ...goal };
    return false;
  }

  /** Arrives at once. */
  jump() {
    this.now = { ...this.goal };
  }

  /** Columns of the matrices to the screen, for a model of that middle and radius. */
  matrices(middle, radius, aspect) {
    const { turn, distance, x, y } = this.now;
    const scale = 1 / radius;
    const shift = [x, y, -distance];
    const toView = new Float32Array(16);
    for (let row = 0; row < 3; ++row) {
      const line = turn.slice(3 * row, 3 * row + 3).map((value) => value * scale);
      line.forEach((value, column) => (toView[4 * column + row] = value));
      toView[12 + row] = shift[row] - line.reduce((sum, value, axis) => sum + value * middle[axis], 0);
    }
    toView[15] = 1;
    const far = distance + 1.1;
    const near = Math.max(distance - 1.1, far / 2000);
    // What is higher than wide is shown as wide as it is high.
    const focal = Math.min(1, aspect) / Math.tan(FIELD / 2);
    const toClip = new Float32Array(16);
    toClip[0] = focal / aspect;
    toClip[5] = focal;
    toClip[10] = (near + far) / (near - far);
    // The bar at the foot is not to hide anything.
    toClip[9] = -0.06;
    toClip[11] = -1;
    toClip[14] = (2 * near * far) / (near - far);
    return { toView, toClip };
  }
}

/** Rotation about an axis of the screen. */
function about(axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return [
    [1, 0, 0, 0, c, -s, 0, s, c],
    [c, 0, s, 0, 1, 0, -s, 0, c],
    [c, -s, 0, s, c, 0, 0, 0, 1],
  ][axis];
}

function multiply(a, b) {
  return Array.from({ length: 9 }, (_, index) => {
    const [row, column] = [3 * Math.floor(index / 3), index % 3];
    return a[row] * b[column] + a[row + 1] * b[3 + column] + a[row + 2] * b[6 + column];
  });
}

/** Rows made perpendicular and of length one, so that errors do not add up. */
function orthonormal(rows) {
  const unit = (row) => {
    const length = Math.hypot(...row) || 1;
    return row.map((value) => value / length);
  };
  const near = unit(rows.slice(6));
  const right = rows.slice(0, 3);
  const along = right.reduce((sum, value, axis) => sum + value * near[axis], 0);
  const x = unit(right.map((value, axis) => value - along * near[axis]));
  const y = [0, 1, 2].map((axis) => {
    const [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
    return near[i] * x[j] - near[j] * x[i];
  });
  return [...x, ...y, ...near];
}
