// The three-dimensional view of a report: the layers of a run as they were at each time.
//
// Draws only when something has changed. Every surface is lit from beside the eye, so that its shape
// is seen: a colour is that of the legend or the scale, times a brightness from AMBIENT to 1. Nothing
// is tone-mapped. Several views on a page turn together.

import {
  AmbientLight,
  BufferAttribute,
  BufferGeometry,
  ColorManagement,
  DirectionalLight,
  DoubleSide,
  LinearSRGBColorSpace,
  Mesh,
  MeshLambertMaterial,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

ColorManagement.enabled = false;
const views = [];
const KINDS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };
const AMBIENT = 0.5; // Brightness of a surface that turns away from the light

// The arrays of a payload: base64 of gzip, with an index of name to [kind, offset, length].
async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer();
  return (place) => {
    const [kind, offset, length] = place;
    return new KINDS[kind](bytes.slice(offset, offset + length * KINDS[kind].BYTES_PER_ELEMENT));
  };
}

class View {
  constructor(root, told, arrays) {
    this.root = root;
    this.told = told;
    this.arrays = arrays;
    this.shades = told.shades.map((one) => [1, 3, 5].map((i) => parseInt(one.slice(i, i + 2), 16)));
    this.colouring = told.colourings[0];
    this.scene = new Scene();
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.camera = new PerspectiveCamera(28, 1, told.size / 100, told.size * 50);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    // A Lambert surface sends back 1 / pi of what it receives.
    this.light = new DirectionalLight(0xffffff, Math.PI * (1 - AMBIENT));
    this.scene.add(new AmbientLight(0xffffff, Math.PI * AMBIENT), this.light);
    this.build();
    this.listen();
    this.home();
  }

  // What there is to show; what is shown when is decided by `update`, which makes each drawable
  // when it is first wanted, so that the first picture does not wait for all of them.
  build() {
    const { touches } = this.told;
    this.drawables = this.told.drawables.map((one) => ({ ...one, object: null }));
    this.touched = this.points({ ...touches, layer: "touched" });
    this.mark = new Points(this.positions(new Float32Array(3)), this.spots(14));
    this.mark.material.depthTest = false;
    this.mark.visible = false;
    this.scene.add(this.touched, this.mark);
  }

  positions(values) {
    return new BufferGeometry().setAttribute("position", new BufferAttribute(values, 3));
  }

  make(one) {
    const make = { faces: "mesh", pieces: "line", pose: "finger", points: "points" };
    const object = this[make[Object.keys(make).find((key) => one[key])]](one);
    this.scene.add(object);
    return object;
  }

  points(one) {
    const color = this.told.layers[one.layer].colour;
    const size = (2 * one.radius) / Math.tan((this.camera.fov * Math.PI) / 360);
    const material = one.layer === "untouched" ? this.spots(9) : new PointsMaterial({ color, size });
    return new Points(this.positions(this.places(one.points)), material);
  }

  // Round marks of a size in pixels. They lie on the surface, or a little under it, and are drawn
  // as if they were nearer to the eye.
  spots(size) {
    const color = this.told.layers.untouched.colour;
    const scaled = size * this.renderer.getPixelRatio();
    const material = new PointsMaterial({ color, size: scaled, sizeAttenuation: false });
    const lift = (0.05 * this.told.size).toExponential();
    material.onBeforeCompile = (shader) => {
      shader.vertexShader = shader.vertexShader.replace("#include <project_vertex>", `
        #include <project_vertex>
        vec4 nearer = projectionMatrix * (mvPosition + vec4(0.0, 0.0, ${lift}, 0.0));
        gl_Position.z = nearer.z / nearer.w * gl_Position.w;`);
      shader.fragmentShader = shader.fragmentShader.replace("#include <clipping_planes_fragment>",
        "if (length(gl_PointCoord - 0.5) > 0.5) discard;\n#include <clipping_planes_fragment>");
    };
    return material;
  }

  places(place) {
    const whole = this.arrays(place);
    const found = new Float32Array(whole.length);
    const { low, step } = this.told;
    for (let i = 0; i < whole.length; i++) found[i] = low[i % 3] + step * whole[i];
    return found;
  }

