"use strict";
// Plays the swims in #replay-data with the three.js in #replay-library. Lengths are in units.
(async () => {
  const host = document.querySelector(".replay");
  const message = host.querySelector("p");
  const read = (id) => document.getElementById(id).textContent;
  const unpack = (text) => {
    const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  };
  try {
    const library = document.createElement("script"); // which the page's policy allows by its hash
    library.textContent = new TextDecoder().decode(await unpack(read("replay-library")));
    document.head.append(library);
    const data = JSON.parse(read("replay-data"));
    for (const swimmer of data.swimmers) {
      swimmer.columns = new Float32Array(await unpack(swimmer.columns));
    }
    play(host, data, THREE);
    message.remove();
  } catch (error) {
    message.prepend(`The replay needs a browser with WebGL (${error.message}). `);
  }
})();

function play(host, data, three) {
  const { step, floor, colours, swimmers } = data;
  const renderer = new three.WebGLRenderer({ antialias: true });
  const scene = new three.Scene();
  const camera = new three.PerspectiveCamera(35, 1, 1, 400);
  const orbit = new three.OrbitControls(camera, renderer.domElement);
  const [stage, legend] = [".stage", ".legend"].map((name) => host.querySelector(name));
  const [button, slider, clock, speed, view] = host.querySelector(".controls").children;
  const end = step * (Math.max(...swimmers.map((one) => one.samples)) - 1);
  const shown = []; // points that every view has in its frame
  let time = 0;
  let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  let changed = true;
  let last = 0;

  swimmers.forEach(addSwimmer);
  const marks = data.marks.map(([y, text]) => ({
    element: addText(stage, "mark", text),
    place: new three.Vector3(data.ends[1] + 0.3, y, floor),
  }));
  shown.push(...marks.map((mark) => mark.place));
  const box = new three.Box3().setFromPoints(shown);
  addLight();
  addFloor();
  connect();
  stage.prepend(renderer.domElement);
  view.selectedIndex = stage.clientWidth < stage.clientHeight ? 2 : 0;
  new ResizeObserver(resize).observe(stage);
  resize();
  requestAnimationFrame(frame);

  function add(geometry, color, parent = scene) {
    const material = new three.MeshStandardMaterial({ color, roughness: 0.6 });
    const mesh = new three.Mesh(geometry, material);
    parent.add(mesh);
    return mesh;
  }

  function addText(parent, kind, words) {
    const element = document.createElement("span");
    element.className = kind;
    element.textContent = words;
    parent.append(element);
    return element;
  }

  // Columns of a swimmer: the body's pose in the world, then pose, size and colour of each part.
  function read(one, column, row, count = 3) {
    return Array.from({ length: count }, (_, i) => one.columns[(column + i) * one.samples + row]);
  }

  function addSwimmer(one) {
    const [wide, long] = read(one, 14, 0);
    const capsule = (radius, length) => new three.CapsuleGeometry(radius, length, 16, 40);
    one.body = new three.Group();
    add(capsule(wide / 2 + 0.02, 0.1), one.colour, one.body); // a band
    one.parts = Array.from({ length: 9 }, (_, k) => {
      const cube = k && new three.BoxGeometry(1, 1, 1);
      const part = add(cube || capsule(wide / 2, long - wide), "white", one.body);
      part.castShadow = true;
      return part;
    });
    const flat = new three.MeshBasicMaterial({ color: one.colour });
    one.trail = new three.InstancedMesh(new three.CircleGeometry(0.1, 16), flat, one.samples);
    one.trail.frustumCulled = false;
    for (let row = 0; row < one.samples; row += 1) {
      const [x, y, z] = read(one, 0, row);
      one.trail.setMatrixAt(row, new three.Matrix4().makeTranslation(x, y, floor + 0.04));
      shown.push(new three.Vector3(x, y + 2, z + 1), new three.Vector3(x + 1.5, y - 1.5, floor));
      shown.push(new three.Vector3(x - 1.5, y, floor));
    }
    scene.add(one.body, one.trail);
    one.text = addText(legend, "label", one.label);
    one.text.style.borderColor = one.colour;
  }

  function addLight() {
    const half = box.getSize(new three.Vector3()).length() / 2 + 3;
    const sun = new three.DirectionalLight("#ffffff", 2);
    box.getCenter(sun.target.position);
    sun.position.copy(sun.target.position).add(new three.Vector3(0, 0, half));
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.normalBias = 0.05;
    const range = { left: -half, right: half, top: half, bottom: -half, far: 2 * half };
    Object.assign(sun.shadow.camera, range);
    renderer.shadowMap.enabled = true;
    scene.background = new three.Color(colours.water);
    scene.fog = new three.Fog(colours.water, 40, 110);
    scene.add(sun, sun.target, new three.HemisphereLight("#ffffff", "#9fc6d8", 2.2));
  }

  function addFloor() {
    const sand = add(new three.PlaneGeometry(400, 400), "white");
    sand.material.map = gridTexture(400);
    sand.receiveShadow = true;
    sand.position.z = floor;
    const [left, right] = data.ends;
    const line = add(new three.BoxGeometry(right - left, 0.15, 0.06), colours.ink);
    line.position.set((left + right) / 2, 0, floor);
  }

  // One tile is as wide as the wide grid; a texture is smooth where lines would flicker.
  function gridTexture(width) {
    const [narrow, wide] = data.grid;
    const tile = Object.assign(document.createElement("canvas"), { width: 1024, height: 1024 });
    const pen = tile.getContext("2d");
    pen.fillStyle = colours.sand;
    pen.fillRect(0, 0, 1024, 1024);
    pen.fillStyle = colours.grid;
    for (let at = 0; at <= wide; at += narrow) {
      const half = at % wide ? 2 : 5;
      pen.fillRect(0, (1024 * at) / wide - half, 1024, 2 * half);
      pen.fillRect((1024 * at) / wide - half, 0, 2 * half, 1024);
    }
    const texture = new three.CanvasTexture(tile);
    texture.colorSpace = three.SRGBColorSpace;
    texture.wrapS = texture.wrapT = three.RepeatWrapping;
    texture.repeat.set(width / wide, width / wide);
    texture.anisotropy = renderer.capabilities.getMaxAnisotropy();
    return texture;
  }

  function connect() {
    slider.max = end;
    slider.addEventListener("input", () => seek(Number(slider.value)));
    button.addEventListener("click", () => {
      const wasPlaying = playing;
      seek(time < end ? time : 0);
      playing = !wasPlaying;
    });
    view.addEventListener("change", aim);
    orbit.addEventListener("change", () => {
      changed = true;
    });
    host.querySelector(".controls").hidden = false;
  }

  function seek(to) {
    time = to;
    playing = false;
    changed = true;
  }

  function resize() {
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.setSize(stage.clientWidth, stage.clientHeight);
    camera.aspect = stage.clientWidth / stage.clientHeight;
    camera.updateProjectionMatrix();
    aim();
  }

  // Puts the camera as near as it sees every path whole.
  function aim() {
    const from = [[1, -0.4, 0.6], [0, -0.01, 1], [0, -1, 0.8]][view.selectedIndex];
    const beside = 1 - 110 / stage.clientWidth; // room for the distances
    const above = 1 - 50 / stage.clientHeight;
    const fits = (point) => {
      const { x, y } = point.clone().project(camera);
      return Math.abs(x) < beside && Math.abs(y) < above;
    };
    camera.up.set(0, 0, 1);
    box.getCenter(orbit.target);
    for (let distance = 10; distance < 300; distance *= 1.04) {
      camera.position.set(...from).setLength(distance).add(orbit.target);
      camera.lookAt(orbit.target);
      camera.updateMatrixWorld();
      if (shown.every(fits)) {
        break;
      }
    }
    orbit.update();
    changed = true;
  }

  function move(one) {
    const row = Math.min(one.samples - 2, Math.floor(time / step));
    const share = Math.min(1, time / step - row);
    const place = (object, column) => {
      const [from, to] = [row, row + 1].map((at) => read(one, column, at, 7));
      const [before, after] = [from, to].map((pose) => new three.Vector3(...pose));
      object.position.lerpVectors(before, after, share);
      const turns = [from, to].map((pose) => new three.Quaternion(...pose.slice(3)));
      object.quaternion.slerpQuaternions(...turns, share);
    };
    place(one.body, 0);
    one.parts.forEach((part, k) => {
      const size = read(one, 14 + 13 * k, row);
      part.visible = size[0] > 0;
      part.scale.set(...(k ? size : [1, 1, 1]));
      part.material.color.setRGB(...read(one, 17 + 13 * k, row), three.SRGBColorSpace);
      place(part, 7 + 13 * k);
    });
    one.trail.count = row + 1;
    const distance = Math.round(data.cmPerUnit * one.body.position.y) || 0; // no "-0"
    one.text.textContent = `${one.label} ${distance} cm`;
  }

  function placeMark({ element, place }) {
    const { x, y, z } = place.clone().project(camera);
    const left = ((x + 1) * stage.clientWidth) / 2;
    const top = ((1 - y) * stage.clientHeight - element.offsetHeight) / 2;
    element.style.transform = `translate(${left}px, ${top}px)`;
    element.style.visibility = z < 1 ? "visible" : "hidden"; // it may be behind the camera
  }

  function frame(now) {
    if (playing) {
      time = Math.min(end, time + (Math.min(100, now - last) / 1000) * Number(speed.value));
      playing = time < end;
      changed = true;
    }
    last = now;
    if (changed) {
      changed = false;
      button.textContent = playing ? "pause" : time < end ? "play" : "again";
      slider.value = time;
      clock.textContent = `${time.toFixed(1)} / ${end.toFixed(0)} s`;
      swimmers.forEach(move);
      renderer.render(scene, camera);
      marks.forEach(placeMark);
      host.dataset.ready = "yes";
    }
    requestAnimationFrame(frame);
  }
}
