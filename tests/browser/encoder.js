// Makes progressive meshes from docs/FORMATS.md alone, the slow and obvious way: faces are triples,
// fans are searched for in all of them. Shares nothing with the decoder under test but the document.

import { deflateRawSync, crc32 as zlibCrc32 } from 'node:zlib';

/** CRC-32 (IEEE), bit by bit. */
export function crc32(bytes) {
  if (zlibCrc32) return zlibCrc32(bytes);
  let rest = 0xffffffff;
  for (const byte of bytes) {
    rest ^= byte;
    for (let bit = 0; bit < 8; ++bit) rest = (rest >>> 1) ^ (0xedb88320 & -(rest & 1));
  }
  return (rest ^ 0xffffffff) >>> 0;
}

/** Random numbers that are the same each time: `next(n)` is less than n. */
export function random(seed) {
  let state = BigInt(seed) + 1n;
  return (limit) => {
    state = (state * 6364136223846793005n + 1442695040888963407n) & 0xffffffffffffffffn;
    return Number((state >> 33n) % BigInt(limit));
  };
}

/** A mesh as the document describes it: `faces` are triples of vertices, `first` is h₀ of each. */
class DocumentMesh {
  constructor(faces, vertices) {
    this.faces = faces.map((face) => [...face]);
    this.vertices = vertices;
    /** Half-edges out of each vertex, so that not all faces need to be searched. */
    this.out = Array.from({ length: vertices }, () => []);
    this.faces.forEach((face, index) => face.forEach((v, place) => this.out[v].push(3 * index + place)));
    this.first = [];
    for (let vertex = 0; vertex < vertices; ++vertex) {
      const out = this.halfEdgesOf(vertex);
      this.first.push(out.find((half) => this.twin(half) === null) ?? out[0]);
    }
  }

  origin(half) {
    return this.faces[Math.floor(half / 3)][half % 3];
  }

  end(half) {
    return this.faces[Math.floor(half / 3)][(half % 3 + 1) % 3];
  }

  halfEdgesOf(vertex) {
    return this.out[vertex];
  }

  /** Exactly two faces have the edge, one in each direction. */
  twin(half) {
    const [a, b] = [this.origin(half), this.end(half)];
    const along = this.halfEdgesOf(a).filter((other) => this.end(other) === b);
    const against = this.halfEdgesOf(b).filter((other) => this.end(other) === a);
    return along.length === 1 && against.length === 1 ? against[0] : null;
  }

  previous(half) {
    return 3 * Math.floor(half / 3) + ((half % 3) + 2) % 3;
  }

  /** Half-edges of the fan, the neighbours, and whether it is closed. */
  fan(vertex) {
    const halves = [this.first[vertex]];
    for (;;) {
      const next = this.twin(this.previous(halves.at(-1)));
      if (next === halves[0] || next === null) {
        const neighbours = halves.map((half) => this.end(half));
        if (next === null) neighbours.push(this.origin(this.previous(halves.at(-1))));
        return { halves, neighbours, closed: next !== null };
      }
      halves.push(next);
    }
  }

  /** By the table of the document. Faces are changed first, h₀ of open fans is found anew. */
  split(parent, kind, count, begin) {
    const { halves, neighbours, closed } = this.fan(parent);
    const degree = halves.length;
    const r = this.vertices;
    const start = kind === 2 ? degree - count : begin;
    const taken = Array.from({ length: count }, (_, index) => halves[(start + index) % degree]);
    for (const half of taken) this.faces[Math.floor(half / 3)][half % 3] = r;
    this.out[parent] = this.out[parent].filter((half) => !taken.includes(half));
    this.out.push([...taken]);
    const f = 3 * this.faces.length;
    const n = (index) => neighbours[closed ? index % degree : index];
    if (kind === 0) this.faces.push([parent, n(begin), r], [parent, r, n(begin + count)]);
    if (kind === 1) this.faces.push([parent, r, n(count)]);
    if (kind === 2) this.faces.push([parent, n(degree - count), r]);
    for (let half = f; half < 3 * this.faces.length; ++half) this.out[this.origin(half)].push(half);
    this.vertices += 1;
    this.first.push(kind === 1 ? (count === 0 ? f + 1 : halves[0]) : f + 2);
    if (kind === 0 && closed) this.first[parent] = f + 3;
    // An open fan begins where there is no twin: nothing else needs to be remembered.
    for (const vertex of [parent, r, ...neighbours]) {
      const open = this.halfEdgesOf(vertex).filter((half) => this.twin(half) === null);
      if (open.length === 1) [this.first[vertex]] = open;
    }
  }
}

