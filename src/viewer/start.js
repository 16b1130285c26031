// Starts the worker where the viewer is loaded as the files it is written in. In one module
// start_from_text.js takes this file's place.

export function startWorker() {
  return new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
}
