// The pages that `meshmill document` writes, opened from the disk. The command is the one that
// MESHMILL names; without it these tests say that they skip.

import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { mkdtemp, readFile, rm, writeFile } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { promisify } from 'node:util';

import { newPage, open } from './browser.js';
import { encode } from './encoder.js';
import { covered, hash, pixels, settled, stateHash } from './seeing.js';
import { serve } from './server.js';
import { dented, octahedron } from './shapes.js';

const BITS = 14;
const ball = encode(octahedron(BITS), { bits: BITS, batches: 88, isEven: true, settle: dented(BITS) });

const command = process.env.MESHMILL;
const skip = command ? false : 'MESHMILL does not name the command';
if (skip) console.error(`tests of documents are skipped: ${skip}`);

const run = (...words) => promisify(execFile)(command, words);

let browser;
let folder;
before(async () => {
  if (skip) return;
  browser = await open();
  folder = await mkdtemp(join(tmpdir(), 'meshmill-document-'));
  await writeFile(join(folder, 'ball & "co".pm'), ball.bytes);
});
after(async () => {
  await browser?.close();
  if (folder) await rm(folder, { recursive: true });
});

/** Opens a page and waits for all of its mesh; returns the view. */
async function shown(address) {
  const view = await newPage(browser.context);
  await view.goto(address);
  await view.evaluate(() => (globalThis.element = document.querySelector('progressive-mesh')));
  await view.waitForFunction(() => element.isComplete);
  await settled(view);
  return view;
}

test('a document is one file that shows the mesh from the disk', { skip }, async () => {
  const page = join(folder, 'ball.html');
  const { stdout } = await run('document', join(folder, 'ball & "co".pm'), '-o', page);
  assert.match(stdout, /ball\.html/);
  const view = await shown(pathToFileURL(page).href);
  assert.equal(await hash(view), stateHash(ball.states.at(-1)));
  assert.equal(await view.title(), 'ball & "co"');
  await view.getByRole('application', { name: 'ball & "co"' }).waitFor();
  await view.evaluate(() => element.setAttribute('theme', 'light'));
  assert.ok(covered(await pixels(view)) > 0.1);
  assert.deepEqual(view.complaints, []);
  await view.close();
});

test('a mesh beside its page is loaded from a server, and from the disk it says why not', { skip }, async () => {
  const page = join(folder, 'out.html');
  await run('document', join(folder, 'ball & "co".pm'), '-o', page, '--external');
  const bytes = await readFile(join(folder, 'out.pm'));
  assert.deepEqual(Uint8Array.from(bytes), ball.bytes);
  const html = await readFile(page, 'utf8');
  assert.ok(html.length < 60_000, 'the mesh is not in it');
  const server = await serve({ '/out.html': html, '/out.pm': bytes });
  const view = await shown(`${server.url}/out.html`);
  assert.equal(await hash(view), stateHash(ball.states.at(-1)));
  assert.deepEqual(view.complaints, []);
  await view.goto(pathToFileURL(page).href);
  await view.getByText('the file cannot be fetched').waitFor();
  await view.close();
  await server.close();
});

test('a file that is no whole progressive mesh is refused with exit code 3', { skip }, async () => {
  const files = {
    'cut.pm': ball.bytes.subarray(0, 5000),
    'other.pm': Buffer.from('ply\n'),
    'empty.pm': Buffer.alloc(0),
  };
  for (const [name, bytes] of Object.entries(files)) {
    await writeFile(join(folder, name), bytes);
    const page = join(folder, `${name}.html`);
    await assert.rejects(run('document', join(folder, name), '-o', page), ({ code, stderr }) => {
      assert.equal(code, 3);
      assert.match(stderr, new RegExp(name));
      return true;
    });
    await assert.rejects(readFile(page), 'no page is left');
  }
});
