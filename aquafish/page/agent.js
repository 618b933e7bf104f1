// The fish's agent: SelfModelAgent of aquafish/online, made simpler. It knows the water, its sensors
// are whole, it refines no gait, and it looks for a second fault only beside the likeliest first
// ones. aquafish/page/program.py prints FACTS, and functions with names_like_this, from the library's
// own Python; thresholds.NAME is that of aquafish/online/thresholds.py. A state is a Float64Array in
// the order of aquafish_gym/physics/layout.py; a robot is its sizes, the gains of its servos, and
// its rows there; a fault is { fin, word, number }.

const { thresholds } = FACTS;
const WHOLE = makeRobot(
  FACTS.sizes,
  FACTS.fins.map(() => 1),
);

// Returns an array that one of the printed functions sets.
function filled(length, fill, ...given) {
  const found = new Float64Array(length);
  fill(...given, found);
  return found;
}

function makeRobot(sizes, gain) {
  return { sizes, gain, rows: filled(FACTS.robotRows, robot_rows, sizes, [1], [1, 1]) };
}

// Returns the largest difference of two robots' sizes and gains.
function difference(one, other) {
  const changes = less([...one.sizes, ...one.gain], [...other.sizes, ...other.gain]);
  return Math.max(...changes.map(Math.abs));
}

// Returns a robot with faults. Each is bilinear in its number and in the value that it changes.
function broken(robot, faults) {
  const values = [...robot.sizes, ...robot.gain];
  for (const { fin, word, number } of faults) {
    for (const [at, a, b, c, d] of FACTS.effects[fin][word]) {
      values[at] = a + b * number + (c + d * number) * values[at];
    }
  }
  const count = FACTS.sizes.length;
  return makeRobot(values.slice(0, count), values.slice(count));
}

const atRest = (finAngles) => filled(FACTS.stateRows, start, finAngles);
const moved = (state, error) => filled(FACTS.stateRows, move, state, error);
const errorOf = (state, other) => filled(FACTS.errors, state_error, state, other);
const observe = (state) => filled(12, sense, state, [0, 0, 0]).subarray(0, 9); // without a goal

// Returns what the servos do for an action in [-1, 1].
const commandOf = ({ gain }, action) =>
  gain.map((x, i) => x * (FACTS.middle[i] + FACTS.reach[i] * action[i]));

// Swims a state on, in place, for as long as an action is held.
function advance(robot, state, action, current) {
  const command = commandOf(robot, action);
  for (let i = 0; i < FACTS.hold; i += 1) step(state, robot.rows, current, command);
}

// Returns a gait that is swum: its number, its network's memory, and its actions so far.
function begin(gait) {
  const { inputs, nodes } = FACTS.gaits[gait].layout;
  return { gait, values: new Float64Array(inputs + 2 * nodes), steps: 0 };
}

// Returns a gait's next action, in a state: gait.controllers.network.respond.
function respond(swimming, state) {
  const { genes, layout } = FACTS.gaits[swimming.gait];
  const { inputs, nodes, ends, clipped, memory } = layout;
  const { values } = swimming;
  sense_inputs(state, [genes[0] * swimming.steps * FACTS.seconds], values);
  swimming.steps += 1;
  let at = 1;
  let first = inputs;
  for (const last of ends) {
    const end = inputs + last;
    const sources = memory ? inputs + nodes : first;
    const squash = clipped && last === nodes ? (z) => clip(z, [-1, 1]) : Math.tanh;
    for (let node = first; node < end; node += 1) {
      let total = 0;
      for (let i = 0; i < sources; i += 1) total += genes[at + 2 + i] * values[i];
      values[node + nodes] = squash(FACTS.outputGain * (genes[at] + genes[at + 1] * total));
      at += 2 + sources;
    }
    values.copyWithin(first, first + nodes, end + nodes);
    first = end;
  }
  return Array.from(values.subarray(first - FACTS.fins.length, first));
}

// Returns how far each gait would swim along +y from a state, and the present one if it goes on.
function imagine(robot, state, swimming, current) {
  return [...FACTS.gaits.map((_, gait) => begin(gait)), swimming].map((one) => {
    const ahead = Float64Array.from(state);
    for (let i = 0; i < FACTS.horizon; i += 1) advance(robot, ahead, respond(one, ahead), current);
    const far = ahead[FACTS.northing] - state[FACTS.northing];
    return Number.isFinite(far) ? far : -Infinity;
  });
}

