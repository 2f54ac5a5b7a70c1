// Gives the scene of viser's client its light, shadows and materials. The client draws with three.js and shares no
// classes, so that new objects are made by the constructors of objects that exist. Lengths are metres; z is up.

/** Middle of the field. */
const FIELD = [0, 0, 0.19];
/** Distances of the camera from the field: below the first it is inside the body, beyond the second in the theatre. */
const [INSIDE, OUTSIDE] = [0.24, 0.7];
const AGX = 6;
const PCF = 1;

/** Materials by their names in the MuJoCo model. */
const MATERIALS = {
  steel: { metalness: 0.82, roughness: 0.3, colour: 0xd5dade },
  silver: { metalness: 0.85, roughness: 0.36, colour: 0xc4c8cc },
  gunmetal: { metalness: 0.9, roughness: 0.36, colour: 0x4a4d52 },
  pulley: { metalness: 1, roughness: 0.42 },
  extrusion: { metalness: 0.9, roughness: 0.5 },
  black: { metalness: 0.35, roughness: 0.5, colour: 0x1b1c1f },
  tray: { metalness: 0.95, roughness: 0.38, colour: 0x9aa1a7 },
  stand: { metalness: 0.8, roughness: 0.45 },
  peg: { roughness: 0.4 },
  tissue: { roughness: 0.45, wet: [0.95, 0.8, 0.03], colour: 0xb9564c },
  vessel: { roughness: 0.3, wet: [0.5, 0.2, 0.03], colour: 0x7a1214 },
  vein: { roughness: 0.3, wet: [0.5, 0.2, 0.03], colour: 0x3c3468 },
};

const NOISE = `
varying vec3 vPlace;
uniform mat3 normalMatrix;
float grain(vec3 p) { p = fract(p * 0.3183099 + 0.1); p *= 17.0; return fract(p.x * p.y * p.z * (p.x + p.y + p.z)); }
float noise(vec3 p) {
  vec3 i = floor(p), f = fract(p); f = f * f * (3.0 - 2.0 * f);
  return mix(mix(mix(grain(i), grain(i + vec3(1, 0, 0)), f.x), mix(grain(i + vec3(0, 1, 0)), grain(i + vec3(1, 1, 0)), f.x), f.y),
    mix(mix(grain(i + vec3(0, 0, 1)), grain(i + vec3(1, 0, 1)), f.x), mix(grain(i + vec3(0, 1, 1)), grain(i + vec3(1, 1, 1)), f.x), f.y), f.z);
}
const mat3 TURN = mat3(0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6);
float relief(vec3 p) { p = TURN * p; return 0.65 * noise(p * 260.0) + 0.35 * noise(p * 620.0); }
`;

/** Makes a material look like wet tissue: spots, fine vessels, a relief, and a film of uneven gloss. */
function moisten(material, [spots, bumps, glow]) {
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nvarying vec3 vPlace;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvPlace = position;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\n${NOISE}`)
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        float broad = noise(vPlace * 55.0), middle = noise(vPlace * 140.0 + 7.0);
        diffuseColor.rgb *= mix(vec3(1.0), mix(vec3(0.80, 0.52, 0.48), vec3(1.06, 0.98, 0.90), 0.6 * broad + 0.4 * middle), ${spots.toFixed(3)});
        float thread = abs(noise(vPlace * 48.0 + 1.1 * middle) - 0.5);
        diffuseColor.rgb *= mix(vec3(1.0), vec3(0.80, 0.42, 0.40), ${(0.4 * spots).toFixed(3)} * middle * (1.0 - smoothstep(0.0, 0.022, thread)));`,
      )
      .replace(
        "#include <roughnessmap_fragment>",
        "#include <roughnessmap_fragment>\nroughnessFactor = clamp(roughnessFactor + 0.35 * (noise(vPlace * 90.0) - 0.55), 0.12, 1.0);",
      )
      .replace(
        "#include <normal_fragment_maps>",
        `#include <normal_fragment_maps>
        float step0 = 0.00045, here = relief(vPlace);
        vec3 slope = vec3(relief(vPlace + vec3(step0, 0, 0)), relief(vPlace + vec3(0, step0, 0)), relief(vPlace + vec3(0, 0, step0))) - here;
        slope = normalMatrix * (slope * ${(0.9 * bumps).toFixed(3)});
        normal = normalize(normal - (slope - dot(slope, normal) * normal));`,
      )
      .replace(
        "#include <emissivemap_fragment>",
        `#include <emissivemap_fragment>\ntotalEmissiveRadiance += ${glow.toFixed(3)} * diffuseColor.rgb * vec3(1.0, 0.45, 0.4);`,
      );
  };
  material.needsUpdate = true;
}

/** Height of the drape: flat around the phantom's tray, then falling in folds to the table. */
function cloth(x, y) {
  const [ax, ay] = [Math.max(0, Math.abs(x) - 0.125), Math.max(0, Math.abs(y) - 0.095)];
  const out = Math.hypot(ax, ay);
  const fall = 1 - Math.exp(-((out / 0.085) ** 1.6));
  const turn = Math.atan2(y, x);
  const folds = 0.006 * Math.sin(17 * turn + 3 * Math.sin(3 * turn)) + 0.004 * Math.sin(31 * turn + 40 * out);
  const ripples = 0.0035 * Math.sin(38 * x + 11 * Math.sin(9 * y)) * Math.sin(29 * y + 3 * x);
  return 0.139 - 0.112 * fall + Math.min(1, out / 0.05) * (folds * Math.exp(-((out - 0.1) ** 2) / 0.02) + ripples);
}

