// A progressive mesh (docs/FORMATS.md) from its bytes, block by block as they arrive. Everything
// that is handed out has been checked; whatever was handed out before a fault is a valid mesh.

import { ByteReader, Columns, crc32, Fault, inflate, RAW_BYTES_MAX, unzigzag } from './bytes.js';
import { grown, HalfEdges } from './half_edges.js';

/** The most splits that one batch may hold. */
const BATCH_SPLITS_MAX = 65536;

/**
 * Decodes an async iterable of chunks (`Uint8Array`): yields the header, the base and each batch,
 * as plain objects of numbers and typed arrays. Stops, with `isWhole` false, in front of the first
 * block that is not needed to show `facesMax` faces.
 */
export async function* decode(chunks, facesMax = Infinity) {
  const bytes = new ByteReader(chunks);
  const header = readHeader(await bytes.take(128, 'the header'));
  yield { kind: 'header', ...header };
  let state = null;
  let before = { rms: Infinity, maximum: Infinity };
  for (let index = 0; index <= header.batches; ++index) {
    if (state && state.mesh.faces >= facesMax) {
      yield { kind: 'end', isWhole: false };
      return;
    }
    const what = index === 0 ? 'the base' : `batch ${index}`;
    const offset = bytes.offset;
    try {
      const head = readHead(await bytes.take(32, what), before, header.length - offset);
      const packed = await bytes.take(head.length, what);
      if (crc32(packed) !== head.checksum) throw new Fault(`the checksum of ${what} is wrong`);
      const columns = new Columns(await inflate(packed, head.rawLength, what), what);
      const decodeBlock = state ? decodeBatch : decodeBase;
      const block = decodeBlock(columns, head, header, state);
      state ??= block.state;
      before = head;
      yield { ...block.shown, rms: head.rms, maximum: head.maximum, bytes: bytes.offset };
    } catch (error) {
      const place = error.message.startsWith('byte ') ? '' : `byte ${offset}: `;
      throw error instanceof Fault ? new Fault(place + error.message) : error;
    }
  }
  await checkEnd(bytes, header, state.mesh);
  yield { kind: 'end', isWhole: true };
}

async function checkEnd(bytes, header, mesh) {
  const { offset } = bytes;
  if (mesh.vertices !== header.vertices || mesh.faces !== header.faces || offset !== header.length) {
    throw new Fault(`byte ${offset}: the header announces another mesh than there is`);
  }
  if (!(await bytes.isAtEnd())) throw new Fault(`byte ${offset}: bytes follow the last batch`);
}

function readHeader(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const u32 = (offset) => view.getUint32(offset, true);
  const f64 = (offset) => view.getFloat64(offset, true);
  const expect = (fits, offset, why) => {
    if (!fits) throw new Fault(`byte ${offset}: ${why}`);
  };
  expect(String.fromCharCode(...bytes.subarray(0, 8)) === '\x89MMPROG\n', 0, 'this is no progressive mesh');
  expect(u32(8) === 1, 8, `version ${u32(8)} is not known, only version 1`);
  expect(crc32(bytes.subarray(0, 124)) === u32(124), 124, 'the checksum of the header is wrong');
  const channels = [0, 3, -1, 4][u32(12)];
  expect(channels >= 0, 12, 'the flags are not known');
  const header = {
    length: Number(view.getBigUint64(16, true)),
    vertices: u32(24),
    faces: u32(28),
    baseVertices: u32(32),
    baseFaces: u32(36),
    batches: u32(40),
    bits: u32(44),
    origin: [f64(48), f64(56), f64(64)],
    step: f64(72),
    channels,
  };
  const { vertices, faces, bits, step } = header;
  expect(vertices < 2 ** 31 && header.baseVertices <= vertices, 24, 'so many vertices cannot be');
  expect(faces < 2 ** 30 && header.baseFaces <= faces, 28, 'so many faces cannot be');
  expect(bits >= 4 && bits <= 24, 44, `coordinates of ${bits} bits cannot be`);
  expect(header.origin.every(Number.isFinite), 48, 'the origin is not finite');
  expect(step > 0 && step < Infinity, 72, 'the step is not positive');
  expect(bytes.subarray(80, 124).every((byte) => byte === 0), 80, 'reserved bytes are not zero');
  return header;
}

/** The head of a block that may take `room` bytes. */
function readHead(bytes, before, room) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const u32 = (offset) => view.getUint32(offset, true);
  if (crc32(bytes.subarray(0, 28)) !== u32(28)) throw new Fault('the checksum of a block is wrong');
  const head = {
    length: u32(0),
    rawLength: u32(4),
    splits: u32(8),
    faces: u32(12),
    rms: view.getFloat32(16, true),
    maximum: view.getFloat32(20, true),
    checksum: u32(24),
  };
  if (head.rawLength > RAW_BYTES_MAX) throw new Fault('a block unpacks to too many bytes');
  if (32 + head.length > room) throw new Fault('a block is longer than the file');
  for (const error of ['rms', 'maximum']) {
    const fits = head[error] >= 0 && head[error] < Infinity && head[error] <= before[error];
    if (!fits) throw new Fault('the error of a block is no distance, or grows');
  }
  return head;
}

