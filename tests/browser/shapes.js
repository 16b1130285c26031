// Small shapes to begin with, and where their vertices come to lie when they are refined.

/** Places from −1…1 to integers. */
export const quantised = (place, bits) =>
  place.map((value) => Math.round(((value + 1) / 2) * (2 ** bits - 1)));

/** An octahedron. */
export function octahedron(bits) {
  const places = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
  const faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
  return { places: places.map((place) => quantised(place, bits)), faces };
}

/** A square sheet with a boundary, of n × n quads. */
export function sheet(bits, n) {
  const places = [];
  const faces = [];
  for (let j = 0; j <= n; ++j) {
    for (let i = 0; i <= n; ++i) places.push(quantised([(2 * i) / n - 1, (2 * j) / n - 1, 0], bits));
  }
  const at = (i, j) => j * (n + 1) + i;
  for (let j = 0; j < n; ++j) {
    for (let i = 0; i < n; ++i) {
      faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
  }
  return { places, faces };
}

/** Two triangles that share one vertex: its faces are no fan, so that it is never a parent. */
export function bowtie(bits) {
  const places = [[0, 0, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]];
  return { places: places.map((place) => quantised(place, bits)), faces: [[0, 2, 1], [0, 3, 4]] };
}

/** Near where they were, at random: for connectivity, not for looks. */
export const jitter = (bits) => (place, next) =>
  place.map((value) => Math.min(2 ** bits - 1, Math.max(0, value + next(65) - 32)));

export const colored = (base, channels) => ({
  ...base,
  colors: base.places.map((place) => [...place, 200].slice(0, channels).map((value) => value & 255)),
});

/** In the middle of the neighbours, on a ball with dents: for looks. */
export const dented = (bits) => (_, next, middle) => {
  const size = 2 ** bits - 1;
  const direction = middle.map((value) => (2 * value) / size - 1);
  const length = Math.hypot(...direction) || 1;
  const [x, y, z] = direction.map((value) => value / length);
  const radius = 0.86 + 0.08 * Math.sin(7 * x) * Math.sin(6 * y + 1) * Math.cos(5 * z);
  return quantised([x * radius, y * radius, z * radius], bits);
};
