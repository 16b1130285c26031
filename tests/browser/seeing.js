// What a page shows: the events of its element, the mesh that is in it, and the picture.

import { createHash } from 'node:crypto';

/** The events of that name that were seen so far. */
export const events = (view, name) =>
  view.evaluate((wanted) => seen.events.filter((event) => event.name === wanted), name);

export async function until(view, name) {
  await view.waitForFunction((wanted) => seen.events.some((event) => event.name === wanted), name);
  return (await events(view, name)).at(-1);
}

/** Complete, nothing moves, and what there was to compute is computed. */
export async function settled(view) {
  await view.waitForFunction(() => element.mesh && element.request + element.rest === 0 && element.isEnded);
  // Parts of the look fade in and out.
  await view.waitForTimeout(100);
}

/** Positions and corners of all that is shown. */
export async function hash(view) {
  const texts = await view.evaluate(() => {
    const { mesh } = element;
    const arrays = [mesh.positions.array.slice(0, 3 * mesh.vertices), mesh.corners.array.slice(0, 3 * mesh.faces)];
    return Promise.all(arrays.map((array) => new Promise((resolve) => {
      const reader = new FileReader();
      reader.onload = () => resolve(reader.result.split(',')[1]);
      reader.readAsDataURL(new Blob([array]));
    })));
  });
  return hashOf(...texts.map((text) => Buffer.from(text, 'base64')));
}

export function hashOf(places, corners) {
  return createHash('sha256').update(places).update(corners).digest('hex');
}

/** The same of a state of the encoder. */
export const stateHash = ({ places, faces }) =>
  hashOf(new Uint8Array(Float32Array.from(places).buffer), new Uint8Array(Uint32Array.from(faces).buffer));

/** Pixels of the middle of the page: red, green, blue, alpha. */
export async function pixels(view) {
  const png = (await view.screenshot()).toString('base64');
  const text = await view.evaluate(async (url) => {
    const image = await createImageBitmap(await (await fetch(url)).blob());
    const canvas = new OffscreenCanvas(400, 340);
    const context = canvas.getContext('2d');
    context.drawImage(image, -120, -40);
    const { data } = context.getImageData(0, 0, 400, 340);
    let letters = '';
    for (let begin = 0; begin < data.length; begin += 8192) {
      letters += String.fromCharCode(...data.subarray(begin, begin + 8192));
    }
    return btoa(letters);
  }, `data:image/png;base64,${png}`);
  return Buffer.from(text, 'base64');
}

/** Share of pixels that differ clearly. */
export function difference(a, b) {
  let count = 0;
  for (let index = 0; index < a.length; index += 4) {
    const apart = [0, 1, 2].map((channel) => Math.abs(a[index + channel] - b[index + channel]));
    if (Math.max(...apart) > 12) count += 1;
  }
  return (4 * count) / a.length;
}

/** Share of pixels that are not the background, which is nearly white in the light look. */
export function covered(picture) {
  let count = 0;
  for (let index = 0; index < picture.length; index += 4) if (picture[index] < 220) count += 1;
  return (4 * count) / picture.length;
}
