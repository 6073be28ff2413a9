// The page: a panel for the light, the bundle that it holds, the viewer that shows it.

const PANEL = `
<details open><summary>Relight</summary>
<label>Light <select id="r-light"></select><span></span></label>
<canvas id="r-strip" width="208" height="104" title="The sky, its suns, and the direction of the view. Drag it to turn the light."></canvas>
<label>Turn <input id="r-turn" type="range" min="0" max="360" step="1"><output></output></label>
<label>Exposure <input id="r-exposure" type="range" min="-4" max="4" step="0.1"><output></output></label>
<label>Sun <input id="r-sun" type="range" min="0" max="3" step="0.05"><output></output></label>
<label>Sun from <input id="r-azimuth" type="range" min="-180" max="180" step="1"><output></output></label>
<label>Sun height <input id="r-height" type="range" min="2" max="90" step="1"><output></output></label>
<label>Captured <input id="r-tint" type="range" min="-1" max="1" step="0.02" title="Whether the captured light was cooler or warmer than estimated"><output></output></label>
<label>Lamps <input id="r-lamps" type="range" min="0" max="2" step="0.05"><output></output></label>
<div id="r-terms"></div>
<small id="r-objects" hidden>Objects show in the light that they were inserted in.</small>
<div class="row"><button data-view="relit">Relit</button><button data-view="albedo">Albedo</button><button data-view="captured">Captured</button></div>
<div class="row"><button id="r-compare">Before | after</button><button id="r-sky">Sky</button></div>
<div class="row"><button id="r-load">Load light</button><button id="r-save">Save relit .ply</button></div>
<small class="keys">Drop an .hdr or .exr here. Shift + drag or [ ] turns the light.</small>
<small class="touch">Drag to look around, pinch to come nearer. Turn moves the light.</small>
</details><input id="r-file" type="file" accept=".hdr,.exr" hidden>`;

const RADIANS = Math.PI / 180;
const element = (id) => document.getElementById(id);
const rounded = (value) => typeof value === "number" ? String(+value.toFixed(3)) : value; // as the address has it

async function start() {
  const data = JSON.parse(element("live-data").textContent), query = new URLSearchParams(location.hash.slice(1) || location.search);
  document.body.insertAdjacentHTML("beforeend", `<div id="relight">${PANEL}</div><div id="relight-message"></div><div id="relight-line"></div>`);
  const tell = (text) => {
    element("relight-message").textContent = text;
    element("relight-message").style.display = text ? "block" : "none";
  };
  try {
    if (localStorage.getItem("controlsPanelOpen") === null) localStorage.setItem("controlsPanelOpen", "false"); // the viewer's list of keys
  } catch { /* storage may be denied */ }
  try {
    const files = await readFiles(data);
    await Live.checkSplat(files[data.splat], data.meta.splats.find(({ file }) => file === data.splat));
    const bundle = Live.readBundle(data.meta, files, data.splat), { scene_from_splat: frame } = data.meta.frame;
    const proxy = Live.readProxy(files["proxy.glb"]), cameraFor = (aspect) => Live.framed(data.meta.camera, proxy.positions, aspect);
    const stage = await host(document.body, files[data.splat], frame, cameraFor, { renderer: query.get("renderer") ?? "webgpu", ui: !query.has("noui"), gloss: bundle.gloss, objects: bundle.objects?.mesh });
    const lights = data.meta.lights.map((entry) => Live.lightOf(entry, files[entry.file]));
    window.relight = new Session(bundle, proxy, lights, stage, data, tell);
    window.relight.begin(query);
  } catch (error) {
    tell(error.message);
    throw error;
  }
}

// The files of the bundle by name: packed in this page, or beside it.
async function readFiles({ files, packed }) {
  const found = {};
  for (const name of files) {
    if (!packed) {
      const answer = await fetch(name);
      if (!answer.ok) throw new Error(`${name} is missing beside this page`);
      found[name] = new Uint8Array(await answer.arrayBuffer());
      continue;
    }
    const node = document.querySelector(`script[data-file="${name}"]`), text = node.textContent.trim(), parts = [];
    for (let at = 0; at < text.length; at += 1 << 22) {
      const binary = atob(text.slice(at, at + (1 << 22))), bytes = new Uint8Array(binary.length);
      for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
      parts.push(bytes);
    }
    node.remove();
    const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream("gzip"));
    found[name] = new Uint8Array(await new Response(stream).arrayBuffer());
  }
  return found;
}

