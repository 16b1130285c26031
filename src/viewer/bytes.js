// The bytes of a progressive mesh (docs/FORMATS.md) as they arrive: read in order, checked, and
// unpacked into columns of numbers. Knows no meshes.

/** The most bytes that the payload of a block may be unpacked to. */
export const RAW_BYTES_MAX = 2 ** 26;

/** A broken rule of the format, or a file that ends early. */
export class Fault extends Error {}

/** Bytes in the order they come, whatever the chunks they come in. */
export class ByteReader {
  constructor(chunks) {
    this.chunks = chunks[Symbol.asyncIterator]();
    this.rest = new Uint8Array(0);
    /** Bytes handed out. */
    this.offset = 0;
  }

  /** The next `count` bytes. What is not there yet takes no memory. */
  async take(count, what) {
    const parts = [];
    let missing = count;
    while (missing > this.rest.length) {
      parts.push(this.rest);
      missing -= this.rest.length;
      const { done, value } = await this.chunks.next();
      this.rest = done ? new Uint8Array(0) : value;
      if (done) throw new Fault(`byte ${this.offset + count - missing}: the file ends in ${what}`);
    }
    parts.push(this.rest.subarray(0, missing));
    this.rest = this.rest.subarray(missing);
    this.offset += count;
    return join(parts, count);
  }

  /** Whether nothing follows. */
  async isAtEnd() {
    while (this.rest.length === 0) {
      const { done, value } = await this.chunks.next();
      if (done) return true;
      this.rest = value;
    }
    return false;
  }
}

function join(parts, length) {
  if (parts.length === 1) return parts[0];
  const whole = new Uint8Array(length);
  let offset = 0;
  for (const part of parts) {
    whole.set(part, offset);
    offset += part.length;
  }
  return whole;
}

/** CRC-32 (IEEE). */
export function crc32(bytes) {
  const table = (crc32.table ??= Uint32Array.from({ length: 256 }, (_, index) => {
    let rest = index;
    for (let bit = 0; bit < 8; ++bit) rest = rest & 1 ? (rest >>> 1) ^ 0xedb88320 : rest >>> 1;
    return rest;
  }));
  let rest = -1;
  for (let index = 0; index < bytes.length; ++index) {
    rest = (rest >>> 8) ^ table[(rest ^ bytes[index]) & 255];
  }
  return ~rest >>> 0;
}

/** Unpacks a raw DEFLATE stream to exactly `length` bytes; a bomb is stopped at the first too many. */
export async function inflate(packed, length, what) {
  const stream = new DecompressionStream('deflate-raw');
  const writer = stream.writable.getWriter();
  // Whatever goes wrong in writing goes wrong in reading, too, and is reported there.
  writer.write(packed).catch(() => {});
  writer.close().catch(() => {});
  const reader = stream.readable.getReader();
  const parts = [];
  let found = 0;
  try {
    for (let part = await reader.read(); !part.done; part = await reader.read()) {
      parts.push(part.value);
      found += part.value.length;
      if (found > length) break;
    }
  } catch {
    throw new Fault(`${what} cannot be unpacked`);
  }
  if (found !== length) {
    reader.cancel().catch(() => {});
    const amount = found > length ? 'more than' : `${found} instead of`;
    throw new Fault(`${what} unpacks to ${amount} ${length} bytes`);
  }
  return join(parts, length);
}

/** Columns of an unpacked payload, read one after the other. */
export class Columns {
  constructor(raw, what) {
    this.raw = raw;
    this.what = what;
    this.offset = 0;
  }

  fail(why) {
    throw new Fault(`${this.what}: ${why}`);
  }

  /** `count` unsigned numbers in LEB128, less than 2³². */
  numbers(count) {
    const { raw } = this;
    if (count > raw.length - this.offset) this.fail('a column is too short');
    const values = new Uint32Array(count);
    let offset = this.offset;
    for (let index = 0; index < count; ++index) {
      let byte = raw[offset++];
      let value = byte & 127;
      for (let shift = 7; byte > 127; shift += 7) {
        byte = raw[offset++];
        if (shift > 28 || (shift === 28 && byte > 15)) this.fail('a number has too many bits');
        value |= (byte & 127) << shift;
      }
      values[index] = value;
    }
    // Past the end `byte` is undefined, which ends the number: noticed here.
    if (offset > raw.length) this.fail('a column is too short');
    this.offset = offset;
    return values;
  }

  /** `count` signed differences for each of three coordinates, all of x first. */
  coordinates(count, bits) {
    const width = Math.ceil(bits / 8);
    const differences = new Int32Array(3 * count);
    let seen = 0;
    for (let axis = 0; axis < 3; ++axis) {
      const codes = differences.subarray(axis * count, (axis + 1) * count);
      for (let place = 0; place < width; ++place) {
        const column = this.bytes(count);
        for (let index = 0; index < count; ++index) codes[index] |= column[index] << (8 * place);
      }
      for (let index = 0; index < count; ++index) {
        const code = codes[index];
        seen |= code;
        codes[index] = (code >>> 1) ^ -(code & 1);
      }
    }
    if (seen >>> bits) this.fail('a coordinate has too many bits');
    return differences;
  }

  /** `count` bytes as they are. */
  bytes(count) {
    const column = this.raw.subarray(this.offset, (this.offset += count));
    if (column.length < count) this.fail('a column is too short');
    return column;
  }

  finish() {
    if (this.offset !== this.raw.length) this.fail('bytes are left over');
  }
}

export function unzigzag(code) {
  return (code >>> 1) ^ -(code & 1);
}