/** Covers the table with a surgical drape that fades into the background. like: a mesh whose classes are used. */
function drape(like) {
  const [columns, rows, half] = [161, 161, 1.0];
  const places = new Float32Array(3 * columns * rows);
  // Finer near the phantom.
  const spread = (k, count) => {
    const u = (2 * k) / (count - 1) - 1;
    return half * Math.sign(u) * (0.3 * Math.abs(u) + 0.7 * Math.abs(u) ** 2.2);
  };
  const faces = [];
  for (let j = 0; j < rows; j++)
    for (let i = 0; i < columns; i++) {
      const [x, y] = [spread(i, columns), spread(j, rows)];
      places.set([x, y, cloth(x, y)], 3 * (j * columns + i));
      const at = j * columns + i;
      if (i + 1 < columns && j + 1 < rows) faces.push(at, at + 1, at + columns + 1, at, at + columns + 1, at + columns);
    }
  const shape = new like.geometry.constructor();
  const Values = like.geometry.getAttribute("position").constructor;
  shape.setAttribute("position", new Values(places, 3));
  shape.setIndex(new Values(new Uint32Array(faces), 1));
  shape.computeVertexNormals();
  const material = new like.material.constructor({ color: 0x16494f, metalness: 0, roughness: 0.95, transparent: true });
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nvarying vec3 vPlace;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvPlace = position;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "#include <common>\nvarying vec3 vPlace;")
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        vec2 weave = sin(vPlace.xy * 2600.0);
        diffuseColor.rgb *= 1.0 + 0.05 * weave.x * weave.y;
        diffuseColor.a *= 1.0 - smoothstep(0.40, 0.78, length(vPlace.xy * vec2(0.9, 1.15)));`,
      );
  };
  const made = new like.constructor(shape, material);
  made.receiveShadow = true;
  made.renderOrder = -1;
  return made;
}

const between = (a, b, share) => a + (b - a) * share;

export class Theatre {
  constructor(viewer) {
    this.viewer = viewer;
    this.dressed = new WeakSet();
    viewer.scene.onBeforeRender = (renderer, scene, camera) => this.prepare(renderer, scene, camera);
    viewer.requestRender();
  }

  /** Called before each picture. */
  prepare(renderer, scene, camera) {
    scene.traverse((node) => this.dress(node));
    const { key } = this;
    if (!key) return;
    const shadows = /** @type {any} */ (document.getElementById("shadows"))?.checked ?? false;
    if (renderer.toneMapping !== AGX) {
      renderer.toneMapping = AGX;
      renderer.shadowMap.type = PCF;
    }
    const away = camera.position.distanceTo(key.target.getWorldPosition(key.position.clone()));
    const outside = Math.min(1, Math.max(0, (away - INSIDE) / (OUTSIDE - INSIDE)));
    renderer.toneMappingExposure = between(1.25, 1.15, outside);
    scene.environmentIntensity = between(0.35, 0.6, outside);
    key.intensity = 2.6;
    this.fill.intensity = between(0.5, 0.8, outside);
    if (key.castShadow !== shadows) key.castShadow = shadows;
    const reach = between(0.15, 0.75, outside);
    const { camera: box } = key.shadow;
    if (box.right === reach) return;
    // Inside the body only what is near the field casts a shadow, not the arms above it.
    const near = key.position.distanceTo(key.target.position) - between(0.13, 0.9, outside);
    Object.assign(box, { left: -reach, right: reach, bottom: -reach, top: reach, near, far: near + 2 });
    box.updateProjectionMatrix();
    // The client reverses the depth buffer, so that a positive bias moves the shadow away from the light.
    Object.assign(key.shadow, { bias: 0.0006, normalBias: between(0.0008, 0.004, outside), radius: between(4, 2.5, outside) });
  }

  dress(node) {
    if (this.dressed.has(node)) return;
    this.dressed.add(node);
    if (node.isDirectionalLight) this.light(node);
    const look = node.isMesh && MATERIALS[node.material.name];
    if (node.isMesh && node.material.name === "wood") {
      node.visible = false;
      if (!this.cloth) this.root.add((this.cloth = drape(node)));
    }
    if (!look || this.dressed.has(node.material)) return;
    this.dressed.add(node.material);
    const { metalness = 0, roughness, colour, wet } = look;
    Object.assign(node.material, { metalness, roughness });
    if (colour !== undefined) node.material.color.set(colour);
    if (wet) moisten(node.material, wet);
  }

  /** Replaces the server's light by a key light with shadows and a fill light. */
  light(given) {
    given.visible = false;
    if (this.key) return;
    this.key = new given.constructor(0xfff4e8);
    this.fill = new given.constructor(0xbfd4ff);
    this.key.position.set(-0.42, 0.38, 1.0);
    this.fill.position.set(0.6, -0.9, 0.7);
    for (const light of [this.key, this.fill]) {
      this.dressed.add(light);
      light.target.position.set(...FIELD);
      this.root.add(light, light.target);
    }
    this.key.shadow.mapSize.set(2048, 2048);
  }

  get root() {
    return this.viewer.nodeRefFromName[""];
  }
}

/** Waits for the client, which makes its scene some time after the page. */
function begin() {
  const viewer = window["__viserMutable"];
  if (viewer?.scene && viewer.nodeRefFromName[""]) window.ravenjax.theatre = new Theatre(viewer);
  else setTimeout(begin, 50);
}
if (document.getElementById("root")) begin(); // not in the 2D view
