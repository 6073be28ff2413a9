// A page that plays: frames of splats that were relit beforehand, one after the other, in a viewer that one may move in.

const PLAYER = `
<details open><summary>Relit</summary>
<label>Frame <input id="r-frame" type="range" min="0" step="1" value="0"><output></output></label>
<div class="row"><button id="r-play"></button><button id="r-sky">Sky</button></div>
<small class="keys">Space plays and stops; the keys , and . go one frame back and on.</small>
</details>`;

const MOST_HELD = 1e7; // splats of all frames on the graphics card: some 60 bytes each

async function start() {
  const { data, query, notify } = layOut(PLAYER), frames = framesOf(data);
  try {
    const cameraFor = (aspect) => Live.framed(data.camera, [], aspect), first = Math.min(Math.max(Math.round(+query.get("frame") || 0), 0), data.frames.length - 1);
    const { viewer, camera } = await opening(document.body, frames(first), cameraFor, { renderer: query.get("renderer") ?? "webgpu", ui: !query.has("noui") });
    const entity = await arrival(viewer.app, data.scene_from_splat), image = data.sky && Live.fromRgbe(await readFiles({ files: [data.sky.file], packed: data.packed })[data.sky.file]);
    const player = new Player(viewer.app, entity, frames, data, image, first, notify);
    Object.assign(player, { camera, playing: !query.has("frame"), sky: query.get("sky") !== "0" });
    if (query.has("nopanel")) element("relight").style.display = "none";
    player.listen();
    player.paint();
    await shownIn(viewer);
    player.begin();
    window.relight = player;
  } catch (error) {
    notify(error.message);
    throw error;
  }
}

// A function that promises the bytes of a frame. In the page a frame may be stored as what differs from the one before.
function framesOf({ frames, packed }) {
  if (!packed) return (number) => beside(frames[number].file);
  const whole = [];
  for (const { file, differs } of frames) {
    whole.push(!differs ? unpacked[file] : Promise.all([whole.at(-1), unpacked[file]]).then(([before, bytes]) => {
      for (let i = 0; i < bytes.length; i++) bytes[i] ^= before[i];
      return bytes;
    }));
    whole.at(-1).catch(() => {}); // whoever awaits it says so
  }
  return (number) => whole[number];
}

class Player {
  // entity: that of the frame that the viewer has loaded, whose number is `shown`. frames: of `framesOf`. image: radiance
  // of the sky, or null.
  constructor(app, entity, frames, { frames: { length }, fps, splats, sky, scene_from_splat }, image, shown, notify) {
    Object.assign(this, { app, frames, length, fps, image, shown, notify, frame: scene_from_splat, sky: true, playing: true, turn: sky?.turn, exposure: sky?.exposure });
    this.ahead = Math.max(3, Math.min(length, Math.floor(MOST_HELD / splats)));
    this.entities = new Map([[shown, entity]]); // by number: only the one that is shown is enabled
    this.time = (shown + 0.5) / fps; // seconds since the first frame began
    this.settled = true; // whether the frame that is shown last is sorted and drawn
    this.drawn = 0;
    this.painted = skyOf(app);
  }

  // The number of the frame that the clock is at.
  get asked() {
    return Math.floor(this.time * this.fps) % this.length;
  }

  begin() {
    this.app.systems.gsplat.on("frame:ready", (camera, layer, ready) => {
      if (ready && !this.settled) this.drawn++;
      this.settled = ready;
      this.release();
    });
    this.app.on("update", (seconds) => this.tick(seconds));
    this.load();
  }

  // The clock stands while its frame is not there yet. While one is being sorted, others are left out.
  tick(seconds) {
    if (this.playing && this.entities.has(this.asked)) this.time += seconds;
    if (this.settled && this.asked !== this.shown && this.entities.has(this.asked)) this.show(this.asked);
    if (!this.settled) this.app.renderNextFrame = true;
  }

  show(number) {
    this.entities.get(this.shown).enabled = false;
    this.entities.get(number).enabled = true;
    this.shown = number;
    this.settled = false;
    this.refresh();
    this.load();
  }

  // Load the frames to come, one at a time, and let go of those long past.
  async load() {
    if (this.loading) return;
    this.loading = true;
    try {
      for (let number = this.missing(); number >= 0; number = this.missing()) {
        const asset = await arrived(this.app, "gsplat", `${number}.compressed.ply`, this.frames(number).then((bytes) => new Response(bytes)));
        const entity = placed(new Entity(`frame ${number}`), this.frame);
        entity.enabled = false;
        entity.addComponent("gsplat", { unified: true, asset });
        this.app.root.addChild(entity);
        this.entities.set(number, entity);
        this.release();
      }
    } catch (error) {
      this.notify(error.message);
    } finally {
      this.loading = false;
    }
  }

  // The next number that is not there, of as many as may be held, or -1.
  missing() {
    for (let step = 0; step < this.ahead; step++) {
      const number = (this.asked + step) % this.length;
      if (!this.entities.has(number)) return number;
    }
    return -1;
  }

  // An entity that the engine may still draw stays.
  release() {
    for (const [number, entity] of this.entities) {
      if (this.entities.size <= this.ahead || !this.settled) return;
      if (number === this.shown || (number - this.asked + this.length) % this.length < this.ahead) continue;
      const asset = this.app.assets.get(entity.gsplat.asset);
      this.entities.delete(number);
      entity.destroy();
      this.app.assets.remove(asset);
      asset.unload();
    }
  }

  // Change what is asked for: {frame, playing, sky}. A frame stops the clock.
  set({ frame = null, playing = frame === null ? this.playing : false, sky = this.sky }) {
    if (frame !== null) this.time = ((frame + this.length) % this.length + 0.5) / this.fps;
    Object.assign(this, { playing, sky });
    this.paint();
    this.refresh();
    this.load();
  }

  paint() {
    this.painted(this.sky ? this.image : null, this.turn * Math.PI / 180, this.exposure);
  }

  refresh() {
    const slider = element("r-frame"), number = this.playing ? this.shown : this.asked;
    slider.max = this.length - 1;
    slider.value = number;
    slider.nextElementSibling.textContent = `${number + 1}/${this.length}`;
    element("r-play").textContent = this.playing ? "Stop" : "Play";
    element("r-sky").hidden = !this.image;
    element("r-sky").setAttribute("aria-pressed", this.sky);
  }

  listen() {
    element("r-frame").oninput = ({ target }) => this.set({ frame: +target.value });
    element("r-play").onclick = () => this.set({ playing: !this.playing });
    element("r-sky").onclick = () => this.set({ sky: !this.sky });
    addEventListener("keydown", (event) => {
      const { key, target } = event;
      if (!" ,.".includes(key) || target.tagName === "BUTTON" && key === " ") return;
      event.stopImmediatePropagation();
      event.preventDefault();
      this.set(key === " " ? { playing: !this.playing } : { frame: this.asked + (key === "," ? -1 : 1) });
    }, { capture: true });
    this.refresh();
  }
}

start();