/** Numbers in LEB128. */
function numbers(values) {
  const bytes = [];
  for (let value of values) {
    for (; value > 127; value = Math.floor(value / 128)) bytes.push((value % 128) | 128);
    bytes.push(value);
  }
  return bytes;
}

const zigzag = (value) => (value < 0 ? -2 * value - 1 : 2 * value);

/** Triples of differences as columns. */
function coordinates(triples, bits) {
  const size = 2 ** bits;
  const signed = (value) => {
    const rest = ((value % size) + size) % size;
    return rest >= size / 2 ? rest - size : rest;
  };
  const bytes = [];
  for (let axis = 0; axis < 3; ++axis) {
    for (let place = 0; place < Math.ceil(bits / 8); ++place) {
      for (const triple of triples) bytes.push((zigzag(signed(triple[axis])) >> (8 * place)) & 255);
    }
  }
  return bytes;
}

function channels(differences, count) {
  const bytes = [];
  for (let channel = 0; channel < count; ++channel) {
    for (const difference of differences) bytes.push(difference[channel] & 255);
  }
  return bytes;
}

const minus = (a, b) => a.map((value, index) => value - b[index]);

export function block(raw, splits, faces, error) {
  const payload = deflateRawSync(Uint8Array.from(raw));
  const bytes = Buffer.alloc(32 + payload.length);
  bytes.writeUInt32LE(payload.length, 0);
  bytes.writeUInt32LE(raw.length, 4);
  bytes.writeUInt32LE(splits, 8);
  bytes.writeUInt32LE(faces, 12);
  bytes.writeFloatLE(error, 16);
  bytes.writeFloatLE(3 * error, 20);
  bytes.writeUInt32LE(crc32(payload), 24);
  bytes.writeUInt32LE(crc32(bytes.subarray(0, 28)), 28);
  payload.copy(bytes, 32);
  return bytes;
}

export function header(values) {
  const bytes = Buffer.alloc(128);
  bytes.write('\x89MMPROG\n', 'latin1');
  bytes.writeUInt32LE(1, 8);
  bytes.writeUInt32LE([0, 0, 0, 1, 3][values.channels], 12);
  bytes.writeBigUInt64LE(BigInt(values.length), 16);
  const words = ['vertices', 'faces', 'baseVertices', 'baseFaces', 'batches', 'bits'];
  words.forEach((word, index) => bytes.writeUInt32LE(values[word], 24 + 4 * index));
  values.origin.forEach((value, axis) => bytes.writeDoubleLE(value, 48 + 8 * axis));
  bytes.writeDoubleLE(values.step, 72);
  bytes.writeUInt32LE(crc32(bytes.subarray(0, 124)), 124);
  return bytes;
}

/**
 * A progressive mesh: `base` has `places` (triples in 0 to 2^bits − 1), `faces` and, with channels,
 * `colors`; `batches` times, as many splits as do not touch each other are chosen at random, and
 * `settle(place, random, middle)` says where vertices come to lie. Returns the bytes, and the mesh after each block.
 */