const dot = (one, other) => one.reduce((sum, x, i) => sum + x * other[i], 0);
const less = (one, other) => one.map((x, i) => x - other[i]);
const clip = (x, [low, high]) => Math.max(low, Math.min(high, x));
const sum = (numbers) => numbers.reduce((total, x) => total + x, 0);
const meanOf = (rows) => rows[0].map((_, i) => sum(rows.map((row) => row[i])) / rows.length);

// Returns the mean of the products of two tables' columns.
function products(one, other) {
  const columns = (rows) => Array.from(rows[0], (_, i) => rows.map((row) => row[i]));
  const others = columns(other);
  return columns(one).map((left) => others.map((right) => dot(left, right) / left.length));
}

// Returns x for l x = b, where l is lower triangular.
function forward(lower, b) {
  const x = [];
  for (const row of lower) x.push((b[x.length] - dot(x, row)) / row[x.length]);
  return x;
}

// Returns the lower triangular l whose l l' is a matrix.
function cholesky(matrix) {
  const lower = [];
  for (const row of matrix) {
    const found = forward(lower, row);
    lower.push([...found, Math.sqrt(row[found.length] - dot(found, found))]);
  }
  return lower;
}

// Returns a matrix with the squares of standard deviations on its diagonal besides.
function withNoise(matrix, sds) {
  return matrix.map((row, i) => row.map((x, j) => (i === j ? x + sds[i] * sds[i] : x)));
}

// The robot's model of itself: a cubature Kalman filter, as in aquafish.online.self_model.
class SelfModel {
  constructor(robot, state) {
    this.robot = robot;
    this.state = state;
    this.modelError = thresholds.MODEL_ERROR;
    this.covariance = FACTS.startCovariance;
  }

  // Returns the errors of the filter's points.
  spread() {
    const lower = cholesky(this.covariance);
    const columns = lower.map((_, j) =>
      lower.map((row) => Math.sqrt(FACTS.errors) * (row[j] ?? 0)),
    );
    return [...columns, ...columns.map((column) => column.map((x) => -x))];
  }

  step(action, current) {
    const points = [new Float64Array(FACTS.errors), ...this.spread()].map((e) =>
      moved(this.state, e),
    );
    for (const point of points) advance(this.robot, point, action, current);
    const errors = points.slice(1).map((point) => errorOf(point, points[0]));
    const mean = meanOf(errors);
    this.state = moved(points[0], mean);
    const around = errors.map((row) => less(row, mean));
    this.covariance = withNoise(products(around, around), this.modelError);
  }

  // Carries the state on by a moment. Returns the squared error of what it predicts to observe, in
  // standard deviations.
  carry({ action, current, observed }) {
    this.step(action, current);
    const errors = this.spread();
    const seen = errors.map((error) => observe(moved(this.state, error)));
    this.expected = meanOf(seen);
    const around = seen.map((row) => less(row, this.expected));
    const lower = cholesky(withNoise(products(around, around), FACTS.noise));
    const innovation = forward(lower, less(observed, this.expected));
    const gains = products(errors, around).map((row) => forward(lower, row));
    const correction = gains.map((row) => dot(row, innovation));
    this.state = moved(this.state, correction);
    this.covariance = this.covariance.map((row, i) =>
      row.map((x, j) => x - dot(gains[i], gains[j]) + (i === j ? 1e-14 : 0)),
    );
    return dot(innovation, innovation);
  }
}

// Swims a state on, in place, and adds the squares of what was observed otherwise.
function follow(robot, state, squares, moments) {
  for (const { action, observed, current } of moments) {
    advance(robot, state, action, current);
    const errors = less(observe(state), observed);
    for (let i = 0; i < squares.length; i += 1) squares[i] += errors[i] * errors[i];
  }
}

// Returns the robot of faults with its cost: minus a log posterior, in which each channel's own
// error is profiled out.
function judge(one, faults, moments) {
  const robot = broken(one.robot, faults);
  const state = Float64Array.from(one.state);
  const squares = [...one.squares];
  follow(robot, state, squares, moments.slice(one.onset));
  const count = moments.length;
  const logs = FACTS.noise.map((sd, i) => Math.log(sd * sd + squares[i] / count));
  const cost = (count / 2) * sum(logs) + sum(faults.map(({ word }) => FACTS.costs[word]));
  return { cost: Number.isFinite(cost) ? cost : Infinity, squares, robot, faults, one };
}

