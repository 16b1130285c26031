// Starts the worker from the text of `decoder`, which src/viewer/module.rs puts in front of all else.

/* global decoder */

export function startWorker() {
  const url = URL.createObjectURL(new Blob([`(${decoder})()`], { type: 'text/javascript' }));
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}
