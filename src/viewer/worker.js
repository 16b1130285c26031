// The worker that fetches and decodes, so that the page stays responsive. It is made of the text of
// the functions it needs, since a page opened from a disk cannot load a worker from a file.

import { ByteReader, Columns, crc32, Fault, inflate, join, RAW_BYTES_MAX, unzigzag } from './bytes.js';
import { Attribute, BATCH_SPLITS_MAX, checkEnd, connectSplits, decode } from './decode.js';
import { decodeBase, decodeBatch, guess, readHead, readHeader } from './decode.js';
import { FAN_FACES_MAX, firstHalfEdges, grown, HalfEdges, next } from './half_edges.js';
import { pairTwins, previous, sortedBy } from './half_edges.js';

/** How often a connection that breaks is taken up again where it broke. */
export const RETRIES_MAX = 3;

/** Starts a worker that runs `serve`. */
export function startWorker() {
  const url = URL.createObjectURL(new Blob([workerSource()], { type: 'text/javascript' }));
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}

/** All that `serve` needs, by name. */
const ITEMS = {
  ...{ RAW_BYTES_MAX, FAN_FACES_MAX, BATCH_SPLITS_MAX, RETRIES_MAX },
  ...{ Fault, ByteReader, Columns, crc32, inflate, join, unzigzag },
  ...{ HalfEdges, firstHalfEdges, grown, next, pairTwins, previous, sortedBy },
  ...{ Attribute, checkEnd, connectSplits, decode, decodeBase, decodeBatch, guess, readHead, readHeader },
  ...{ serve, inlined, fetched },
};

function workerSource() {
  const text = ([name, item]) =>
    typeof item === 'function' ? String(item) : `const ${name} = ${item};`;
  return [...Object.entries(ITEMS).map(text), 'serve(self);'].join('\n');
}

/**
 * Decodes what the first message says (`{ url, facesMax }`, or no URL for texts in base64 that
 * follow, `null` behind the last) and posts what `decode` yields, `arrived` and `fault`.
 */
export function serve(scope) {
  const texts = [];
  let wake = () => {};
  scope.onmessage = async ({ data }) => {
    if (data === null || typeof data === 'string') {
      texts.push(data);
      wake();
      return;
    }
    const nextText = async () => {
      while (texts.length === 0) await new Promise((resolve) => (wake = resolve));
      return texts.shift();
    };
    const post = (message) => {
      const arrays = Object.values(message).filter(ArrayBuffer.isView);
      scope.postMessage(message, arrays.map((array) => array.buffer));
    };
    const counted = async function* (chunks) {
      let arrived = 0;
      for await (const chunk of chunks) {
        post({ kind: 'arrived', arrived: (arrived += chunk.length) });
        yield chunk;
      }
    };
    try {
      const chunks = data.url ? fetched(data.url) : inlined(nextText);
      for await (const part of decode(counted(chunks), data.facesMax)) post(part);
    } catch (error) {
      post({ kind: 'fault', message: error.message });
    }
  };
}

/** Bytes that stand in the page as texts in base64. */
export async function* inlined(nextText) {
  for (let text = await nextText(); text !== null; text = await nextText()) {
    yield Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }
}

/** Bytes from a server; where the connection breaks, the rest is asked for. */
export async function* fetched(url) {
  let arrived = 0;
  let version = null;
  for (let retries = 0; ; ++retries) {
    const headers = arrived > 0 ? { Range: `bytes=${arrived}-`, 'If-Range': version } : {};
    try {
      const answer = await fetch(url, { headers });
      if (!answer.ok) throw new Fault(`the server answers ${answer.status} ${answer.statusText}`);
      if (arrived > 0 && answer.status !== 206) throw new Fault('the connection broke');
      version = answer.headers.get('ETag') ?? answer.headers.get('Last-Modified');
      const reader = answer.body.getReader();
      for (let part = await reader.read(); !part.done; part = await reader.read()) {
        arrived += part.value.length;
        yield part.value;
      }
      return;
    } catch (error) {
      if (error instanceof Fault) throw error;
      if (arrived === 0) throw new Fault('the file cannot be fetched');
      if (retries === RETRIES_MAX || !version) throw new Fault('the connection broke');
    }
  }
}
