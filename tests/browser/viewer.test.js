// The element in a real browser. Pictures are judged by what can be seen in them; nothing here
// depends on how fast anything is.

import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { newPage, open } from './browser.js';
import { encode } from './encoder.js';
import { covered, difference, events, hash, pixels, settled, stateHash, until } from './seeing.js';
import { page, serve } from './server.js';
import { colored, dented, jitter, octahedron, sheet } from './shapes.js';

const BITS = 14;
const ball = encode(octahedron(BITS), { bits: BITS, batches: 88, isEven: true, settle: dented(BITS) });
const flat = encode(colored(sheet(BITS, 3), 3), { bits: BITS, batches: 8, channels: 3, settle: jitter(BITS) });

let browser;
before(async () => {
  browser = await open();
});
after(() => browser.close());

const wrong = (change) => {
  const bytes = ball.bytes.slice();
  change(bytes);
  return bytes;
};
/** Where the block `index` begins. */
const offset = (index) => ball.blocks.slice(0, index).reduce((sum, { length }) => sum + length, 128);

const FILES = {
  '/ball.pm': ball.bytes,
  '/flat.pm': flat.bytes,
  '/small-pieces.pm': { bytes: ball.bytes, size: 1024 },
  '/breaks.pm': { bytes: ball.bytes, size: 4096, cutAt: 40_000 },
  '/cut.pm': ball.bytes.slice(0, offset(60) + 40),
  '/cut-in-base.pm': ball.bytes.slice(0, 150),
  '/corrupt.pm': wrong((bytes) => (bytes[offset(50) + 60] ^= 1)),
  '/future.pm': wrong((bytes) => (bytes[8] = 2)),
  '/other.pm': new TextEncoder().encode('ply\nformat ascii 1.0\n'.repeat(20)),
};

/** Opens a page with the element; runs `look` on it; complaints on the console are faults. */
async function withElement(attributes, look, { inner = '', routes = {}, expected = /^$/ } = {}) {
  const server = await serve({ '/': page(attributes, inner), ...FILES, ...routes });
  const view = await newPage(browser.context);
  try {
    await view.goto(`${server.url}/`, { waitUntil: 'commit' });
    await view.waitForFunction(() => globalThis.seen);
    await look(view, server);
    assert.deepEqual(view.complaints.filter((text) => !expected.test(text)), []);
  } finally {
    await view.close();
    await server.close();
  }
}

test('a mesh is loaded, refined to its end, and seen', async () => {
  await withElement('src="/ball.pm" theme="light" caption="A ball"', async (view) => {
    const { triangles } = await until(view, 'complete');
    assert.equal(triangles, ball.values.faces);
    assert.equal(await hash(view), stateHash(ball.states.at(-1)));
    await settled(view);
    const share = covered(await pixels(view));
    assert.ok(share > 0.15 && share < 0.9, `${share} is covered`);
    const refined = (await events(view, 'refined')).map((event) => event.triangles);
    assert.deepEqual(refined, refined.toSorted((a, b) => a - b));
    assert.equal((await events(view, 'complete')).length, 1);
    assert.equal((await events(view, 'error')).length, 0);
    assert.equal((await events(view, 'progress')).at(-1).bytes, ball.bytes.length);
    const { rms } = (await events(view, 'refined')).at(-1);
    assert.equal(rms, 0);
  });
});

test('a coarse picture differs from a fine one, and a fine one not from itself', async () => {
  const pictures = [];
  for (const limit of [60, 1e9, 1e9]) {
    await withElement(`src="/ball.pm" theme="light" max-triangles="${limit}"`, async (view) => {
      await until(view, 'complete');
      await settled(view);
      pictures.push(await pixels(view));
      assert.ok((await view.evaluate(() => element.mesh.faces)) <= limit);
    });
  }
  assert.ok(difference(pictures[0], pictures[1]) > 0.05);
  assert.ok(difference(pictures[1], pictures[2]) < 0.002);
});

test('the size of the pieces does not matter', async () => {
  const hashes = [];
  for (const name of ['ball', 'small-pieces']) {
    await withElement(`src="/${name}.pm"`, async (view) => {
      await until(view, 'complete');
      hashes.push(await hash(view));
    });
  }
  assert.equal(hashes[0], hashes[1]);
  assert.equal(hashes[0], stateHash(ball.states.at(-1)));
});