// Returns faults with numbers about those given.
function near(faults, spacing) {
  let several = [[]];
  for (const fault of faults) {
    const range = FACTS.numberRanges[fault.word];
    const numbers = thresholds.STENCIL.map((k) => clip(fault.number + k * spacing, range));
    several = several.flatMap((some) =>
      [...new Set(numbers)].map((number) => [...some, { ...fault, number }]),
    );
  }
  return several;
}

// Returns what explains moments best, and the likeliest robots of other words with their weights.
//
// before: what it may have been, the present belief first. onsets: the number of moments, at any of
// which something may have broken. slack: a factor on how far off an explanation may be.
function recognise({ before, onsets, moments, slack }) {
  const sorted = (several) => several.sort((a, b) => a.cost - b.cost);
  const tried = (one, faults) => judge(one, faults, moments);
  const explains = ({ squares }) =>
    squares.every((x, i) => Math.sqrt(x / moments.length) <= slack * FACTS.tolerance[i]);
  const best = new Map(); // by the words of the faults, and what it was before
  const narrow = (several) => {
    let chosen = sorted(several).slice(0, thresholds.NARROWED_HYPOTHESES);
    let spacing = thresholds.FIRST_SPACING;
    for (let round = 0; round < thresholds.NARROWING_ROUNDS; round += 1) {
      chosen = chosen.map(
        ({ one, faults }) => sorted(near(faults, spacing).map((these) => tried(one, these)))[0],
      );
      for (const found of sorted(chosen)) {
        const names = found.faults.map(({ fin, word }) => `${fin}:${word}`);
        const words = [before.indexOf(found.one.robot), ...names].join("; ");
        if (!(best.get(words)?.cost <= found.cost)) best.set(words, found);
      }
      if (round > 0) chosen = chosen.slice(0, thresholds.LATE_HYPOTHESES);
      spacing /= thresholds.SPACING_RATIO;
    }
    return sorted([...best.values()]);
  };
  const cases = [];
  const state = Float64Array.from(moments[0].state);
  const squares = FACTS.noise.map(() => 0);
  for (let onset = 0; onset < onsets; onset += 1) {
    for (const robot of before) {
      cases.push({ robot, onset, state: Float64Array.from(state), squares: [...squares] });
    }
    follow(before[0], state, squares, [moments[onset]]);
  }
  let found = narrow(cases.flatMap((one) => FACTS.singles.map((faults) => tried(one, faults))));
  if (!explains(found[0])) {
    const single = found.filter(({ faults }) => faults.length);
    const firsts = single.slice(0, thresholds.LATE_HYPOTHESES);
    const pairs = firsts.flatMap(({ one, faults }) =>
      FACTS.singles.map((other) => tried(one, [...faults, ...other])),
    );
    found = narrow(pairs);
  }
  const likelihood = ({ cost }) => Math.exp(found[0].cost - cost);
  const total = sum(found.map(likelihood));
  const alternatives = found.map((one) => ({ robot: one.robot, weight: likelihood(one) / total }));
  const [{ robot, one }] = found;
  const model = new SelfModel(robot, one.state);
  model.modelError = thresholds.RECOGNISED_ERROR;
  for (const moment of moments.slice(one.onset)) model.carry(moment);
  return { explains: explains(found[0]), model, alternatives };
}

// Returns what a worker works out: what explains some moments, or how far each gait would swim from
// the state in which the robot will be some actions ahead.
function ponder(job) {
  if (job.moments) return recognise(job);
  const { robot, state, swimming, ahead, current } = job;
  for (let i = 0; i < ahead; i += 1) advance(robot, state, respond(swimming, state), current);
  return { far: imagine(robot, state, swimming, current) };
}

class Agent {
  // think(job, asked) lets a worker ponder a copy of a job, and sets asked.found to the result.
  constructor(finAngles, think) {
    this.think = think;
    this.model = new SelfModel(WHOLE, atRest(finAngles));
    this.swimming = begin(0);
    this.current = [0, 0, 0]; // of the water, which it knows
    this.steps = 0;
    this.events = [];
    this.alternatives = [{ robot: WHOLE, weight: 1 }];
    this.far = []; // how far each gait would swim
    this.ahead = 1; // actions after which that should be known
    // The last ones, all with the present belief: as many as without a compass, since a longer stretch
    // tells a seized fin from a weak one.
    this.moments = [];
    this.squares = [];
    this.slack = 1;
    this.alarm = -Infinity; // when the last case began
    this.explained = true; // the last alarm
    this.choose();
  }

