// What the example pages share: what their address asks for, a slider that turns the light, a stage of three.js or of
// PlayCanvas. The loaders need nothing of it. ?angle=, ?light=, ?on=0, ?eye=x,y,z, ?target=x,y,z, ?fov=, ?bare.

export const asked = new URLSearchParams(location.search);
export const numbers = (name, other) => asked.get(name)?.split(",").map(Number) ?? other;

// The slider: it sets light.angle, in degrees. background: of the page.
export function slider(light, background = "#000") {
    const style = document.head.appendChild(document.createElement("style"));
    style.textContent = `html, body, canvas { margin: 0; width: 100%; height: 100%; display: block; overflow: hidden; background: ${background} }
        label { position: fixed; left: 16px; bottom: 16px; color: #fff; font: 14px sans-serif }`;
    if (!asked.has("bare")) document.body.insertAdjacentHTML("beforeend", `<label>Light <input type="range" min="0" max="360" step="1"> <span></span></label>`);
    const turn = (degrees) => {
        if (light) light.angle = Number(degrees);
        const label = document.querySelector("label");
        if (label) [label.firstElementChild.value, label.lastElementChild.textContent] = [degrees, `${degrees}\u00b0`];
    };
    document.querySelector("label input")?.addEventListener("input", ({ target }) => turn(target.value));
    turn(asked.get("angle") ?? light?.angle ?? 0);
}

// { renderer, scene, camera, look(eye, target), run(frames, before) }: the title is "shown" after so many frames; before(seconds) is
// called before each.
export function threeStage(THREE, OrbitControls, fov, antialias = false) {
    const renderer = new THREE.WebGLRenderer({ antialias }), scene = new THREE.Scene();
    document.body.appendChild(renderer.domElement);
    const camera = new THREE.PerspectiveCamera(Number(asked.get("fov") ?? fov), 1, 0.01, 1000);
    const controls = new OrbitControls(camera, renderer.domElement);
    const look = (eye, target) => {
        camera.position.set(...numbers("eye", eye));
        controls.target.set(...numbers("target", target));
        controls.update();
    };
    const run = (frames, before) => renderer.setAnimationLoop((time) => {
        before?.(time / 1000);
        if (renderer.domElement.clientWidth !== innerWidth || camera.aspect !== innerWidth / innerHeight) {
            camera.aspect = innerWidth / innerHeight;
            camera.updateProjectionMatrix();
            renderer.setSize(innerWidth, innerHeight);
        }
        renderer.render(scene, camera);
        if (--frames < 0) document.title = "shown";
    });
    return { renderer, scene, camera, look, run };
}

// An app of PlayCanvas that fills the window and shows splats with whole colours.
export async function playcanvasApp(pc) {
    const canvas = document.body.appendChild(document.createElement("canvas")), options = new pc.AppOptions();
    options.graphicsDevice = await pc.createGraphicsDevice(canvas, { deviceTypes: [asked.get("device") ?? "webgl2"], antialias: false });
    options.componentSystems = [pc.RenderComponentSystem, pc.CameraComponentSystem, pc.GSplatComponentSystem];
    options.resourceHandlers = [pc.TextureHandler, pc.ContainerHandler, pc.GSplatHandler];
    const app = new pc.AppBase(canvas);
    app.init(options);
    app.setCanvasFillMode(pc.FILLMODE_FILL_WINDOW);
    app.setCanvasResolution(pc.RESOLUTION_AUTO);
    app.scene.gsplat.dataFormat = pc.GSPLATDATA_LARGE;
    app.start();
    return app;
}

// Its camera; the title is "shown" after 20 frames.
export function playcanvasCamera(pc, app, eye, target) {
    const camera = new pc.Entity("camera"), fov = Number(asked.get("fov") ?? 45);
    camera.addComponent("camera", { clearColor: new pc.Color(0, 0, 0), fov, nearClip: 0.01 });
    camera.setPosition(...numbers("eye", eye));
    camera.lookAt(new pc.Vec3(...numbers("target", target)));
    app.root.addChild(camera);
    let frames = 0;
    app.on("frameend", () => { if (++frames > 20) document.title = "shown"; });
}