class Session {
  constructor(bundle, proxy, lights, stage, data, tell) {
    Object.assign(this, { bundle, proxy, lights, stage, tell, live: Live });
    this.state = { light: 0, turn: data.turn, exposure: 0, tint: 0, sun: 1, azimuth: 0, height: null, lamps: bundle.meta.lamps ?? 0, view: "relit", sky: true, compare: false, line: 0.5 };
    this.state.terms = bundle.terms.map(({ color }) => ({ on: true, ev: 0, color: Live.hexOf(color) }));
    this.state.captured = lights[0].captured ?? 0;
    this.usual = Object.fromEntries(Object.entries(this.state).map(([key, value]) => [key, typeof value === "boolean" ? value : rounded(value)]));
    this.surface = Live.surfaceOf(bundle);
    this.ratio = new Float32Array(bundle.count * 3);
    this.gains = new Uint16Array(bundle.count * 4);
    this.plain = new Uint16Array(bundle.count * 4).map((_, i) => i % 4 === 3 ? 0 : Live.GAIN_UNIT);
    this.most = [1, 1, 1];
    this.shadows = new Map();
    this.compare = comparison(stage.app, stage.canvas, (captured) => {
      stage.objects(captured ? 0 : this.objects());
      return captured ? stage.show(this.plain, [1, 1, 1]) : stage.show(this.gains, this.most, this.mirrored);
    });
    this.strip = Live.indicator(element("r-strip"));
    this.mirrored = null; // what is glossy mirrors, where it does
    this.busy = null;
    this.written = bundle.objects && this.lightText(); // the light at the start
  }

  begin(query) {
    this.query = query.toString();
    for (const key of ["turn", "exposure", "tint", "sun", "azimuth", "height", "lamps", "line"]) if (query.has(key)) this.state[key] = +query.get(key);
    for (const key of ["sky", "compare"]) if (query.has(key)) this.state[key] = query.get(key) !== "0";
    if (query.has("view")) this.state.view = query.get("view");
    if (query.has("light")) this.state.light = Math.max(0, this.lights.findIndex(({ name }) => name === query.get("light")));
    this.state.captured = query.has("captured") ? +query.get("captured") : this.lights[this.state.light].captured ?? 0;
    this.state.terms.forEach((term, index) => {
      const asked = query.get(`lamp${index}`); // the captured light is 0
      if (asked !== null) Object.assign(term, asked === "off" ? { on: false } : { on: true, ev: +asked });
    });
    if (query.has("nopanel")) element("relight").style.display = "none";
    this.addSliders();
    this.listen();
    this.set({});
  }

  // Change some of the state and show it.
  set(changes) {
    const before = this.state.light;
    Object.assign(this.state, changes);
    this.state.turn = (this.state.turn % 360 + 360) % 360;
    if (this.state.light !== before && !("height" in changes)) Object.assign(this.state, { azimuth: 0, height: null, sun: 1, ...("captured" in changes ? {} : { captured: this.lights[this.state.light].captured ?? 0 }) });
    this.refresh();
    cancelAnimationFrame(this.busy);
    this.busy = requestAnimationFrame(() => this.draw());
  }

  // The suns of the light, moved as the panel says, and turned. Under a light without one the panel has no sun either.
  suns() {
    const { light, turn, azimuth, height, sun } = this.state;
    return this.lights[light].suns.map(({ direction: [x, y, z], weight }, i) => {
      let direction = [x, y, z];
      if (i === 0 && height !== null) {
        const across = Math.hypot(x, z) || 1, up = height * RADIANS;
        direction = [x / across * Math.cos(up), Math.sin(up), z / across * Math.cos(up)];
      }
      const turned = turn + (i === 0 ? azimuth : 0);
      return { direction: Live.turnedDirection(direction, turned * RADIANS), weight: weight.map((value) => value * sun) };
    }).filter(({ weight }) => weight.some((value) => value > 0));
  }

  // How bright inserted objects are: 0 in any other light than the one that they were inserted in, at another exposure as
  // much as that.
  objects() {
    const { state, bundle: { objects } } = this;
    if (!objects || state.view !== "relit" || this.written !== this.lightText()) return 0;
    return 2 ** state.exposure;
  }

  // What the light depends on, but for the exposure.
  lightText() {
    const { light, turn, tint, sun, azimuth, height, lamps, terms, captured } = this.state;
    return JSON.stringify({ light, turn: (turn % 360 + 360) % 360, tint, sun, azimuth, height, lamps, terms, captured });
  }

