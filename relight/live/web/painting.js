// Parts made on the page: a brush takes the splats that are seen under it while the camera rests.

const MARK = [2.6, 0.6, 0.2]; // of the light of a part that is painted, over what its sliders say

function letPaint(session) {
  const { stage: { app, canvas }, bundle } = session, { parts } = bundle;
  if (!parts?.rows) return;
  const ring = element("relight-brush"), radius = () => +element("r-radius").value;
  let placed = null, seen = null, last = null;
  const stroke = ({ clientX, clientY }) => {
    const { left, top } = canvas.getBoundingClientRect(), at = { x: clientX - left, y: clientY - top };
    Live.paint(parts, seen.under(last ?? at, at, radius()), session.painted, session.brush === "erase");
    last = at;
    session.regroup();
  };
  const look = () => {
    const { width, height } = canvas.getBoundingClientRect(), camera = app.root.findComponent("camera");
    return Live.seen(placed ??= Live.placed(bundle), new Mat4().mul2(camera.projectionMatrix, camera.viewMatrix).data, width, height);
  };
  const follow = (event) => {
    ring.style.display = session.brush && event.target === canvas ? "block" : "none";
    Object.assign(ring.style, { left: `${event.clientX - radius()}px`, top: `${event.clientY - radius()}px`, width: `${2 * radius()}px`, height: `${2 * radius()}px` });
  };
  const touched = (event) => {
    follow(event);
    if (event.type === "pointerdown" && session.brush && event.button === 0 && event.isPrimary && !event.shiftKey && event.target === canvas) seen = look();
    if (!seen) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    if (event.type === "pointerdown" || event.type === "pointermove") stroke(event);
    else seen = last = null;
  };
  for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) addEventListener(type, touched, { capture: true });
  const hold = (brush) => {
    session.brush = session.brush === brush ? null : brush;
    ring.style.display = "none";
    session.set({ view: "relit" });
  };
  element("r-new").onclick = () => session.begins();
  for (const brush of ["paint", "erase"]) element(`r-${brush}`).onclick = () => hold(brush);
  element("r-keepparts").onclick = () => Object.entries(session.partFiles()).forEach(([name, bytes]) => save(name, bytes));
}
