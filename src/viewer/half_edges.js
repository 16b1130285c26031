// The connectivity of a growing mesh, as docs/FORMATS.md says: half-edge h = 3 f + c goes out of
// corner c of face f. Knows no positions. Splits are checked before anything is changed.

import { Fault } from './bytes.js';

/** The most faces around a vertex that is split: bounds the time that a file can ask for. */
const FAN_FACES_MAX = 1024;

export class HalfEdges {
  /** From the corners of the base: three vertices for each face, all less than `vertices`. */
  constructor(corners, vertices) {
    this.vertices = vertices;
    this.faces = corners.length / 3;
    /** By half-edge: the vertex it goes out of. */
    this.origin = corners.slice();
    /** By half-edge: the one that goes the other way, or −1. */
    this.twin = pairTwins(corners, vertices);
    /** By vertex: where its fan begins (h₀), −1 without a face, −2 where its faces are no fan. */
    this.first = firstHalfEdges(corners, this.twin, vertices);
    /** The fan that was walked last: half-edges out of a vertex, counter-clockwise. */
    this.fan = new Int32Array(FAN_FACES_MAX);
    this.isClosed = false;
    /** Half-edges whose origin became a new vertex, in the order of the splits. */
    this.moved = new Uint32Array(1024);
    this.movedCount = 0;
  }

  /** Makes room for more vertices and faces. */
  reserve(vertices, faces) {
    this.first = grown(this.first, this.vertices + vertices);
    this.origin = grown(this.origin, 3 * (this.faces + faces));
    this.twin = grown(this.twin, 3 * (this.faces + faces));
  }

  /** Finds the fan of a vertex; returns how many faces it has. */
  walk(vertex) {
    const { twin, fan } = this;
    const start = this.first[vertex];
    if (start < 0) throw new Fault(`the faces of vertex ${vertex} are no fan`);
    let count = 0;
    let half = start;
    do {
      if (count === FAN_FACES_MAX) throw new Fault(`vertex ${vertex} has too many faces to be split`);
      fan[count++] = half;
      half = twin[half % 3 === 0 ? half + 2 : half - 1];
    } while (half >= 0 && half !== start);
    this.isClosed = half === start;
    return count;
  }

  /**
   * Splits p: the new vertex r takes `count` faces from the `begin`-th of its fan on. Returns the
   * faces it adds: f₁ = (p, n_a, r) of kinds 0 and 2 begins with half-edge `f`, f₂ = (p, r, n_b) of
   * kinds 0 and 1 with `g`; −1 stands for what is not there.
   */
  split(p, kind, count, begin) {
    const degree = this.checkedDegree(p, kind, count, begin);
    const { origin, twin, first, fan } = this;
    const isEmpty = count === 0;
    const start = kind === 2 ? degree - count : begin;
    // The outermost half-edges of what r takes, and what lies beyond them.
    const a = isEmpty ? -1 : fan[start];
    const b = isEmpty ? -1 : previous(fan[(start + count - 1) % degree]);
    const beyondA = isEmpty ? previous(fan[degree - 1]) : twin[a];
    const beyondB = isEmpty ? fan[0] : twin[b];
    const neighbourA = isEmpty ? origin[beyondA] : origin[next(a)];
    const neighbourB = isEmpty ? origin[next(beyondB)] : origin[b];
    this.move(start, count, degree);
    const r = this.vertices++;
    const f = kind === 1 ? -1 : 3 * this.faces++;
    const g = kind === 2 ? -1 : 3 * this.faces++;
    if (f >= 0) {
      this.addFace(f, p, neighbourA, r);
      this.pair(f, beyondA);
      this.pair(f + 1, a);
      this.pair(f + 2, g);
    }
    if (g >= 0) {
      this.addFace(g, p, r, neighbourB);
      this.pair(g, f < 0 ? -1 : f + 2);
      this.pair(g + 1, b);
      this.pair(g + 2, beyondB);
    }
    if (this.isClosed || kind === 1) first[p] = g;
    else if (start === 0) first[p] = f;
    first[r] = f >= 0 ? f + 2 : isEmpty ? g + 1 : a;
    // At the end of an open fan, n_b's boundary goes along the new face.
    if (g >= 0 && beyondB < 0 && first[neighbourB] === b) first[neighbourB] = g + 2;
    if (kind === 2 && isEmpty && first[neighbourA] === beyondA) first[neighbourA] = f + 1;
    return kind === 0 ? 2 : 1;
  }