  mesh(one) {
    const { colour: color, opacity } = this.told.layers[one.layer];
    const geometry = this.positions(this.places(one.vertices));
    geometry.setIndex(new BufferAttribute(this.arrays(one.faces), 1));
    if (opacity < 1) return this.pane(geometry, color, opacity);
    const offset = { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 };
    const colours = new BufferAttribute(new Uint8Array(geometry.attributes.position.count * 3), 3, true);
    geometry.setAttribute("color", colours);
    geometry.computeVertexNormals();
    const mesh = new Mesh(geometry);
    mesh.userData = {
      plain: new MeshLambertMaterial({ color, side: DoubleSide, ...offset }),
      valued: new MeshLambertMaterial({ vertexColors: true, side: DoubleSide, ...offset }),
      values: Object.fromEntries(
        Object.entries(one.values).map(([name, place]) => [name, this.arrays(place)])),
    };
    return mesh;
  }

  pane(geometry, color, opacity) {
    geometry.computeVertexNormals();
    const clear = { color, opacity, transparent: true, depthWrite: false, side: DoubleSide };
    return new Mesh(geometry, new MeshLambertMaterial(clear));
  }

  line(one) {
    const geometry = new LineSegmentsGeometry().setPositions(this.places(one.pieces));
    const linewidth = one.layer === "contours" ? 3 : 1;
    return new LineSegments2(geometry, new LineMaterial({ color: this.told.layers[one.layer].colour, linewidth }));
  }

  finger({ pose }) {
    const { pad, layers: { finger } } = this.told;
    this.pad ??= this.positions(this.arrays(pad.vertices)).setIndex(new BufferAttribute(this.arrays(pad.faces), 1));
    const mesh = this.pane(this.pad, finger.colour, finger.opacity);
    mesh.position.fromArray(pose);
    mesh.quaternion.fromArray(pose, 3);
    return mesh;
  }

  // Colours of the values that are chosen, of one model when it is first shown.
  paint(mesh) {
    const { plain, valued, values, painted } = mesh.userData;
    if (!values) return;
    const chosen = values[this.colouring];
    mesh.material = chosen ? valued : plain;
    if (!chosen || painted === this.colouring) return;
    const colours = mesh.geometry.attributes.color;
    chosen.forEach((value, i) => colours.array.set(this.shades[value], 3 * i));
    colours.needsUpdate = true;
    mesh.userData.painted = this.colouring;
  }

  listen() {
    const find = (name) => this.root.querySelector(`[data-control=${name}]`);
    this.slider = find("time");
    this.readout = find("readout");
    this.showing = Object.fromEntries(Object.keys(this.told.layers).map((name) => {
      const box = find(name);
      box?.addEventListener("change", () => this.update());
      return [name, () => box?.checked ?? false];
    }));
    find("colour")?.addEventListener("change", (event) => {
      this.colouring = event.target.value;
      this.update();
    });
    this.slider.addEventListener("input", () => views.forEach((one) => one.seek(this.slider.value)));
    find("play").addEventListener("click", () => this.play());
    find("home").addEventListener("click", () => views.forEach((one) => one.home()));
    for (const one of document.querySelectorAll(`[data-place][data-view="${this.root.id}"]`)) {
      one.addEventListener("click", () => this.visit(this.told.places[one.dataset.place]));
    }
    this.controls.addEventListener("change", () => {
      for (const other of views) if (other !== this) other.follow(this);
      this.draw();
    });
    new ResizeObserver(() => this.resize()).observe(this.root.querySelector(".stage"));
    window.addEventListener("beforeprint", () => this.draw());
  }

  seek(share) {
    this.slider.value = share;
    this.update();
  }

  play() {
    clearInterval(this.timer);
    if (Number(this.slider.value) >= 1) this.slider.value = 0;
    this.timer = setInterval(() => {
      const next = Math.min(Number(this.slider.value) + 0.01, 1);
      views.forEach((one) => one.seek(next));
      if (next >= 1) clearInterval(this.timer);
    }, 80);
  }

