"""What is known of a robot, however it came to be known, and what has changed since."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from scipy.stats import t as student

from cart import CART, PUSH, QUICK, SD, SOUGHT, measured, record, with_numbers
from eea import Hypothesis, Number, Robot, Trial
from eea.core.checks import ConfigurationError
from eea.infer.file import from_arrays, to_arrays
from eea.infer.known import Known

NOISE = dict(zip(CART.channels, SD, strict=True))
HEAVIER = Hypothesis("it is heavier", moves={"gain": Number(mean=0.0, sd=0.3, low=0.0)}, odds=0.1)
SENSOR_OFF = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=0.5)}, odds=0.1)
ROBOT = replace(SOUGHT, hypotheses=[HEAVIER])
BUILT = replace(SOUGHT, hypotheses=[HEAVIER, SENSOR_OFF])
EFFORT = replace(QUICK, bodies=2, poses=1, descents=1, alternatives="never")


def trial(seed, **values):
    return measured(np.random.default_rng(seed), **values)


def from_answer():
    return SOUGHT.infer([trial(seed) for seed in range(3)], config=QUICK, noise=NOISE).known(ROBOT)


def from_logs():
    return ROBOT.learn([trial(seed) for seed in range(20, 25)], config=EFFORT)


def from_statement():
    fixed = {"gain": Number(0.0, 2.0, healthy=1.0), "drag": Number(0.0, 2.0, healthy=1.0)}
    robot = replace(with_numbers(ROBOT, **fixed), hypotheses=[HEAVIER])
    return Known(robot, SOUGHT.infer([trial(0)], config=QUICK).noise)


@pytest.fixture(scope="module", params=[from_answer, from_logs, from_statement])
def known(request):
    return request.param()


def test_a_log_of_the_same_robot_is_the_same_and_of_another_is_not(known):
    for seed in range(3):
        verdict = known.test(trial(100 + seed))
        assert verdict.same
        assert 0.5 < verdict.excess < 2.0
    other = known.test(trial(200, gain=1.6))
    assert not other.same
    assert other.excess > 2.0 or other.p < 1e-6
    stopped = trial(201)
    stopped.signal[30:] = 0.0  # what no numbers explain
    look = known.test(stopped)
    assert not look.same
    assert look.excess > 2.0


def test_what_has_changed_since_is_inferred(known):
    found = known.infer([trial(300, gain=1.3)], config=QUICK)
    assert found.probability("it is heavier") > 0.99
    assert found.good, found.verdict
    _, low, high = found.broken("gain")
    assert low < 1.3 < high < low + 0.1
    same = known.infer([trial(301)], config=QUICK)
    assert same.probability("it is heavier") < 0.2
    lighter = known.infer([trial(302, gain=0.5)], config=QUICK)
    assert lighter.probability("it is heavier") < 0.01
    assert not lighter.good


def test_numbers_are_followed_from_what_is_known(known):
    if known.robot.healthy:  # numbers that are stated are not followed
        with pytest.raises(ConfigurationError, match="healthy must be left out"):
            known.follow()
        return
    follower = known.follow()
    before = follower.table()["gain"]
    for seed in range(4):
        assert not follower.update(trial(400 + seed)).alarm
    low, high = follower.table()["gain"][1:]
    assert low < 1.0 < high
    assert high - low < before[2] - before[1]
    follower.update(trial(500, gain=1.4))
    named = follower.update(trial(501, gain=1.4))
    assert named.alarm
    assert named.findings[0].startswith("it is heavier (")


def test_the_chance_is_uniform_where_the_robot_is_the_same():
    """Of an answer with its uncertainty: the noise is known, so the statistic is chi-square."""
    rng = np.random.default_rng(7)
    p = []
    for _ in range(30):
        known = SOUGHT.infer([measured(rng)], config=QUICK, noise=NOISE).known()
        p.append(known.test(measured(rng)).p)
    assert kstest(p, "uniform").pvalue > 0.01


@pytest.mark.slow
def test_noise_that_few_samples_told_raises_no_false_alarm():
    rng = np.random.default_rng(8)
    alarms = np.zeros(3)
    for _ in range(100):
        known = SOUGHT.infer([measured(rng)], config=QUICK).known()
        log = measured(rng)
        p = (
            known.test(log).p,
            known.follow().update(log).p,
            known.infer([log], config=QUICK).goodness.size_p,
        )
        alarms += np.array(p) < 0.01
    assert (alarms <= 3).all()  # by chi-square follow() and infer() raise it 5 times


def test_a_number_that_has_changed_stays_changed():
    broken = replace(CART, hypotheses=[HEAVIER])
    known = broken.infer([trial(8, gain=1.4)], config=QUICK, noise=NOISE).known()
    assert known.test(trial(9, gain=1.4)).same
    assert not known.test(trial(10)).same


DRIFTS = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=1.0)}, odds=0.1)
WIDER = replace(SOUGHT, hypotheses=[DRIFTS])  # its ranges have room for the change
WHOLE_BIAS = 0.12


def biased(seed):
    return trial(seed, bias=WHOLE_BIAS)


@pytest.mark.parametrize("robot", [SOUGHT, WIDER], ids=["before", "with the hypothesis"])
def test_what_is_known_is_the_same_number_in_a_wider_range(robot):
    """A prior is of shares of ranges, which hypotheses widen."""
    found = robot.infer([biased(20)], config=QUICK, noise=NOISE)
    middle, low, high = found.table()["bias"]
    known = found.known(WIDER)
    number = known.robot.table["bias"]
    i = known.robot.prior.names.index("bias")
    span = number.high - number.low
    assert number.low + span * known.robot.prior.mean[i] == pytest.approx(middle, abs=0.002)
    sd = span * known.robot.prior.covariance[i, i] ** 0.5
    assert 3.29 * sd == pytest.approx(high - low, rel=0.1)
    assert all(known.test(biased(seed)).same for seed in range(30, 34))
    assert known.infer([biased(40)], config=QUICK).probability("the sensor is off") < 0.1
    off = known.infer([measured(np.random.default_rng(41), bias=0.9)], config=QUICK)
    assert off.probability("the sensor is off") > 0.99


def test_numbers_are_followed_in_the_ranges_that_hypotheses_widen():
    follower = WIDER.follow(NOISE)
    for seed in range(3):
        assert not follower.update(biased(seed)).alarm
    low, high = follower.table()["bias"][1:]
    assert low < WHOLE_BIAS < high < low + 0.1


def test_what_a_hypothesis_fixes_stays_fixed_while_another_number_changes():
    """Of a number that was healthy, of a switch, and of one with a prior."""
    stuck = Hypothesis("it is stuck", fixed={"gain": 0.4, "valve": 0.0, "bias": 0.9}, odds=0.1)
    drags = Hypothesis("it drags", moves={"drag": Number(0.0, sd=0.5)}, odds=0.1)
    robot = Robot(
        lambda values, wave: (
            (values["gain"] * (1.0 + values["valve"]))[:, None] * wave
            + values["drag"][:, None] * np.cos(3.0 * wave)
            + values["bias"][:, None]
        )[:, :, None],
        {
            "gain": Number(0.0, 2.0, healthy=1.0),
            "drag": Number(0.0, 2.0, healthy=1.0),
            "valve": Number(0.0, 1.0, mean=1.0, switch=True),
            "bias": Number(0.0, sd=0.1),
        },
        {"force": "N"},
        hypotheses=[stuck, drags],
    )
    wave = np.sin(0.3 * np.arange(60))
    noise = np.random.default_rng(0).normal(0.0, 0.1, (2, 60))
    before, later = (
        Trial((0.4 * wave + drag * np.cos(3.0 * wave) + 0.9 + one)[:, None], wave)
        for drag, one in zip((1.0, 1.6), noise, strict=True)
    )
    found = robot.infer([before], noise={"force": 0.1})
    assert found.probability("it is stuck") > 0.99
    again = found.known().infer([later])
    assert again.good
    assert again.probability("it drags") > 0.99
    assert again.broken("drag")[0] == pytest.approx(1.6, abs=0.1)


def test_a_switch_that_has_moved_is_followed_from_there():
    robot = Robot(
        lambda values, wave: (
            values["gain"][:, None] * wave + values["valve"][:, None] * np.cos(3.0 * wave)
        )[:, :, None],
        {"gain": Number(0.0, 2.0), "valve": Number(0.0, 1.0, mean=1.0, switch=True)},
        {"force": "N"},
        hypotheses=[Hypothesis("the valve is half open", moves={"valve": Number(0.0)}, odds=0.1)],
    )
    wave = np.sin(0.3 * np.arange(60))
    rng = np.random.default_rng(0)

    def felt():
        signal = 0.7 * wave + 0.5 * np.cos(3.0 * wave) + rng.normal(0.0, 0.1, 60)
        return Trial(signal[:, None], wave)

    follower = robot.infer([felt()], noise={"force": 0.1}).known().follow()
    for _ in range(3):
        followed = follower.update(felt())
        assert not followed.alarm
    assert followed.table["valve"][0] == pytest.approx(0.5, abs=0.05)


def test_an_answer_that_no_robot_explains_or_two_explain_is_not_known():
    bad = SOUGHT.infer([measured(np.random.default_rng(0), sd=(0.0, 0.0)),
                        measured(np.random.default_rng(0), sd=(0.0, 0.0), gain=1.7)],
                       config=QUICK, noise=NOISE)  # fmt: skip
    with pytest.raises(ConfigurationError, match="an answer must be good to be known"):
        bad.known()
    times = 0.1 * np.arange(1.0, 61.0)
    wave = Robot(
        lambda values, times: np.sin(values["g"][:, None] ** 2 * times)[:, :, None],
        {"g": Number(-2.0, 2.0)},
        {"signal": "V"},
    )
    signal = np.sin(1.14**2 * times) + np.random.default_rng(0).normal(0.0, 0.1, 60)
    found = wave.infer([Trial(signal[:, None], times)])
    with pytest.raises(ConfigurationError, match="must be one to be known; got: two values of g"):
        found.known()
    followed = wave.follow({"signal": 0.1}).update(Trial(signal[:, None], times))
    assert any("two values of g" in said for said in followed.findings)
    low, high = followed.table["g"][1:]
    assert low < -1.5 < 1.5 < high  # not one of the two


def test_hypotheses_that_explain_alike_leave_a_number_open():
    times = 0.05 * np.arange(200)

    def wave(values, _):
        return ((values["a"] + values["b"])[:, None] * np.sin(times))[:, :, None]

    changed = [Hypothesis(f"{name} is off", moves={name: Number(0.0)}) for name in "ab"]
    numbers = {name: Number(0.0, 3.0, healthy=1.0) for name in "ab"}
    robot = Robot(wave, numbers, {"signal": "V"}, hypotheses=changed)
    noise = np.random.default_rng(6).normal(0.0, 0.05, 200)
    found = robot.infer([Trial((2.7 * np.sin(times) + noise)[:, None])])
    for _, low, high in found.table().values():
        assert low == pytest.approx(1.0, abs=0.05)
        assert high == pytest.approx(1.7, abs=0.05)
    alone = found.table(hypothesis="a is off")
    assert alone["b"] == pytest.approx((1.0, 1.0, 1.0), abs=1e-4)
    assert alone["a"][2] - alone["a"][1] < 0.05
    with pytest.raises(ConfigurationError, match="two hypotheses explain the log, with other"):
        found.known()


WITHOUT_BIAS = {name: SOUGHT.table[name] for name in ("gain", "drag")}


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (
            replace(CART, channels={"force": "N", "rate": "rad/s"}),
            "channels of robot must be those",
        ),
        (replace(SOUGHT, numbers=WITHOUT_BIAS), "numbers of robot must be those"),
        (CART, "gain of robot must be such as"),  # which takes it to be healthy
        (with_numbers(SOUGHT, drag=Number(1.5, 3.0)), "range of drag must hold 1, which is known"),
    ],
)
def test_another_robot_is_not_known(robot, said):
    found = SOUGHT.infer([trial(0, sd=(1e-3, 1.0))], config=QUICK)
    with pytest.raises(ConfigurationError, match=said):
        found.known(robot)


def test_what_a_log_adds_nothing_to_is_not_called_unmeasured():
    """A log that tells less than what is known leaves it as well known as before."""
    known = SOUGHT.infer([trial(seed) for seed in range(3)], config=QUICK, noise=NOISE).known()
    found = known.infer([trial(3)], config=QUICK)
    assert found.good
    (said,) = [words for words in found.findings if words.startswith("hardly better known than")]
    assert "gain" in said
    assert not any("not measured" in words for words in found.findings)


def test_a_later_log_is_read_as_the_known_good_ones_were():
    rng = np.random.default_rng(11)

    def held():
        signal = np.array(measured(rng).signal)
        signal[:, 1] = np.repeat(signal[::3, 1], 3)
        return Trial(signal, PUSH)

    known = ROBOT.learn([held() for _ in range(4)], config=EFFORT)
    found = known.infer([held()], config=QUICK)
    assert found.good, found.verdict
    said = "force repeats the reading before in 40 of 60 rows: they are left out"
    assert said in found.findings


SESSIONS, LOGS = 4, 2
BETWEEN, WITHIN = 0.05, 0.02  # sd of the gain, in its unit


def known_good(rng, sessions=SESSIONS, logs=LOGS):
    """Return logs and their sessions' labels; the gains' sample variances are as they should be."""
    builds = rng.normal(size=sessions)
    builds = (builds - builds.mean()) / builds.std(ddof=1)
    builds *= np.hypot(BETWEEN, WITHIN / logs**0.5)
    apart = np.linspace(-1.0, 1.0, logs) * WITHIN * (1.0 - 1.0 / logs) ** 0.5 if logs > 1 else [0.0]
    trials = [
        measured(rng, gain=1.0 + build + own, bias=0.02 * rng.normal())
        for build in builds
        for own in apart
    ]
    return trials, [f"build {session}" for session in range(sessions) for _ in range(logs)]


def spread_of(reference, name="gain"):
    """Return the sd that a reference gives a number, in its unit."""
    prior = reference.robot.prior
    number = reference.robot.table[name]
    i = prior.names.index(name)
    return (number.high - number.low) * prior.covariance[i, i] ** 0.5


@pytest.fixture(scope="module")
def reference():
    return BUILT.learn(*known_good(np.random.default_rng(0)), config=EFFORT)


def widening(freedom):
    return student.ppf(0.95, freedom) / student.ppf(0.95, 1e9)


def test_the_spread_of_a_new_session_is_found_and_widened_by_students_t(reference):
    new = np.hypot((1.0 + 1.0 / SESSIONS) ** 0.5 * BETWEEN, WITHIN)
    assert spread_of(reference) == pytest.approx(widening(SESSIONS - 1) * new, rel=0.15)


def test_the_spread_of_logs_of_one_session_is_that_within():
    logs = [measured(np.random.default_rng(i), gain=1.0 + WITHIN * (-1) ** i) for i in range(6)]
    expected = widening(5) * (1.0 + 1.0 / 6) ** 0.5 * WITHIN * (6 / 5) ** 0.5
    assert spread_of(BUILT.learn(logs, config=EFFORT)) == pytest.approx(expected, rel=0.3)


def test_sessions_of_one_log_are_as_wide_as_logs_of_one_session_and_few_are_wider(reference):
    trials, _ = known_good(np.random.default_rng(2), sessions=3, logs=1)
    one, each = (
        spread_of(BUILT.learn(trials, labels, config=EFFORT)) for labels in (None, range(3))
    )
    assert one == pytest.approx(each, rel=0.1)
    few = BUILT.learn(*known_good(np.random.default_rng(3), sessions=2), config=EFFORT)
    assert spread_of(few) > 1.2 * spread_of(reference)


def test_later_logs_of_an_ongoing_session_are_judged_by_that_session():
    rng = np.random.default_rng(8)
    trials, labels = known_good(rng)
    columns = np.column_stack([PUSH, np.ones_like(PUSH)])
    gains = np.linalg.lstsq(columns, np.transpose([t.signal[:, 0] for t in trials]))[0][0]
    means = gains.reshape(SESSIONS, LOGS).mean(axis=1)
    label = f"build {means.argmax()}"
    ongoing = BUILT.learn(trials, labels, config=EFFORT, ongoing=label)
    assert ongoing.robot.usual["gain"] == pytest.approx(means.max(), abs=0.01)
    within = widening(SESSIONS * (LOGS - 1)) * (1.0 + 1.0 / LOGS) ** 0.5 * WITHIN
    assert spread_of(ongoing) == pytest.approx(within, rel=0.25)


ONE_ROW = Trial([[1.0, 1.0]], PUSH[:1])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"known_good": [ONE_ROW] * 2, "sessions": None}, "known_good must have more samples"),
        ({"sessions": ["a"]}, "sessions must be one label for each of 4 logs, such as"),
        ({"sessions": {"log 1": "a", "log 2": "a"}}, "sessions must be one label for each"),
        ({"sessions": ["a", None, "b", "b"]}, "sessions must be one label for each"),
        ({"sessions": np.ones((4, 2))}, "sessions must be one label for each"),
        ({"ongoing": "build 7"}, "ongoing must be one of the labels"),
        ({"sessions": None, "ongoing": "build 0"}, "ongoing must be one of the labels"),
        ({"sessions": range(4), "ongoing": 0}, "ongoing needs a session of two logs"),
    ],
)
def test_logs_and_sessions_that_do_not_fit_together_are_refused(change, said):
    trials, labels = known_good(np.random.default_rng(9), sessions=2)
    given = {"known_good": trials, "sessions": labels, "config": EFFORT, **change}
    with pytest.raises(ConfigurationError, match=said):
        BUILT.learn(**given)


def test_a_log_of_fewer_samples_than_numbers_is_judged(reference):
    start = measured(np.random.default_rng(10))
    short = Trial(start.signal[:1], start.inputs)
    found = reference.infer([short], config=QUICK)
    assert found.probability("nothing is broken") > 0.5
    with pytest.raises(ConfigurationError, match="more samples than"):
        BUILT.infer([short], config=QUICK)


def test_noise_and_what_is_known_are_learned(reference):
    np.testing.assert_allclose(reference.noise.sd, SD, rtol=0.1)
    assert np.abs(reference.noise.correlation).max() == 0.0
    assert reference.robot.usual["gain"] == pytest.approx(1.0, abs=0.06)
    assert reference.misfits.mean() == pytest.approx(1.0, abs=0.1)


def test_watch_raises_false_alarms_at_its_rate(reference):
    rng = np.random.default_rng(4)
    logs = [trial for trial, _ in zip(*known_good(rng, 40, 1), strict=True)]
    p = np.array([reference.test(log).p for log in logs])
    assert (p < 0.1).mean() <= 0.2
    assert (p < 1e-3).sum() == 0
    assert (p > 0.5).sum() >= 8


def test_a_change_of_another_number_is_named_and_one_within_the_spread_is_not(reference):
    off = reference.infer([trial(6, bias=0.4)], config=QUICK)
    assert off.findings[0].startswith("the sensor is off (100%): bias 0.")
    lighter = reference.infer([trial(6, gain=0.5)], config=QUICK)
    assert "sd from those of known-good logs" in lighter.verdict
    found = reference.infer([trial(7, gain=1.04)], config=QUICK)
    assert found.probability("nothing is broken") > 0.8
    shown = found.findings[-1].removeprefix("a change of gain by less than ").split()
    assert float(shown[0]) > 2.0 * spread_of(reference)


def test_a_log_is_judged_by_how_well_known_good_ones_are_explained():
    """A simulator that is a little wrong is so in known-good logs, too."""
    rng = np.random.default_rng(8)
    bend = np.where(np.arange(60) % 20 < 4, 0.6, 1.0)[:, None]

    def bent(trial):
        return Trial(trial.signal * bend, trial.inputs)

    reference = BUILT.learn([bent(one) for one in known_good(rng, 4, 1)[0]], config=EFFORT)
    assert reference.test(bent(measured(rng))).same
    assert not SOUGHT.infer([bent(measured(rng))], config=QUICK, noise=NOISE).good


STATED = with_numbers(
    BUILT, gain=Number(0.0, 2.0, healthy=0.8, unit="m"), drag=Number(0.0, 2.0, healthy=1.0)
)


def test_the_answer_says_that_known_good_logs_contradict_whole():
    trials, labels = known_good(np.random.default_rng(11), sessions=3)
    reference = STATED.learn(trials, labels, config=EFFORT)
    (said,) = reference.findings
    assert said.startswith("the known-good logs contradict healthy: gain is 0.99")
    assert said.endswith(", and not 0.8")
    answer = reference.infer(trials[:1], config=QUICK)
    assert answer.findings[-1] == said
    assert from_arrays(to_arrays(answer)).findings == answer.findings


def test_whole_that_agrees_with_the_logs_is_not_contradicted():
    """Also where it is at the end of a range."""
    rng = np.random.default_rng(13)
    ends = {"gain": Number(1.0, 2.0, healthy=1.0), "drag": Number(0.0, 1.0, healthy=1.0)}
    for robot, count in ((CART, 4), (with_numbers(CART, **ends), 4)):
        logs = [measured(rng, bias=0.02 * rng.normal()) for _ in range(count)]
        assert robot.learn(logs, config=EFFORT).findings == ()


def test_known_good_logs_without_noise_are_said_to_have_none(reference):
    logs = [trial(11, sd=0.0, gain=1.0 + 0.02 * i) for i in range(3)]
    found = BUILT.learn(logs, config=EFFORT).findings
    assert any("is only rounding: by it any noise in a log counts as a change" in s for s in found)
    assert not any("rounding" in said for said in reference.findings)


def pendulum(values, torque):
    """Return the gyroscopes (B, T, 1) of pendulums that torques (B, T) drive from rest."""
    angle = values["angle"].copy()
    rate = np.zeros(len(torque))
    gyro = np.empty((*torque.shape, 1))
    for step, push in enumerate(torque.T):
        rate += 0.01 * (values["motor"] * push - 9.81 / values["length"] * np.sin(angle))
        angle += 0.01 * rate
        gyro[:, step, 0] = rate + values["bias"]
    return gyro


@pytest.mark.slow
def test_a_search_that_ends_elsewhere_does_not_pass_for_a_spread():
    """From near the top a pendulum has many valleys: one log in eight ended in a wrong one."""
    robot = Robot(
        pendulum,
        {
            "length": Number(0.2, 2.0),
            "motor": Number(0.0, 2.0),
            "bias": Number(0.0, sd=0.03),
            "angle": Number.angle(),
        },
        {"gyro": "rad/s"},
    )
    rng = np.random.default_rng(1)

    def swung(samples=150, motor=1.0):
        values = {"length": 0.63, "motor": motor, "bias": 0.02, "angle": rng.uniform(-3, 3)}
        torque = 6.0 * np.sign(np.sin(0.05 * np.arange(samples)))
        log = record(pendulum, values, torque, 0.05, rng)
        log.signal[rng.random(samples) < 0.1] = np.nan
        return log

    for samples in (150, 100):  # the next log but one begins at 2.8 rad
        swung(samples)
    known_good = [swung(motor=motor) for motor in rng.normal(1.0, 0.03, 4).repeat(2)]
    reference = robot.learn(known_good, sessions=[1, 1, 2, 2, 3, 3, 4, 4])
    assert reference.misfits.max() < 1.5
    prior = reference.robot.prior
    assert prior.names == ("length", "motor", "bias")
    assert (np.sqrt(np.diag(prior.covariance)) < [0.01, 0.03, 0.03]).all()


def test_a_later_log_may_begin_elsewhere_than_the_known_good_ones():
    """All logs began at rest: that is no knowledge of the robot."""

    def glide(values, push):
        time = 0.05 * np.arange(push.shape[1])
        speed = values["speed at first"][:, None] * np.exp(-values["drag"][:, None] * time)
        return (speed + values["gain"][:, None] * push)[:, :, None]

    robot = Robot(
        glide,
        {
            "drag": Number(0.5, 2.0),
            "gain": Number(0.0, 2.0),
            "speed at first": Number(0.0, sd=1.0, varies=True),
        },
        {"speed": "m/s"},
        hypotheses=[Hypothesis("it is weak", moves={"gain": Number(mean=0, sd=0.3, high=0)})],
    )
    rng = np.random.default_rng(0)

    def log(speed, gain=1.0):
        values = {"drag": 1.0, "gain": gain, "speed at first": speed}
        return record(glide, values, PUSH, 0.05, rng)

    reference = robot.learn([log(0.3), *(log(0.0) for _ in range(3))], config=EFFORT)
    assert reference.robot.prior.names == ("drag", "gain")
    for speed in (1.5, -1.0):
        assert reference.test(log(speed)).same
        found = reference.infer([log(speed)], config=QUICK)
        assert found.branches[0].hypothesis.name == "nothing is broken"
        assert found.good
        _, low, high = found.table(0.99)["speed at first@1"]
        assert low < speed < high
    assert not reference.test(log(1.5, gain=0.7)).same


COUNT = np.arange(80)


def test_known_good_logs_that_two_answers_explain_alike_are_refused():
    def alias(values, _):  # four samples a turn: 1 turn more is the same signal
        turns = 0.25 * COUNT * values["speed"][:, None]
        return np.sin(2.0 * np.pi * turns)[:, :, None]

    wheel = Robot(alias, {"speed": Number(0.1, 7.9, unit="Hz")}, {"side": "m"})
    rng = np.random.default_rng(0)
    side = np.sin(2.0 * np.pi * 0.25 * 2.7 * COUNT)[:, None]
    logs = [Trial(side + rng.normal(0.0, 0.1, side.shape)) for _ in range(2)]
    with pytest.raises(ConfigurationError, match=r"one answer; .*: 2\.7 Hz and 6\.7 Hz"):
        wheel.learn(logs)


@pytest.mark.parametrize("gain", [1.3, 0.5])
def test_known_good_logs_beyond_a_range_are_said_to_be(gain):
    wave = np.sin(0.1 * COUNT)[:, None]
    robot = Robot(
        lambda values, _: values["gain"][:, None, None] * wave,
        {"gain": Number(0.0, 1.0)},
        {"side": "m"},
    )
    rng = np.random.default_rng(0)
    logs = [Trial(gain * wave + rng.normal(0.0, 0.3, wave.shape)) for _ in range(4)]
    said = robot.learn(logs, config=EFFORT).findings
    at_end = "gain is at the end of its range, 1, and may be beyond it"
    assert said == ((at_end,) if gain > 1.0 else ())


def line(values, inputs):
    return (values["gain"][:, None] * inputs[:, :, 0] + values["bias"][:, None])[:, :, None]


LINE = Robot(
    line,
    {"gain": Number(0.0, 10.0), "bias": Number(0.0, sd=0.5)},
    {"y": "m"},
    [
        Hypothesis("it is weak", moves={"gain": Number(mean=0.0, sd=2.0, high=0.0)}, odds=0.1),
        Hypothesis("it is shifted", moves={"bias": Number(mean=0.0, sd=2.0)}, odds=0.1),
    ],
)


def of_line(rng, gain, bias=0.0):
    """Return a log of the line with a gain, which differs by 0.1 from log to log."""
    inputs = rng.uniform(0.0, 1.0, (20, 1)).repeat(10, axis=0)
    signal = rng.normal(gain, 0.1) * inputs + bias + rng.normal(0.0, 0.03, (200, 1))
    return Trial(signal, inputs)


@pytest.mark.parametrize("gain", [5.0, 4.0])
def test_what_was_learned_holds_on_after_an_answer(gain):
    """Logs after it vary as the known-good ones did, and are judged by these; so after a file."""
    rng = np.random.default_rng(7)
    learned = LINE.learn([of_line(rng, 5.0) for _ in range(8)])
    answer = learned.infer([of_line(rng, gain)])
    known = answer.known()
    np.testing.assert_array_equal(known.misfits, learned.misfits)
    assert known.findings == learned.findings
    assert all(known.test(of_line(rng, gain)).same for _ in range(10))
    same = known.infer([of_line(rng, gain)])
    assert same.findings[0].startswith("nothing is broken")
    again = same.known()
    widths = [one.robot.prior.covariance[0, 0] for one in (learned, known, again)]
    assert 1.5 < widths[1] / widths[0] < 3.5
    assert widths[2] == pytest.approx(widths[1], rel=0.5)
    assert not known.test(of_line(rng, gain - 1.5)).same
    assert known.infer([of_line(rng, gain - 1.5)]).findings[0].startswith("it is weak")
    read = from_arrays(to_arrays(answer)).known(LINE)
    np.testing.assert_allclose(read.robot.prior.covariance, known.robot.prior.covariance)
    log = of_line(rng, gain)
    assert read.test(log) == known.test(log)


def test_groups_that_were_not_learned_are_not_told_by_a_later_log():
    rng = np.random.default_rng(8)
    shifted = of_line(rng, 5.0, bias=0.8)
    alone = replace(EFFORT, nuisances=())
    learned = LINE.learn([of_line(rng, 5.0) for _ in range(6)], config=alone)
    assert learned.groups == frozenset()
    assert learned.test(of_line(rng, 5.0)).same
    assert not learned.test(shifted).same
    plain = replace(LINE, hypotheses=())
    good = Trial(5.0 * shifted.inputs + rng.normal(0.0, 0.03, (200, 1)), shifted.inputs)
    known = plain.infer([good], config=alone).known()
    assert not known.test(shifted).same
    follower = known.follow()
    assert follower.update(shifted).alarm
    assert list(follower.table()) == ["gain"]
