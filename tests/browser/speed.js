// How fast the decoder is: `node speed.js FILE.pm` decodes a file five times, in a worker of the
// browser and in node, and says how many splits a second. A measurement, not a test.

import { readFile } from 'node:fs/promises';
import { argv } from 'node:process';

import { decode } from '../../src/viewer/decode.js';
import { newPage, open } from './browser.js';
import { serve } from './server.js';

const ROUNDS = 5;

/** Splits a second of each round, in thousands; runs in node and, as text, in a worker. */
async function measure(decoder, bytes, rounds) {
  const found = [];
  for (let round = 0; round < rounds; ++round) {
    const chunks = async function* () {
      for (let begin = 0; begin < bytes.length; begin += 65536) yield bytes.subarray(begin, begin + 65536);
    };
    const start = performance.now();
    let splits = 0;
    for await (const part of decoder(chunks())) splits += part.parents?.length ?? 0;
    found.push(Math.round(splits / (performance.now() - start)));
  }
  return found;
}

const bytes = new Uint8Array(await readFile(argv[2]));
console.log('node:', ...(await measure(decode, bytes, ROUNDS)), 'thousand splits/s');

const server = await serve({ '/': '<!doctype html><link rel="icon" href="data:,">', '/mesh.pm': bytes });
const { context, close } = await open();
const page = await newPage(context);
await page.goto(server.url);
const worker = `import { decode } from '${server.url}/viewer/decode.js';
  const bytes = new Uint8Array(await (await fetch('${server.url}/mesh.pm')).arrayBuffer());
  postMessage(await (${measure})(decode, bytes, ${ROUNDS}));`;
const found = await page.evaluate((text) => new Promise((resolve, reject) => {
  const url = URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));
  const started = new Worker(url, { type: 'module' });
  started.onmessage = ({ data }) => resolve(data);
  started.onerror = (error) => reject(new Error(error.message));
}), worker);
console.log('chromium:', ...found, 'thousand splits/s');
await close();
await server.close();