  // Look at a place where something happened, at that time.
  visit(place) {
    this.seek(Math.min(1, place.time / this.told.end));
    this.mark.visible = true;
    this.mark.geometry.attributes.position.array.set(place.point);
    this.mark.geometry.attributes.position.needsUpdate = true;
    const target = new Vector3(...this.told.middle);
    const out = new Vector3(...place.point).sub(target).setZ(0.35 * this.told.size);
    this.camera.position.copy(target).addScaledVector(out.normalize(), this.told.size * 2.05);
    this.controls.target.copy(target);
    this.controls.update();
    this.draw();
    this.root.scrollIntoView({ block: "nearest" });
  }

  home() {
    const [turn, rise] = [-50, 18].map((one) => (one * Math.PI) / 180);
    const out = [Math.cos(turn) * Math.cos(rise), Math.sin(turn) * Math.cos(rise), Math.sin(rise)];
    this.controls.target.set(...this.told.middle);
    this.camera.position.set(...this.told.middle).addScaledVector(new Vector3(...out), this.told.size * 2.05);
    this.mark.visible = false;
    this.controls.update();
    this.update();
  }

  follow(other) {
    this.camera.position.copy(other.camera.position);
    this.camera.quaternion.copy(other.camera.quaternion);
    this.controls.target.copy(other.controls.target);
    this.draw();
  }

  update() {
    const time = this.told.end * Number(this.slider.value);
    const by = (times) => times.filter((one) => one <= time + 1e-9).length;
    const model = by(this.told.models.map((one) => one.time)) - 1;
    const last = new Map(); // of what shares a path, unless its layer accumulates
    const { layers } = this.told;
    for (const one of this.drawables) {
      if (one.time <= time + 1e-9) last.set(layers[one.layer].accumulates ? one : one.path, one);
    }
    const current = new Set(last.values());
    for (const one of this.drawables) {
      const visible = current.has(one) && this.showing[one.layer]();
      if (visible) this.paint((one.object ??= this.make(one)));
      if (one.object) one.object.visible = visible;
    }
    const touches = by(this.told.touches.times);
    this.touched.geometry.setDrawRange(0, touches ? this.told.touches.ends[touches - 1] : 0);
    this.touched.visible = this.showing.touched();
    const told = model < 0 ? "no model yet" : this.told.models[model].told;
    const counts = `${counted(touches, "touch", "es")}, ${counted(by(this.told.contours), "contour", "s")}`;
    // What holds at the end stands on the page already.
    const ended = Number(this.slider.value) >= 1;
    this.readout.textContent = ended ? "end of the run" : `${time.toFixed(1)} s, ${counts}: ${told}`;
    const scale = this.root.querySelector(".scale");
    scale.hidden = this.colouring === "plain";
    for (const bar of scale.querySelectorAll("[data-colouring]")) {
      bar.hidden = bar.dataset.colouring !== this.colouring;
    }
    this.draw();
  }

  resize() {
    const { clientWidth: wide, clientHeight: high } = this.root.querySelector(".stage");
    if (!wide || !high) return;
    this.renderer.setSize(wide, high);
    this.camera.aspect = wide / high;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.light.position.copy(this.camera.position).sub(this.controls.target);
      this.light.position.z += this.told.size;
      this.renderer.render(this.scene, this.camera);
      this.root.dataset.drawn = Number(this.root.dataset.drawn || 0) + 1;
      window.palpateFirstPicture ??= performance.now();
    });
  }
}

function counted(number, one, more) {
  return `${number} ${one}${number === 1 ? "" : more}`;
}

async function start(root) {
  const told = JSON.parse(root.querySelector("script[type='application/json']").textContent);
  const arrays = await unpack(root.querySelector("script[type='text/plain']").textContent.trim());
  const view = new View(root, told, arrays);
  views.push(view);
  const stage = root.querySelector(".stage");
  stage.append(view.renderer.domElement);
  view.resize();
  root.classList.add("live");
}

for (const root of document.querySelectorAll(".view3d")) {
  start(root).catch((error) => {
    root.classList.add("static");
    root.querySelector(".fallback").textContent =
      `This browser draws no three-dimensional view (${error.message}); the picture is a still.`;
  });
}
