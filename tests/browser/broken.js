// Progressive meshes that break a rule of docs/FORMATS.md, each in its own way, with checksums that
// are right: what the decoder here and the one of the command both have to refuse.

import { block, crc32, encode, header } from './encoder.js';
import { jitter, octahedron } from './shapes.js';

const BITS = 12;
const settle = jitter(BITS);
const small = encode(octahedron(BITS), { bits: BITS, batches: 1, settle });
const coarse = encode(octahedron(BITS), { bits: BITS, batches: 0, settle });

/** A file of the blocks given, whose header says what is there. */
function file(values, blocks) {
  const length = 128 + blocks.reduce((sum, part) => sum + part.length, 0);
  return Uint8Array.from(Buffer.concat([header({ ...values, length }), ...blocks]));
}

/** Wrong values in the header, and what is said of them. */
const HEADERS = [
  [{ bits: 3 }, /^byte 44: /, 0],
  [{ bits: 25 }, /^byte 44: /, 0],
  [{ step: 0 }, /^byte 72: /, 0],
  [{ step: NaN }, /^byte 72: /, 0],
  [{ origin: [0, Infinity, 0] }, /^byte 48: /, 0],
  [{ vertices: 2 ** 31 }, /^byte 24: /, 0],
  [{ faces: 2 ** 30 }, /^byte 28: /, 0],
  [{ baseVertices: 5 }, /the base is not what the header announces$/, 0],
  [{ vertices: small.values.vertices + 1 }, /the header announces another mesh than there is$/, 2],
  [{ batches: 2 }, /longer than the file|the file ends/, 2],
];

/** Raw bytes of a batch behind an octahedron, its splits and faces. */
const place = Array(12).fill(0);
const BATCHES = [
  [[6, 3, 0, ...place], 1, 2, /splits a vertex that is not there/],
  [[0, 1, 0, ...place], 1, 1, /kind 1/],
  [[0, 0, 0, ...place], 1, 2, /takes 0 faces/],
  [[0, 12, 0, ...place], 1, 2, /takes 4 faces/],
  [[0, 3, 4, ...place], 1, 2, /from 4 on/],
  [[0, 3, 0, ...place], 1, 1, /adds other faces/],
  [[0, 3, 0, ...place, 0], 1, 2, /left over/],
  [[0, 3, 0, ...place.slice(1)], 1, 2, /too short/],
  [[0, 255, 255, 255, 255, 31, 0, ...place], 1, 2, /too many bits/],
  [[0, 3, 0, ...place.map((_, index) => (index === 1 ? 255 : 0))], 1, 2, /too many bits/],
  [[], 1, 2, /too short/],
  [[], 0, 0, /0 splits/],
];

/** Corners of the one face of a base with the vertices of an octahedron. */
const BASES = [
  [[0, 2, 20], /a vertex that is not there/],
  [[1, 2, 2], /a vertex that is not there/],
  [[0, 2, 1], /a vertex twice/],
];

/** All of them: `expected` is what is said, `blocks` are those that can be shown. */
export function brokenFiles() {
  const files = HEADERS.map(([change, expected, blocks]) => ({
    name: `header ${JSON.stringify(change)}`,
    bytes: file({ ...small.values, ...change }, small.blocks),
    expected,
    blocks,
  }));
  for (const [raw, splits, faces, expected] of BATCHES) {
    const values = { ...coarse.values, batches: 1, vertices: 6 + splits, faces: 8 + faces };
    const bytes = file(values, [coarse.blocks[0], block(raw, splits, faces, 0)]);
    files.push({ name: `batch ${raw}`, bytes, expected, blocks: 1 });
  }
  for (const [corners, expected] of BASES) {
    const values = { ...coarse.values, baseFaces: 1, faces: 1 };
    const bytes = file(values, [block([...Array(36).fill(0), ...corners], 6, 1, 0)]);
    files.push({ name: `base ${corners}`, bytes, expected, blocks: 0 });
  }
  for (const raw of [1, 61, 2 ** 26]) {
    const wrong = Buffer.from(coarse.blocks[0]);
    wrong.writeUInt32LE(raw, 4);
    wrong.writeUInt32LE(crc32(wrong.subarray(0, 28)), 28);
    const bytes = file(coarse.values, [wrong]);
    files.push({ name: `raw length ${raw}`, bytes, expected: /unpacks to/, blocks: 0 });
  }
  const growing = block(Array(15).fill(0).fill(3, 1, 2), 1, 2, 1);
  const values = { ...coarse.values, batches: 1, vertices: 7, faces: 10 };
  const bytes = file(values, [coarse.blocks[0], growing]);
  return [...files, { name: 'an error that grows', bytes, expected: /grows/, blocks: 1 }];
}
