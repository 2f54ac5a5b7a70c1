// Draws the robot in three dimensions with WebGL 2: the bodies of `describe_figure` at given joint positions.
// `view.js` starts it, in a worker if the browser can draw there, so that the page stays responsive. It imports nothing,
// because a worker has no import map.

/** An ArrayBuffer of base64. */
function bytes(text) {
  if (Uint8Array["fromBase64"]) return Uint8Array["fromBase64"](text).buffer;
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}

const VERTEX = `#version 300 es
layout(location = 0) in vec3 corner;
uniform mat4 view, place;
uniform vec3 low, size;
out vec3 seen;
void main() {
  vec4 world = place * vec4(low + size * corner, 1.0);
  seen = world.xyz;
  gl_Position = view * world;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 seen;
uniform vec3 eye;
uniform vec4 colour;
out vec4 pixel;
void main() {
  vec3 facing = normalize(cross(dFdx(seen), dFdy(seen)));
  vec3 away = normalize(eye - seen);
  if (dot(facing, away) < 0.0) facing = -facing;
  float key = max(dot(facing, normalize(vec3(0.4, -0.5, 0.9))), 0.0);
  float light = 0.42 + 0.16 * facing.z + 0.3 * key + 0.22 * max(dot(facing, away), 0.0);
  pixel = vec4(colour.rgb * light * colour.a, colour.a);
}`;

// Matrices are 4 x 4 in column-major order, as WebGL requires.
const multiplied = (a, b) => {
  const out = new Float64Array(16);
  for (let c = 0; c < 4; c += 1)
    for (let r = 0; r < 4; r += 1) for (let k = 0; k < 4; k += 1) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
};
const moved = ([x, y, z]) => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1];
const turned = ([w, x, y, z]) => [
  1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
  2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
  2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0,
  0, 0, 0, 1,
];
const about = ([x, y, z], angle) => {
  const s = Math.sin(angle / 2);
  return turned([Math.cos(angle / 2), s * x, s * y, s * z]);
};

const minus = (a, b) => a.map((one, k) => one - b[k]);
const crossed = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const unit = (a) => a.map((one) => one / Math.hypot(...a));

/** Poses of all bodies at joint positions {arm: 7 numbers}. Arms without positions stay at home. */
export function places(bodies, positions) {
  const out = [];
  for (const { parent, position, quaternion, joint } of bodies) {
    let place = multiplied(moved(position), turned(quaternion));
    if (joint) {
      const q = (positions[joint.arm]?.[joint.index] ?? joint.home) - joint.zero;
      const own =
        joint.kind === "slide"
          ? moved(joint.axis.map((one) => one * q))
          : multiplied(multiplied(moved(joint.anchor), about(joint.axis, q)), moved(joint.anchor.map((one) => -one)));
      place = multiplied(place, own);
    }
    out.push(parent < 0 ? place : multiplied(out[parent], place));
  }
  return out;
}

/** A point of a body's frame in the world. */
export const carried = (place, [x, y, z]) => [0, 1, 2].map((k) => place[k] * x + place[4 + k] * y + place[8 + k] * z + place[12 + k]);

function looking(eye, focus, fov, aspect) {
  const back = unit(minus(eye, focus));
  const right = unit(crossed([0, 0, 1], back));
  const up = crossed(back, right);
  const turn = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, 0, 0, 0, 1];
  const f = 1 / Math.tan(fov / 2);
  const [near, far] = [0.01, 12];
  const lens = [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
  return multiplied(lens, multiplied(turn, moved(eye.map((one) => -one))));
}

export class Figure {
  /** canvas: of the page or offscreen; answer(message): called with {ready}, or {picture} as a Blob. */
  constructor(canvas, description, answer) {
    this.canvas = canvas;
    this.answer = answer;
    this.bodies = description.bodies;
    this.cameras = structuredClone(description.cameras);
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
    answer({ ready: Boolean(this.gl) });
    if (!this.gl) return;
    this.program = this.compiled();
    this.names = Object.fromEntries(
      ["view", "place", "low", "size", "eye", "colour"].map((name) => [name, this.gl.getUniformLocation(this.program, name)]),
    );
    this.meshes = this.bodies.map(() => []);
    this.scene = null;
    this.extent = null;
    this.wanted = false;
    this.load();
  }

  /** Handles messages of the page: {extent}, {scene}, {turn}, {nearer}, {picture}. */
  hear({ extent, scene, turn, nearer, picture }) {
    if (!this.gl) return;
    if (extent) this.extent = extent;
    if (scene) this.scene = scene; // robot and ghost are joint positions by arm; apart: their distance, mm
    if (turn) this.turn(turn);
    if (nearer) this.nearer(nearer);
    if (picture) this.picture();
    else this.ask();
  }