test('on a slow network the shape is there within a tenth of the bytes', async () => {
  await withElement('theme="light"', async (view) => {
    const control = await browser.context.newCDPSession(view);
    await control.send('Network.enable');
    await control.send('Network.emulateNetworkConditions', {
      offline: false,
      latency: 20,
      downloadThroughput: 60_000,
      uploadThroughput: 60_000,
    });
    const first = await view.evaluate(() => new Promise((resolve) => {
      element.addEventListener('refined', () => resolve(element.arrived), { once: true });
      element.setAttribute('src', '/slow.pm');
    }));
    assert.ok(first < ball.bytes.length / 10, `${first} of ${ball.bytes.length} bytes`);
    assert.ok(covered(await pixels(view)) > 0.1);
    const arrived = await view.evaluate(() => element.arrived);
    assert.ok(arrived < ball.bytes.length, 'the rest is still on its way');
    await until(view, 'complete');
  }, { routes: { '/slow.pm': { bytes: ball.bytes, size: 2048, gap: 20 } } });
});

const FAULTS = {
  '/cut.pm': [/^byte \d+: the file ends in batch 60$/, 60],
  '/corrupt.pm': [/^byte \d+: the checksum of batch 50 is wrong$/, 50],
  '/cut-in-base.pm': [/^byte 150: the file ends in the base$/, 0],
  '/future.pm': [/version 2 is not known/, 0],
  '/other.pm': [/no progressive mesh/, 0],
  '/missing.pm': [/the server answers 404/, 0],
};

for (const [path, [message, blocks]] of Object.entries(FAULTS)) {
  test(`${path} is an error, and what has arrived stays`, async () => {
    await withElement(`src="${path}" theme="light"`, async (view) => {
      const error = await until(view, 'error');
      assert.match(error.message, message);
      const notice = view.getByRole('alert');
      assert.ok((await notice.textContent()).includes(error.message));
      if (blocks > 0) {
        await settled(view);
        assert.equal(await hash(view), stateHash(ball.states[blocks - 1]));
        assert.ok(covered(await pixels(view)) > 0.1);
      }
      assert.equal((await events(view, 'complete')).length, 0);
    }, { expected: /404/ });
  });
}

test('where a connection breaks, the rest is asked for', async () => {
  await withElement('src="/breaks.pm"', async (view, server) => {
    await until(view, 'complete');
    assert.equal(await hash(view), stateHash(ball.states.at(-1)));
    const ranges = server.requests.filter(({ path }) => path === '/breaks.pm').map(({ range }) => range);
    assert.equal(ranges.length, 2);
    assert.match(ranges[1], /^bytes=\d+-$/);
  }, { expected: /ERR_|Failed to load/ });
});

test('bytes inside the page are shown while the page still loads', async () => {
  const text = Buffer.from(ball.bytes).toString('base64');
  const element = (part) => `<script type="application/octet-stream;base64">${part}</script>`;
  const pieces = text.match(/.{1,8192}/g).map(element);
  await withElement('theme="light"', async (view) => {
    await until(view, 'complete');
    assert.equal(await hash(view), stateHash(ball.states.at(-1)));
  }, { inner: pieces.join('\n') });
  await withElement('theme="light"', async (view) => {
    assert.match((await until(view, 'error')).message, /the file ends in batch/);
    await settled(view);
    assert.ok(covered(await pixels(view)) > 0.1);
  }, { inner: pieces.slice(0, 4).join('\n') });
});

test('keys, mouse and wheel turn, shift and near it, and it finds back', async () => {
  await withElement('src="/ball.pm" theme="light" max-triangles="3000"', async (view) => {
    const { triangles } = await until(view, 'complete');
    await settled(view);
    const home = await pixels(view);
    const changes = async (act) => {
      const goal = () => JSON.stringify(element.camera.goal);
      const start = await view.evaluate(goal);
      await act();
      await view.waitForFunction((text) => JSON.stringify(element.camera.goal) !== text, start);
      await settled(view);
      return difference(home, await pixels(view));
    };
    await view.keyboard.press('Tab');
    for (const key of ['ArrowLeft', 'ArrowDown', 'Shift+ArrowUp', '+']) {
      assert.ok((await changes(() => view.keyboard.press(key))) > 0.02, key);
      assert.ok((await changes(() => view.keyboard.press('Home'))) < 0.002, 'Home');
    }
    const drag = async (button) => {
      await view.mouse.move(320, 200);
      await view.mouse.down({ button });
      await view.mouse.move(400, 240, { steps: 4 });
      await view.mouse.up({ button });
    };
    const reset = () => view.getByRole('button', { name: 'Back to the beginning' }).click();
    const wheel = async () => {
      await view.mouse.move(320, 200);
      await view.mouse.wheel(0, -400);
    };
    const acts = [() => drag('left'), () => drag('right'), wheel];
    for (const act of acts) {
      assert.ok((await changes(act)) > 0.02, String(act));
      assert.ok((await changes(reset)) < 0.002, 'reset');
    }
    const refined = await events(view, 'refined');
    assert.equal(refined.at(-1).triangles, triangles, 'at rest all of it is shown');
  });
});

