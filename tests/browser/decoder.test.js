// The decoder without a browser: what it makes of files from an encoder that knows only the
// document, whatever the chunks, and what it says of files that are wrong.

import assert from 'node:assert/strict';
import { readdir, readFile } from 'node:fs/promises';
import { test } from 'node:test';

import { decode } from '../../src/viewer/decode.js';
import { Mesh } from '../../src/viewer/mesh.js';
import { brokenFiles } from './broken.js';
import { encode } from './encoder.js';
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

test('what breaks a rule is refused, says where, and leaves what came before it', async () => {
  for (const { name, bytes, expected, blocks } of brokenFiles()) {
    const { mesh, fault, parts } = await decoded(bytes);
    assert.match(fault ?? 'nothing', expected, name);
    assert.match(fault, /^byte \d+: /, name);
    assert.equal(parts, blocks, name);
    if (blocks > 0) assert.ok(shown(mesh).faces.length >= 24, name);
  }
});

const GOLDEN = new URL('../../testdata/progressive/', import.meta.url);
/** Files of the command that are whole; all others there are wrong in some way. */
const WHOLE = ['hills.pm', 'hills-colored.pm', 'octahedron.pm'];

test('the files that the command is tested with are accepted and refused as there', async () => {
  const names = (await readdir(GOLDEN)).filter((name) => name.endsWith('.pm'));
  assert.ok(WHOLE.every((name) => names.includes(name)));
  for (const name of names) {
    const { fault, parts } = await decoded(new Uint8Array(await readFile(new URL(name, GOLDEN))), 1000);
    assert.equal(fault === null, WHOLE.includes(name), `${name}: ${fault}`);
    const hasBase = !/header|magic|base|future/.test(name);
    assert.equal(parts > 0, hasBase, name);
  }
});

test('decoding ends where no more faces are wanted', async () => {
  const { bytes, blocks } = encode(octahedron(BITS), { bits: BITS, batches: 6, settle });
  const kinds = [];
  for await (const part of decode(inChunks(bytes, 64), 10)) kinds.push(part.kind);
  assert.equal(kinds.at(-1), 'end');
  assert.ok(kinds.length < blocks.length + 2);
});