function decodeBase(columns, head, header) {
  const { baseVertices: vertices, baseFaces: faces, channels } = header;
  if (head.splits !== vertices || head.faces !== faces) {
    throw new Fault('the base is not what the header announces');
  }
  const places = new Attribute(3, 3, header.bits);
  const colors = channels ? new Attribute(channels, 4, 8) : null;
  places.readBase(columns, vertices);
  colors?.readBase(columns, vertices);
  const corners = columns.numbers(3 * faces);
  columns.finish();
  let corner = 0;
  for (let index = 0; index < corners.length; ++index) {
    corner += unzigzag(corners[index]);
    if (!(corner >= 0 && corner < vertices)) throw new Fault('the base names a vertex that is not there');
    corners[index] = corner;
  }
  for (let index = 0; index < corners.length; index += 3) {
    const [a, b, c] = corners.subarray(index, index + 3);
    if (a === b || b === c || c === a) throw new Fault('a face of the base has a vertex twice');
  }
  const state = { mesh: new HalfEdges(corners, vertices), places, colors };
  const shown = { places: Float32Array.from(places.values), colors: colors?.values.slice() };
  return { state, shown: { kind: 'base', corners, ...shown } };
}

/**
 * Applies a batch to `state`. What is shown of it is by split: the parent, where in `moved` its
 * corners begin, the faces it adds; the new place and colour of the parent, and those of the new
 * vertex. `corners` are those of the new faces as each split makes them.
 */
function decodeBatch(columns, head, header, state) {
  const { splits } = head;
  const { mesh, places, colors } = state;
  if (splits < 1 || splits > BATCH_SPLITS_MAX) throw new Fault(`${splits} splits are no batch`);
  if (mesh.vertices + splits > header.vertices || mesh.faces + head.faces > header.faces) {
    throw new Fault('a batch has more than the header announces');
  }
  const [parents, codes, begins] = [0, 1, 2].map(() => columns.numbers(splits));
  let parent = -1;
  for (let index = 0; index < splits; ++index) {
    parent += parents[index] + 1;
    if (parent >= mesh.vertices) throw new Fault('a batch splits a vertex that is not there');
    parents[index] = parent;
  }
  // Read to its end before anything is changed.
  const placed = places.readSplits(columns, parents, guess);
  const colored = colors?.readSplits(columns, parents, (before) => before);
  columns.finish();
  const shown = { kind: 'batch', parents, ...connectSplits(mesh, parents, codes, begins, head) };
  shown.parentPlaces = Float32Array.from(placed.parents);
  shown.places = Float32Array.from(placed.added);
  shown.parentColors = colored?.parents;
  shown.colors = colored?.added;
  return { shown };
}

/** Where a new vertex is expected: as far from the parent's old place as the parent has gone. */
function guess(before, after) {
  return 2 * before - after;
}

/** What every vertex has: `width` values, `stride` apart, modulo 2^bits. */
class Attribute {
  constructor(width, stride, bits) {
    Object.assign(this, { width, stride, bits, mask: 2 ** bits - 1 });
    this.values = stride === 4 ? new Uint8Array(0) : new Int32Array(0);
  }

  /** Differences for `count` vertices, as the file has them: all of the first value, and so on. */
  read(columns, count) {
    const { bits, width, stride } = this;
    return stride === 4 ? columns.bytes(width * count) : columns.coordinates(count, bits);
  }

  readBase(columns, count) {
    const { width, stride, mask } = this;
    const differences = this.read(columns, count);
    this.count = count;
    // An alpha that is not stored is opaque.
    this.values = new this.values.constructor(stride * count).fill(255);
    for (let axis = 0; axis < width; ++axis) {
      let value = 0;
      for (let index = 0; index < count; ++index) {
        value = (value + differences[axis * count + index]) & mask;
        this.values[stride * index + axis] = value;
      }
    }
  }

  /** Changes parents and adds new vertices; returns both. */
  readSplits(columns, parents, guessed) {
    const { width, stride, mask } = this;
    const count = parents.length;
    const [toParent, toNew] = [this.read(columns, count), this.read(columns, count)];
    const { values } = this;
    const found = new values.constructor(stride * count).fill(255);
    const added = found.slice();
    for (let axis = 0; axis < width; ++axis) {
      for (let index = 0; index < count; ++index) {
        const before = values[stride * parents[index] + axis];
        const after = (before + toParent[axis * count + index]) & mask;
        found[stride * index + axis] = after;
        added[stride * index + axis] = (guessed(before, after) + toNew[axis * count + index]) & mask;
        values[stride * parents[index] + axis] = after;
      }
    }
    const end = stride * (this.count + count);
    this.values = grown(values, end);
    this.values.set(added, end - added.length);
    this.count += count;
    return { parents: found, added };
  }
}

function connectSplits(mesh, parents, codes, begins, head) {
  const splits = parents.length;
  const starts = new Uint32Array(splits + 1);
  const faces = new Uint8Array(splits);
  const facesBefore = mesh.faces;
  mesh.reserve(splits, 2 * splits);
  mesh.movedCount = 0;
  const corners = new Uint32Array(6 * splits);
  for (let index = 0; index < splits; ++index) {
    const kind = codes[index] % 3;
    const from = 3 * mesh.faces;
    faces[index] = mesh.split(parents[index], kind, (codes[index] - kind) / 3, begins[index]);
    starts[index + 1] = mesh.movedCount;
    // The corners of new faces as this split leaves them: splits that follow note what they move.
    for (let half = from; half < 3 * mesh.faces; ++half) {
      corners[half - 3 * facesBefore] = mesh.origin[half];
    }
  }
  const added = mesh.faces - facesBefore;
  if (added !== head.faces) throw new Fault('a batch adds other faces than its head says');
  const moved = mesh.moved.slice(0, mesh.movedCount);
  return { starts, moved, faces, corners: corners.slice(0, 3 * added) };
}