test('two fingers near and shift it', async () => {
  await withElement('src="/ball.pm" theme="light"', async (view) => {
    await until(view, 'complete');
    await settled(view);
    const control = await browser.context.newCDPSession(view);
    const touch = (type, ...points) =>
      control.send('Input.dispatchTouchEvent', {
        type,
        touchPoints: points.map(([x, y], id) => ({ x, y, id })),
      });
    const distance = () => view.evaluate(() => element.camera.goal.distance);
    const start = await distance();
    await touch('touchStart', [300, 200], [340, 200]);
    await touch('touchMove', [260, 200], [380, 200]);
    await touch('touchEnd');
    assert.ok((await distance()) < 0.7 * start);
  });
});

test('every shading looks its own way, with colours and without', async () => {
  for (const file of ['ball', 'flat']) {
    const pictures = [];
    await withElement(`src="/${file}.pm" theme="light" max-triangles="700"`, async (view) => {
      await until(view, 'complete');
      for (const shading of ['smooth', 'flat', 'wire']) {
        await view.getByRole('radio', { name: shading }).check();
        await settled(view);
        pictures.push(await pixels(view));
        assert.equal(await view.evaluate(() => element.shading), shading);
      }
    });
    assert.ok(difference(pictures[0], pictures[2]) > 0.02);
    assert.ok(difference(pictures[1], pictures[2]) > 0.02);
  }
});

test('a dark look is dark and a light one light, as the reader likes it', async () => {
  const background = async (view) => (await pixels(view)).slice(0, 3);
  await withElement('src="/ball.pm"', async (view) => {
    await view.emulateMedia({ colorScheme: 'dark' });
    await until(view, 'complete');
    assert.ok((await background(view)).every((value) => value < 90));
    await view.emulateMedia({ colorScheme: 'light' });
    assert.ok((await background(view)).every((value) => value > 200));
    await view.evaluate(() => element.setAttribute('theme', 'dark'));
    assert.ok((await background(view)).every((value) => value < 90));
  });
});

test('a lost graphics context comes back with the same picture', async () => {
  await withElement('src="/ball.pm" theme="light"', async (view) => {
    await until(view, 'complete');
    await settled(view);
    const picture = await pixels(view);
    await view.evaluate(async () => {
      const { gl } = element.drawing;
      const tool = gl.getExtension('WEBGL_lose_context');
      const next = (name) => new Promise((resolve) =>
        element.parts.canvas.addEventListener(name, () => setTimeout(resolve), { once: true }));
      const lost = next('webglcontextlost');
      tool.loseContext();
      await lost;
      const restored = next('webglcontextrestored');
      tool.restoreContext();
      await restored;
    });
    await settled(view);
    assert.ok(difference(picture, await pixels(view)) < 0.002);
  });
});

test('more may be asked for later, and another file, and the element may move', async () => {
  await withElement('src="/ball.pm" max-triangles="100"', async (view) => {
    await until(view, 'complete');
    assert.ok((await view.evaluate(() => element.mesh.facesArrived)) < 400, 'the rest is not loaded');
    const shows = (faces) => view.waitForFunction((wanted) => element.mesh?.faces === wanted, faces);
    await view.evaluate(() => element.removeAttribute('max-triangles'));
    await shows(ball.values.faces);
    await view.evaluate(() => element.setAttribute('src', '/flat.pm'));
    await shows(flat.values.faces);
    await view.evaluate(() => document.body.append(element));
    await settled(view);
    await shows(flat.values.faces);
  });
});

test('everything has a name, and what happens is said once', async () => {
  await withElement('src="/ball.pm" caption="A ball"', async (view) => {
    await until(view, 'complete');
    await view.getByRole('application', { name: 'A ball' }).waitFor();
    assert.equal(await view.getByRole('status').textContent(), 'All of the mesh is shown');
    assert.equal(await view.getByRole('progressbar').getAttribute('aria-valuenow'), '100');
    const help = view.getByRole('button', { name: 'Keys and gestures' });
    assert.equal(await help.getAttribute('aria-expanded'), 'false');
    await help.click();
    assert.equal(await help.getAttribute('aria-expanded'), 'true');
    await view.getByText('arrow keys').waitFor();
  });
});