  /** Loads the shapes one body at a time, so that the page stays responsive. */
  async load() {
    for (const [k, { meshes }] of this.bodies.entries()) {
      if (!meshes.length) continue;
      this.meshes[k] = meshes.map((mesh) => this.loaded(mesh));
      await new Promise((resolve) => setTimeout(resolve));
    }
    this.ask();
  }

  compiled() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [
      [gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, FRAGMENT],
    ]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  loaded({ colour, low, size, corners, faces }) {
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, bytes(corners), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.UNSIGNED_SHORT, true, 6, 0);
    const order = bytes(faces);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, order, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { array, colour, low, size, corners: order.byteLength / 2 };
  }

  ask() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      this.draw();
    });
  }

  draw() {
    const { gl, canvas, scene } = this;
    if (!scene || !this.extent) return;
    const { width, height } = this.extent;
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.enable(gl.SCISSOR_TEST);
    gl.enable(gl.DEPTH_TEST);
    const robot = places(this.bodies, scene.robot);
    const ghost = scene.ghost && places(this.bodies, scene.ghost);
    for (const { name, x, y, w, h } of this.views(width, height)) {
      const { place: eye, focus, fov } = this.cameras[name];
      gl.viewport(x, y, w, h);
      gl.scissor(x, y, w, h);
      gl.uniformMatrix4fv(this.names.view, false, new Float32Array(looking(eye, focus, fov, w / h)));
      gl.uniform3fv(this.names.eye, eye);
      gl.disable(gl.BLEND);
      this.bodiesAt(robot, () => true, null);
      if (ghost && scene.apart > 0.4) {
        gl.enable(gl.BLEND);
        gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
        this.bodiesAt(ghost, (body) => body.joint || this.rides(body), [0.16, 0.62, 0.95, 0.5]);
      }
    }
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Whether a body moves with a joint of another. */
  rides({ parent }) {
    return parent >= 0 && (Boolean(this.bodies[parent].joint) || this.rides(this.bodies[parent]));
  }

  views(width, height) {
    if (width < height * 1.25) {
      const half = Math.floor(height / 2);
      return [{ name: "theatre", x: 0, y: half, w: width, h: height - half }, { name: "closeup", x: 0, y: 0, w: width, h: half }];
    }
    const half = Math.floor(width / 2);
    return [{ name: "theatre", x: 0, y: 0, w: half, h: height }, { name: "closeup", x: half, y: 0, w: width - half, h: height }];
  }

  bodiesAt(at, which, look) {
    const { gl, names } = this;
    for (const [k, body] of this.bodies.entries()) {
      if (!which(body)) continue;
      gl.uniformMatrix4fv(names.place, false, new Float32Array(at[k]));
      for (const mesh of this.meshes[k]) {
        gl.uniform3fv(names.low, mesh.low);
        gl.uniform3fv(names.size, mesh.size);
        gl.uniform4fv(names.colour, look ?? [...mesh.colour, 1]);
        gl.bindVertexArray(mesh.array);
        gl.drawElements(gl.TRIANGLES, mesh.corners, gl.UNSIGNED_SHORT, 0);
      }
    }
  }

  /** The view at a position in the picture, {x, y} from 0 to 1. */
  under({ x, y }) {
    const { width, height } = this.extent;
    return this.cameras[(width < height * 1.25 ? y : x) > 0.5 ? "closeup" : "theatre"];
  }

  /** Rotates the view at a position by a drag of dx, dy px. */
  turn({ at, dx, dy }) {
    if (!this.extent) return;
    const camera = this.under(at);
    const from = minus(camera.place, camera.focus);
    const r = Math.hypot(...from);
    const round = Math.atan2(from[1], from[0]) - 0.008 * dx;
    const high = Math.max(-0.2, Math.min(1.4, Math.asin(from[2] / r) + 0.006 * dy));
    camera.place = camera.focus.map((one, k) => one + r * [Math.cos(high) * Math.cos(round), Math.cos(high) * Math.sin(round), Math.sin(high)][k]);
  }

  /** Multiplies the distance of the view at a position by a factor. */
  nearer({ at, by }) {
    if (!this.extent) return;
    const camera = this.under(at);
    const r = Math.hypot(...minus(camera.place, camera.focus));
    const factor = Math.max(0.05, Math.min(8, r * by)) / r;
    camera.place = camera.focus.map((one, k) => one + factor * (camera.place[k] - one));
  }

  /** The present picture as PNG. */
  async picture() {
    this.draw(); // the browser discards a picture after it was shown
    const { canvas } = this;
    this.answer({ picture: canvas.convertToBlob ? await canvas.convertToBlob() : await new Promise((resolve) => canvas.toBlob(resolve)) });
  }
}

if (globalThis.WorkerGlobalScope) {
  let figure = null;
  addEventListener("message", ({ data }) => {
    if (data.canvas) figure = new Figure(data.canvas, JSON.parse(data.description), (message) => postMessage(message));
    else figure.hear(data);
  });
}
