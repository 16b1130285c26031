// What surrounds the picture: the bar with caption, figures and choices, in a dark and a light look.

const STYLE = `
:host { --ink: #23262b; --quiet: #6b7078; --paper: #f7f6f3; --paper-low: #e3e1dc; --bar: #fffc;
  --rule: #0000001a; --accent: #2f6f8f; --alarm: #a63d2f;
  display: block; position: relative; overflow: hidden; contain: strict; min-height: 200px;
  color: var(--ink); background: radial-gradient(120% 100% at 50% 30%, var(--paper), var(--paper-low));
  font: 13px/1.4 system-ui, sans-serif; color-scheme: light; }
:host(.dark) { --ink: #e9e7e2; --quiet: #9a9ea5; --paper: #2b2e33; --paper-low: #15171a; --bar: #1c1e22cc;
  --rule: #ffffff1f; --accent: #79b8d3; --alarm: #f0907f; color-scheme: dark; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; cursor: grab;
  outline: none; }
canvas:active { cursor: grabbing; }
canvas:focus-visible { box-shadow: inset 0 0 0 3px var(--accent); }
.progress { position: absolute; inset: 0 0 auto; height: 3px; transition: opacity .8s .4s; }
.progress.done { opacity: 0; }
.progress div { height: 100%; width: 100%; background: var(--accent); transform-origin: 0 0;
  transform: scaleX(0); transition: transform .2s linear; }
.foot { position: absolute; inset: auto 0 0; display: flex; flex-direction: column; align-items: start;
  pointer-events: none; padding: 12px; gap: 8px; }
.foot > * { pointer-events: auto; }
.notice, .help, .bar { background: var(--bar); border-radius: 10px; padding: 7px 12px; margin: 0;
  max-width: 46em; backdrop-filter: blur(8px); }
.notice, .help, .bar, fieldset, button { border: 1px solid var(--rule); }
.notice { color: var(--alarm); }
.help { color: var(--quiet); }
:host([hidden]), [hidden] { display: none !important; }
.bar { box-sizing: border-box; width: 100%; display: flex; flex-wrap: wrap; align-items: center;
  gap: 6px 14px; max-width: none; }
.words { flex: 1 1 12em; min-width: 0; }
.caption { font-weight: 600; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.caption:empty { display: none; }
.figures { color: var(--quiet); font-variant-numeric: tabular-nums; }
fieldset { display: flex; border-radius: 7px; padding: 2px; margin: 0; }
label { position: relative; }
input { position: absolute; inset: 0; opacity: 0; margin: 0; cursor: pointer; }
label span { display: block; padding: 3px 11px; border-radius: 5px; color: var(--quiet); }
input:checked + span { background: var(--rule); color: var(--ink); }
input:focus-visible + span, button:focus-visible { outline: 2px solid var(--accent); outline-offset: 1px; }
button { font: inherit; color: var(--quiet); background: none; border-radius: 7px; min-width: 30px;
  height: 30px; cursor: pointer; }
button:hover, label:hover span { color: var(--ink); }
.spoken { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
@media (prefers-reduced-motion: reduce) { * { transition: none !important; } }
`;

const HELP = `Drag or arrow keys: turn · wheel, pinch, + and −: nearer and farther ·
right button, two fingers or Shift with arrows: move · double click or Home: back to the beginning`;

const choice = (name) =>
  `<label><input type="radio" name="shading" value="${name}"><span>${name}</span></label>`;

const MARKUP = `<style>${STYLE}</style>
<canvas tabindex="0" role="application" aria-roledescription="3D view" aria-describedby="help"></canvas>
<div class="progress" role="progressbar" aria-label="Loading" aria-valuemin="0" aria-valuemax="100"><div></div></div>
<div class="foot"><p class="notice" role="alert" hidden></p><p class="help" id="help" hidden>${HELP}</p>
<div class="bar"><div class="words"><div class="caption"></div><div class="figures">…</div></div>
<fieldset aria-label="Shading">${['smooth', 'flat', 'wire'].map(choice).join('')}</fieldset>
<div><button class="reset" title="Back to the beginning" aria-label="Back to the beginning">⟲</button>
<button class="ask" aria-label="Keys and gestures" aria-expanded="false">?</button></div>
</div></div><div class="spoken" role="status"></div>`;

/** Fills a shadow root; returns the parts by name. */
export function furnish(root) {
  root.innerHTML = MARKUP;
  const part = (selector) => root.querySelector(selector);
  const names = ['progress', 'notice', 'caption', 'figures', 'reset', 'spoken'];
  const parts = Object.fromEntries(names.map((name) => [name, part(`.${name}`)]));
  Object.assign(parts, { canvas: part('canvas'), shading: part('fieldset') });
  const [ask, help] = [part('.ask'), part('.help')];
  ask.addEventListener('click', () => {
    help.hidden = !help.hidden;
    ask.setAttribute('aria-expanded', !help.hidden);
  });
  return parts;
}

/** What the drawing needs to know of a look. */
export const LOOKS = {
  light: { clay: [0.83, 0.8, 0.76], line: [0.1, 0.12, 0.16] },
  dark: { clay: [0.77, 0.75, 0.72], line: [0.04, 0.05, 0.07] },
};

/** The figures below the caption. */
export function describe({ faces, error, diagonal }) {
  const count = faces.toLocaleString('en');
  const triangles = `${count} triangle${faces === 1 ? '' : 's'}`;
  if (error.rms === 0) return `${triangles} · all there is`;
  const share = (100 * error.rms) / diagonal;
  return `${triangles} · error ${error.rms.toPrecision(2)} (${share.toPrecision(2)} % of the diagonal)`;
}
