// <progressive-mesh src="…" caption max-triangles target-fps shading theme up>: shows a progressive
// mesh as it loads, and lets it be turned. Without `src` its bytes stand inside it, in base64:
// <script type="application/octet-stream;base64">…</script>, once or several times.
//
// Events, with a `detail`: `progress` (bytes, length), `refined` (triangles, vertices, rms, maximum),
// `complete` (triangles) when all is shown that will be, `error` (message).

import { Camera } from './camera.js';
import { LoadController } from './controller.js';
import { Drawing } from './drawing.js';
import { listen } from './gestures.js';
import { describe, furnish, LOOKS } from './look.js';
import { Mesh } from './mesh.js';
import { startWorker } from './start.js';

/** Milliseconds of a frame for normals, when nothing else is to be done. Chosen by hand: half a frame. */
const WORK_MS = 8;
/** Splits of a frame as a share of what is shown, so that copying costs no more than all of it. */
const PORTION = 1 / 10;

const INLINE = 'application/octet-stream;base64';

/** Outside a browser, as in tests of the decoder, there are no elements. */
const Element = globalThis.HTMLElement ?? class {};

class ProgressiveMesh extends Element {
  static observedAttributes = ['src', 'caption', 'max-triangles', 'target-fps', 'shading', 'theme', 'up'];

  constructor() {
    super();
    this.parts = furnish(this.attachShadow({ mode: 'open' }));
    this.camera = new Camera();
    /** What is shown, or null before the base has arrived. */
    this.mesh = null;
    this.frameAt = null;
    this.slow = 0;
    /** The frame that was asked for, and the look at what is at rest; 0 for none. */
    this.request = 0;
    this.rest = 0;
  }

  connectedCallback() {
    try {
      if (!this.drawing) this.furnish();
    } catch (error) {
      // Without graphics there is nothing to load.
      this.fail(error.message);
      return;
    }
    this.isDark = globalThis.matchMedia('(prefers-color-scheme: dark)');
    this.isDark.onchange = () => this.dress();
    this.sizes = new ResizeObserver(() => this.invalidate());
    this.sizes.observe(this.parts.canvas);
    for (const name of ProgressiveMesh.observedAttributes.slice(1)) this.adopt(name);
    this.load();
  }

  disconnectedCallback() {
    this.stop();
    this.sizes?.disconnect();
    cancelAnimationFrame(this.request);
    clearTimeout(this.rest);
    this.request = this.rest = 0;
  }

  attributeChangedCallback(name) {
    if (!this.isConnected || !this.sizes) return;
    if (name === 'src') this.load();
    else this.adopt(name);
  }

