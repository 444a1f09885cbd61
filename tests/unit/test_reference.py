"""The reference against itself: the corner, the motion laws, peaks and golden files."""

import csv
from functools import cache
from itertools import pairwise

import pytest
from reference import golden
from reference.corner import Corner, corner_with_deviation
from reference.delta import Robot
from reference.paper_law import corner_leg
from reference.peaks import peaks
from reference.polynomial import evaluate
from reference.ppo import Plan
from reference.precision import Number, agree, mp
from reference.superposition import overlap_with_deviation
from reference.taylor import Taylor

CASES = golden.load("cases.toml")
LAW_CASES = [name for name, case in CASES["case"].items() if case["law"] == "paper"]
ROBOT: Robot = golden.robot(CASES)


@cache
def plan(name: str) -> Plan:
    return golden.plan(CASES["case"][name])


@cache
def corner() -> Corner:
    return corner_with_deviation(mp.mpf("0.006"))


def rounds_to(value: Number, text: str) -> bool:
    """Whether the value agrees with a printed decimal to half a unit of its last place."""
    places = len(text.partition(".")[2])
    return bool(abs(mp.mpf(value) - mp.mpf(text)) <= mp.mpf("0.5001") * mp.mpf(10) ** -places)


def position_at(ppo: Plan, time: Number) -> list[Number]:
    index, parameter = ppo.locate(time)
    return [s.coefficients[0] for s in ppo.phases[index].position(parameter, 0)]


# Taylor arithmetic


def test_taylor_arithmetic_agrees_with_numerical_derivatives() -> None:
    def function(x: Number) -> Number:
        return mp.sin(x * x) / mp.sqrt(2 + mp.cos(x)) - 3 / x

    x = Taylor([mp.mpf("0.7"), mp.mpf(1), mp.mpf(0), mp.mpf(0), mp.mpf(0)])
    series = (x * x).sine_cosine()[0] / (2 + x.sine_cosine()[1]).sqrt() - Taylor.constant(mp.mpf(3), 4) / x
    for n in range(5):
        assert agree(series.derivative(n), mp.diff(function, mp.mpf("0.7"), n), 30)


# Corner


def test_corner_leg_is_the_papers_constant_times_the_deviation() -> None:
    assert agree(corner().leg / mp.mpf("0.006"), 16 * (45 - mp.sqrt(2)) / 119)


def test_corner_ends_on_both_legs_with_the_papers_preimage() -> None:
    m = corner().leg
    assert agree(evaluate(corner().x, mp.mpf(1)), m)
    assert agree(evaluate(corner().y, mp.mpf(1)), m)
    u0, u2, v2 = corner().preimage  # eq. 12
    assert agree(u0**2, 5 * (18 - 3 * mp.sqrt(2)) * m / 17)
    assert agree(u2**2, u0**2 / 2)
    assert agree(v2, u2)


@pytest.mark.parametrize("gamma", ["0", "0.13", "0.5", "0.77", "1"])
def test_corner_is_the_papers_polynomial_and_symmetric(gamma: str) -> None:
    g, m = mp.mpf(gamma), corner().leg
    u0, u2, v2 = corner().preimage
    x = 2 * (u0 * v2 + u2 * v2) * g**5 / 5 - u0 * v2 * g**4 + 2 * u0 * v2 * g**3 / 3  # eq. 3
    assert agree(evaluate(corner().x, g), x)
    assert agree(evaluate(corner().y, g), m - evaluate(corner().x, 1 - g))
    assert agree(evaluate(corner().y, g), mp.quad(lambda t: evaluate(corner().hodograph_y, t), [0, g]))
    s = g * (1 - g)
    assert agree(corner().parametric_speed(g), 2 * u2**2 * (1 - 4 * s + (2 + mp.sqrt(2)) * s**2))  # eq. 18