  checkedDegree(parent, kind, count, begin) {
    const degree = this.walk(parent);
    const fits = kind !== 0
      ? !this.isClosed && begin === 0 && count <= degree
      : count >= 1 && (this.isClosed ? count < degree && begin < degree : begin + count <= degree);
    if (fits) return degree;
    throw new Fault(`a split of kind ${kind} takes ${count} faces from ${begin} on, of ${degree}`);
  }

  /** Gives faces of the fan that was walked to the new vertex. */
  move(begin, count, degree) {
    const { origin, fan } = this;
    const total = this.movedCount + count;
    if (total > this.moved.length) this.moved = grown(this.moved, total);
    const { moved } = this;
    for (let index = 0; index < count; ++index) {
      const half = fan[(begin + index) % degree];
      origin[half] = this.vertices;
      moved[this.movedCount + index] = half;
    }
    this.movedCount = total;
  }

  addFace(half, a, b, c) {
    this.origin[half] = a;
    this.origin[half + 1] = b;
    this.origin[half + 2] = c;
  }

  /** Makes two half-edges each other's twins; `other` may be −1. */
  pair(half, other) {
    this.twin[half] = other;
    if (other >= 0) this.twin[other] = half;
  }
}

function next(half) {
  return half % 3 === 2 ? half - 2 : half + 1;
}

function previous(half) {
  return half % 3 === 0 ? half + 2 : half - 1;
}

/** `array`, or a larger copy of it that holds at least `length`. */
export function grown(array, length) {
  if (length <= array.length) return array;
  const larger = new array.constructor(Math.max(length, Math.ceil(1.5 * array.length)));
  larger.set(array);
  return larger;
}

/** Twins where exactly two faces have an edge, one in each direction; −1 elsewhere. */
function pairTwins(corners, vertices) {
  const end = (half) => corners[next(half)];
  const low = (half) => Math.min(corners[half], end(half));
  const high = (half) => Math.max(corners[half], end(half));
  const all = Int32Array.from(corners, (_, half) => half);
  // Sorted by both ends, the half-edges of an edge are neighbours.
  const order = sortedBy(sortedBy(all, high, vertices), low, vertices);
  const twin = new Int32Array(corners.length).fill(-1);
  for (let begin = 0, stop = 0; begin < order.length; begin = stop) {
    const half = order[begin];
    for (stop = begin + 1; stop < order.length; ++stop) {
      if (low(order[stop]) !== low(half) || high(order[stop]) !== high(half)) break;
    }
    const other = order[begin + 1];
    if (stop - begin === 2 && corners[half] === end(other) && corners[other] === end(half)) {
      twin[half] = other;
      twin[other] = half;
    }
  }
  return twin;
}

/** `items` in the order of `key` (less than `keys`); those with equal keys stay in order. */
function sortedBy(items, key, keys) {
  const places = new Int32Array(keys + 1);
  for (const item of items) places[key(item) + 1] += 1;
  for (let index = 0; index < keys; ++index) places[index + 1] += places[index];
  const sorted = new Int32Array(items.length);
  for (const item of items) sorted[places[key(item)]++] = item;
  return sorted;
}

/** h₀ of every vertex of the base; −1 without a face, −2 where the faces are more than one fan. */
function firstHalfEdges(corners, twin, vertices) {
  const first = new Int32Array(vertices).fill(-1);
  const degree = new Int32Array(vertices);
  for (let half = 0; half < corners.length; ++half) {
    const vertex = corners[half];
    degree[vertex] += 1;
    const found = first[vertex];
    if (found < 0 || (twin[half] < 0 && twin[found] >= 0)) first[vertex] = half;
  }
  for (let vertex = 0; vertex < vertices; ++vertex) {
    let half = first[vertex];
    let count = 0;
    while (half >= 0 && !(count > 0 && half === first[vertex])) {
      half = twin[previous(half)];
      count += 1;
    }
    if (count !== degree[vertex]) first[vertex] = -2;
  }
  return first;
}