  draw() {
    const { bundle, ratio, gains, stage, state } = this, light = this.lights[state.light], turn = state.turn * RADIANS;
    const exposure = light.exposure * 2 ** state.exposure, lamps = this.lamps(light) * 2 ** state.exposure, balance = Live.balanceOf(state.tint), factors = this.factors(light, balance), began = performance.now();
    if (state.view === "captured") gains.set(this.plain);
    else {
      if (state.view === "albedo") {
        Live.albedoChanges(bundle, this.surface, ratio);
        Live.balanced(ratio, balance);
      } else {
        Live.changes(bundle, Live.lightTable(bundle, light, turn, exposure, light.suns.length ? state.sun : 1, lamps), ratio);
        const suns = this.suns();
        Live.addSuns(bundle, this.surface, suns, suns.map(({ direction }) => this.shadow(direction)), exposure, ratio);
        Live.balanced(ratio, balance);
        Live.addTerms(bundle, factors, ratio);
      }
      Live.gains(bundle, ratio, gains);
      if (this.objects()) Live.besideObjects(bundle.objects, gains);
      if (state.view === "relit") Live.showSky(bundle, light, turn, exposure, gains, factors[0]);
    }
    this.mirrored = bundle.gloss && state.view === "relit" ? this.mirror(light, turn, exposure, lamps, factors, balance) : null;
    this.most = state.view === "relit" ? Live.usualGain(bundle, light, turn, exposure, lamps, factors, balance) : [1, 1, 1];
    this.milliseconds = performance.now() - began;
    stage.sky(state.sky && state.view === "relit" && light.sky !== "captured" ? light.image : null, turn, exposure);
    if (light.sky !== "captured") this.strip.draw(light, turn, exposure, this.suns());
    this.compare.set(state.compare, state.line);
    this.remember();
    element("relight-line").style.display = state.compare ? "block" : "none";
    element("relight-line").style.left = `${100 * state.line}%`;
    if (!state.compare) stage.show(gains, this.most, this.mirrored);
    this.drawn = (this.drawn ?? 0) + 1;
  }

  // What is mirrored in a light: the new one blurred for each roughness, and how much brighter the scene is that hides it.
  mirror(light, turn, exposure, lamps, factors, balance) {
    const { bundle } = this, own = bundle.terms.findIndex(({ kind }) => kind === "captured");
    const coefficients = Live.mirroredLight(bundle.gloss, light, turn, exposure, this.suns(), own < 0 ? [0, 0, 0] : factors[own]);
    this.texture = Live.mirrorTexture(bundle.gloss, coefficients, this.texture);
    return { texture: this.texture, hidden: Live.meanChange(bundle, light, turn, exposure, lamps, factors, balance) };
  }

  // What the light of lamps is multiplied by beside a light: its own number, moved as the slider is.
  lamps(light) {
    const { lamps } = this.bundle.meta;
    if (light.sky === "captured") return 0; // they are part of it
    return lamps ? light.lamps * this.state.lamps / lamps : this.state.lamps;
  }

  // How many times each term is there, red, green and blue: as the sliders say. balance: of the albedo that lamps shine on.
  factors({ unit = 1 }, balance) {
    const { terms, captured, exposure } = this.state;
    return this.bundle.terms.map(({ kind, color }, index) => {
      const { on, ev, color: shown } = terms[index], strength = on ? unit * 2 ** exposure * (kind === "captured" ? captured : 2 ** ev) : 0;
      return (shown === Live.hexOf(color) ? color : Live.tintOf(shown)).map((value, k) => value * strength * (kind === "captured" ? 1 : balance[k]));
    });
  }

  // The shadow map of a sun, kept while it stands still.
  shadow(direction) {
    const key = direction.map((value) => value.toFixed(5)).join();
    if (!this.shadows.has(key)) {
      if (this.shadows.size >= 8) this.shadows.delete(this.shadows.keys().next().value);
      this.shadows.set(key, new Live.Shadow(this.proxy, direction));
    }
    return this.shadows.get(key);
  }

