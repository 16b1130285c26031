// The worker, which fetches and decodes, so that the page stays responsive. In one module, this file
// and what it imports are the body of a function whose text becomes a worker: a page opened from a
// disk cannot load one from a file. So they name nothing else.

import { Fault } from './bytes.js';
import { decode } from './decode.js';

/** How often a connection that breaks is taken up again where it broke. */
const RETRIES_MAX = 3;

/**
 * Decodes what the first message says (`{ url, facesMax }`, or no URL for texts in base64 that
 * follow, `null` behind the last) and posts what `decode` yields, `arrived` and `fault`.
 */
function serve(scope) {
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
    let arrived = 0;
    const counted = async function* (chunks) {
      for await (const chunk of chunks) {
        arrived += chunk.length;
        post({ kind: 'arrived', arrived });
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
async function* inlined(nextText) {
  for (let text = await nextText(); text !== null; text = await nextText()) {
    yield Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }
}

/** Bytes from a server; where the connection breaks, the rest is asked for. */
async function* fetched(url) {
  let arrived = 0;
  let version = null;
  for (let retries = 0; ; ++retries) {
    const headers = arrived > 0 ? { Range: `bytes=${arrived}-`, 'If-Range': version } : {};
    try {
      const answer = await fetch(url, { headers });
      if (!answer.ok) throw new Fault(`the server answers ${answer.status}`);
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

serve(globalThis);
