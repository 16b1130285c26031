// The decoder without a browser: what it makes of files from an encoder that knows only the
// document, whatever the chunks, and what it says of files that are wrong.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { decode } from '../../src/viewer/decode.js';
import { Mesh } from '../../src/viewer/mesh.js';
import { block, crc32, encode, header } from './encoder.js';
import { bowtie, colored, jitter, octahedron, sheet } from './shapes.js';

const BITS = 12;
const settle = jitter(BITS);

export async function* inChunks(bytes, size = bytes.length) {
  for (let begin = 0; begin < bytes.length; begin += size) yield bytes.subarray(begin, begin + size);
}

/** The mesh that is there at the end, and why it ended: null for a whole file. */
async function decoded(bytes, size) {
  let mesh = null;
  let fault = null;
  let parts = 0;
  try {
    for await (const part of decode(inChunks(bytes, size))) {
      if (part.kind === 'header') mesh = new Mesh(part);
      if (part.kind === 'base' || part.kind === 'batch') {
        mesh.add(part);
        parts += 1;
      }
    }
  } catch (error) {
    fault = error.message;
  }
  return { mesh, fault, parts };
}

/** Shows everything; plain arrays to compare. */
function shown(mesh, faces = Infinity) {
  mesh.skipFinished();
  mesh.approach(faces, Infinity);
  return {
    places: [...mesh.positions.array.subarray(0, 3 * mesh.vertices)],
    faces: [...mesh.corners.array.subarray(0, 3 * mesh.faces)],
  };
}

const shapes = {
  'a closed surface': octahedron(BITS),
  'a sheet with a boundary': sheet(BITS, 3),
  'a bow tie': bowtie(BITS),
};

for (const [name, base] of Object.entries(shapes)) {
  test(`${name} is refined as the document says`, async () => {
    for (let seed = 1; seed <= 8; ++seed) {
      const { bytes, states } = encode(base, { bits: BITS, batches: 6, seed, settle });
      const { mesh, fault } = await decoded(bytes);
      assert.equal(fault, null);
      const { places, faces } = states.at(-1);
      assert.deepEqual(shown(mesh), { places, faces });
    }
  });

  test(`${name} goes back through every state it came through`, async () => {
    const { bytes, states } = encode(base, { bits: BITS, batches: 5, settle });
    const { mesh } = await decoded(bytes);
    shown(mesh);
    for (const { places, faces } of [...states.toReversed(), ...states]) {
      assert.deepEqual(shown(mesh, faces.length / 3), { places, faces });
    }
  });
}

test('any number of triangles can be shown, and splits in between change nothing', async () => {
  const { bytes, states } = encode(octahedron(BITS), { bits: BITS, batches: 8, settle });
  const { mesh } = await decoded(bytes);
  for (const wanted of [100, 11, 57, 8, 9, 300, 10, 0]) {
    mesh.approach(wanted, Infinity);
    assert.ok(mesh.faces <= Math.max(8, wanted) && mesh.faces >= Math.min(mesh.facesArrived, wanted) - 1);
  }
  const { places, faces } = states.at(-1);
  assert.deepEqual(shown(mesh), { places, faces });
});

test('colours with and without an alpha arrive', async () => {
  for (const channels of [3, 4]) {
    const base = colored(octahedron(BITS), channels);
    const { bytes, states } = encode(base, { bits: BITS, batches: 5, channels, settle });
    const { mesh, fault } = await decoded(bytes);
    assert.equal(fault, null);
    shown(mesh);
    for (const { faces, colors } of states.toReversed()) {
      shown(mesh, faces.length / 3);
      const found = [...mesh.colors.array.subarray(0, 4 * mesh.vertices)];
      assert.deepEqual(found.filter((_, index) => index % 4 < channels), colors);
      if (channels === 3) assert.ok(found.every((value, index) => index % 4 < 3 || value === 255));
    }
  }
});

test('every width of coordinates is read', async () => {
  for (const bits of [4, 8, 9, 16, 17, 24]) {
    const { bytes, states } = encode(octahedron(bits), { bits, batches: 4, settle: jitter(bits) });
    const { mesh, fault } = await decoded(bytes);
    assert.equal(fault, null);
    const { places, faces } = states.at(-1);
    assert.deepEqual(shown(mesh), { places, faces });
  }
});

test('the size of the chunks does not matter', async () => {
  const { bytes } = encode(sheet(BITS, 4), { bits: BITS, batches: 8, settle });
  const whole = shown((await decoded(bytes)).mesh);
  for (const size of [1, 7, 128, 1024]) {
    assert.deepEqual(shown((await decoded(bytes, size)).mesh), whole);
  }
});

test('every prefix is an error that says where, and a mesh of whole blocks', async () => {
  const { bytes, blocks, states } = encode(octahedron(BITS), { bits: BITS, batches: 3, settle });
  for (let length = 0; length < bytes.length; ++length) {
    const { mesh, fault, parts } = await decoded(bytes.subarray(0, length), 100);
    assert.match(fault, /^byte \d+: the file ends in (the header|the base|batch \d)$/);
    assert.equal(Number(fault.match(/\d+/)[0]), length);
    let end = 128;
    const whole = blocks.filter((part) => (end += part.length) <= length).length;
    assert.equal(parts, whole);
    if (whole > 0) assert.equal(shown(mesh).places.length, states[whole - 1].places.length);
  }
});

