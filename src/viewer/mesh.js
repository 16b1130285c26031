// The mesh that is on screen: what has arrived, and how much of it is shown. Splits are applied and
// undone by patching arrays, which note what changed for those who keep a copy. Draws nothing.
//
// Vertices and faces are numbered in the order of splits, so those shown are always the first ones.
// Of what is not shown the arrays hold what the next splits will make of it.

/** Entries of an array that are noted as changed together. */
const PAGE_ENTRIES = 1024;

/** An array of entries of `width` numbers each that grows, and remembers what changed. */
class Pages {
  constructor(type, width) {
    this.width = width;
    this.array = new type(width * PAGE_ENTRIES);
    this.changed = new Uint8Array(1);
  }

  reserve(entries) {
    if (entries * this.width <= this.array.length) return;
    const pages = Math.ceil((1.5 * entries) / PAGE_ENTRIES);
    const array = new this.array.constructor(pages * PAGE_ENTRIES * this.width);
    array.set(this.array);
    this.array = array;
    // Copies have to be made anew, so all that was there counts as changed.
    this.changed = new Uint8Array(pages).fill(1);
  }

  /** Adds entries behind the first `count`. */
  append(count, values) {
    const end = count + values.length / this.width;
    this.reserve(end);
    this.array.set(values, count * this.width);
    this.changed.fill(1, Math.floor(count / PAGE_ENTRIES), Math.ceil(end / PAGE_ENTRIES));
  }

  mark(entry) {
    this.changed[Math.floor(entry / PAGE_ENTRIES)] = 1;
  }

  /** Calls `visit(begin, end)`, in numbers of the array, for what changed; forgets that it did. */
  drain(visit) {
    const { changed } = this;
    const size = PAGE_ENTRIES * this.width;
    for (let begin = changed.indexOf(1); begin >= 0; begin = changed.indexOf(1, begin)) {
      let end = changed.indexOf(0, begin);
      if (end < 0) end = changed.length;
      changed.fill(0, begin, end);
      visit(begin * size, end * size);
    }
  }
}

export class Mesh {
  constructor(header) {
    this.header = header;
    this.positions = new Pages(Float32Array, 3);
    this.corners = new Pages(Uint32Array, 3);
    this.normals = new Pages(Int32Array, 1);
    this.colors = header.channels ? new Pages(Uint8Array, 4) : null;
    this.batches = [];
    /** Of what is shown: the batch that is next or in progress, and its splits that are applied. */
    this.batch = 0;
    this.applied = 0;
    this.vertices = 0;
    this.faces = 0;
    /** Of what has arrived. */
    this.verticesArrived = 0;
    this.facesArrived = 0;
    /** Vertices whose normal was computed once; others take that of the vertex they came from. */
    this.normalsKnown = 0;
    this.normalsFit = false;
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
  }

  /** Takes what the decoder hands out. */
  add(part) {
    const isBase = part.kind === 'base';
    const { places, colors } = part;
    const count = places.length / 3;
    this.positions.append(this.verticesArrived, places);
    this.corners.append(this.facesArrived, part.corners);
    this.normals.append(this.verticesArrived, new Int32Array(count));
    if (this.colors) this.colors.append(this.verticesArrived, colors);
    this.enclose(places);
    if (isBase) {
      this.base = { vertices: count, faces: part.corners.length / 3, rms: part.rms, maximum: part.maximum };
      this.vertices = count;
      this.faces = this.base.faces;
    } else {
      this.batches.push(part);
    }
    this.verticesArrived += count;
    this.facesArrived += part.corners.length / 3;
    this.normalsFit = false;
  }

  enclose(places) {
    places.forEach((place, index) => {
      this.low[index % 3] = Math.min(this.low[index % 3], place);
      this.high[index % 3] = Math.max(this.high[index % 3], place);
    });
  }

  /** Diagonal of the bounding box, in steps. */
  get diagonal() {
    return Math.hypot(...this.high.map((high, axis) => high - this.low[axis]));
  }

  /** Distance of what is shown from the finest mesh, in model units: that of the last whole block. */
  get error() {
    return this.batch === 0 ? this.base : this.batches[this.batch - 1];
  }

  get canRefine() {
    return this.batch < this.batches.length;
  }

  /** Faces that the next split adds. */
  get nextFaces() {
    return this.batches[this.batch]?.faces[this.applied] ?? 0;
  }

  /** Shows as many faces as splits allow, at most `faces`, in at most `splitsMax` of them; returns how many. */
  approach(faces, splitsMax) {
    let splits = 0;
    while (splits < splitsMax && this.faces + this.nextFaces <= faces && this.refine()) splits += 1;
    while (splits < splitsMax && this.faces > faces && this.coarsen()) splits += 1;
    if (splits > 0) this.normalsFit = false;
    return splits;
  }

