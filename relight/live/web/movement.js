// Inserted objects moved by hand: drag one over the level at which it was gripped, with shift up and down. Keys 7 and 8
// turn the one held last; a double click puts one back.

const STEP = Math.PI / 12, LEAST_SLOPE = 0.02; // a ray as level as that meets the plane too far away

function letMove(session) {
  const { stage, bundle: { objects } } = session, movable = objects?.movable ?? [];
  if (!movable.length) return;
  const { app, canvas } = stage;
  let held = null, last = movable[0];
  const rayAt = ({ clientX, clientY }) => {
    const { left, top } = canvas.getBoundingClientRect(), camera = app.root.findComponent("camera"), at = (depth) => camera.screenToWorld(clientX - left, clientY - top, depth);
    const near = at(camera.nearClip), far = at(camera.nearClip + 1), way = [far.x - near.x, far.y - near.y, far.z - near.z], length = Math.hypot(...way);
    return { start: [near.x, near.y, near.z], way: way.map((value) => value / length) };
  };
  const under = (event) => {
    if (!(session.objects() > 0) || event.target !== canvas) return null;
    const { start, way } = rayAt(event), [nearest] = movable.map((object) => ({ object, distance: object.met(start, way) })).sort((a, b) => a.distance - b.distance);
    return nearest.distance < Infinity ? { ...nearest, point: start.map((value, k) => value + nearest.distance * way[k]) } : null;
  };
  // Where the pointer is, over the level of the grip, or beside it on an upright plane.
  const follow = (event) => {
    const { start, way } = rayAt(event), { object, point } = held, up = event.shiftKey, across = Math.hypot(way[0], way[2]);
    if (up ? across < LEAST_SLOPE : Math.abs(way[1]) < LEAST_SLOPE) return;
    const far = up ? ((point[0] - start[0]) * way[0] + (point[2] - start[2]) * way[2]) / across ** 2 : (point[1] - start[1]) / way[1];
    if (!(far > 0)) return;
    const [x, y, z] = start.map((value, k) => value + far * way[k] - point[k]), step = up ? [0, y, 0] : [x, 0, z];
    object.move(...step);
    held.point = point.map((value, k) => value + step[k]);
    session.set({});
  };
  const stop = (event) => {
    event.stopImmediatePropagation();
    event.preventDefault();
  };
  const touched = (event) => {
    if (event.type === "pointerdown" && event.button === 0 && event.isPrimary) held = under(event);
    if (!held) {
      if (event.type === "pointermove" && !event.buttons) canvas.style.cursor = under(event) ? "move" : "";
      return;
    }
    last = held.object;
    stop(event);
    if (event.type === "pointermove") follow(event);
    if (event.type === "pointerup" || event.type === "pointercancel") held = null;
  };
  for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) addEventListener(type, touched, { capture: true });
  addEventListener("dblclick", (event) => {
    const found = under(event);
    if (!found) return;
    stop(event);
    found.object.back();
    session.set({});
  }, { capture: true });
  addEventListener("keydown", ({ key, target }) => {
    if (target.tagName === "SELECT" || !"78".includes(key) || !(session.objects() > 0)) return;
    last.move(0, 0, 0, key === "7" ? STEP : -STEP);
    session.set({});
  });
}