  log(what) {
    this.events.push({ seconds: this.steps * FACTS.seconds, what });
  }

  // Returns the action for an observation.
  act(observed) {
    if (this.steps) {
      const moment = { action: this.action, current: this.current, observed };
      this.case?.moments.push(moment);
      this.asked?.since.push(moment);
      this.carry(moment);
    }
    if (this.asked?.found) this.take(this.asked);
    this.notice();
    const { due, found } = this.choice;
    if (found && this.steps === due) this.change(found.far);
    if ((found && this.steps > due) || this.steps >= due + FACTS.horizon) this.choose();
    this.action = respond(this.swimming, this.model.state);
    this.steps += 1;
    return this.action;
  }

  // Carries the model on by a moment.
  carry(moment) {
    const { model, moments, squares } = this;
    this.moments = [...moments, { ...moment, state: model.state }].slice(
      -thresholds.ACTIONS_BEFORE_GYRO_ALARM - 1,
    );
    this.squares = [...squares, model.carry(moment)].slice(-thresholds.WINDOWS.at(-1));
  }

  notice() {
    // What it has just found is not exact, as in foreign water: another break surprises it more.
    const isSettled = this.steps >= this.alarm + thresholds.SETTLED_CASE_ACTIONS;
    const least = isSettled ? 1 : thresholds.FOREIGN_SURPRISE_MARGIN;
    const surprises = ([window, most]) => sum(this.squares.slice(-window)) > least * most;
    if (FACTS.windows.some(surprises) && (isSettled || this.explained)) this.open();
    if (this.case && !this.asked && this.steps - this.alarm + 1 >= this.case.due[0]) {
      this.case.due = this.case.due.slice(1);
      this.asked = { since: [], found: null }; // what it has become, and the moments since then
      this.think(this.case, this.asked);
    }
  }

  // Opens the case of an alarm: what it may have been, and when that may have broken.
  open() {
    const { robot, modelError } = this.model;
    const before = robot === WHOLE ? [WHOLE] : [robot, WHOLE];
    const onsets = this.moments.length;
    // Where nothing explained the last alarm, the model's error is larger.
    const growth = this.explained ? 0 : thresholds.ERROR_GROWTH;
    this.slack = this.explained ? 1 : thresholds.ERROR_GROWTH * this.slack;
    this.model.modelError = thresholds.RECOGNISED_ERROR.map((sd, i) =>
      Math.min(FACTS.largestError[i], Math.max(growth * modelError[i], sd)),
    );
    this.case = {
      before,
      onsets,
      moments: [...this.moments],
      slack: this.slack,
      due: FACTS.inferences,
    };
    this.asked = null; // what it asked before is of another case
    this.alarm = this.steps;
    this.explained = false;
    this.log("noticed");
  }

  // Takes what it has become, which it asked some actions ago.
  take({ since, found }) {
    const { model, alternatives, explains } = found;
    const before = this.model.robot;
    this.asked = null;
    this.alternatives = alternatives;
    this.explained = explains;
    if (!this.case.due.length) this.case = null;
    this.log(explains ? "knew" : "unknown");
    if (!explains) return;
    if (!faultsOf(model.robot).length) model.robot = WHOLE;
    Object.assign(this.model, model);
    this.moments = [];
    this.squares = [];
    for (const moment of since) this.carry(moment);
    if (difference(model.robot, before) > thresholds.SAME_GAIT_DIFFERENCE) this.choose();
  }

  // Asks how far gaits would swim, from where it will be when that is known.
  choose() {
    const { choice, steps, swimming, current } = this;
    const late = choice?.found ? steps - choice.due : -1;
    this.ahead = Math.max(1, this.ahead + late);
    this.choice = { due: steps + this.ahead, found: null };
    const { robot, state } = this.model;
    this.think({ robot, state, swimming, current, ahead: this.ahead }, this.choice);
  }

  // Changes the gait, unless the present one would swim farther.
  change(far) {
    this.choice.found = null;
    this.far = far.slice(0, -1);
    const best = this.far.indexOf(Math.max(...this.far));
    const better = this.far[best] > far.at(-1);
    if (better) this.swimming = begin(best);
    else this.far[this.swimming.gait] = far.at(-1); // if it goes on
    this.log(better ? "changed" : "kept");
  }
}
