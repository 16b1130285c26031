// Draws a mesh with WebGL2, and keeps the copies of its arrays that the graphics hardware has. All
// of it can be made anew from the mesh when the hardware loses it.

const VERTEX = `#version 300 es
uniform mat4 toView, toClip;
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 normal;
layout(location = 2) in vec4 color;
out vec3 place, direction, tint;
void main() {
  vec4 seen = toView * vec4(position, 1.0);
  place = seen.xyz;
  direction = mat3(toView) * normal.xyz;
  tint = color.rgb;
  gl_Position = toClip * seen;
}`;

// A key light at the upper left, a fill on the right, light from the sky and from the ground, all
// fixed to the screen, so that turning the model is what shows its shape. Both sides are lit; the
// inner one is a little darker and warmer, but not at the outline, where single pixels show it.
const FRAGMENT = `#version 300 es
precision highp float;
uniform int mode;
uniform vec4 line;
in vec3 place, direction, tint;
out vec4 color;
const vec3 KEY = vec3(-0.44, 0.62, 0.65), FILL = vec3(0.8, 0.1, 0.59);
void main() {
  if (mode == 2) { color = vec4(line.rgb * line.a, line.a); return; }
  vec3 eye = normalize(-place);
  vec3 n = normalize(cross(dFdx(place), dFdy(place)));
  if (mode == 0 && dot(direction, direction) > 0.0) n = normalize(direction);
  bool isBack = !gl_FrontFacing && abs(dot(n, eye)) > 0.3;
  if (isBack && mode == 0) n = -n;
  float key = max(0.0, (dot(n, KEY) + 0.15) / 1.15);
  float fill = max(0.0, dot(n, FILL));
  vec3 around = mix(vec3(0.13, 0.115, 0.105), vec3(0.33, 0.345, 0.37), 0.5 + 0.5 * n.y);
  float edge = pow(1.0 - max(0.0, dot(n, eye)), 3.0);
  float shine = pow(max(0.0, dot(n, normalize(KEY + eye))), 24.0);
  vec3 own = pow(tint, vec3(2.2));
  if (isBack) own *= vec3(0.72, 0.62, 0.55);
  vec3 light = around + vec3(1.05, 1.0, 0.94) * key * sqrt(key) + vec3(0.12, 0.135, 0.16) * fill;
  vec3 sum = own * light + 0.07 * shine + 0.14 * edge * around;
  sum = sum * (1.0 + sum * 0.16) / (1.0 + sum * 0.3);
  color = vec4(pow(sum, vec3(1.0 / 2.2)), 1.0);
}`;

const MODES = { smooth: 0, flat: 1, wire: 1 };

export class Drawing {
  /** Throws where there is no WebGL2. */
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', { antialias: true });
    if (!gl) throw new Error('this browser shows no WebGL2');
    this.gl = gl;
    this.prepare();
  }

  /** Makes everything that a lost context has lost. */
  prepare() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(`WebGL refuses: ${gl.getProgramInfoLog(program)}`);
    }
    gl.useProgram(program);
    this.uniforms = Object.fromEntries(
      ['toView', 'toClip', 'mode', 'line'].map((name) => [name, gl.getUniformLocation(program, name)]),
    );
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.polygonOffset(1, 1);
    this.copies = {};
    this.hasLines = false;
  }

  /** Lets go of the mesh. */
  forget() {
    const { gl } = this;
    for (const copy of Object.values(this.copies)) gl.deleteBuffer(copy.buffer);
    this.copies = {};
    this.hasLines = false;
  }

  /** The copy of an array on the hardware, brought up to date. */
  copy(name, target, pages) {
    const { gl } = this;
    const { array } = pages;
    const copy = (this.copies[name] ??= { buffer: gl.createBuffer(), length: 0 });
    gl.bindBuffer(target, copy.buffer);
    if (copy.length !== array.length) {
      copy.length = array.length;
      gl.bufferData(target, array, gl.DYNAMIC_DRAW);
      pages.drain(() => {});
      return copy;
    }
    const width = array.BYTES_PER_ELEMENT;
    pages.drain((begin, end) => {
      gl.bufferSubData(target, begin * width, array, begin, end - begin);
      if (name === 'corners' && this.hasLines) this.copyLines(array, begin, end);
    });
    gl.bindBuffer(target, copy.buffer);
    return copy;
  }

  /** The edges of some faces, as pairs of vertices: corner k begins the k-th. */
  copyLines(corners, begin, end) {
    const { gl } = this;
    const ends = new Uint32Array(2 * (end - begin));
    for (let corner = begin; corner < end; ++corner) {
      const place = 2 * (corner - begin);
      ends[place] = corners[corner];
      ends[place + 1] = corners[corner % 3 === 2 ? corner - 2 : corner + 1];
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.copies.lines.buffer);
    gl.bufferSubData(gl.ELEMENT_ARRAY_BUFFER, 8 * begin, ends);
  }

  /** Edges are kept only while they are shown: they take twice the room of the faces. */
  keepLines(corners, areShown) {
    const { gl } = this;
    const isLarger = areShown && this.copies.lines?.length !== corners.length;
    if (areShown === this.hasLines && !isLarger) return;
    if (this.copies.lines) gl.deleteBuffer(this.copies.lines.buffer);
    delete this.copies.lines;
    this.hasLines = areShown;
    if (!areShown) return;
    this.copies.lines = { buffer: gl.createBuffer(), length: corners.length };
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.copies.lines.buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, 8 * corners.length, gl.DYNAMIC_DRAW);
    const step = 3 << 16;
    for (let begin = 0; begin < corners.length; begin += step) {
      this.copyLines(corners, begin, Math.min(begin + step, corners.length));
    }
  }

  copyAll(mesh, shading) {
    const { gl } = this;
    const attribute = (place, name, pages, width, type) => {
      this.copy(name, gl.ARRAY_BUFFER, pages);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, width, type, type !== gl.FLOAT, 0, 0);
    };
    attribute(0, 'positions', mesh.positions, 3, gl.FLOAT);
    attribute(1, 'normals', mesh.normals, 4, gl.INT_2_10_10_10_REV);
    if (mesh.colors) attribute(2, 'colors', mesh.colors, 4, gl.UNSIGNED_BYTE);
    else gl.disableVertexAttribArray(2);
    this.keepLines(mesh.corners.array, shading === 'wire');
    this.copy('corners', gl.ELEMENT_ARRAY_BUFFER, mesh.corners);
  }

  /**
   * Draws the first faces of `mesh`. `look` has the `clay` of a mesh without colours and the `line`
   * colour, as shares of red, green, blue and opacity.
   */
  draw(mesh, matrices, shading, look) {
    const { gl, uniforms } = this;
    const { canvas } = gl;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!mesh) return;
    this.copyAll(mesh, shading);
    gl.uniformMatrix4fv(uniforms.toView, false, matrices.toView);
    gl.uniformMatrix4fv(uniforms.toClip, false, matrices.toClip);
    gl.uniform1i(uniforms.mode, MODES[shading]);
    if (!mesh.colors) gl.vertexAttrib4f(2, ...look.clay, 1);
    const isWire = shading === 'wire';
    if (isWire) gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.drawElements(gl.TRIANGLES, 3 * mesh.faces, gl.UNSIGNED_INT, 0);
    if (!isWire) return;
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.enable(gl.BLEND);
    gl.uniform1i(uniforms.mode, 2);
    gl.uniform4f(uniforms.line, ...look.line);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.copies.lines.buffer);
    gl.drawElements(gl.LINES, 6 * mesh.faces, gl.UNSIGNED_INT, 0);
    gl.disable(gl.BLEND);
  }
}
