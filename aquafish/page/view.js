// The page: it swims the fish of the program (agent.js), draws it by scene.js, and breaks it.
(async () => {
  const host = document.querySelector(".live");
  const problem = host.querySelector(".problem");
  try {
    const three = await loadThree("live-library");
    live(host, JSON.parse(document.getElementById("live-data").textContent), three);
    problem.remove();
  } catch (error) {
    problem.textContent = `This page needs a browser with WebGL (${error.message}).`;
  }
})();

// Returns a worker that ponders the agent's jobs, made of the page's own program.
function startWorker() {
  const program = document.getElementById("live-program").textContent;
  const text = `${program}\nonmessage = ({ data }) => postMessage(ponder(data));`;
  return new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
}

// Returns a number of a normal distribution.
function normal() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

// The fish, what broke of it, and its agent.
class Swim {
  constructor() {
    const angles = FACTS.fins.map(() => Math.PI * (2 * Math.random() - 1));
    this.worker = startWorker();
    this.robot = WHOLE;
    this.faults = FACTS.fins.map(() => []);
    this.state = atRest(angles);
    this.current = [0, 0, 0];
    this.wanted = this.current; // from the next action on
    this.steps = 0;
    this.isStruck = false; // but not yet broken
    this.brokenAt = null; // s
    this.knewAt = null;
    this.felt = []; // what the gyroscope felt and should have felt after each action
    const waiting = []; // for the worker, which answers in order
    this.worker.onmessage = ({ data }) => {
      waiting.shift().found = data;
    };
    this.agent = new Agent(angles, (job, asked) => {
      waiting.push(asked);
      this.worker.postMessage(job);
    });
  }

  get seconds() {
    return (this.steps * FACTS.seconds) / FACTS.hold;
  }

  get truth() {
    return faultsOf(this.robot);
  }

  get belief() {
    return faultsOf(this.agent.model.robot);
  }

  get isRight() {
    return wordsOf(this.truth) === wordsOf(this.belief);
  }

  // Breaks a fin, from the next action on.
  breakFin(fin, faults) {
    this.faults[fin] = faults.map(([word, number]) => ({ fin: FACTS.fins[fin], word, number }));
    this.isStruck = true;
  }

  // Swims on for a time step of 0.01 s.
  tick() {
    const { agent } = this;
    if (this.steps % FACTS.hold === 0) {
      if (this.isStruck) {
        this.robot = broken(WHOLE, this.faults.flat());
        this.brokenAt = this.seconds;
        this.knewAt = null;
        this.isStruck = false;
      }
      const seen = observe(this.state);
      const felt = seen.map((x, i) => (i < 6 ? x : x + FACTS.gyroNoise * normal()));
      this.action = agent.act(felt);
      this.current = this.wanted;
      agent.current = this.current;
      this.ghost = Float64Array.from(agent.model.state);
      this.felt.push({
        seconds: this.seconds,
        felt: felt.slice(6),
        expected: (agent.model.expected ?? seen).slice(6),
      });
      this.felt = this.felt.slice(-100);
    }
    step(this.state, this.robot.rows, this.current, commandOf(this.robot, this.action));
    const believed = agent.model.robot;
    step(this.ghost, believed.rows, this.current, commandOf(believed, this.action));
    this.steps += 1;
    if (this.brokenAt !== null && this.knewAt === null && this.isRight) this.knewAt = this.seconds;
  }

  // Returns the parts of a robot in a state, thirteen numbers each.
  static parts(robot, state) {
    const found = new Float64Array(FACTS.parts);
    const marked = FACTS.fins.map((fin) =>
      Number(faultsOf(robot).some((fault) => fault.fin === fin)),
    );
    place_fish(robot.sizes, marked, state, found);
    return found;
  }
}

