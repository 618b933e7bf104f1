// Runs the printed functions step(state, sliders) and draw(state, sliders, shapes).
const data = JSON.parse(document.getElementById("simulation-data").textContent);
const LONGEST_FRAME = 0.1; // s: a page that was hidden does not catch up
const root = document.querySelector(".simulation");
const find = (words) => root.querySelector(words);
const canvas = find("canvas");
const state = new Float64Array(data.start);
const sliders = new Float64Array(data.sliders.map((slider) => slider[2]));
const shapes = new Float64Array(data.numbers);
let time = 0;
let due = 0;
let before = null;
let running = true;

function restart() {
  state.set(data.start);
  time = 0;
  due = 0;
  find(".stopped").hidden = true;
}

function paint() {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const [left, right, bottom, top] = data.view;
  const scale = Math.min(width / (right - left), height / (top - bottom));
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, width, height);
  context.setTransform(
    scale,
    0,
    0,
    -scale,
    width / 2 - (scale * (left + right)) / 2,
    height / 2 + (scale * (bottom + top)) / 2,
  );
  context.lineCap = "round";
  draw(state, sliders, shapes);
  let at = 0;
  for (const [isLine, colour] of data.shapes) {
    context.beginPath();
    if (isLine) {
      context.moveTo(shapes[at], shapes[at + 1]);
      context.lineTo(shapes[at + 2], shapes[at + 3]);
      context.lineWidth = Math.max(0, shapes[at + 4]);
      context.strokeStyle = colour;
      if (shapes[at + 4] > 0) context.stroke();
      at += 5;
    } else {
      context.arc(shapes[at], shapes[at + 1], Math.max(0, shapes[at + 2]), 0, 2 * Math.PI);
      context.fillStyle = colour;
      context.fill();
      at += 3;
    }
  }
  find(".time").textContent = `${time.toFixed(1)} s`;
}

function frame(now) {
  if (running && before !== null) due += Math.min((now - before) / 1000, LONGEST_FRAME);
  before = now;
  while (due >= data.timestep && state.every(Number.isFinite)) {
    step(state, sliders);
    due -= data.timestep;
    time += data.timestep;
  }
  if (state.every(Number.isFinite)) paint();
  else find(".stopped").hidden = false;
  requestAnimationFrame(frame);
}

root.querySelectorAll("label").forEach((label, i) => {
  const input = label.querySelector("input");
  [input.min, input.max, input.value] = data.sliders[i];
  const show = () => {
    sliders[i] = input.valueAsNumber;
    label.querySelector("output").textContent = Number(sliders[i].toPrecision(3));
  };
  input.addEventListener("input", show);
  show();
});
find("[name=pause]").addEventListener("click", () => {
  running = !running;
  find("[name=pause]").textContent = running ? "pause" : "go on";
});
find("[name=restart]").addEventListener("click", restart);
requestAnimationFrame(frame);
