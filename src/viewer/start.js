// Starts the worker: from its file, or from its text where all of the viewer is one module.

/* global decoder */

export function startWorker() {
  // src/viewer/module.rs puts a function of that name in front.
  if (typeof decoder === 'undefined') {
    return new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
  }
  const text = new Blob([`(${decoder})()`], { type: 'text/javascript' });
  const url = URL.createObjectURL(text);
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}
