"use strict";
// Draws the page's GLB with three.js, to turn with the mouse. The page gives `page`: glb (base64), cameras.
// The state is in the address (#grasp=1&frame=5&hide=hand,cloud&camera=0), so that a view can be linked.
(() => {
  const page = JSON.parse(document.getElementById("page").textContent);
  const canvas = document.getElementById("view");
  const state = { grasp: document.querySelector("input[name=grasp]:checked")?.value, camera: null };

  const scene = new THREE.Scene();
  const eye = new THREE.PerspectiveCamera(35, 1, 0.005, 20);
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
  } catch (error) {
    document.getElementById("message").textContent = "This browser has no WebGL: open the .glb beside this page.";
    document.body.dataset.state = "failed";
    return;
  }
  renderer.setPixelRatio(window.devicePixelRatio);
  scene.background = new THREE.Color(0xffffff);
  scene.add(new THREE.HemisphereLight(0xffffff, 0xb0a898, 2.2));
  const lamp = new THREE.DirectionalLight(0xffffff, 1.8);
  eye.add(lamp); // over the viewer's shoulder
  lamp.position.set(-0.5, 0.8, 0.6);
  scene.add(eye);
  const controls = new THREE.OrbitControls(eye, canvas);
  const leaves = []; // of the scene: {node, group, kind, name}
  const slider = document.getElementById("frame"); // of the closing; null without frames
  const press = document.getElementById("press"); // its select; null without presses
  const force = document.getElementById("force");
  const atRest = () => !slider || slider.value === slider.max;

  function render() {
    renderer.render(scene, eye);
  }

  function resize(width = canvas.parentElement.clientWidth, height = canvas.parentElement.clientHeight) {
    renderer.setSize(width, height);
    eye.aspect = width / height;
    eye.updateProjectionMatrix();
    render();
  }

  function boxOf(wanted) {
    const box = new THREE.Box3();
    for (const { node, kind } of leaves) if (node.visible && wanted(kind)) box.expandByObject(node);
    return box;
  }

  // The object and the shown grasp fill the picture, the hand beside the object.
  function frame() {
    const box = boxOf((kind) => kind !== "camera" && kind !== "force");
    const centre = box.getCenter(new THREE.Vector3());
    const distance = 0.56 * box.getSize(new THREE.Vector3()).length() / Math.tan((eye.fov * Math.PI) / 360);
    const from = new THREE.Vector3(0.8, 0.45, -0.4);
    const hand = boxOf((kind) => kind === "hand");
    if (!hand.isEmpty()) {
      const aside = hand.getCenter(new THREE.Vector3()).sub(boxOf((kind) => kind === "object").getCenter(new THREE.Vector3()));
      aside.y = 0;
      aside.normalize();
      from.set(aside.z, 0, -aside.x);
      const gels = boxOf((kind) => kind === "gel").getCenter(new THREE.Vector3()).sub(hand.getCenter(new THREE.Vector3()));
      if (from.dot(gels) < 0) from.negate(); // where the fingers are
      from.addScaledVector(aside, 0.6).setY(0.4);
    }
    eye.up.set(0, 1, 0);
    eye.position.copy(centre).addScaledVector(from.normalize(), distance);
    controls.target.copy(centre);
    controls.update();
  }

  // As a camera of the dataset sees it, its picture as high as this one.
  function look(number) {
    const { position, target, up, field } = page.cameras[number];
    eye.fov = field;
    eye.position.set(...position);
    eye.up.set(...up);
    controls.target.set(...target);
    eye.lookAt(controls.target);
    controls.update();
    eye.updateProjectionMatrix();
  }

  function apply() {
    const hidden = new Set([...document.querySelectorAll("input[data-kind]:not(:checked)")].map((x) => x.dataset.kind));
    for (const { node, group, kind } of leaves) {
      const shown = group === "object" || (press?.value && group === `press-${press.value}`) || (group === `grasp-${state.grasp}` && (kind !== "cloud" || atRest()));
      node.visible = shown && !hidden.has(kind);
    }
    for (const part of document.querySelectorAll("[data-grasp]")) part.hidden = part.dataset.grasp !== state.grasp;
    if (slider) showFrame();
    if (press) showPress();
    const parts = [`grasp=${state.grasp}`];
    if (!atRest()) parts.push(`frame=${slider.value}`);
    if (press?.value) parts.push(`press=${press.value}`, `force=${force.value}`);
    if (hidden.size) parts.push(`hide=${[...hidden].join(",")}`);
    if (state.camera !== null) parts.push(`camera=${state.camera}`);
    history.replaceState(null, "", `#${parts.join("&")}`);
    render();
  }

  // The hand at the slider's frame, and its readings on the gels and beside the scene.
  function showFrame() {
    const frames = page.frames[state.grasp];
    const number = Number(slider.value);
    document.getElementById("time").textContent = `${frames.time[number].toFixed(2)} s`;
    const images = [...document.querySelectorAll(`section[data-grasp="${state.grasp}"] .readings img`)];
    if (frames.readings) images.forEach((image, sensor) => (image.src = frames.readings[number][sensor] ?? frames.empty));
    const gels = leaves.filter(({ group, kind }) => group === `grasp-${state.grasp}` && kind === "gel");
    for (const { node, group, kind, name } of leaves) {
      const pose = group === `grasp-${state.grasp}` && frames.poses[`${kind} ${name}`];
      if (pose) node.matrix.set(...pose[number], 0, 0, 0, 1).decompose(node.position, node.quaternion, node.scale);
    }
    if (frames.readings) gels.forEach(({ node }, sensor) => node.traverse(({ material }) => {
      if (material) images[sensor].decode().then(() => draw(material, images[sensor]), () => {}); // the next came first
    }));
  }

  // The sensor at the slider's force, and its reading on the gel and beside the scene.
  function showPress() {
    const shown = page.presses[press.value], number = Number(force.value);
    const [image, line] = document.getElementById("pressed").children;
    document.getElementById("pressed").hidden = !shown;
    if (!shown) return;
    image.src = shown.readings[number];
    line.textContent = shown.lines[number];
    const { node } = leaves.find(({ group }) => group === `press-${press.value}`);
    node.matrix.set(...shown.poses[number], 0, 0, 0, 1).decompose(node.position, node.quaternion, node.scale);
    node.traverse(({ material }) => {
      if (material) image.decode().then(() => draw(material, image), () => {}); // the next came first
    });
  }

  function draw(material, image) {
    material.emissiveMap.image = image;
    material.emissiveMap.needsUpdate = true;
    render();
  }

  let playing = null;
  function play() {
    clearInterval(playing);
    if (atRest()) slider.value = 0;
    playing = setInterval(() => {
      slider.stepUp();
      if (atRest()) clearInterval(playing);
      apply();
    }, 120);
    apply();
  }

  function restore() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const grasp = document.querySelector(`input[name=grasp][value="${CSS.escape(asked.get("grasp") ?? "")}"]`);
    if (grasp) {
      grasp.checked = true;
      state.grasp = grasp.value;
    }
    if (slider && asked.has("frame")) slider.value = asked.get("frame");
    if (page.presses[asked.get("press")]) press.value = asked.get("press");
    if (press && asked.has("force")) force.value = asked.get("force");
    const hidden = (asked.get("hide") ?? "").split(",");
    for (const box of document.querySelectorAll("input[data-kind]")) {
      if (asked.has("hide")) box.checked = !hidden.includes(box.dataset.kind);
    }
    if (page.cameras[asked.get("camera")]) state.camera = Number(asked.get("camera"));
  }

  function prepare(node) {
    const name = node.userData.name ?? node.name;
    const [group, kind, ...rest] = name.split(" ");
    leaves.push({ node, group, kind, name: rest.join(" ") });
    node.traverse((part) => {
      if (!part.material) return;
      part.frustumCulled = false;
      if (part.isPoints) {
        part.material.size = 0.0006; // m: three pixels of a reading
        part.material.sizeAttenuation = true;
      } else if (part.isMesh && kind !== "cloud") {
        // Points on a surface are drawn before it.
        Object.assign(part.material, { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 });
      }
      // There are no surroundings that metal could reflect: it would be black.
      if (part.material.metalness > 0.3) part.material.metalness = 0.3;
      if (kind === "force") { // seen through hand and object
        part.material.depthTest = false;
        part.renderOrder = 1;
      }
      if (kind === "gel") { // as it was read, whatever the light
        part.material.emissive?.set(0xffffff);
        part.material.emissiveMap = part.material.map;
        part.material.color?.set(0x000000);
      }
    });
  }

  for (const input of document.querySelectorAll("input[data-kind]")) input.addEventListener("change", apply);
  for (const input of document.querySelectorAll("input[name=grasp]")) {
    input.addEventListener("change", () => {
      state.grasp = input.value;
      apply();
    });
  }
  for (const input of [slider, press, force]) input?.addEventListener("input", apply);
  document.getElementById("play")?.addEventListener("click", play);
  function fade(slider) {
    const opacity = Number(slider.value);
    for (const { node, kind } of leaves) {
      if (kind !== slider.dataset.opacity) continue;
      node.traverse((part) => {
        if (part.material) Object.assign(part.material, { transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
      });
    }
    render();
  }
  const sliders = document.querySelectorAll("input[data-opacity]");
  for (const slider of sliders) slider.addEventListener("input", () => fade(slider));
  document.getElementById("whole").addEventListener("click", () => {
    state.camera = null;
    eye.fov = 35;
    eye.updateProjectionMatrix();
    frame();
    apply();
  });
  for (const button of document.querySelectorAll("button[data-camera]")) {
    button.addEventListener("click", () => {
      state.camera = Number(button.dataset.camera);
      look(state.camera);
      apply();
    });
  }
  controls.addEventListener("change", render);
  window.addEventListener("resize", () => resize());

  const bytes = Uint8Array.from(atob(page.glb), (letter) => letter.charCodeAt(0));
  new THREE.GLTFLoader().parse(bytes.buffer, "", (loaded) => {
    scene.add(loaded.scene);
    const root = loaded.scene.getObjectByName("world");
    for (const node of root.children) prepare(node);
    restore();
    apply();
    sliders.forEach(fade);
    resize();
    if (state.camera === null) frame();
    else look(state.camera);
    render();
    window.viewer = { scene, eye, controls, leaves, canvas, render, resize };
    document.body.dataset.state = "ready";
  }, (error) => {
    document.getElementById("message").textContent = `The scene can't be shown: ${error.message}`;
    document.body.dataset.state = "failed";
  });
})();
