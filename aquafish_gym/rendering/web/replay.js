// Plays the swims in #replay-data with the three.js in #replay-library, by scene.js.
(async () => {
  const host = document.querySelector(".replay");
  const message = host.querySelector("p");
  try {
    const three = await loadThree("replay-library");
    const data = JSON.parse(document.getElementById("replay-data").textContent);
    for (const swimmer of data.swimmers) {
      swimmer.columns = new Float32Array(await unpack(swimmer.columns));
    }
    play(host, data, three);
    message.remove();
  } catch (error) {
    message.prepend(`The replay needs a browser with WebGL (${error.message}). `);
  }
})();

function play(host, data, three) {
  const { step, floor, colours, swimmers } = data;
  const renderer = makeRenderer(three);
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
  const half = box.getSize(new three.Vector3()).length() / 2 + 3;
  const sun = addLight(three, renderer, scene, colours.water, half);
  box.getCenter(sun.target.position);
  sun.position.copy(sun.target.position).add(new three.Vector3(0, 0, half));
  addFloor(three, renderer, scene, data.grid, colours).position.z = floor;
  addLine();
  connect();
  stage.prepend(renderer.domElement);
  view.selectedIndex = stage.clientWidth < stage.clientHeight ? 2 : 0;
  new ResizeObserver(resize).observe(stage);
  resize();
  requestAnimationFrame(frame);

  // Columns of a swimmer: the body's pose in the world, then pose, size and colour of each part.
  function read(one, column, row, count = 3) {
    return Array.from({ length: count }, (_, i) => one.columns[(column + i) * one.samples + row]);
  }

  function addSwimmer(one) {
    const [wide, long] = read(one, 14, 0);
    const count = (one.columns.length / one.samples - 7) / 13;
    Object.assign(one, addFish(three, scene, count, wide, long, one.colour));
    one.trail = addTrail(three, scene, one.colour, one.samples);
    for (let row = 0; row < one.samples; row += 1) {
      const [x, y, z] = read(one, 0, row);
      one.trail.setMatrixAt(row, new three.Matrix4().makeTranslation(x, y, floor + 0.04));
      const half = long / 2;
      const aside = 0.75 * half;
      shown.push(new three.Vector3(x, y + half, z + half / 2));
      shown.push(new three.Vector3(x + aside, y - aside, floor));
      shown.push(new three.Vector3(x - aside, y, floor));
    }
    one.text = addText(legend, "label", one.label);
    one.text.style.borderColor = one.colour;
  }

  function addLine() {
    const [left, right] = data.ends;
    const line = addMesh(
      three,
      scene,
      new three.BoxGeometry(right - left, 0.15, 0.06),
      colours.ink,
    );
    line.position.set((left + right) / 2, 0, floor);
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
    fitStage(renderer, camera, stage);
    aim();
  }

  // Puts the camera as near as it sees every path whole.
  function aim() {
    const from = VIEWS[view.value];
    const beside = 1 - 110 / stage.clientWidth; // room for the distances
    const above = 1 - 50 / stage.clientHeight;
    const fits = (point) => {
      const { x, y } = point.clone().project(camera);
      return Math.abs(x) < beside && Math.abs(y) < above;
    };
    camera.up.set(0, 0, 1);
    box.getCenter(orbit.target);
    for (let distance = 10; distance < 300; distance *= 1.04) {
      camera.position
        .set(...from)
        .setLength(distance)
        .add(orbit.target);
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
      showPart(three, part, k, read(one, 7 + 13 * k, row, 13));
      place(part, 7 + 13 * k);
    });
    one.trail.count = row + 1;
    const distance = Math.round(data.cmPerUnit * one.body.position.y) || 0; // no "-0"
    one.text.textContent = `${one.label} ${distance} cm`;
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
      for (const { element, place } of marks) placeText(element, place, camera, stage);
      host.dataset.ready = "yes";
    }
    requestAnimationFrame(frame);
  }
}
