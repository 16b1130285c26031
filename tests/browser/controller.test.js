// The controller on machines that are made up, with a clock that is made up, too.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { LoadController } from '../../src/viewer/controller.js';

/** A machine that draws so many triangles in a millisecond, after `base` ms for each frame. */
class Machine {
  constructor({ perMs, base = 2, total, targetFps = 30 }) {
    Object.assign(this, { perMs, base, total, now: 1000, shown: total });
    this.controller = new LoadController({ targetFps });
  }

  /** Frames while something moves; returns what was shown and how long frames took. */
  move(milliseconds) {
    const frames = [];
    const end = this.now + milliseconds;
    while (this.now < end) {
      this.controller.moved(this.now);
      this.controller.frame(this.now, this.shown);
      this.shown = Math.round(Math.min(this.total, this.controller.allowed(this.now)));
      // Screens show no more than sixty pictures a second.
      const frameMs = Math.max(1000 / 60, this.base + this.shown / this.perMs);
      this.now += frameMs;
      frames.push({ shown: this.shown, frameMs });
    }
    return frames;
  }

  rest(milliseconds) {
    this.controller.pause();
    this.now += milliseconds;
    this.shown = Math.min(this.total, this.controller.allowed(this.now));
  }
}

const last = (frames, count) => frames.slice(-count);

test('a mesh that is too much is made coarser until the frame rate holds', () => {
  const machine = new Machine({ perMs: 10_000, total: 2_000_000 });
  const frames = machine.move(6000);
  assert.ok(last(frames, 60).every(({ frameMs }) => frameMs < 1.25 * (1000 / 30)));
  assert.ok(last(frames, 60).every(({ shown }) => shown > 100_000), 'not more than needed');
});

test('frames of seconds are slow frames, too', () => {
  const machine = new Machine({ perMs: 700, total: 2_000_000 });
  const frames = machine.move(30_000);
  assert.ok(frames.findIndex(({ frameMs }) => frameMs < 100) < 20);
  assert.ok(last(frames, 60).every(({ frameMs }) => frameMs < 1.5 * (1000 / 30)));
});

test('a mesh that is no trouble is shown in full all the time', () => {
  const machine = new Machine({ perMs: 1_000_000, total: 2_000_000 });
  assert.ok(machine.move(3000).every(({ shown }) => shown === 2_000_000));
});

test('the count settles and does not swing', () => {
  const machine = new Machine({ perMs: 20_000, total: 5_000_000 });
  const settled = machine.move(12_000).slice(-200).map(({ shown }) => shown);
  let turns = 0;
  let direction = 0;
  settled.slice(1).forEach((shown, index) => {
    const step = Math.sign(shown - settled[index]);
    if (step !== 0 && direction !== 0 && step !== direction) turns += 1;
    if (step !== 0) direction = step;
  });
  assert.ok(turns <= 2, `${turns} turns`);
  assert.ok(Math.max(...settled) < 2 * Math.min(...settled));
});

test('at rest everything is shown, and the next movement begins with what was found', () => {
  const machine = new Machine({ perMs: 10_000, total: 2_000_000 });
  const before = machine.move(4000).at(-1).shown;
  machine.rest(100);
  assert.ok(machine.shown < 2_000_000, 'a moment between two movements is no rest');
  machine.rest(400);
  assert.equal(machine.shown, 2_000_000);
  const [first] = machine.move(50);
  assert.ok(first.shown <= 1.3 * before && first.shown >= 0.5 * before);
});

test('a machine that becomes faster is used', () => {
  const machine = new Machine({ perMs: 5000, total: 2_000_000 });
  const slow = machine.move(6000).at(-1).shown;
  machine.perMs = 50_000;
  const fast = machine.move(20_000).at(-1).shown;
  assert.ok(fast > 4 * slow, `${slow} and then ${fast}`);
});

test('one slow frame and a page that was hidden change little', () => {
  const machine = new Machine({ perMs: 50_000, total: 1_000_000 });
  machine.move(3000);
  machine.now += 120;
  const [after] = machine.move(20);
  assert.ok(after.shown >= 500_000);
  const other = new Machine({ perMs: 50_000, total: 1_000_000 });
  other.move(3000);
  other.now += 60_000;
  assert.equal(other.move(1000).at(-1).shown, 1_000_000);
});

test('something is always shown, however slow the machine', () => {
  const machine = new Machine({ perMs: 1, base: 100, total: 2_000_000 });
  assert.ok(machine.move(60_000).every(({ shown }) => shown >= 1000));
});

test('the rate that is wanted is the one that is held', () => {
  const shown = [15, 60].map((targetFps) => {
    const machine = new Machine({ perMs: 10_000, total: 5_000_000, targetFps });
    return machine.move(8000).at(-1).shown;
  });
  assert.ok(shown[0] > 2.5 * shown[1], shown.join());
});
