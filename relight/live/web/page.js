// The page: the bundle that it holds, the session that lights it, the viewer that shows it.

async function start() {
  const { data, query, notify } = layOut(PANEL, `<div id="relight-line"></div><div id="relight-brush"></div>`);
  try {
    const files = readFiles(data), proxy = Live.readProxy(await files["proxy.glb"]), cameraFor = (aspect) => Live.framed(data.meta.camera, proxy.positions, aspect);
    let session = null;
    await host(document.body, opened(files, data), data.meta.frame.scene_from_splat, cameraFor, { renderer: query.get("renderer") ?? "webgpu", ui: !query.has("noui"), proxy }, async (stage, { bundle }) => {
      const lights = await Promise.all(data.meta.lights.map(async (entry) => Live.lightOf(entry, await files[entry.file])));
      const likely = data.meta.offered ?? [], offered = Live.offeredOf(likely, await Promise.all(likely.map(({ file }) => files[file])));
      session = new Session(bundle, proxy, lights, offered, stage, data, notify);
      session.begin(query);
    });
    window.relight = session;
  } catch (error) {
    notify(error.message);
    throw error;
  }
}

// The splat's bytes and the bundle, once they are all read.
async function opened(files, { files: names, splat, meta }) {
  const bytes = await files[splat], read = {};
  await Live.checkSplat(bytes, meta.splats.find(({ file }) => file === splat));
  for (const name of names) read[name] = await files[name];
  return { splat: bytes, bundle: Live.readBundle(meta, read, splat) };
}

const BY_HAND = ["tint", "green", "bright", "day", "dayAzimuth", "dayHeight", "dayShare"]; // what the address keeps of the captured light

class Session {
  constructor(bundle, proxy, lights, offered, stage, data, notify) {
    Object.assign(this, { bundle, proxy, lights, offered, stage, notify, live: Live });
    this.state = { light: 0, turn: data.turn, exposure: 0, tint: 0, sun: 1, azimuth: 0, height: null, lamps: bundle.meta.lamps ?? 0, view: "relit", day: 0, dayAzimuth: null, dayHeight: null, dayShare: null, green: 0, bright: 0, sky: true, ground: true, compare: false, line: 0.5 };
    this.state.terms = bundle.terms.map(({ color }) => ({ on: true, ev: 0, color: Live.hexOf(color) }));
    this.state.parts = bundle.parts ? [{ name: "all else", exposure: 0, tint: [1, 1, 1] }, ...bundle.parts.entries].map(({ exposure, tint }) => ({ on: true, ev: exposure, color: Live.hexOf(tint) })) : [];
    this.state.captured = lights[0].captured ?? 0;
    this.usual = Object.fromEntries(Object.entries(this.state).map(([key, value]) => [key, typeof value === "boolean" ? value : rounded(value)]));
    this.most = [1, 1, 1];
    this.shadows = new Map();
    this.compare = comparison(stage.app, stage.canvas, (captured) => this.put(captured));
    this.strip = Live.indicator(element("r-strip"));
    this.dayStrip = Live.indicator(element("r-daystrip"));
    this.mirrored = null; // what is glossy mirrors, where it does
    this.brush = null; // "paint" or "erase" while it is held
    this.painted = 0; // the number of the part that it paints
    this.busy = null;
    this.written = bundle.objects && this.lightText(); // the light at the start
  }

  begin(query) {
    this.query = query.toString();
    this.onCard = !query.has("processor"); // which lights the splats
    for (const key of ["turn", "exposure", "sun", "azimuth", "height", "lamps", "line", ...BY_HAND]) if (query.has(key)) this.state[key] = +query.get(key);
    for (const key of ["sky", "ground", "compare"]) if (query.has(key)) this.state[key] = query.get(key) !== "0";
    if (query.has("view")) this.state.view = query.get("view");
    if (query.has("light")) this.state.light = Math.max(0, this.lights.findIndex(({ name }) => name === query.get("light")));
    this.state.captured = query.has("captured") ? +query.get("captured") : this.lights[this.state.light].captured ?? 0;
    this.state.terms.forEach((term, index) => {
      const asked = query.get(`lamp${index}`); // the captured light is 0
      if (asked !== null) Object.assign(term, asked === "off" ? { on: false } : { on: true, ev: +asked });
    });
    this.state.parts.forEach((part, index) => {
      const asked = query.get(`part${index}`); // all else is 0
      if (asked !== null) Object.assign(part, asked === "off" ? { on: false } : { on: true, ev: +asked });
    });
    if (query.has("nopanel")) element("relight").style.display = "none";
    addSliders(this);
    letPaint(this);
    letMove(this);
    listen(this);
    refreshPanel(this);
    this.draw(); // so that the first picture is in the light
  }