test('every byte that is wrong is found, and no mesh is wrong for it', async () => {
  const { bytes, states } = encode(octahedron(BITS), { bits: BITS, batches: 3, settle });
  for (let place = 0; place < bytes.length; ++place) {
    const wrong = bytes.slice();
    wrong[place] ^= 1 << (place % 8);
    const { mesh, fault, parts } = await decoded(wrong);
    assert.ok(fault, `byte ${place}`);
    if (parts > 0) {
      const { places, faces } = states[parts - 1];
      assert.deepEqual(shown(mesh), { places, faces });
    }
  }
});

/** A file of the blocks given, whose header says what is there. */
function file(values, blocks) {
  const length = 128 + blocks.reduce((sum, part) => sum + part.length, 0);
  return Uint8Array.from(Buffer.concat([header({ ...values, length }), ...blocks]));
}

test('a header that cannot be is refused', async () => {
  const { blocks, values } = encode(octahedron(BITS), { bits: BITS, batches: 1, settle });
  const changes = [
    [{ bits: 3 }, /^byte 44: /],
    [{ bits: 25 }, /^byte 44: /],
    [{ step: 0 }, /^byte 72: /],
    [{ step: NaN }, /^byte 72: /],
    [{ origin: [0, Infinity, 0] }, /^byte 48: /],
    [{ vertices: 2 ** 31 }, /^byte 24: /],
    [{ faces: 2 ** 30 }, /^byte 28: /],
    [{ baseVertices: 5 }, /the base is not what the header announces$/],
    [{ vertices: values.vertices + 1 }, /the header announces another mesh than there is$/],
    [{ batches: 2 }, /longer than the file|the file ends/],
  ];
  for (const [change, expected] of changes) {
    const { fault } = await decoded(file({ ...values, ...change }, blocks));
    assert.match(fault ?? 'nothing', expected, JSON.stringify(change));
  }
});

test('a version from the future, another file, and bytes behind the end are told apart', async () => {
  const { bytes } = encode(octahedron(BITS), { bits: BITS, batches: 1, settle });
  const future = bytes.slice();
  future[8] = 2;
  assert.match((await decoded(future)).fault, /^byte 8: version 2 is not known/);
  assert.match((await decoded(new TextEncoder().encode('x'.repeat(500)))).fault, /no progressive mesh/);
  const longer = Uint8Array.from([...bytes, 0]);
  const { fault, parts } = await decoded(longer);
  assert.match(fault, /bytes follow the last batch/);
  assert.equal(parts, 2);
});

/** An octahedron and one batch with these raw bytes. */
async function withBatch(raw, splits, faces) {
  const { blocks, values } = encode(octahedron(BITS), { bits: BITS, batches: 0, settle });
  const head = { ...values, batches: 1, vertices: 6 + splits, faces: 8 + faces };
  return decoded(file(head, [blocks[0], block(raw, splits, faces, 0)]));
}

const place = Array(12).fill(0);

test('a split that cannot be is refused, and the mesh before it stays', async () => {
  const cases = [
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
  ];
  for (const [raw, splits, faces, expected] of cases) {
    const { mesh, fault, parts } = await withBatch(raw, splits, faces);
    assert.match(fault ?? 'nothing', expected, raw.join());
    assert.match(fault, /^byte \d+: /);
    assert.equal(parts, 1);
    assert.equal(shown(mesh).faces.length, 24);
  }
  assert.equal((await withBatch([0, 3, 3, ...place], 1, 2)).fault, null);
});

test('a base with a vertex that is not there or a face that is none is refused', async () => {
  const { values } = encode(octahedron(BITS), { bits: BITS, batches: 0, settle });
  const base = { ...values, baseFaces: 1, faces: 1 };
  for (const [corners, expected] of [
    [[0, 2, 20], /a vertex that is not there/],
    [[1, 2, 2], /a vertex that is not there/],
    [[0, 2, 1], /a vertex twice/],
  ]) {
    const raw = [...Array(36).fill(0), ...corners];
    const { fault } = await decoded(file(base, [block(raw, 6, 1, 0)]));
    assert.match(fault ?? 'nothing', expected);
  }
});

test('a block that unpacks to more or less than it says is refused', async () => {
  const { blocks, values } = encode(octahedron(BITS), { bits: BITS, batches: 0, settle });
  for (const raw of [1, 61, 2 ** 26]) {
    const wrong = Buffer.from(blocks[0]);
    wrong.writeUInt32LE(raw, 4);
    wrong.writeUInt32LE(crc32(wrong.subarray(0, 28)), 28);
    assert.match((await decoded(file(values, [wrong]))).fault, /unpacks to/);
  }
});

test('decoding ends where no more faces are wanted', async () => {
  const { bytes, blocks } = encode(octahedron(BITS), { bits: BITS, batches: 6, settle });
  const kinds = [];
  for await (const part of decode(inChunks(bytes, 64), 10)) kinds.push(part.kind);
  assert.equal(kinds.at(-1), 'end');
  assert.ok(kinds.length < blocks.length + 2);
});
