// What mouse, fingers and keys mean: turning, nearing and shifting. Knows no mesh.

/** A drag over the whole height turns by so much, radians. */
const TURN = Math.PI;
/** A key turns by so much, radians… */
const KEY_TURN = Math.PI / 18;
/** … shifts by such a share of the height, and nears by such a factor. */
const KEY_PAN = 0.05;
const KEY_ZOOM = 1.2;

/** Lets `canvas` be turned: tells `camera`, and calls `moved` each time. */
export function listen(canvas, camera, moved) {
  const pointers = new Map();
  const on = (name, listener) => canvas.addEventListener(name, listener, { passive: false });
  on('pointerdown', (event) => {
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  // Whatever ends a gesture ends the capture.
  on('lostpointercapture', (event) => pointers.delete(event.pointerId));
  on('contextmenu', (event) => event.preventDefault());
  on('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const others = [...pointers].filter(([id]) => id !== event.pointerId);
    pointers.set(event.pointerId, now);
    const size = canvas.clientHeight || 1;
    const [right, down] = now.map((value, axis) => (value - before[axis]) / size);
    if (others.length > 0) pinch(camera, others[0][1], before, now, size);
    else if (event.shiftKey || event.buttons & 6) camera.pan(right, -down);
    else camera.turn(TURN * right, TURN * down);
    moved();
  });
  on('wheel', (event) => {
    event.preventDefault();
    // Lines and pages, where the wheel counts those; pinching on a touch pad comes as ctrl + wheel.
    const pixels = event.deltaY * [1, 16, 400][event.deltaMode];
    camera.zoom(Math.exp(-Math.max(-200, Math.min(200, pixels)) * (event.ctrlKey ? 0.01 : 0.0015)));
    moved();
  });
  on('dblclick', () => {
    camera.reset();
    moved();
  });
  on('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || !press(camera, event)) return;
    event.preventDefault();
    moved();
  });
}

/** One of two fingers moves: the other is the fixed point. */
function pinch(camera, fixed, before, now, size) {
  const arm = (point) => [point[0] - fixed[0], point[1] - fixed[1]];
  const [from, to] = [arm(before), arm(now)];
  const ratio = Math.hypot(...to) / (Math.hypot(...from) || 1);
  const twist = Math.atan2(from[1], from[0]) - Math.atan2(to[1], to[0]);
  camera.zoom(Math.min(2, Math.max(0.5, ratio || 1)));
  camera.turn(0, 0, Math.atan2(Math.sin(twist), Math.cos(twist)));
  camera.pan((now[0] - before[0]) / 2 / size, (before[1] - now[1]) / 2 / size);
}

/** Returns whether the key means something. */
function press(camera, { key, shiftKey }) {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const arrow = arrows[key];
  if (arrow) {
    const [right, down] = arrow;
    if (shiftKey) camera.pan(KEY_PAN * right, -KEY_PAN * down);
    else camera.turn(KEY_TURN * right, KEY_TURN * down);
  } else if (key === '+' || key === '=') camera.zoom(KEY_ZOOM);
  else if (key === '-') camera.zoom(1 / KEY_ZOOM);
  else if (key === 'Home' || key === '0') camera.reset();
  else return false;
  return true;
}