function live(host, data, three) {
  const { colours } = data;
  const { position, orientation } = data.rows;
  const find = (selector) => host.querySelector(selector);
  const stage = find(".stage");
  const menu = find(".menu");
  const inputs = Object.fromEntries([...host.querySelectorAll("[name]")].map((e) => [e.name, e]));
  const renderer = makeRenderer(three);
  const scene = new three.Scene();
  const camera = new three.PerspectiveCamera(35, 1, 1, 400);
  const orbit = new three.OrbitControls(camera, renderer.domElement);
  const { room } = data; // of the fish, units
  const [wide, long] = data.capsule;
  const fish = addFish(three, scene, data.parts, wide, long, colours.fish);
  const ghost = addFish(three, scene, data.parts, wide, long, colours.belief);
  const sun = addLight(three, renderer, scene, colours.water, 6 * room);
  const sand = addFloor(three, renderer, scene, data.grid, colours);
  const trail = addTrail(three, scene, colours.fish, 1000);
  const names = [addText(stage, "name", "the fish"), addText(stage, "name ghost", "its belief")];
  const beside = new three.Vector3(-1.75 * room, 0, 0); // where the ghost is drawn
  let swim = null;
  let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  let last = 0;
  let owed = 0;
  let floor = data.floor;
  let pressed = null;
  let slow = 0; // ms of frames that took too long, less those of others

  [ghost.band, ...ghost.parts].forEach(({ material }) => {
    material.transparent = true;
    material.opacity = 0.55;
  });
  ghost.parts.forEach((part) => {
    part.castShadow = false;
  });
  stage.prepend(renderer.domElement);
  begin();
  connect();
  inputs.camera.value = stage.clientWidth < stage.clientHeight ? "behind" : "side";
  new ResizeObserver(() => fitStage(renderer, camera, stage)).observe(stage);
  fitStage(renderer, camera, stage);
  aim();
  requestAnimationFrame(frame);

  function begin() {
    swim?.worker.terminate();
    swim = new Swim();
    trail.count = 0;
    floor = data.floor;
    orbit.target.set(0, 0, 0);
    for (const name of ["x", "y"]) inputs[name].value = 0;
    showFin();
    swim.tick();
  }

  function connect() {
    inputs.play.addEventListener("click", () => {
      playing = !playing;
    });
    inputs.again.addEventListener("click", () => {
      begin();
      aim();
    });
    inputs.camera.addEventListener("change", aim);
    inputs.fin.addEventListener("change", showFin);
    for (const name of ["length", "width"]) {
      inputs[name].addEventListener("input", showSliders);
      inputs[name].addEventListener("change", () => {
        const sizes = ["length", "width"].map((size) => [size, Number(inputs[size].value) / 100]);
        breakFin(sizes.filter(([, number]) => number < 1));
      });
    }
    for (const name of ["x", "y"]) {
      inputs[name].addEventListener("input", () => {
        const [x, y] = [inputs.x, inputs.y].map((one) => Number(one.value) / data.cmPerUnit);
        swim.wanted = [x, y, 0];
        showSliders();
      });
    }
    addButtons(find(".words"));
    const { domElement } = renderer;
    domElement.addEventListener("pointerdown", (event) => {
      pressed = event;
      menu.hidden = true;
    });
    domElement.addEventListener("pointerup", (event) => {
      const moved = Math.hypot(event.x - pressed.x, event.y - pressed.y);
      if (moved < 8) openMenu(event.offsetX, event.offsetY);
    });
    domElement.addEventListener("pointermove", (event) => {
      const over = finAt(event.offsetX, event.offsetY) !== null;
      domElement.style.cursor = over ? "pointer" : "grab";
    });
    find(".controls").hidden = false;
  }

  // Adds a button for each way to break the chosen fin, and one to mend it.
  function addButtons(parent) {
    for (const [name, ...fault] of [...data.breaks, ["whole"]]) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name;
      button.addEventListener("click", () => breakFin(fault.length ? [fault] : []));
      parent.append(button);
    }
  }

  function breakFin(faults) {
    swim.breakFin(Number(inputs.fin.value), faults);
    menu.hidden = true;
    showFin();
  }

  // Shows what is broken of the chosen fin.
  function showFin() {
    const faults = swim.faults[inputs.fin.value];
    for (const size of ["length", "width"]) {
      const number = faults.find(({ word }) => word === size)?.number ?? 1;
      inputs[size].value = 100 * number;
    }
    showSliders();
    const now = JSON.stringify(faults.map(({ word, number }) => [word, number]));
    [...find(".words").children].forEach((button, i) => {
      const [, ...fault] = data.breaks[i] ?? [];
      button.classList.toggle("set", now === JSON.stringify(fault.length ? [fault] : []));
    });
  }

  function showSliders() {
    for (const size of ["length", "width"]) {
      inputs[size].nextElementSibling.textContent = `${Math.round(inputs[size].value)}%`;
    }
    for (const name of ["x", "y"])
      inputs[name].nextElementSibling.textContent = `${inputs[name].value} cm/s`;
  }

  // Returns the number of the fin that is drawn at a place of the stage, or null.
  function finAt(x, y) {
    const seen = (point) => {
      const at = point.project(camera);
      return [((at.x + 1) * stage.clientWidth) / 2, ((1 - at.y) * stage.clientHeight) / 2];
    };
    const distances = FACTS.fins.map((_, i) => {
      const part = fish.parts[data.firstFin + i];
      const axis = data.lengthAxes[i];
      const half = Math.max(part.scale.getComponent(axis), room / 3) / 2;
      const along = [-1, -0.5, 0, 0.5, 1].map((k) =>
        new three.Vector3().setComponent(axis, k * half),
      );
      return Math.min(
        ...along.map((point) => {
          point.applyQuaternion(part.quaternion).add(part.position);
          const [left, top] = seen(
            point.applyQuaternion(fish.body.quaternion).add(fish.body.position),
          );
          return Math.hypot(left - x, top - y);
        }),
      );
    });
    const nearest = Math.min(...distances);
    return nearest < 30 ? distances.indexOf(nearest) : null;
  }

  function openMenu(x, y) {
    const fin = finAt(x, y);
    if (fin === null) return;
    inputs.fin.value = fin;
    showFin();
    const title = document.createElement("b");
    title.textContent = data.finWords[FACTS.fins[fin]];
    menu.replaceChildren(title);
    addButtons(menu);
    menu.hidden = false;
    const left = Math.min(x + 8, stage.clientWidth - menu.offsetWidth - 8);
    const top = Math.max(8, Math.min(y - 40, stage.clientHeight - menu.offsetHeight - 8));
    menu.style.transform = `translate(${left}px, ${top}px)`;
  }

  function aim() {
    camera.up.set(0, 0, 1);
    const distance = room * (stage.clientWidth < stage.clientHeight ? 10 : 7.1);
    camera.position
      .set(...VIEWS[inputs.camera.value])
      .setLength(distance)
      .add(orbit.target);
    orbit.update();
  }

  function draw(shape, robot, state) {
    const parts = Swim.parts(robot, state);
    shape.parts.forEach((part, k) => {
      showPart(three, part, k, parts.subarray(data.partNumbers * k, data.partNumbers * (k + 1)));
    });
    shape.body.quaternion.set(...state.subarray(orientation, orientation + 4));
  }

  function frame(now) {
    if (playing) {
      owed += (Math.min(100, now - last) / 1000) * Number(inputs.speed.value);
      while (owed > data.timestep) {
        swim.tick();
        owed -= data.timestep;
        if (swim.steps % 50 === 0) leaveMark();
      }
    }
    const took = Math.min(100, now - last);
    slow = Math.max(0, slow + (took > data.slowFrame ? took : -took));
    if (slow > 500) lighten();
    last = now;
    const { agent, state } = swim;
    const place = new three.Vector3(...state.subarray(position, position + 3));
    draw(fish, swim.robot, state);
    fish.body.position.copy(place);
    draw(ghost, agent.model.robot, swim.ghost);
    ghost.body.position.copy(place).add(beside);
    for (const { material } of ghost.parts) material.color.set(colours.belief);
    floor = Math.min(floor, place.z - data.clearance);
    const tile = data.grid[1]; // the floor follows by whole tiles, so that its lines stay
    sand.position.set(tile * Math.round(place.x / tile), tile * Math.round(place.y / tile), floor);
    sun.target.position.copy(place);
    sun.position.copy(place).add(new three.Vector3(0, 0, 6 * room));
    camera.position.add(place).sub(orbit.target);
    orbit.target.copy(place);
    orbit.update();
    renderer.render(scene, camera);
    const above = new three.Vector3(0, 0, 0.55 * room);
    placeText(names[0], place.clone().add(above), camera, stage);
    placeText(names[1], place.clone().add(beside).add(above), camera, stage);
    write();
    host.dataset.ready = "yes";
    requestAnimationFrame(frame);
  }

  // Draws with less effort, on a device that is slow.
  function lighten() {
    slow = 0;
    const coarser = Math.max(0.5, 0.7 * renderer.getPixelRatio());
    if (!sun.castShadow) renderer.setPixelRatio(coarser);
    sun.castShadow = false;
  }

  function leaveMark() {
    const [x, y] = swim.state.subarray(position, position + 2);
    const at = (swim.steps / 50 - 1) % 1000;
    trail.setMatrixAt(at, new three.Matrix4().makeTranslation(x, y, floor + 0.04));
    trail.instanceMatrix.needsUpdate = true;
    trail.count = Math.max(trail.count, at + 1);
  }

  function thought() {
    const { agent } = swim;
    const { what } = agent.events.at(-1) ?? {};
    if (what === "noticed") return "I do not turn as I should. Something is wrong with me. What?";
    if (what === "unknown")
      return "Something is wrong with me, and none of my ideas explains what I feel.";
    const words = sentenceOf(swim.belief, data, "my ");
    const far = Math.round(data.cmPerUnit * Math.max(...agent.far));
    const gait = Number.isFinite(far)
      ? ` The best gait that I know should take me ${far} cm in ${data.horizon} s.`
      : "";
    return `${words[0].toUpperCase()}${words.slice(1)}.${gait}`;
  }

  function write() {
    const { agent, brokenAt, knewAt } = swim;
    const setText = (element, text) => {
      if (element.textContent !== text) element.textContent = text;
    };
    setText(inputs.play, playing ? "pause" : "play");
    const forward = data.cmPerUnit * swim.state[FACTS.northing];
    setText(find(".controls output"), `${swim.seconds.toFixed(0)} s, ${forward.toFixed(0)} cm`);
    setText(find(".thought"), thought());
    const since = (what) =>
      agent.events.find((one) => brokenAt !== null && one.seconds >= brokenAt && one.what === what);
    const times = [since("noticed")?.seconds, knewAt, since("changed")?.seconds];
    const keeps = (one) => one.what === "kept" && one.seconds >= knewAt;
    const kept = knewAt !== null && agent.events.some(keeps);
    [...host.querySelectorAll("dd")].forEach((element, i) => {
      const time = times[i] ?? null;
      const none = kept && i === 2 ? "same" : "–";
      setText(element, time === null ? none : `${(time - brokenAt).toFixed(1)} s`);
    });
    host.dataset.truth = wordsOf(swim.truth);
    host.dataset.belief = wordsOf(swim.belief);
    if (swim.steps % FACTS.hold < 10) {
      writeBeliefs(find(".beliefs"), agent.alternatives, (faults) => sentenceOf(faults, data, ""));
      writeGaits(find(".gaits"), agent, data.cmPerUnit);
      drawGyro(find(".gyro"), swim, colours);
    }
  }
}
