// The panel: its controls, what they show, and what they change. Its functions take the session of the page.

const PANEL = `
<details open><summary>Relight</summary>
<label>Light <select id="r-light"></select><span></span></label>
<canvas id="r-strip" width="208" height="104" title="The sky, its suns, and the direction of the view. Drag it to turn the light."></canvas>
<label>Turn <input id="r-turn" type="range" min="0" max="360" step="1"><output></output></label>
<label>Exposure <input id="r-exposure" type="range" min="-4" max="4" step="0.1"><output></output></label>
<label>Sun <input id="r-sun" type="range" min="0" max="3" step="0.05"><output></output></label>
<label>Sun from <input id="r-azimuth" type="range" min="-180" max="180" step="1"><output></output></label>
<label>Sun height <input id="r-height" type="range" min="2" max="90" step="1"><output></output></label>
<label>Lamps <input id="r-lamps" type="range" min="0" max="2" step="0.05"><output></output></label>
<details id="r-day"><summary>Captured light</summary>
<label>Light <select id="r-offered"></select></label>
<canvas id="r-daystrip" width="208" height="104" title="The captured light. Drag its sun: captured shadows vanish from the albedo where it is right."></canvas>
<label>Sun from <input id="r-dayAzimuth" type="range" min="0" max="360" step="1"><output></output></label>
<label>Sun height <input id="r-dayHeight" type="range" min="1" max="90" step="1"><output></output></label>
<label>Sun share <input id="r-dayShare" type="range" min="0" max="0.95" step="0.01" title="Of the light on what faces the sun"><output></output></label>
<label>Brightness <input id="r-bright" type="range" min="-3" max="3" step="0.05"><output></output></label>
<label>Warmth <input id="r-tint" type="range" min="-2" max="2" step="0.02"><output></output></label>
<label>Green <input id="r-green" type="range" min="-1" max="1" step="0.01"><output></output></label>
<div class="row"><button id="r-keep" title="Two files for --captured-light captured_light.json">Save captured light</button></div>
</details>
<div id="r-terms" class="rows"></div>
<div id="r-parts" class="rows"></div>
<div id="r-painting" hidden>
<div class="row"><button id="r-new" title="Paint what is to be lit apart">New part</button><button id="r-paint">Paint</button><button id="r-erase">Erase</button><button id="r-keepparts" title="A mask and parts.json for the folder of the scene">Save part</button></div>
<label>Brush <input id="r-radius" type="range" min="4" max="120" step="1" value="24"><output></output></label>
</div>
<small id="r-objects" hidden>Objects show in the light that they were inserted in.</small>
<small id="r-move" hidden>Drag an object to move it, with shift up and down; 7 and 8 turn it, a double click puts it back. Its shadow is then approximate.</small>
<div class="row"><button data-view="relit">Relit</button><button data-view="albedo">Albedo</button><button data-view="captured">Captured</button></div>
<div class="row"><button id="r-compare">Before | after</button><button id="r-sky">Sky</button><button id="r-ground" hidden>Ground</button></div>
<div class="row"><button id="r-load">Load light</button><button id="r-save">Save relit .ply</button></div>
<small class="keys">Drop an .hdr or .exr here. Shift + drag or [ ] turns the light.</small>
<small class="touch">Drag to look around, pinch to come nearer. Turn moves the light.</small>
</details><input id="r-file" type="file" accept=".hdr,.exr" hidden>`;

const RADIANS = Math.PI / 180, DAY_LEVEL = 0.35; // mean luminance at which the map of the captured light is shown
const rounded = (value) => typeof value === "number" ? String(+value.toFixed(3)) : value; // as the address has it

// A row for the captured light and one for each lamp; one for all else and for each part of the capture.
function addSliders(session) {
  const { terms, parts } = session.bundle;
  addRows(session, "terms", terms);
  if (parts?.entries.length) addRows(session, "parts", [{ name: "all else" }, ...parts.entries]);
}

