// The decoder beside the command's: the same mesh from the same file, refused where it refuses, and
// what `refine` writes as glTF is valid. The command is the one that MESHMILL names.

import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { mkdtemp, readFile, rm, writeFile } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { promisify } from 'node:util';

import { decode } from '../../src/viewer/decode.js';
import { Mesh } from '../../src/viewer/mesh.js';
import { brokenFiles } from './broken.js';
import { encode } from './encoder.js';
import { colored, jitter, octahedron, sheet } from './shapes.js';

const command = process.env.MESHMILL;
const skip = command ? false : 'MESHMILL does not name the command';
if (skip) console.error(`tests beside the command are skipped: ${skip}`);

const run = (...words) => promisify(execFile)(command, words);

let folder;
before(async () => {
  folder = await mkdtemp(join(tmpdir(), 'meshmill-refine-'));
});
after(() => rm(folder, { recursive: true }));

async function* inChunks(bytes) {
  yield Uint8Array.from(bytes);
}

/** The mesh of a file, with as many of its faces as are wanted. */
async function decoded(bytes, faces = Infinity) {
  let mesh = null;
  for await (const part of decode(inChunks(bytes))) {
    if (part.kind === 'header') mesh = new Mesh(part);
    else if (part.kind !== 'end') mesh.add(part);
  }
  mesh.approach(faces, Infinity);
  const { origin, step } = mesh.header;
  const places = [...mesh.positions.array.subarray(0, 3 * mesh.vertices)];
  // Single precision moves positions by much less than a step.
  const integers = (found) => found.map((value, index) => Math.round((value - origin[index % 3]) / step));
  return { places, faces: [...mesh.corners.array.subarray(0, 3 * mesh.faces)], integers };
}

/** Positions and faces of a binary PLY of triangles. */
function readPly(bytes) {
  const end = bytes.indexOf('end_header\n') + 11;
  const header = bytes.subarray(0, end).toString('latin1');
  const count = (name) => Number(new RegExp(`element ${name} (\\d+)`).exec(header)[1]);
  const properties = header.split('element face')[0].match(/property \w+ \w+/g);
  const sizes = properties.map((line) => ({ double: 8, float: 4, uchar: 1 })[line.split(' ')[1]]);
  const stride = sizes.reduce((sum, size) => sum + size, 0);
  const value = (offset) => (sizes[0] === 8 ? bytes.readDoubleLE(offset) : bytes.readFloatLE(offset));
  const places = [];
  for (let vertex = 0; vertex < count('vertex'); ++vertex) {
    for (let axis = 0; axis < 3; ++axis) places.push(value(end + stride * vertex + axis * sizes[0]));
  }
  const faces = [];
  const start = end + stride * count('vertex');
  for (let face = 0; face < count('face'); ++face) {
    assert.equal(bytes[start + 13 * face], 3);
    for (let corner = 0; corner < 3; ++corner) faces.push(bytes.readUInt32LE(start + 13 * face + 1 + 4 * corner));
  }
  return { places, faces };
}

async function expectSame(bytes, count, out) {
  const { places, faces, integers } = await decoded(bytes, count);
  const found = readPly(await readFile(out));
  assert.deepEqual(faces, found.faces);
  assert.deepEqual(places, integers(found.places));
}

/** Faces after every fifth block: of a part of a batch, refine chooses other splits. */
async function countsAfterBlocks(bytes) {
  const counts = [];
  let faces = 0;
  for await (const part of decode(inChunks(bytes))) {
    faces += (part.corners?.length ?? 0) / 3;
    if (part.corners) counts.push(faces);
  }
  return counts.filter((_, index) => index % 5 === 0 || index === counts.length - 1);
}

test('a real file gives the mesh that refine gives, after any block', { skip }, async () => {
  const [mesh, file, out] = ['m.ply', 'm.pm', 'out.ply'].map((name) => join(folder, name));
  await run('generate', 'gyroid', '--triangles', '20k', '-o', mesh);
  await run('progressive', mesh, '-o', file);
  const bytes = await readFile(file);
  for (const count of await countsAfterBlocks(bytes)) {
    await run('refine', file, '-o', out, '--force', '-t', String(count));
    await expectSame(bytes, count, out);
  }
});

test('files from the document alone are refined alike by both', { skip }, async () => {
  const [file, out] = ['d.pm', 'd.ply'].map((name) => join(folder, name));
  for (const base of [octahedron(12), sheet(12, 4)]) {
    const { bytes } = encode(base, { bits: 12, batches: 8, settle: jitter(12) });
    await writeFile(file, bytes);
    await run('refine', file, '-o', out, '--force');
    await expectSame(bytes, Infinity, out);
  }
});

test('what the decoder refuses, refine refuses with exit code 3', { skip }, async () => {
  const [file, out] = ['b.pm', 'b.ply'].map((name) => join(folder, name));
  for (const { name, bytes } of brokenFiles()) {
    await writeFile(file, bytes);
    await assert.rejects(run('refine', file, '-o', out, '--force'), ({ code }) => {
      assert.equal(code, 3, name);
      return true;
    }, name);
  }
});

test('what refine writes as glTF is valid', { skip }, async (context) => {
  const validator = await import('gltf-validator').catch(() => null);
  if (!validator) return context.skip("gltf-validator is missing: run 'npm ci' in tests/browser");
  const [file, out] = ['g.pm', 'g.glb'].map((name) => join(folder, name));
  for (const [base, channels] of [[octahedron(12), 0], [colored(sheet(12, 4), 3), 3]]) {
    const { bytes } = encode(base, { bits: 12, batches: 6, channels, settle: jitter(12) });
    await writeFile(file, bytes);
    await run('refine', file, '-o', out, '--force');
    const written = Uint8Array.from(await readFile(out));
    const { issues } = await validator.default.validateBytes(written);
    assert.equal(issues.numErrors + issues.numWarnings, 0, JSON.stringify(issues.messages));
  }
});
