// What the page shows beside the water: beliefs, gaits and the gyroscope.

// Lists what the fish may have become, the likeliest first.
function writeBeliefs(list, alternatives, sentence) {
  const weights = new Map(); // by what it has become
  for (const { robot, weight } of alternatives) {
    const words = sentence(faultsOf(robot));
    weights.set(words, (weights.get(words) ?? 0) + weight);
  }
  const shown = [...weights].filter(([, weight]) => weight >= 0.005).slice(0, 3);
  const rows = shown.map(([words, weight]) => {
    const row = document.createElement("li");
    const bar = document.createElement("i");
    bar.style.width = `${100 * weight}%`;
    row.append(bar);
    addText(row, "", words);
    addText(row, "", `${Math.round(100 * weight)}%`);
    return row;
  });
  list.replaceChildren(...rows);
}

// Draws a bar for the way of each gait.
function writeGaits(chart, { far, swimming }, cmPerUnit) {
  const most = Math.max(1, ...far);
  const bars = far.map((distance, i) => {
    const bar = document.createElement("i");
    bar.style.height = `${100 * Math.max(0, distance / most)}%`;
    bar.className = i === swimming.gait ? "swum" : "";
    bar.title = `gait ${i + 1}: ${Math.round(cmPerUnit * distance)} cm`;
    return bar;
  });
  chart.replaceChildren(...bars);
}

// Draws what the gyroscope felt in the last 20 s, and what the fish expected.
function drawGyro(canvas, swim, colours) {
  const scale = Math.min(2, devicePixelRatio);
  canvas.width = canvas.clientWidth * scale;
  canvas.height = canvas.clientHeight * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  const width = canvas.clientWidth;
  const row = canvas.clientHeight / 3;
  const from = swim.seconds - 20;
  const x = (seconds) => ((seconds - from) / 20) * width;
  if (swim.brokenAt !== null) {
    pen.fillStyle = colours.broken;
    pen.fillRect(x(swim.brokenAt) - 1.5, 0, 3, 3 * row);
  }
  ["pitch", "roll", "yaw"].forEach((name, axis) => {
    const middle = (axis + 0.5) * row;
    const most = Math.max(
      0.5,
      ...swim.felt.flatMap((one) => [Math.abs(one.felt[axis]), Math.abs(one.expected[axis])]),
    );
    const line = (which, colour, thick) => {
      pen.strokeStyle = colour;
      pen.lineWidth = thick;
      pen.beginPath();
      for (const one of swim.felt) {
        pen.lineTo(x(one.seconds), middle - (one[which][axis] / most) * 0.46 * row);
      }
      pen.stroke();
    };
    line("expected", colours.belief, 3);
    line("felt", colours.ink, 1.2);
    pen.fillStyle = colours.muted;
    pen.font = "11px system-ui, sans-serif";
    pen.fillText(name, 2, middle - 0.3 * row);
  });
}