function addRows(session, list, entries) {
  element(`r-${list}`).replaceChildren(...entries.map(({ kind, name }, index) => {
    const row = document.createElement("div"), label = document.createElement("label"), own = kind === "captured";
    const input = (type, more) => Object.assign(document.createElement("input"), { type, ...more });
    const change = (values) => session.set(own && "captured" in values ? values : { [list]: session.state[list].map((entry, i) => i === index ? { ...entry, ...values } : entry) });
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

// Show what the session is in: its light, numbers and buttons, and only the controls that do something.
function refreshPanel(session) {
  const { state, lights } = session, select = element("r-light");
  if (select.options.length !== lights.length) select.replaceChildren(...lights.map(({ name }, i) => new Option(name, i)));
  select.value = state.light;
  for (const key of ["sun", "azimuth", "height"]) element(`r-${key}`).parentElement.style.display = lights[state.light].suns.length ? "" : "none";
  const { direction: [x, y, z] } = lights[state.light].suns[0] ?? { direction: [0.5, 0.7, 0.5] };
  const height = state.height ?? Math.asin(y / Math.hypot(x, y, z)) / RADIANS;
  const shown = { turn: [state.turn, `${Math.round(state.turn)}\u00b0`], exposure: [state.exposure, state.exposure.toFixed(1)], sun: [state.sun, `x ${state.sun.toFixed(2)}`],
    azimuth: [state.azimuth, `${Math.round(state.azimuth)}\u00b0`], height: [height, `${Math.round(height)}\u00b0`], lamps: [state.lamps, `x ${state.lamps.toFixed(2)}`] };
  for (const [key, [value, text]] of Object.entries(shown)) {
    element(`r-${key}`).value = value;
    element(`r-${key}`).nextElementSibling.textContent = text;
  }
  refreshDay(session);
  for (const list of ["terms", "parts"]) document.querySelectorAll(`#r-${list} .term`).forEach((row, index) => {
    const { on, ev, color } = state[list][index], own = list === "terms" && session.bundle.terms[index].kind === "captured", [switched, picker] = row.querySelectorAll("label input");
    switched.checked = on;
    if (picker) picker.value = color;
    row.querySelector("input[type=range]").value = own ? state.captured : ev;
    row.querySelector("output").textContent = own ? `x ${state.captured.toFixed(2)}` : `${ev < 0 ? "\u2212" : "+"}${Math.abs(ev).toFixed(1)}`;
    row.classList.toggle("off", !on);
  });
  element("r-painting").hidden = !session.bundle.parts?.rows || state.parts.length > 255;
  for (const key of ["paint", "erase", "keepparts", "radius"]) element(`r-${key}`).closest("label, button").style.display = session.painted ? "" : "none";
  for (const key of ["paint", "erase"]) element(`r-${key}`).setAttribute("aria-pressed", key === session.brush);
  element("r-radius").nextElementSibling.textContent = element("r-radius").value;
  const captured = lights[state.light].sky === "captured"; // which cannot be turned, and whose lamps are part of it
  element("r-day").style.display = captured || session.bundle.meta.lamps !== null ? "none" : ""; // a room's light has several colours
  element("r-lamps").parentElement.style.display = captured || session.bundle.meta.lamps === null ? "none" : "";
  for (const key of ["turn", "sky", "strip"]) element(`r-${key}`).closest("label, button, canvas").style.display = captured ? "none" : "";
  for (const button of document.querySelectorAll("#relight [data-view]")) button.setAttribute("aria-pressed", button.dataset.view === state.view);
  element("r-objects").hidden = !session.bundle.objects || state.view !== "relit" || session.objects() > 0;
  element("r-move").hidden = !session.bundle.objects?.movable.length || !(session.objects() > 0);
  element("r-compare").setAttribute("aria-pressed", state.compare);
  element("r-sky").setAttribute("aria-pressed", state.sky);
  element("r-ground").hidden = !session.bundle.ground || captured;
  element("r-ground").setAttribute("aria-pressed", state.ground);
}

// Show how the captured light is set; without likely lights only its brightness and colour are.
function refreshDay(session) {
  const { state, offered } = session, hand = session.hand(), select = element("r-offered");
  if (!select.options.length) select.replaceChildren(new Option("as estimated", 0), ...offered.map(({ name, share }, i) => new Option(`${name}, ${Math.round(100 * share)}%`, i + 1)));
  select.value = state.day;
  select.parentElement.style.display = offered.length ? "" : "none";
  for (const key of ["dayAzimuth", "dayHeight", "dayShare"]) element(`r-${key}`).parentElement.style.display = hand ? "" : "none";
  element("r-daystrip").style.display = element("r-keep").style.display = hand ? "" : "none";
  const stops = (value) => `${value < 0 ? "\u2212" : "+"}${Math.abs(value).toFixed(1)}`;
  const values = { bright: [state.bright, stops(state.bright)], tint: [state.tint, stops(state.tint)], green: [state.green, stops(state.green)] };
  if (hand) Object.assign(values, { dayAzimuth: [hand.azimuth, `${Math.round(hand.azimuth)}\u00b0`], dayHeight: [hand.height, `${Math.round(hand.height)}\u00b0`], dayShare: [hand.share, hand.share.toFixed(2)] });
  for (const [key, [value, text]] of Object.entries(values)) {
    element(`r-${key}`).value = value;
    element(`r-${key}`).nextElementSibling.textContent = text;
  }
  if (!hand) return;
  const image = Live.imageByHand(offered[state.day - 1], hand), mean = Live.meanLuminance(image);
  session.dayStrip.draw({ image }, 0, DAY_LEVEL / Math.max(mean, 1e-9), hand.share > 0 ? [{ direction: Live.towardSun(hand.azimuth, hand.height) }] : []);
}

// Let the map and the sliders of the captured light change the session.
function listenDay(session) {
  const strip = element("r-daystrip");
  for (const key of ["dayAzimuth", "dayHeight", "dayShare", "bright", "tint", "green"]) element(`r-${key}`).oninput = ({ target }) => session.set({ [key]: +target.value });
  element("r-offered").onchange = ({ target }) => session.set({ day: +target.value });
  strip.onpointerdown = (event) => {
    strip.setPointerCapture(event.pointerId);
    strip.onpointermove(event);
  };
  strip.onpointermove = ({ buttons, offsetX, offsetY }) => {
    if (!buttons) return;
    const longitude = Math.PI * (1 - 2 * offsetX / strip.clientWidth), azimuth = Math.atan2(Math.sin(longitude), -Math.cos(longitude)) / RADIANS;
    session.set({ dayAzimuth: (azimuth + 360) % 360, dayHeight: Math.min(Math.max(90 - 180 * offsetY / strip.clientHeight, 1), 90), dayShare: Math.max(session.hand().share, 0.05) });
  };
  element("r-keep").onclick = () => Object.entries(session.handFiles()).forEach(([name, bytes]) => save(name, bytes));
}

function save(name, bytes) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([bytes])), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// Let the controls, keys, drags and dropped files change the session.
function listen(session) {
  const { state, stage } = session;
  for (const key of ["turn", "exposure", "sun", "azimuth", "height", "lamps"]) element(`r-${key}`).oninput = ({ target }) => session.set({ [key]: +target.value });
  element("r-light").onchange = ({ target }) => session.set({ light: +target.value });
  for (const button of document.querySelectorAll("#relight [data-view]")) button.onclick = () => session.set({ view: button.dataset.view });
  element("r-compare").onclick = () => session.set({ compare: !state.compare });
  element("r-sky").onclick = () => session.set({ sky: !state.sky });
  element("r-ground").onclick = () => session.set({ ground: !state.ground });
  element("r-radius").oninput = () => refreshPanel(session);
  element("r-load").onclick = () => element("r-file").click();
  element("r-save").onclick = () => save("relit_splat.ply", session.relitPly());
  listenDay(session);
  const take = async (file) => {
    try {
      await session.addLight(file.name.replace(/\.(hdr|exr)$/i, ""), new Uint8Array(await file.arrayBuffer()));
      session.notify("");
    } catch (error) {
      session.notify(`${file.name}: ${error.message}`);
    }
  };
  element("r-file").onchange = ({ target }) => target.files.length && take(target.files[0]);
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files.length) take(event.dataTransfer.files[0]);
  });
  addEventListener("keydown", ({ key, target }) => {
    if (target.tagName !== "SELECT" && "[]".includes(key)) session.set({ turn: state.turn + (key === "[" ? -5 : 5) });
  });
  let dragged = null;
  const held = (event) => {
    if (event.type === "pointerdown" && event.shiftKey && event.target === stage.canvas) dragged = event.clientX;
    if (dragged === null) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    if (event.type === "pointermove") {
      session.set({ turn: state.turn + (event.clientX - dragged) / 2 });
      dragged = event.clientX;
    }
    if (event.type === "pointerup" || event.type === "pointercancel") dragged = null;
  };
  for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) addEventListener(type, held, { capture: true });
  const strip = element("r-strip");
  strip.onpointerdown = ({ pointerId }) => strip.setPointerCapture(pointerId);
  strip.onpointermove = ({ buttons, movementX }) => buttons && session.set({ turn: state.turn - 360 * movementX / strip.clientWidth });
  stage.app.on("prerender", () => {
    const { x, z } = stage.app.root.findComponent("camera").entity.forward;
    session.strip.look(x, z);
  });
  const line = element("relight-line");
  line.onpointerdown = (event) => line.setPointerCapture(event.pointerId);
  line.onpointermove = ({ buttons, clientX }) => buttons && session.set({ line: Math.min(Math.max(clientX / innerWidth, 0.02), 0.98) });
}
