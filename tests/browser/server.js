// A server of the viewer's modules and of bytes made in tests: at any pace, in pieces, breaking off.

import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { setTimeout as pause } from 'node:timers/promises';

const VIEWER = new URL('../../src/viewer/', import.meta.url);

/** A page around the element. `inside` are its attributes, `inner` its children. */
export const page = (inside, inner = '') => `<!doctype html><html lang="en"><meta charset="utf-8">
<link rel="icon" href="data:,"><style>body { margin: 0 } progressive-mesh { height: 100vh }</style>
<script type="module" src="/viewer/progressive-mesh.js"></script>
<progressive-mesh ${inside}>${inner}</progressive-mesh>
<script>window.seen = { events: [] };
const element = document.querySelector('progressive-mesh');
for (const name of ['progress', 'refined', 'complete', 'error'])
  element.addEventListener(name, ({ detail }) => seen.events.push({ name, ...detail }));
</script>`;

/**
 * Serves `/viewer/…` and what `routes` says by path: text, bytes, or `{ bytes, size, gap, cutAt }`:
 * in pieces of `size` with `gap` milliseconds between them, breaking off once in front of `cutAt`.
 */
export async function serve(routes) {
  const requests = [];
  const answer = async (request, response) => {
    const path = new URL(request.url, 'http://local').pathname;
    requests.push({ path, range: request.headers.range });
    if (path.startsWith('/viewer/')) {
      response.setHeader('Content-Type', 'text/javascript');
      return response.end(await readFile(new URL(path.slice(8), VIEWER)));
    }
    const found = routes[path];
    if (found === undefined) return response.writeHead(404).end();
    if (typeof found === 'string') {
      response.setHeader('Content-Type', 'text/html');
      return response.end(found);
    }
    return send(request, response, found.bytes ? found : { bytes: found });
  };
  const server = createServer((request, response) => {
    answer(request, response).catch((error) => response.destroy(error));
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  const close = () => {
    server.closeAllConnections();
    return new Promise((resolve) => server.close(resolve));
  };
  return { url: `http://127.0.0.1:${server.address().port}`, requests, close };
}

async function send(request, response, { bytes, size = bytes.length, gap = 0, cutAt = Infinity }) {
  const begin = Number(/bytes=(\d+)-/.exec(request.headers.range)?.[1] ?? 0);
  response.writeHead(begin > 0 ? 206 : 200, {
    'Content-Type': 'application/octet-stream',
    'Content-Length': bytes.length - begin,
    ETag: '"1"',
  });
  for (let offset = begin; offset < bytes.length; offset += size) {
    if (begin === 0 && offset >= cutAt) {
      // Those that are on their way should still arrive.
      await pause(50);
      return response.destroy();
    }
    if (gap > 0) await pause(gap);
    response.write(bytes.subarray(offset, offset + size));
  }
  return response.end();
}
