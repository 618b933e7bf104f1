// What the page says of a robot: the faults that make it of the whole one.

function faultsOf({ sizes, gain }) {
  const differs = (share) => Math.abs(share - 1) > thresholds.NUMBER_MARGIN;
  return FACTS.fins.flatMap((fin, i) => {
    const { length, width } = FACTS.columns[fin];
    const long = sizes[length] / WHOLE.sizes[length];
    const wide = sizes[width] / WHOLE.sizes[width];
    const weed = (sizes[width] - WHOLE.sizes[width]) / (FACTS.maxima[width] - WHOLE.sizes[width]);
    const speed = Math.abs(gain[i]);
    if (long === 0 && wide === 0) return [{ fin, word: "missing", number: 0 }];
    const words = [
      ["length", long, differs(long)],
      ["width", wide, wide < 1 && differs(wide)],
      ["entangled", weed, wide > 1 && differs(wide)],
      ["seized", 0, speed === 0],
      ["reversed", 0, gain[i] < 0],
      ["weak", speed, speed > 0 && differs(speed)],
    ];
    return words.filter((one) => one[2]).map(([word, number]) => ({ fin, word, number }));
  });
}

const wordsOf = (faults) => faults.map(({ fin, word }) => `${fin}:${word}`).join("; ");

// Returns faults as people say them: "my tail is seized and my left flipper is missing".
function sentenceOf(faults, { phrases, finWords }, whose) {
  const said = faults.map(({ fin, word, number }) => {
    const phrase = phrases[word].replace("#", `${Math.round(100 * number)}%`);
    return `${whose}${finWords[fin]} ${phrase}`;
  });
  return said.join(" and ") || (whose ? "I am whole" : "whole");
}