  // A light from the bytes of an .hdr or .exr; it is shown, and stays in the list.
  async addLight(name, bytes) {
    const picture = bytes[0] === 0x76 ? await Live.readExr(bytes) : Live.readHdr(bytes); // the first byte of OpenEXR
    if (Math.abs(picture.width / picture.height - 2) > 0.02) throw new Error(`a picture of ${picture.width} x ${picture.height}: expected a lat-long light, twice as wide as high`);
    const light = Live.lightFrom(name, Live.reduced(picture));
    Live.changes(this.bundle, Live.lightTable(this.bundle, light, 0, 1), this.ratio);
    Live.addSuns(this.bundle, this.surface, light.suns, light.suns.map(({ direction }) => this.shadow(direction)), 1, this.ratio);
    light.exposure = Live.exposureOf(this.bundle, light, this.ratio);
    light.lamps = this.bundle.meta.lamps ?? 0;
    light.captured = this.state.captured;
    this.lights.push(light);
    this.set({ light: this.lights.length - 1 });
  }

  // Keep in the address what `begin` reads from it, so that it can be shared and survives a reload.
  remember() {
    const { state, lights } = this, kept = new URLSearchParams(this.query), put = (key, value, usual) => value === usual ? kept.delete(key) : kept.set(key, value);
    if (state.light < this.bundle.meta.lights.length) put("light", lights[state.light].name, lights[0].name); // a dropped one cannot be named
    for (const key of ["turn", "exposure", "tint", "sun", "azimuth", "height", "lamps", "view", "captured"]) put(key, rounded(state[key]), key === "captured" ? rounded(lights[state.light].captured ?? 0) : this.usual[key]);
    for (const key of ["sky", "compare"]) put(key, state[key] ? "1" : "0", this.usual[key] ? "1" : "0");
    state.terms.forEach(({ on, ev }, index) => put(`lamp${index}`, on ? String(ev) : "off", "0"));
    const text = kept.toString();
    if (text === location.hash.slice(1)) return;
    clearTimeout(this.writing); // browsers count how often the address changes
    this.writing = setTimeout(() => history.replaceState(null, "", `${location.pathname}${location.search}#${text}`), 300);
  }

  relitPly() {
    return Live.relitPly(this.bundle.splats, this.gains, Live.GAIN_UNIT, this.most);
  }

  // A row for the captured light and one for each lamp.
  addSliders() {
    element("r-terms").replaceChildren(...this.bundle.terms.map(({ kind, name }, index) => {
      const row = document.createElement("div"), label = document.createElement("label"), own = kind === "captured";
      const input = (type, more) => Object.assign(document.createElement("input"), { type, ...more });
      const change = (values) => this.set(own && "captured" in values ? values : { terms: this.state.terms.map((term, i) => i === index ? { ...term, ...values } : term) });
      const switched = input("checkbox", { title: "On or off" }), text = Object.assign(document.createElement("span"), { textContent: name, title: name });
      const slider = own ? input("range", { min: 0, max: 2, step: 0.01 }) : input("range", { min: -6, max: 6, step: 0.1 });
      switched.onchange = () => change({ on: switched.checked });
      slider.oninput = () => change(own ? { captured: +slider.value } : { ev: +slider.value });
      slider.setAttribute("aria-label", `${name}, brightness`);
      label.append(switched, text);
      row.className = "term";
      row.append(label, slider, document.createElement("output"));
      if (!own) {
        const color = input("color", { title: "Colour" });
        color.setAttribute("aria-label", `${name}, colour`);
        color.oninput = () => change({ color: color.value });
        label.append(color);
      }
      return row;
    }));
  }