  /** What a person does with the element, and what the hardware does to it. */
  furnish() {
    const { canvas, shading, reset } = this.parts;
    const moved = () => {
      if (globalThis.matchMedia('(prefers-reduced-motion: reduce)').matches) this.camera.jump();
      this.controller.moved(performance.now());
      this.invalidate();
    };
    listen(canvas, this.camera, moved);
    reset.addEventListener('click', () => {
      this.camera.reset();
      moved();
    });
    shading.addEventListener('change', (event) => this.setAttribute('shading', event.target.value));
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => {
      this.drawing.prepare();
      this.invalidate();
    });
    this.drawing = new Drawing(canvas);
  }

  /** Takes over what an attribute says. */
  adopt(name) {
    const value = this.getAttribute(name);
    if (name === 'caption') {
      this.parts.caption.textContent = value ?? '';
      this.parts.canvas.setAttribute('aria-label', value || '3D model');
    } else if (name === 'target-fps') {
      this.controller = new LoadController({ targetFps: positive(value) ?? 30 });
    } else if (name === 'max-triangles') {
      const before = this.facesMax;
      this.facesMax = positive(value) ?? Infinity;
      // The worker stops at the old limit, so what lies behind it has to be loaded.
      if (before < this.facesMax && this.isCut) this.load();
    } else if (name === 'up') {
      this.camera.setUp(value || 'y');
    } else if (name === 'shading') {
      this.shading = ['flat', 'wire'].includes(value) ? value : 'smooth';
      this.parts.shading.querySelector(`[value=${this.shading}]`).checked = true;
    } else {
      this.dress();
    }
    this.invalidate();
  }

  dress() {
    const theme = this.getAttribute('theme');
    const isDark = theme ? theme === 'dark' : this.isDark.matches;
    this.classList.toggle('dark', isDark);
    this.look = isDark ? LOOKS.dark : LOOKS.light;
    this.invalidate();
  }

  stop() {
    this.worker?.terminate();
    this.worker = null;
    this.arriving?.disconnect();
  }

  load() {
    this.stop();
    this.mesh = this.header = this.normals = null;
    this.isEnded = this.isComplete = this.isCut = false;
    this.drawing?.forget();
    this.parts.notice.hidden = true;
    this.parts.progress.classList.remove('done');
    this.worker = startWorker();
    this.worker.onmessage = ({ data }) => this.receive(data);
    this.worker.onerror = () => this.fail('the decoder cannot be started');
    const src = this.getAttribute('src');
    const url = src ? new URL(src, document.baseURI).href : null;
    this.worker.postMessage({ url, facesMax: this.facesMax });
    if (!src) this.feed();
  }

  /** Hands what stands inside the element to the worker, while the page still loads, too. */
  feed() {
    const { worker } = this;
    let fed = 0;
    const take = () => {
      const isWhole = document.readyState !== 'loading';
      const texts = [...this.children].filter((child) => child.type === INLINE);
      // The last text may still grow.
      for (; fed < texts.length - (isWhole ? 0 : 1); ++fed) worker.postMessage(texts[fed].textContent);
      if (!isWhole) return;
      this.arriving.disconnect();
      worker.postMessage(null);
    };
    this.arriving = new MutationObserver(take);
    this.arriving.observe(this, { childList: true });
    document.addEventListener('DOMContentLoaded', take, { once: true });
    take();
  }

  /** Takes what the worker posts. */
  receive(part) {
    if (part.kind === 'header' || part.kind === 'arrived') {
      if (part.kind === 'header') this.header = part;
      else this.arrived = part.arrived;
      if (this.header) this.showProgress();
    } else if (part.kind === 'end') {
      this.isEnded = true;
      this.isCut = !part.isWhole;
    } else if (part.kind === 'fault') {
      this.fail(part.message);
    } else {
      if (part.kind === 'base') this.begin();
      this.mesh.add(part);
      this.mesh.skipFinished();
    }
    this.invalidate();
  }

  begin() {
    this.mesh = new Mesh(this.header);
    this.parts.spoken.textContent = 'The shape is shown';
  }

  fail(message) {
    this.isEnded = true;
    const { notice, spoken, progress } = this.parts;
    const kept = this.mesh ? ' What has arrived is shown.' : '';
    notice.textContent = `This mesh cannot be shown${this.mesh ? ' in full' : ''}: ${message}.${kept}`;
    notice.hidden = false;
    spoken.textContent = '';
    progress.classList.add('done');
    this.tell('error', { message });
  }

  tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  showProgress() {
    const { arrived: bytes, header } = this;
    const share = Math.min(1, bytes / header.length);
    this.parts.progress.firstChild.style.transform = `scaleX(${share})`;
    this.parts.progress.setAttribute('aria-valuenow', Math.round(100 * share));
    this.tell('progress', { bytes, length: header.length });
  }

  /** What is seen may have changed: draws it with the next frame. */
  invalidate() {
    this.isStale = true;
    this.again();
  }

  again() {
    if (this.request === 0 && this.isConnected) {
      this.request = requestAnimationFrame((now) => this.frame(now));
    }
  }

  frame(now) {
    this.request = 0;
    const elapsed = this.frameAt === null ? 16 : now - this.frameAt;
    // Drawing may go on behind our back: after a slow frame, one that seems quick is not.
    this.slow = Math.max(elapsed, 0.7 * this.slow);
    const { mesh, controller } = this;
    if (mesh) controller.frame(now, mesh.faces);
    const isMoving = this.camera.follow(elapsed);
    if (isMoving) {
      controller.moved(now);
      this.isStale = true;
    }
    const isBusy = mesh !== null && this.work(now);
    if (this.isStale) this.draw();
    this.isStale = false;
    this.frameAt = isMoving || isBusy ? now : null;
    if (isMoving || isBusy) {
      this.again();
      return;
    }
    controller.pause();
    if (!controller.isAtRest(now)) {
      clearTimeout(this.rest);
      this.rest = setTimeout(() => {
        this.rest = 0;
        this.again();
      }, controller.restIn(now));
    } else if (mesh && this.isEnded) {
      this.finish();
    }
  }

  /** Splits and normals of one frame; returns whether some are left. */
  work(now) {
    const { mesh, controller } = this;
    const wanted = Math.min(this.facesMax, controller.allowed(now));
    // Where drawing takes long, fewer and larger portions are there sooner.
    const portion = Math.max(500, PORTION * mesh.vertices * Math.max(1, this.slow / 25));
    if (mesh.approach(wanted, portion) > 0) {
      const { rms, maximum } = mesh.error;
      this.tell('refined', { triangles: mesh.faces, vertices: mesh.vertices, rms, maximum });
      this.isStale = true;
      return true;
    }
    if (this.shading !== 'smooth' || !controller.isAtRest(now)) return false;
    if (!mesh.normalsFit) this.normals = mesh.computeNormals();
    const end = performance.now() + WORK_MS;
    while (this.normals && performance.now() < end) {
      if (!this.normals.next().done) continue;
      this.normals = null;
      this.isStale = true;
    }
    return this.normals !== null;
  }

  draw() {
    const { mesh, drawing, camera } = this;
    const { canvas, figures } = this.parts;
    if (!drawing || drawing.gl.isContextLost()) return;
    const scale = Math.min(globalThis.devicePixelRatio || 1, 3);
    const width = Math.max(1, Math.round(canvas.clientWidth * scale));
    const height = Math.max(1, Math.round(canvas.clientHeight * scale));
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    if (!mesh) {
      drawing.draw(null);
      return;
    }
    const middle = mesh.low.map((low, axis) => (low + mesh.high[axis]) / 2);
    const radius = mesh.diagonal / 2 || 1;
    const matrices = camera.matrices(middle, radius, width / height);
    // Where edges lie close together, they fade, so that the shape stays visible.
    const edge = (height * 1.6) / camera.now.distance / Math.sqrt(mesh.faces);
    const line = [...this.look.line, Math.min(0.7, Math.max(0.06, edge / 14))];
    drawing.draw(mesh, matrices, this.shading, { clay: this.look.clay, line });
    const diagonal = mesh.diagonal * mesh.header.step;
    figures.textContent = describe({ faces: mesh.faces, error: mesh.error, diagonal });
  }

  /** All is shown that will be. */
  finish() {
    if (this.isComplete || !this.parts.notice.hidden) return;
    this.isComplete = true;
    this.parts.progress.classList.add('done');
    this.parts.spoken.textContent = 'All of the mesh is shown';
    this.tell('complete', { triangles: this.mesh.faces });
  }
}

function positive(text) {
  const value = Number(text);
  return value > 0 ? value : null;
}

globalThis.customElements?.define('progressive-mesh', ProgressiveMesh);
