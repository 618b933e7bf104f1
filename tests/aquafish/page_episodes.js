// Swims episodes of the page's program, which comes before this text, in node. Each is given in the
// variable GIVEN as { finAngles, breaks, actions, seed }, and what happened is printed. A break is
// { faults, at }: the faults of the fish from an action on.

// Returns a function that draws from a normal distribution: mulberry32 and Box and Muller.
function normalOf(seed) {
  let state = seed;
  const uniform = () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
  return () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
}

function swim({ finAngles, breaks, actions, seed }) {
  const normal = normalOf(seed);
  const answers = []; // what it works out can be used one action later, and what it is two later
  let now = 0;
  const agent = new Agent(finAngles, (job, asked) => {
    const found = ponder(structuredClone(job));
    answers.push({ due: now + (job.before ? 2 : 1), use: () => Object.assign(asked, { found }) });
  });
  const state = atRest(finAngles);
  const left = [...breaks];
  const happened = [];
  let robot = WHOLE;
  for (now = 0; now < actions; now += 1) {
    if (left[0]?.at === now) {
      const { faults } = left.shift();
      robot = broken(WHOLE, faults);
      happened.push({ truth: wordsOf(faults), at: now, knew: null, start: state[FACTS.northing] });
    }
    while (answers[0]?.due <= now) answers.shift().use();
    const action = agent.act(
      observe(state).map((x, i) => (i < 6 ? x : x + FACTS.gyroNoise * normal())),
    );
    advance(robot, state, action, [0, 0, 0]);
    const last = happened.at(-1);
    if (!last) continue;
    last.words = wordsOf(faultsOf(agent.model.robot));
    if (last.words === last.truth) last.knew ??= (now - last.at) * FACTS.seconds;
    last.way = state[FACTS.northing] - last.start;
  }
  return { happened, events: agent.events };
}

const episodes = JSON.parse(process.env.GIVEN);
process.stdout.write(JSON.stringify(episodes.map(swim)));