def test_corner_deviation_is_the_smallest_distance() -> None:
    def distance(gamma: Number) -> Number:
        return mp.hypot(evaluate(corner().x, gamma), evaluate(corner().y, gamma) - corner().leg)

    assert agree(corner().nearest_parameter(), "0.5")
    assert agree(corner().deviation(), "0.006")
    assert min(distance(mp.mpf(n) / 200) for n in range(201)) >= corner().deviation() - mp.mpf("1e-45")


def test_corner_radius_and_length() -> None:
    def turning(gamma: Number) -> Number:
        return mp.atan2(evaluate(corner().hodograph_x, gamma), evaluate(corner().hodograph_y, gamma))

    half = mp.mpf("0.5")
    assert rounds_to(1000 * corner().parametric_speed(half) / mp.diff(turning, half), "9.16181927")
    assert rounds_to(1000 * corner().arc_length(mp.mpf(1)), "63.61642840")


# The paper's law


def test_headline_numbers_of_the_paper() -> None:
    ppo = plan("paper")
    milliseconds = {name: 1000 * duration for name, duration in ppo.durations.items()}
    assert rounds_to(milliseconds["lift"], "24.73059527")
    assert rounds_to(milliseconds["pick_corner"], "61.43008924")
    assert rounds_to(milliseconds["accelerate"], "65.18797620")
    assert rounds_to(1000 * ppo.nominal_duration, "302.69732142")
    assert rounds_to(1000 * ppo.lengths["corner_leg_pick"], "35.16164284")
    assert rounds_to(1000 * ppo.lengths["lift_length"], "14.83835716")
    assert agree(ppo.aligned_duration, "0.303")


@pytest.mark.parametrize(
    ("v_n", "duration"),
    [
        ("1.2", "0.0530136903369875963"),
        ("1.1999999999", "0.0530136903385970767"),
        ("1.199999", "0.0530137064318001102"),
        ("1.19", "0.0531755476064085794"),
        ("1.1", "0.0547198939003464078"),
        ("1.0", "0.0566493922063718997"),
        ("0.8", "0.0614300892421386911"),
        ("0.4", "0.0790502587925316096"),
        ("0.1", "0.133172801393772253"),
        ("0.01", "0.348746937329592965"),
        ("0.0001", "3.12180991386564963"),
        ("1.3", "0.0514889806055029687"),
        ("1.6", "0.0477236648213899679"),
        ("2.4", "0.0410908790310192197"),
    ],
)
def test_corner_duration_agrees_with_the_table_and_the_closed_form(v_n: str, duration: str) -> None:
    v_b, v_mid = mp.mpf("1.2"), mp.mpf(v_n)
    leg = corner_leg(corner(), mp.mpf(0), v_b, v_mid)
    assert abs(leg.duration - mp.mpf(duration)) < mp.mpf("6e-18") * max(1, leg.duration)
    if v_mid == v_b:
        assert agree(leg.duration, corner().arc_length(mp.mpf(1)) / v_b)
        return
    # Eq. 28 with varsigma where zeta is printed; complex square roots carry it beyond V_B.
    alpha, beta = mp.sqrt(v_b), mp.sqrt(v_b - v_mid)
    ratio = alpha / beta
    delta, eta = mp.sqrt(ratio + 1), mp.sqrt(ratio - 1)
    chi, root = (v_b - v_mid) / alpha, 4 * mp.sqrt(2) - 8
    xi, epsilon = root * (chi + beta) - alpha / 2, root * (chi - beta) - alpha / 2
    scale = 15 * corner().leg / (8 * (5 - 2 * mp.sqrt(2)) * (v_mid - v_b))
    logarithm = mp.log((ratio + 2 * (delta + 1)) / (ratio - 2 * (delta - 1)))
    total = scale * (1 + xi * logarithm / (4 * beta * delta) + epsilon * mp.atan(1 / eta) / (beta * eta))
    assert agree(leg.duration, mp.re(total), 35)


