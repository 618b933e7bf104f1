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
    const library = new TextDecoder().decode(await unpack(read("replay-library")));
    const data = JSON.parse(read("replay-data"));
    for (const swimmer of data.swimmers) {
      swimmer.columns = new Float32Array(await unpack(swimmer.columns));
    }
    play(host, data, new Function(`${library}\nreturn THREE;`)());
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
  const stage = host.querySelector(".stage");
  const [button, slider, clock, speed, view] = host.querySelector(".controls").children;
  const end = step * (Math.max(...swimmers.map((one) => one.samples)) - 1);
  const shown = [];
  let time = 0;
  let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  let changed = true;
  let last = 0;

  swimmers.forEach(addSwimmer);
  const box = new three.Box3().setFromPoints(shown);
  addLight();
  const marks = addFloor();
  connect();
  stage.prepend(renderer.domElement);
  view.selectedIndex = stage.clientWidth < stage.clientHeight ? 2 : 0;
  new ResizeObserver(resize).observe(stage);
  resize();
  requestAnimationFrame(frame);

  function addSwimmer(one) {
    one.body = new three.Group();
    one.solids = one.parts.map(({ kind, size: [x, y, z], colour }) => {
      const capsule = kind === "capsule" && new three.CapsuleGeometry(x / 2, y - x, 16, 40);
      const solid = new three.Mesh(capsule || new three.BoxGeometry(x, y, z), material(colour));
      solid.castShadow = true;
      one.body.add(solid);
      return solid;
    });
    const flat = new three.MeshBasicMaterial({ color: one.colour });
    one.trail = new three.InstancedMesh(new three.CircleGeometry(0.1, 16), flat, one.samples);
    one.trail.frustumCulled = false;
    for (let row = 0; row < one.samples; row += 1) {
      const { x, y, z } = pose(one, 0, row).position;
      one.trail.setMatrixAt(row, new three.Matrix4().makeTranslation(x, y, floor + 0.04));
      shown.push(new three.Vector3(x, y + 2, z + 1), new three.Vector3(x + 1.5, y - 1.5, floor));
      shown.push(new three.Vector3(x - 1.5, y, floor));
    }
    scene.add(one.body, one.trail);
    one.text = addText("label");
    one.text.style.borderColor = one.colour;
  }

  // The body's pose in the world has index 0, its parts' poses in the body follow.
  function pose(one, index, row) {
    const value = (offset) => one.columns[(7 * index + offset) * one.samples + row];
    return {
      position: new three.Vector3(value(0), value(1), value(2)),
      quaternion: new three.Quaternion(value(3), value(4), value(5), value(6)),
    };
  }

  function material(color) {
    return new three.MeshStandardMaterial({ color, roughness: 0.6 });
  }

  function addText(kind, words = "") {
    const element = document.createElement("span");
    element.className = kind;
    element.textContent = words;
    stage.append(element);
    return element;
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

  // Adds sand, a grid and the start line; returns the texts of the distances and their places.
  function addFloor() {
    const sand = new three.Mesh(
      new three.PlaneGeometry(400, 400),
      new three.MeshStandardMaterial({ map: gridTexture(400) }),
    );
    const line = new three.Mesh(
      new three.BoxGeometry(box.max.x - box.min.x, 0.15, 0.06),
      material(colours.ink),
    );
    sand.receiveShadow = true;
    sand.position.z = floor;
    line.position.set((box.min.x + box.max.x) / 2, 0, floor);
    scene.add(sand, line);
    const furthest = data.cmPerUnit * (box.max.y - 2);
    const spacing = [2, 5, 10, 20, 50].find((each) => furthest < 6.5 * each) || 100;
    return Array.from({ length: Math.max(1, Math.ceil(furthest / spacing)) }, (_, count) => ({
      element: addText("mark", count ? `${count * spacing} cm` : "start"),
      place: new three.Vector3(box.max.x + 0.3, (count * spacing) / data.cmPerUnit, floor),
    }));
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
    texture.wrapS = three.RepeatWrapping;
    texture.wrapT = three.RepeatWrapping;
    texture.repeat.set(width / wide, width / wide);
    texture.anisotropy = renderer.capabilities.getMaxAnisotropy();
    return texture;
  }

  function connect() {
    const keys = {
      " ": () => button.click(),
      ArrowLeft: () => seek(time - 1),
      ArrowRight: () => seek(time + 1),
      Home: () => seek(0),
      End: () => seek(end),
    };
    [...view.options].forEach((option, index) => {
      keys[index + 1] = () => {
        view.selectedIndex = index;
        aim();
      };
    });
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
    host.addEventListener("keydown", (event) => {
      if (event.key in keys && event.target === host) {
        event.preventDefault();
        keys[event.key]();
      }
    });
    host.querySelector(".controls").hidden = false;
  }

  function seek(to) {
    time = Math.min(end, Math.max(0, to));
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
    const row = Math.max(0, Math.min(one.samples - 2, Math.floor(time / step)));
    const share = Math.min(1, time / step - row);
    [one.body, ...one.solids].forEach((object, index) => {
      const [before, after] = [row, row + 1].map((at) => pose(one, index, at));
      object.position.lerpVectors(before.position, after.position, share);
      object.quaternion.slerpQuaternions(before.quaternion, after.quaternion, share);
    });
    one.parts.forEach(({ begin, end: until }, index) => {
      one.solids[index].visible = begin <= time && (until === null || time < until);
    });
    one.trail.count = row + 1;
    const distance = (data.cmPerUnit * one.body.position.y).toFixed(0);
    one.text.textContent = `${one.label} ${distance} cm`;
  }

  // Labels move up from one another; a distance mark that would lie below one is hidden.
  function placeTexts() {
    const taken = [];
    const labels = swimmers.map(({ text, body }) => ({
      element: text,
      place: body.position.clone().setZ(body.position.z + 1.2),
      label: true,
    }));
    [...labels, ...marks].forEach(({ element, place, label }) => {
      const [width, height] = [element.offsetWidth, element.offsetHeight];
      const { x, y, z } = place.clone().project(camera);
      const right = stage.clientWidth - width - 4;
      const middle = ((x + 1) * stage.clientWidth) / 2;
      const left = label ? Math.min(Math.max(4, middle - width / 2), right) : middle;
      let top = ((1 - y) * stage.clientHeight - height) / 2;
      const other = () =>
        taken.find(
          (one) =>
            Math.abs(one.left + one.width / 2 - left - width / 2) < (one.width + width) / 2 &&
            Math.abs(one.top - top) < height + 2,
        );
      while (label && other()) {
        top = other().top - height - 4;
      }
      const visible = z < 1 && !other();
      element.style.visibility = visible ? "visible" : "hidden";
      element.style.transform = `translate(${left}px, ${top}px)`;
      if (visible) {
        taken.push({ left, top, width });
      }
    });
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
      placeTexts();
      host.dataset.ready = "yes";
    }
    requestAnimationFrame(frame);
  }
}
