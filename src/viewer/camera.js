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

  /** Follows the goal for some milliseconds; returns whether it has moved, the last step included. */
  follow(elapsed) {
    const { now, goal } = this;
    if (now === goal) return false;
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
    const aparts = now.turn.map((value, index) => value - goal.turn[index]);
    aparts.push(Math.log(ratio), (now.x - goal.x) / now.distance, (now.y - goal.y) / now.distance);
    if (Math.hypot(...aparts) < 1e-3) this.jump();
    return true;
  }

  /** Arrives at once. */
  jump() {
    this.now = this.goal;
  }

  /** Columns of the matrices to the screen, for a model of that middle and radius. */
  matrices(middle, radius, aspect) {
    const { turn, distance, x, y } = this.now;
    const row = (index) => turn.slice(3 * index, 3 * index + 3).map((value) => value / radius);
    const rows = [0, 1, 2].map(row);
    const shift = [x, y, -distance].map((value, index) => value - dot(rows[index], middle));
    const column = (axis) => [...rows.map((line) => line[axis]), 0];
    const toView = [...column(0), ...column(1), ...column(2), ...shift, 1];
    const far = distance + 1.1;
    const near = Math.max(distance - 1.1, far / 2000);
    // What is higher than wide is shown as wide as it is high.
    const focal = Math.min(1, aspect) / Math.tan(FIELD / 2);
    const [scale, offset] = [(near + far) / (near - far), (2 * near * far) / (near - far)];
    // Raised a little: the bar at the foot is not to hide anything.
    const toClip = [focal / aspect, 0, 0, 0, 0, focal, 0, 0, 0, -0.06, scale, -1, 0, 0, offset, 0];
    return { toView, toClip };
  }
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
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
    const [row, column] = [index - (index % 3), index % 3];
    return a[row] * b[column] + a[row + 1] * b[3 + column] + a[row + 2] * b[6 + column];
  });
}

/** Rows made perpendicular and of length one, so that errors do not add up. */
function orthonormal(rows) {
  const unit = (row) => row.map((value) => value / (Math.hypot(...row) || 1));
  const z = unit(rows.slice(6));
  const along = dot(rows, z);
  const x = unit(z.map((value, axis) => rows[axis] - along * value));
  return [...x, z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0], ...z];
}