@pytest.mark.parametrize("name", LAW_CASES)
def test_phases_join_with_continuous_acceleration_at_the_laws_speeds(name: str) -> None:
    ppo, case = plan(name), CASES["case"][name]
    first, last = ppo.phases[0].position(mp.mpf(0), 2), ppo.phases[-1].position(mp.mpf(1), 2)
    for ends, point in ((first, case["pick"]), (last, case["place"])):
        for s, value in zip(ends, point, strict=True):
            assert agree(s.coefficients[0], value)
            assert agree(s.derivative(1), 0)
            assert agree(s.derivative(2), 0)
    v_b, v_max = case["corner_entry_speed"], case["traverse_speed"]
    for (before, after), speed in zip(pairwise(ppo.phases), (v_b, v_b, v_max, v_b, v_b), strict=True):
        ended, begun = before.position(mp.mpf(1), 2), after.position(mp.mpf(0), 2)
        assert agree(mp.norm([s.derivative(1) for s in begun]), speed, 35)
        for order in range(3):
            for a, b in zip(ended, begun, strict=True):
                assert agree(a.derivative(order), b.derivative(order), 35)


@pytest.mark.parametrize(("name", "time"), [("paper", "0.05"), ("unequal", "0.27"), ("comparison", "0.06")])
def test_motion_series_is_the_derivative_of_position_over_aligned_time(name: str, time: str) -> None:
    ppo, t = plan(name), mp.mpf(time)
    index, parameter = ppo.locate(t)
    series = [s.at_rate(ppo.speed_factor) for s in ppo.phases[index].position(parameter, 3)]
    # Central differences; error of order step^2 times a derivative of at most 1e9.
    step = mp.mpf("1e-11")
    samples = [position_at(ppo, t + n * step) for n in (-2, -1, 0, 1, 2)]
    for axis, s in enumerate(series):
        a, b, c, d, e = (sample[axis] for sample in samples)
        assert agree(c, s.coefficients[0])
        assert agree((d - b) / (2 * step), s.derivative(1), 14)
        assert agree((b - 2 * c + d) / step**2, s.derivative(2), 11)
        assert agree((e - 2 * d + 2 * b - a) / (2 * step**3), s.derivative(3), 7)


@pytest.mark.parametrize("name", ["paper", "comparison", "oblique"])
def test_ppo_is_symmetric_in_time(name: str) -> None:
    ppo, case = plan(name), CASES["case"][name]
    for time in (mp.mpf("0.013"), mp.mpf("0.059"), mp.mpf("0.121")):
        there = position_at(ppo, time)
        back = position_at(ppo, ppo.aligned_duration - time)
        for a, b, pick, place in zip(there[:2], back[:2], case["pick"], case["place"], strict=False):
            assert agree(a + b, pick + place)
        assert agree(there[2], back[2])


def test_swapped_task_runs_the_unequal_ppo_backwards() -> None:
    case = CASES["case"]["unequal"]
    swapped = dict(case)
    for key in ("pick", "lift_pick", "corner_deviation_pick"):
        other = key.replace("pick", "place")
        swapped[key], swapped[other] = case[other], case[key]
    ppo, mirror = plan("unequal"), golden.plan(swapped)
    for time in (mp.mpf("0.03"), mp.mpf("0.1"), mp.mpf("0.16"), mp.mpf("0.28"), mp.mpf("0.33")):
        pairs = zip(position_at(ppo, time), position_at(mirror, ppo.aligned_duration - time), strict=True)
        assert all(agree(a, b) for a, b in pairs)


@pytest.mark.parametrize("name", ["paper", "unequal", "comparison"])
def test_arc_length_grows_with_the_speed(name: str) -> None:
    ppo, step = plan(name), mp.mpf("1e-12")
    for time in (mp.mpf("0.0123"), mp.mpf("0.061"), mp.mpf("0.17"), mp.mpf("0.27")):
        ahead, behind = (ppo.arc_length(*ppo.locate(time + n * step)) for n in (1, -1))
        index, parameter = ppo.locate(time)
        speed = mp.norm([s.derivative(1) for s in ppo.phases[index].position(parameter, 1)])
        assert agree((ahead - behind) / (2 * step), ppo.speed_factor * speed, 18)
    assert agree(ppo.arc_length(len(ppo.phases) - 1, mp.mpf(1)), ppo.path_length)