  refresh() {
    const { state, lights } = this, select = element("r-light");
    if (select.options.length !== lights.length) select.replaceChildren(...lights.map(({ name }, i) => new Option(name, i)));
    select.value = state.light;
    for (const key of ["sun", "azimuth", "height"]) element(`r-${key}`).parentElement.style.display = lights[state.light].suns.length ? "" : "none";
    const { direction: [x, y, z] } = lights[state.light].suns[0] ?? { direction: [0.5, 0.7, 0.5] };
    const height = state.height ?? Math.asin(y / Math.hypot(x, y, z)) / RADIANS;
    const shown = { turn: [state.turn, `${Math.round(state.turn)}\u00b0`], exposure: [state.exposure, state.exposure.toFixed(1)], tint: [state.tint, state.tint ? (state.tint > 0 ? "warmer" : "cooler") : "as is"], sun: [state.sun, `x ${state.sun.toFixed(2)}`],
      azimuth: [state.azimuth, `${Math.round(state.azimuth)}\u00b0`], height: [height, `${Math.round(height)}\u00b0`], lamps: [state.lamps, `x ${state.lamps.toFixed(2)}`] };
    for (const [key, [value, text]] of Object.entries(shown)) {
      element(`r-${key}`).value = value;
      element(`r-${key}`).nextElementSibling.textContent = text;
    }
    document.querySelectorAll("#r-terms .term").forEach((row, index) => {
      const { on, ev, color } = state.terms[index], own = this.bundle.terms[index].kind === "captured", [switched, picker] = row.querySelectorAll("label input");
      switched.checked = on;
      if (picker) picker.value = color;
      row.querySelector("input[type=range]").value = own ? state.captured : ev;
      row.querySelector("output").textContent = own ? `x ${state.captured.toFixed(2)}` : `${ev < 0 ? "\u2212" : "+"}${Math.abs(ev).toFixed(1)}`;
      row.classList.toggle("off", !on);
    });
    const captured = lights[state.light].sky === "captured"; // which cannot be turned, and whose lamps are part of it
    element("r-tint").parentElement.style.display = captured || this.bundle.meta.lamps !== null ? "none" : ""; // a room's light has several colours
    element("r-lamps").parentElement.style.display = captured || this.bundle.meta.lamps === null ? "none" : "";
    for (const key of ["turn", "sky", "strip"]) element(`r-${key}`).closest("label, button, canvas").style.display = captured ? "none" : "";
    for (const button of document.querySelectorAll("#relight [data-view]")) button.setAttribute("aria-pressed", button.dataset.view === state.view);
    element("r-objects").hidden = !this.bundle.objects || state.view !== "relit" || this.objects() > 0;
    element("r-compare").setAttribute("aria-pressed", state.compare);
    element("r-sky").setAttribute("aria-pressed", state.sky);
  }

  listen() {
    const { state, stage } = this;
    for (const key of ["turn", "exposure", "tint", "sun", "azimuth", "height", "lamps"]) element(`r-${key}`).oninput = ({ target }) => this.set({ [key]: +target.value });
    element("r-light").onchange = ({ target }) => this.set({ light: +target.value });
    for (const button of document.querySelectorAll("#relight [data-view]")) button.onclick = () => this.set({ view: button.dataset.view });
    element("r-compare").onclick = () => this.set({ compare: !state.compare });
    element("r-sky").onclick = () => this.set({ sky: !state.sky });
    element("r-load").onclick = () => element("r-file").click();
    element("r-save").onclick = () => {
      const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([this.relitPly()])), download: "relit_splat.ply" });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    };
    const take = async (file) => {
      try {
        await this.addLight(file.name.replace(/\.(hdr|exr)$/i, ""), new Uint8Array(await file.arrayBuffer()));
        this.tell("");
      } catch (error) {
        this.tell(`${file.name}: ${error.message}`);
      }
    };
    element("r-file").onchange = ({ target }) => target.files.length && take(target.files[0]);
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      if (event.dataTransfer.files.length) take(event.dataTransfer.files[0]);
    });
    addEventListener("keydown", ({ key, target }) => {
      if (target.tagName !== "SELECT" && "[]".includes(key)) this.set({ turn: state.turn + (key === "[" ? -5 : 5) });
    });
    let dragged = null;
    const held = (event) => {
      if (event.type === "pointerdown" && event.shiftKey && event.target === stage.canvas) dragged = event.clientX;
      if (dragged === null) return;
      event.stopImmediatePropagation();
      event.preventDefault();
      if (event.type === "pointermove") {
        this.set({ turn: state.turn + (event.clientX - dragged) / 2 });
        dragged = event.clientX;
      }
      if (event.type === "pointerup" || event.type === "pointercancel") dragged = null;
    };
    for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) addEventListener(type, held, { capture: true });
    const strip = element("r-strip");
    strip.onpointerdown = ({ pointerId }) => strip.setPointerCapture(pointerId);
    strip.onpointermove = ({ buttons, movementX }) => buttons && this.set({ turn: state.turn - 360 * movementX / strip.clientWidth });
    stage.app.on("prerender", () => {
      const { x, z } = stage.app.root.findComponent("camera").entity.forward;
      this.strip.look(x, z);
    });
    const line = element("relight-line");
    line.onpointerdown = (event) => line.setPointerCapture(event.pointerId);
    line.onpointermove = ({ buttons, clientX }) => buttons && this.set({ line: Math.min(Math.max(clientX / innerWidth, 0.02), 0.98) });
  }
}

start();