  /** Applies the next split, unless it has not arrived. */
  refine() {
    const batch = this.batches[this.batch];
    if (!batch) return false;
    const index = this.applied;
    const parent = batch.parents[index];
    this.change(batch, index, this.vertices);
    if (this.vertices >= this.normalsKnown) {
      this.normals.array[this.vertices] = this.normals.array[parent];
      this.normals.mark(this.vertices);
    }
    this.vertices += 1;
    this.faces += batch.faces[index];
    this.applied += 1;
    this.skipFinished();
    return true;
  }

  /** A batch of no splits is shown as soon as it can be. */
  skipFinished() {
    while (this.canRefine && this.applied === this.batches[this.batch].parents.length) {
      this.batch += 1;
      this.applied = 0;
    }
  }

  /** Undoes the last split, unless it is the base that is shown. */
  coarsen() {
    while (this.applied === 0) {
      if (this.batch === 0) return false;
      this.batch -= 1;
      this.applied = this.batches[this.batch].parents.length;
    }
    this.applied -= 1;
    const batch = this.batches[this.batch];
    this.vertices -= 1;
    this.faces -= batch.faces[this.applied];
    this.change(batch, this.applied, batch.parents[this.applied]);
    return true;
  }

  /**
   * Gives the corners that a split moves to `vertex`, and exchanges place and colour of its parent:
   * the batch keeps those that are not shown.
   */
  change(batch, index, vertex) {
    const corners = this.corners.array;
    for (let place = batch.starts[index]; place < batch.starts[index + 1]; ++place) {
      const corner = batch.moved[place];
      corners[corner] = vertex;
      this.corners.mark(corner / 3);
    }
    const parent = batch.parents[index];
    exchange(this.positions, parent, batch.parentPlaces, index);
    if (this.colors) exchange(this.colors, parent, batch.parentColors, index);
  }

  /**
   * Computes the normals of what is shown, a portion between each `yield`, weighted by area; shows
   * them at the end. What is split meanwhile makes them a little wrong: the caller begins anew.
   */
  *computeNormals() {
    this.normalsFit = true;
    const sums = new Float32Array(3 * this.vertices);
    const { vertices, faces } = this;
    for (let begin = 0; begin < faces; begin += 16384) {
      this.sumNormals(sums, begin, Math.min(begin + 16384, faces));
      yield;
    }
    for (let begin = 0; begin < vertices; begin += 16384) {
      this.packNormals(sums, begin, Math.min(begin + 16384, vertices));
      yield;
    }
    this.normalsKnown = Math.max(this.normalsKnown, vertices);
  }

  sumNormals(sums, begin, end) {
    const corners = this.corners.array;
    const places = this.positions.array;
    for (let corner = 3 * begin; corner < 3 * end; corner += 3) {
      const a = 3 * corners[corner];
      const b = 3 * corners[corner + 1];
      const c = 3 * corners[corner + 2];
      const ux = places[b] - places[a];
      const uy = places[b + 1] - places[a + 1];
      const uz = places[b + 2] - places[a + 2];
      const vx = places[c] - places[a];
      const vy = places[c + 1] - places[a + 1];
      const vz = places[c + 2] - places[a + 2];
      const x = uy * vz - uz * vy;
      const y = uz * vx - ux * vz;
      const z = ux * vy - uy * vx;
      // Beyond the end where splits came in between: nothing is added there.
      for (let v = a, turn = 0; turn < 3; v = turn === 0 ? b : c, ++turn) {
        sums[v] += x;
        sums[v + 1] += y;
        sums[v + 2] += z;
      }
    }
  }

  /** Ten bits for each coordinate, as the graphics hardware reads them. */
  packNormals(sums, begin, end) {
    const normals = this.normals.array;
    for (let vertex = begin; vertex < end; ++vertex) {
      const x = sums[3 * vertex];
      const y = sums[3 * vertex + 1];
      const z = sums[3 * vertex + 2];
      const scale = 511 / (Math.sqrt(x * x + y * y + z * z) || 1);
      const bits = (value) => Math.round(value * scale) & 1023;
      normals[vertex] = bits(x) | (bits(y) << 10) | (bits(z) << 20);
    }
    for (let vertex = begin; vertex < end; vertex += PAGE_ENTRIES) this.normals.mark(vertex);
  }
}

function exchange(pages, entry, others, index) {
  const { array, width } = pages;
  for (let place = 0; place < width; ++place) {
    const value = array[width * entry + place];
    array[width * entry + place] = others[width * index + place];
    others[width * index + place] = value;
  }
  pages.mark(entry);
}