# Motion superposition


def test_comparison_method_reproduces_the_papers_deviation() -> None:
    ppo = plan("comparison")
    assert [mp.nstr(1000 * d, 12) for d in ppo.durations.values()] == ["78.125", "238.28125", "78.125"]
    assert agree(ppo.nominal_duration, "0.31640625")
    assert all(rounds_to(1000 * d, "3.70179006406039272") for d in ppo.corner_deviations)


def test_comparison_deviation_is_the_smallest_distance_over_time() -> None:
    case, ppo = CASES["case"]["comparison_equal_deviation"], plan("comparison_equal_deviation")
    vertices = [(case[side][0], case[side][2] + case[f"lift_{side}"]) for side in ("pick", "place")]
    times = [ppo.aligned_duration * n / 400 for n in range(401)]
    path = [position_at(ppo, time) for time in times]
    for (x, z), deviation in zip(vertices, ppo.corner_deviations, strict=True):
        nearest = min(mp.hypot(p[0] - x, p[2] - z) for p in path)
        assert deviation - mp.mpf("1e-45") <= nearest < deviation * mp.mpf("1.001")


def test_comparison_at_equal_deviation() -> None:
    overlap = overlap_with_deviation(*(mp.mpf(v) for v in ("0.006", "0.305", "0.05", "1.2", "2.4")))
    assert agree(overlap, CASES["case"]["comparison_equal_deviation"]["overlap"])
    assert rounds_to(1000 * plan("comparison_equal_deviation").nominal_duration, "301.42")


# Peaks and golden files


def test_peaks_of_the_paper_case() -> None:
    ppo = plan("paper")
    c, v_b = ppo.speed_factor, mp.mpf("1.2")
    assert agree(peaks(ROBOT, mp.mpf(0), ppo, "tcp_speed")[0], c * mp.mpf("2.4"), 28)
    ramp = mp.mpf("1.875") * v_b / ppo.durations["lift"]
    assert agree(peaks(ROBOT, mp.mpf(0), ppo, "tcp_acceleration")[0], c**2 * ramp, 28)
    velocity = peaks(ROBOT, mp.mpf(0), ppo, "joint_velocity")
    assert rounds_to(velocity[0] / c, "4.423")
    assert rounds_to(velocity[1] / c, "3.00296")
    assert agree(velocity[1], velocity[2], 28)


@pytest.mark.parametrize(
    ("name", "torques"),
    [("paper", (54.8, 49.7)), ("paper_payload", (76.4, 67.6)), ("comparison", (32.3, 27.7))],
)
def test_golden_torque_peaks_agree_with_the_known_ones(name: str, torques: tuple[float, float]) -> None:
    with (golden.FOLDER / f"{name}.csv").open(newline="") as file:
        rows = {row["quantity"]: float(row["value"]) for row in csv.DictReader(file)}
    for i, torque in zip((1, 2), torques, strict=True):
        nominal = rows[f"peak.joint_torque.{i}"] * (rows["aligned_duration"] / rows["nominal_duration"]) ** 2
        assert nominal == pytest.approx(torque, rel=0.005)


@pytest.mark.parametrize("name", CASES["case"])
def test_golden_files_hold_what_the_reference_computes(name: str) -> None:
    with (golden.FOLDER / f"{name}.csv").open(newline="") as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    ppo = plan(name)
    expected = {"nominal_duration": ppo.nominal_duration, "path_length": ppo.path_length, **ppo.lengths}
    time = golden.sample_times(ppo)[1]
    sampled = golden.sample(ppo, ROBOT, CASES["case"][name]["payload"], mp.mpf(time))
    expected |= {f"sample.{time}.joint_torque.{i}": value for i, value in sampled["joint_torque"].items()}
    for quantity, value in expected.items():
        assert agree(rows[quantity]["value"], value, 27)