export function encode(base, options) {
  const { bits = 12, batches = 4, channels: count = 0, seed = 1, settle, isEven = false } = options;
  const next = random(seed);
  const mesh = new DocumentMesh(base.faces, base.places.length);
  const places = base.places.map((place) => [...place]);
  const colors = count ? base.colors.map((color) => [...color]) : null;
  const state = () => ({ places: places.flat(), faces: mesh.faces.flat(), colors: colors?.flat() });
  const zero = [0, 0, 0, 0];
  const raw = coordinates(places.map((place, index) => minus(place, places[index - 1] ?? zero)), bits);
  if (colors) raw.push(...channels(colors.map((color, at) => minus(color, colors[at - 1] ?? zero)), count));
  const corners = base.faces.flat();
  raw.push(...numbers(corners.map((corner, index) => zigzag(corner - (corners[index - 1] ?? 0)))));
  const blocks = [block(raw, places.length, base.faces.length, batches)];
  const states = [state()];
  for (let batch = 0; batch < batches; ++batch) {
    const splits = chooseSplits(mesh, next, isEven);
    const facesBefore = mesh.faces.length;
    const columns = { parents: [], codes: [], begins: [], moves: [], places: [], tints: [], newTints: [] };
    splits.forEach(({ parent, kind, count: taken, begin }, index) => {
      columns.parents.push(parent - (splits[index - 1]?.parent ?? -1) - 1);
      columns.codes.push(kind + 3 * taken);
      columns.begins.push(begin);
      const vertex = mesh.vertices;
      mesh.split(parent, kind, taken, begin);
      const before = places[parent];
      places[parent] = settle(before, next, around(mesh, places, parent));
      places.push(settle(before, next, around(mesh, places, vertex)));
      columns.moves.push(minus(places[parent], before));
      columns.places.push(minus(places[vertex], minus(before.map((value) => 2 * value), places[parent])));
      if (!colors) return;
      const colorBefore = colors[parent];
      colors[parent] = colorBefore.map(() => next(256));
      colors.push(colorBefore.map(() => next(256)));
      columns.tints.push(minus(colors[parent], colorBefore));
      columns.newTints.push(minus(colors[vertex], colorBefore));
    });
    const bytes = [...numbers(columns.parents), ...numbers(columns.codes), ...numbers(columns.begins)];
    bytes.push(...coordinates(columns.moves, bits), ...coordinates(columns.places, bits));
    if (colors) bytes.push(...channels(columns.tints, count), ...channels(columns.newTints, count));
    blocks.push(block(bytes, splits.length, mesh.faces.length - facesBefore, batches - batch - 1));
    states.push(state());
  }
  const values = {
    length: 128 + blocks.reduce((sum, { length }) => sum + length, 0),
    vertices: mesh.vertices,
    faces: mesh.faces.length,
    baseVertices: base.places.length,
    baseFaces: base.faces.length,
    batches,
    bits,
    origin: [-1, -1, -1],
    step: 2 / (2 ** bits - 1),
    channels: count,
  };
  return { bytes: Uint8Array.from(Buffer.concat([header(values), ...blocks])), blocks, values, states };
}

/** The middle of the neighbours that have a place. */
function around(mesh, places, vertex) {
  const near = mesh.fan(vertex).neighbours.map((neighbour) => places[neighbour]).filter(Boolean);
  return [0, 1, 2].map((axis) => near.reduce((sum, place) => sum + place[axis], 0) / near.length);
}

/** Splits that do not touch each other: what is in the fan of one parent is in that of no other.
 * `isEven` halves each fan, the largest first, for shapes that are to look well. */
function chooseSplits(mesh, next, isEven) {
  const used = new Set();
  const splits = [];
  const order = Array.from({ length: mesh.vertices }, (_, vertex) => vertex);
  if (isEven) order.sort((a, b) => mesh.halfEdgesOf(b).length - mesh.halfEdgesOf(a).length);
  for (const parent of order) {
    if (mesh.first[parent] === undefined || next(3) === 0) continue;
    const { halves, neighbours, closed } = mesh.fan(parent);
    if (halves.length !== mesh.halfEdgesOf(parent).length) continue;
    const around = [parent, ...neighbours];
    if (around.some((vertex) => used.has(vertex))) continue;
    around.forEach((vertex) => used.add(vertex));
    const degree = halves.length;
    const kind = closed ? 0 : next(3);
    if (kind > 0) {
      splits.push({ parent, kind, count: next(degree + 1), begin: 0 });
    } else if (closed) {
      const taken = isEven ? Math.floor(degree / 2) : 1 + next(degree - 1);
      if (degree > 1) splits.push({ parent, kind, count: taken, begin: next(degree) });
    } else {
      const begin = next(degree);
      splits.push({ parent, kind, count: 1 + next(degree - begin), begin });
    }
  }
  return splits.sort((a, b) => a.parent - b.parent);
}