  // Change some of the state and show it.
  set(changes) {
    const { light: before, day } = this.state;
    Object.assign(this.state, changes);
    if (this.state.day !== day) Object.assign(this.state, { dayAzimuth: null, dayHeight: null, dayShare: null }, changes);
    this.state.turn = (this.state.turn % 360 + 360) % 360;
    if (this.state.light !== before && !("height" in changes)) Object.assign(this.state, { azimuth: 0, height: null, sun: 1, ...("captured" in changes ? {} : { captured: this.lights[this.state.light].captured ?? 0 }) });
    refreshPanel(this);
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

  // The gains with what objects change where they are.
  putObjects(gains) {
    const { bundle: { objects, surface }, stage } = this;
    objects.movable.forEach(({ pose, middle }, number) => stage.objects.move(number, pose, middle));
    if (!objects.movable.some(({ pose }) => pose.away)) return Live.besideObjects(objects, gains);
    Live.besideMoved(objects, this.surface, (row) => (surface[8 * row + 7] & 3) === Live.LIT, gains);
  }

  // Whether there is ground under the object: in a light that has an image.
  standing() {
    const { state, bundle: { ground }, lights } = this;
    return Boolean(ground) && state.ground && state.view === "relit" && lights[state.light].sky !== "captured" && this.lightsRest();
  }

  // The lights of all else and of each part, or null without parts.
  apart() {
    const { state, bundle: { parts } } = this;
    if (!parts?.entries.length) return null;
    const marked = (index) => this.brush && index === this.painted ? MARK : [1, 1, 1];
    return state.parts.map(({ on, ev }, index) => ({ on, factor: this.tintOf(index).map((value, k) => value * marked(index)[k] * 2 ** ev) }));
  }

  // The tint of a part, as live.json has it where no hand changed it. index: 0 for all else.
  tintOf(index) {
    const { color } = this.state.parts[index], own = index ? this.bundle.parts.entries[index - 1].tint : [1, 1, 1];
    return color === Live.hexOf(own) ? own : Live.tintOf(color);
  }

  // Begin to paint a part.
  begins() {
    const same = this.written === this.lightText();
    this.painted = Live.newPart(this.bundle.parts);
    this.state.parts.push({ on: true, ev: 0, color: "#ffffff" });
    if (same) this.written = this.lightText();
    this.brush = "paint";
    addSliders(this);
    this.set({ view: "relit" });
  }

  // Show the splats that are in parts now.
  regroup() {
    this.regrouped = true;
    this.set({});
  }

  // The painted parts as files for the folder of the scene: {name: bytes}.
  partFiles() {
    return Live.partFiles(this.bundle.parts, this.state.parts.slice(1).map(({ ev }, index) => ({ exposure: ev, tint: this.tintOf(index + 1) })));
  }

  // Whether what is in no part takes the light.
  lightsRest() {
    return this.state.parts[0]?.on ?? true;
  }

  // The ground in a light. Its suns are in the image, where they are not moved.
  putGround(light, turn, exposure) {
    const { state, bundle: { ground }, stage } = this, { sun, azimuth, height } = state;
    const turned = light.suns.map(({ direction, weight }) => ({ direction: Live.turnedDirection(direction, turn), weight: weight.map((value) => -value) }));
    const moved = sun === 1 && azimuth === 0 && height === null ? [] : [...turned, ...this.suns()];
    const text = JSON.stringify([state.light, turn, moved]);
    if (text !== this.grounded) {
      this.grounded = text;
      this.dark = Live.groundShade(ground, Live.arriving(ground, light.image, turn, moved), this.dark ?? new Uint8Array(4 * ground.side ** 2));
    }
    const color = state.sky ? null : Live.groundColor(light.image).map((value) => value * exposure);
    if (color) Live.toneMap(color);
    stage.floor.set(this.dark, color);
  }

  // What the light depends on, but for the exposure.
  lightText() {
    const { light, turn, sun, azimuth, height, lamps, terms, captured, parts } = this.state, byHand = BY_HAND.map((key) => this.state[key]);
    return JSON.stringify({ light, turn: (turn % 360 + 360) % 360, sun, azimuth, height, lamps, terms, captured, parts, byHand });
  }

  draw() {
    const { bundle, stage, state } = this, light = this.lights[state.light], turn = state.turn * RADIANS, began = performance.now();
    const exposure = light.exposure * 2 ** state.exposure, lamps = this.lamps(light) * 2 ** state.exposure, balance = Live.balanceOf(state.tint, state.green, state.bright), factors = this.factors(light, balance);
    this.asked = { view: state.view, light, turn, exposure, lamps, balance, factors, suns: this.suns(), apart: this.apart(), table: this.table(light, turn, exposure, lamps) };
    this.counted = null;
    if (this.regrouped) stage.recolour.regroup();
    this.regrouped = false;
    this.shown = this.onCard && !this.objects() && !this.hand() ? this.asked : this.gains;
    const whole = state.parts.every(({ on }) => on); // else reflections rest, too
    this.mirrored = bundle.gloss && whole && state.view === "relit" ? this.mirror(light, turn, exposure, lamps, factors, balance) : null;
    this.most = state.view === "relit" && this.lightsRest() ? Live.usualGain(bundle, light, turn, exposure, lamps, factors, this.usually(balance)) : [1, 1, 1];
    if (this.standing()) this.putGround(light, turn, exposure);
    this.milliseconds = performance.now() - began;
    stage.sky(state.sky && state.view === "relit" && this.lightsRest() && light.sky !== "captured" ? light.image : null, turn, exposure);
    if (light.sky !== "captured") this.strip.draw(light, turn, exposure, this.asked.suns);
    this.compare.set(state.compare, state.line);
    this.remember();
    element("relight-line").style.display = state.compare ? "block" : "none";
    element("relight-line").style.left = `${100 * state.line}%`;
    if (!state.compare) this.put(false);
    this.drawn = (this.drawn ?? 0) + 1;
  }

  // Show the splats as captured, or in the light.
  put(captured) {
    const { stage } = this;
    stage.objects.show(captured ? 0 : this.objects());
    stage.floor?.show(!captured && this.standing());
    if (captured) stage.show({ ...this.asked, view: "captured" }, [1, 1, 1]);
    else stage.show(this.shown, this.most, this.mirrored);
  }

  // The table of a light: as it was, where only suns and terms differ.
  table(light, turn, exposure, lamps) {
    const { bundle, state } = this, sun = light.suns.length ? state.sun : 1, text = JSON.stringify([state.light, turn, exposure, sun, lamps]);
    if (state.view === "relit" && text !== this.tabled) {
      this.held = Live.lightTable(bundle, light, turn, exposure, sun, lamps);
      this.tabled = text;
    }
    return this.held;
  }

  // The changes of all splats as shown, (N, 3), and their gains, (N, 4), by the processor: what the card does not hand back.
  get ratio() {
    return this.count().ratio;
  }

  get gains() {
    return this.count().gains;
  }

  count() {
    const { bundle, asked: { view, light, turn, exposure, balance, factors, suns, table, apart } } = this;
    if (this.counted) return this.counted;
    const given = view === "captured" ? null : this.given(), { ratio, base, gains } = this.arrays ??= { ratio: new Float32Array(bundle.count * 3), base: new Float32Array(bundle.count * 3), gains: new Uint16Array(bundle.count * 4) };
    if (view === "captured") gains.set(Live.plainGains(bundle.count));
    else {
      if (view === "albedo") {
        Live.albedoChanges(bundle, this.surface, ratio);
        Live.balanced(ratio, balance);
        if (given) Live.divided(ratio, given);
      } else {
        if (this.based !== table) Live.changes(bundle, this.based = table, base);
        ratio.set(base);
        Live.addSuns(bundle, this.surface, suns, suns.map(({ direction }) => this.shadow(direction)), exposure, ratio);
        Live.balanced(ratio, balance);
        const own = (captured) => factors.map((factor, i) => (bundle.terms[i].kind === "captured") === captured ? factor : [0, 0, 0]);
        Live.addTerms(bundle, given ? own(false) : factors, ratio);
        if (given) {
          Live.divided(ratio, given); // all but the captured light shines on an albedo
          Live.addTerms(bundle, own(true), ratio);
        }
        if (apart) Live.apart(bundle.parts, apart, ratio);
      }
      Live.gains(bundle, ratio, gains);
      if (this.objects()) this.putObjects(gains);
      if (view === "relit" && this.lightsRest()) Live.showSky(bundle, light, turn, exposure, gains, factors[0]);
    }
    return this.counted = { ratio, gains };
  }

  // The captured light as a hand set it, {azimuth, height, share}, or null where it is as estimated.
  hand() {
    const { day, dayAzimuth, dayHeight, dayShare } = this.state, offered = this.offered[day - 1];
    return offered ? { azimuth: dayAzimuth ?? offered.azimuth_deg, height: dayHeight ?? offered.height_deg, share: dayShare ?? offered.sun_share } : null;
  }

  // A balance of the albedo with what the captured light set by hand changes of it on the whole.
  usually(balance) {
    const hand = this.hand();
    if (!hand) return balance;
    const none = this.bundle.terms.map(() => [0, 0, 0]), mean = Live.meanChange(this.bundle, Live.lightByHand(this.offered[this.state.day - 1], hand), 0, 1, 0, none);
    return balance.map((value, k) => value / Math.max(mean[k], Live.LEAST_RECEIVED));
  }

  // What splats received of that light over what the estimate gave them, (N, 3), or null.
  given() {
    const hand = this.hand(), text = JSON.stringify([this.state.day, hand]);
    if (hand && text !== this.givenText) {
      this.received = Live.received(this.bundle, this.surface, Live.lightByHand(this.offered[this.state.day - 1], hand), (direction) => this.shadow(direction));
      this.givenText = text;
    }
    return hand && this.received;
  }

  // The captured light as files for --captured-light: {name: bytes}.
  handFiles() {
    const { state } = this, offered = this.offered[state.day - 1], factors = Live.balanceOf(state.tint, state.green, state.bright).map((value) => 1 / value), name = "captured_light.hdr";
    const chosen = Live.chosenLight(offered, this.hand(), factors, name);
    return { [name]: Live.writeHdr(Live.imageByHand(offered, this.hand(), factors)), "captured_light.json": new TextEncoder().encode(JSON.stringify(chosen, null, 1)) };
  }

  // What suns need of every splat, where the processor lights them.
  get surface() {
    return this.surfaces ??= Live.surfaceOf(this.bundle);
  }

  // What is mirrored in a light: the new one blurred for each roughness, and how much brighter the scene is that hides it.
  mirror(light, turn, exposure, lamps, factors, balance) {
    const { bundle } = this, own = bundle.terms.findIndex(({ kind }) => kind === "captured");
    const coefficients = Live.mirroredLight(bundle.gloss, light, turn, exposure, this.suns(), own < 0 ? [0, 0, 0] : factors[own]);
    this.texture = Live.mirrorTexture(bundle.gloss, coefficients, this.factors(light, [1, 1, 1]), this.texture);
    return { texture: this.texture, hidden: Live.meanChange(bundle, light, turn, exposure, lamps, factors, this.usually(balance)) };
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
    const ratio = new Float32Array(3 * this.bundle.count);
    Live.changes(this.bundle, Live.lightTable(this.bundle, light, 0, 1), ratio);
    Live.addSuns(this.bundle, this.surface, light.suns, light.suns.map(({ direction }) => this.shadow(direction)), 1, ratio);
    light.exposure = Live.exposureOf(this.bundle, light, ratio);
    light.lamps = this.bundle.meta.lamps ?? 0;
    light.captured = this.state.captured;
    this.lights.push(light);
    this.set({ light: this.lights.length - 1 });
  }

  // Keep in the address what `begin` reads from it, so that it can be shared and survives a reload.
  remember() {
    const { state, lights } = this, kept = new URLSearchParams(this.query), put = (key, value, usual) => value === usual ? kept.delete(key) : kept.set(key, value);
    if (state.light < this.bundle.meta.lights.length) put("light", lights[state.light].name, lights[0].name); // a dropped one cannot be named
    for (const key of ["turn", "exposure", "sun", "azimuth", "height", "lamps", "view", "captured", ...BY_HAND]) put(key, rounded(state[key]), key === "captured" ? rounded(lights[state.light].captured ?? 0) : this.usual[key]);
    for (const key of ["sky", "ground", "compare"]) put(key, state[key] ? "1" : "0", this.usual[key] ? "1" : "0");
    state.terms.forEach(({ on, ev }, index) => put(`lamp${index}`, on ? String(ev) : "off", "0"));
    state.parts.forEach(({ on, ev }, index) => put(`part${index}`, on ? String(ev) : "off", String(index ? this.bundle.parts.entries[index - 1].exposure : 0)));
    const text = kept.toString();
    if (text === location.hash.slice(1)) return;
    clearTimeout(this.writing); // browsers count how often the address changes
    this.writing = setTimeout(() => history.replaceState(null, "", `${location.pathname}${location.search}#${text}`), 300);
  }

  relitPly() {
    return Live.relitPly(this.bundle.splats, this.gains, Live.GAIN_UNIT, this.most);
  }
}

start();
