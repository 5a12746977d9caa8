"""What a fit's page draws and lists, against numbers worked out here."""

import re
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from cellctl.calibration import (
    Backlash,
    Harmonics,
    JointCompliance,
    PositionRows,
    Postures,
    RobotModel,
    State,
    Task,
    ThermalExpansion,
    Tolerances,
    ToolDeflection,
    Unknowns,
    identify,
)
from cellctl.kinematics import to_poe
from cellctl.report.fit import _advice as advices
from cellctl.report.fit import _by_place, _parameters, _pictures
from cellctl.report.fit._advice import advice, candidates, narrows
from cellctl.report.fit._pictures import coverage, scaled_numbers
from cellctl.report.fit._region import RegionSigma, along_joint
from cellctl.report.fit._rows import head
from cellctl.report.fit.residuals import _Predicted, residuals_of
from tests.helpers.reports import (
    CENTRES,
    ERRORS,
    INSTRUMENT,
    KR5,
    REACH,
    arm,
    measured,
    pointed,
    positions,
    postures,
    sessions,
    sockets,
    told,
    touches,
    truth,
)


@pytest.fixture(scope="module")
def seen():
    """Two hundred positions, a quarter held out."""
    return told(measured(positions(200)))


@pytest.fixture(scope="module")
def touched():
    return told(pointed(touches(120)))


@pytest.fixture(scope="module")
def rows(seen):
    return residuals_of(seen)


def test_errors_drawn_are_model_less_measurement_row_by_row(seen, rows):
    models = [each.state.model for each in (seen.result.identification.nominal, seen.found)]
    block = seen.task.rows.only
    for model, drawn in zip(models, (rows.before, rows.after), strict=True):
        assert drawn == pytest.approx(model.tcp(block.q) - block.xyz, abs=1e-12)
    assert rows.row.tolist() == list(range(200))
    assert rows.tip == pytest.approx(models[1].tcp(block.q))


def test_held_out_rows_drawn_are_those_of_the_verdict(seen, rows):
    before, after = rows.sizes
    assert np.sort(before[rows.held_out]) == pytest.approx(np.sort(seen.result.nominal_errors))
    assert np.sort(after[rows.held_out]) == pytest.approx(np.sort(seen.result.test_errors))
    assert after[rows.fitted].mean() == pytest.approx(seen.result.fit.mean)


def test_a_touchs_error_is_drawn_along_its_normal(touched):
    rows = residuals_of(touched)
    block, state = touched.task.rows.only, touched.found.state
    away = state.model.tcp(block.q) - state.points[block.point]
    distance = np.linalg.norm(away, axis=1)
    assert rows.signed_after == pytest.approx(distance - REACH)
    assert rows.after == pytest.approx((distance - REACH)[:, None] * away / distance[:, None])
    assert rows.point.tolist() == [f"S{point + 1}" for point in block.point]


def test_the_part_along_a_joints_way_is_that_of_a_joint_turned_a_little(seen, rows):
    model, q, step = seen.found.state.model, seen.task.rows.q, 1e-6
    for joint in range(6):
        turned = q.copy()
        turned[:, joint] += step
        way = model.tcp(turned) - model.tcp(q)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        assert rows.joint_after[:, joint] == pytest.approx(np.sum(rows.after * way, axis=1), abs=1e-5)


@pytest.mark.parametrize(
    "make", [lambda: measured(positions(300)), lambda: pointed(touches(240)), lambda: pointed(sockets(120))]
)
def test_residuals_in_their_foreseen_sigma_are_of_size_one(make):
    """Noise as promised: the fit's rows shrink by what they bent, held-out ones grow by what is not known."""
    rows = residuals_of(told(make()))
    for numbers in scaled_numbers(rows):
        assert numbers.std() == pytest.approx(1.0, abs=3.5 / np.sqrt(2 * numbers.size))
    fit, held_out = coverage(rows)
    assert fit == pytest.approx(0.95, abs=0.03)
    assert held_out == pytest.approx(0.95, abs=0.07)


def test_without_what_the_fit_bent_its_rows_would_look_too_good():
    """Thirty rows, thirty-three parameters: the bare residual over σ is far below 1, the scaled one is not."""
    story = told(measured(positions(30)), held_out=0)
    rows = residuals_of(story)
    bare = np.std(rows.after / story.task.rows.only.sigma)
    assert bare < 0.85
    assert scaled_numbers(rows)[0].std() == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("judging", [True, False])
def test_foreseen_variance_is_that_of_many_fits_with_held_but_doubtful_parameters(judging):
    """Four free and two held unknowns, forty numbers, a hundred thousand draws of all of them and of the noise."""
    rng = np.random.default_rng(8)
    rows, asked = rng.normal(size=(40, 6)), rng.normal(size=(10, 6))
    noise, free = rng.uniform(0.5, 2.0, 40), np.array([True, True, False, True, False, True])
    known = np.array([2.0, 0.5, 0.3, 1.0, 0.8, 3.0])
    scaled, tried = rows / noise[:, None], 100_000
    posterior = np.linalg.inv(scaled[:, free].T @ scaled[:, free] + np.diag(known[free] ** -2))
    answer = posterior @ (scaled[:, free] / noise[:, None]).T
    truths = rng.normal(size=(tried, 6)) * known
    numbers = truths @ rows.T + rng.normal(size=(tried, 40)) * noise
    found = numbers @ answer.T
    errors = -truths.copy()
    errors[:, free] += found
    estimate = SimpleNamespace(covariance=np.cov(errors.T), unknowns=SimpleNamespace(free=free))
    sure = _Predicted.of(estimate, judging, False)
    if judging:
        seen, columns, of_noise = errors @ asked.T - rng.normal(size=(tried, 10)), asked, np.ones(10)
    else:
        seen, columns, of_noise = found @ rows[:, free].T - numbers, rows, noise**2
    assert sure.variance(columns[:, None, :], of_noise[:, None])[:, 0] == pytest.approx(seen.var(axis=0), rel=0.03)


def test_a_wave_in_one_joint_is_told_and_joints_without_any_are_not():
    q = postures(400, 3)
    true = truth().on(INSTRUMENT, truth().chain.tool)
    waved = q.copy()
    waved[:, 0] += 3e-4 * np.sin(9.0 * q[:, 0])
    noise = np.random.default_rng(1).normal(0.0, 0.03, (400, 3))
    story = told(measured(PositionRows(q, true.tcp(waved) + noise, np.full((400, 3), 0.03))))
    found = _pictures.explained(residuals_of(story))
    assert found[0][0] == 0
    assert found[0][1] > 0.5
    assert found[0][2] == pytest.approx(3e-4 / np.sqrt(2) * 1100.0, rel=0.25)
    assert all(share < 0.15 for _, share, _ in found[1:])


def test_noise_alone_has_no_pattern_and_no_drift(seen, rows):
    assert _pictures.explained(rows) == []
    assert _pictures.drifts(rows, rows.row.astype(float)) == []


def test_a_drift_is_told_with_its_size_whatever_the_registration_took_of_it():
    block = positions(200)
    slid = block.xyz + np.linspace(0.0, 0.3, 200)[:, None] * [0.0, 0.0, 1.0]
    story = told(measured(PositionRows(block.q, slid, block.sigma)))
    rows = residuals_of(story)
    ((label, change, error),) = _pictures.drifts(rows, rows.row.astype(float))
    assert label == "Z"
    assert change == pytest.approx(-0.3, abs=0.05)  # the model less a measurement that rises
    assert 0.0 < error < 0.05


def test_bins_have_the_means_and_standard_errors_of_their_rows():
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0.0, 10.0, 100), rng.normal(size=100)
    own = _pictures.bins_of(x)
    at, mean, error = _pictures.binned(x, y)
    for bin_ in range(int(own.max()) + 1):
        mine = own == bin_
        assert (at[bin_], mean[bin_]) == pytest.approx((x[mine].mean(), y[mine].mean()))
        assert error[bin_] == pytest.approx(y[mine].std(ddof=1) / np.sqrt(mine.sum()))


def test_of_many_points_the_largest_are_drawn():
    sizes = np.random.default_rng(3).random(5000)
    shown = _pictures.thinned(sizes, 300)
    assert len(shown) == len(set(shown.tolist())) == 300
    assert set(np.argsort(sizes)[-30:]) <= set(shown.tolist())
    assert _pictures.thinned(sizes[:200], 300).tolist() == list(range(200))


def test_cells_have_the_mean_error_of_their_rows():
    """Two clouds far apart: one cell or two each, whose arrows are the clouds' means."""
    rng = np.random.default_rng(4)
    at = np.concatenate([rng.uniform(0.0, 1.0, (200, 3)), rng.uniform(999.0, 1000.0, (200, 3))])
    errors = rng.normal(0.0, 0.01, (400, 3)) + np.where(
        np.arange(400)[:, None] < 200, [0.1, 0.0, 0.0], [0.0, -0.2, 0.0]
    )
    places_, arrows, sizes = _by_place._view(at, errors, 0, 1)
    assert len(places_) == 2
    assert arrows == pytest.approx(np.array([errors[:200, :2].mean(axis=0), errors[200:, :2].mean(axis=0)]))
    assert sizes == pytest.approx(
        np.sqrt([np.mean(np.sum(errors[:200] ** 2, 1)), np.mean(np.sum(errors[200:] ** 2, 1))])
    )


def test_the_table_has_each_parameters_deviation_in_its_own_unit_sigmas_and_tolerances(seen):
    lines = {line.label: line for group in _parameters.groups(seen) for line in group.lines}
    names, found = seen.found.unknowns.names, seen.found
    labels = {each.name: each.label for each in found.unknowns.parameters}
    for name, text in (("a2", "mm"), ("theta3", "°"), ("alpha1", "°")):
        at, factor = names.index(name), 1.0 if text == "mm" else np.degrees(1.0)
        value, sigma = found.deviations[at] * factor, np.sqrt(found.covariance[at, at]) * factor
        tolerance = found.unknowns.sigma[at] * factor
        line = lines[labels[name]]
        assert line.unit == text
        assert float(line.deviation.split(" ± ")[0].replace("−", "-")) == pytest.approx(value, abs=sigma / 10)
        assert float(line.in_assumed_sigmas.replace("−", "-")) == pytest.approx(value / tolerance, abs=0.051)
        assert float(line.in_sigmas.replace("−", "-")) == pytest.approx(value / sigma, abs=0.051)
        assert line.share == pytest.approx(1.0 - (sigma / tolerance) ** 2)
        assert abs(value - ERRORS[name] * factor) < 5.0 * sigma
    assert lines["a2"].nominal == "600"


def test_what_nobody_knew_is_in_the_table_of_places_with_its_sigma(seen):
    assert not {"base X", "tool X"} & {line.label for group in _parameters.groups(seen) for line in group.lines}
    base, tool = _parameters.placements(seen)
    place = [float(text.replace("−", "-")) for text in base["xyz"]]
    assert place == pytest.approx(seen.found.state.model.chain.base_now[:3, 3], abs=6e-4)
    assert np.linalg.norm(np.array(place) - INSTRUMENT[:3, 3]) < 5.0 * np.linalg.norm([float(s) for s in base["sigma"]])
    assert tool["turned"] == ""


def test_sigma_of_a_place_is_told_along_the_axes_that_the_place_is_told_in(seen):
    """The base slides 1 mm along each axis of the measuring frame: how far in σ is not asked of its own axes."""
    found = seen.found
    own = [found.unknowns.names.index(f"base_{axis}") for axis in "xyz"]
    draws = np.random.default_rng(5).multivariate_normal(np.zeros(3), found.covariance[np.ix_(own, own)], 20_000)
    turned = draws @ found.state.model.chain.base_now[:3, :3].T
    told_ = [float(text) for text in _parameters.placements(seen)[0]["sigma"]]
    assert told_ == pytest.approx(turned.std(axis=0), rel=0.06)


def test_points_are_listed_where_they_are(touched):
    for row, centre, sigma in zip(_parameters.points(touched), CENTRES, np.eye(3), strict=True):
        found = np.array([float(text.replace("−", "-")) for text in row["xyz"]])
        assert np.abs(found - centre).max() < 5.0 * max(float(text) for text in row["sigma"])
        assert row["visits"] == int(np.sum(touched.task.rows.pick(touched.used).only.point == int(np.argmax(sigma))))


def test_correlation_is_that_of_draws_from_the_covariance(seen):
    symbols, matrix = _parameters.correlation(seen)
    free = np.flatnonzero(seen.found.unknowns.free)
    draws = np.random.default_rng(6).multivariate_normal(
        np.zeros(len(free)), seen.found.covariance[np.ix_(free, free)], 40_000
    )
    assert matrix == pytest.approx(np.corrcoef(draws.T), abs=0.03)
    assert symbols == [seen.found.unknowns.parameters[index].label for index in free]


def test_the_strongest_pairs_are_named_first_with_what_is_known_of_them():
    matrix = np.eye(3)
    matrix[0, 1] = matrix[1, 0] = -0.99
    matrix[1, 2] = matrix[2, 1] = 0.93
    assert _pictures.strongest(["a", "b", "c"], matrix) == [
        "a and b (−0.990: their sum is known best)",
        "b and c (0.930: their difference is known best)",
    ]


def test_the_picture_has_a_square_for_each_pair_that_is_correlated(seen):
    symbols, matrix = _parameters.correlation(seen)
    picture = _pictures.correlation_picture(symbols, matrix)
    squares = sum(
        path.count("M") for path in re.findall(r'd="([^"]*z[^"]*)"', picture) if path.count("L") == 3 * path.count("M")
    )
    legend = 12
    pairs = np.abs(matrix[np.tril_indices(len(matrix), -1)])
    assert abs(squares - legend - int(np.sum(pairs >= 0.15))) <= 2  # the page's and the axes' own backgrounds


def test_sigma_over_the_region_is_the_fits_own_and_grows_beyond_it(seen):
    region = RegionSigma.of(seen)
    among = region.among(region.postures)
    assert np.sqrt(np.mean(among**2)) == pytest.approx(seen.result.predicted_volumetric_rms, rel=1e-6)
    at, sigma = along_joint(seen, region, 1)
    inside = (at >= region.lower[1]) & (at <= region.upper[1])
    assert sigma[~inside].min() > sigma[inside].min()
    assert sigma.max() > 1.5 * sigma[inside].mean()


def test_rows_advised_are_within_the_limits_and_each_lowers_sigma(touched):
    told_ = advice(touched, RegionSigma.of(touched), candidates(touched)[0])
    limits = KR5.limits()
    sigma = [float(told_["now"]), *(float(row["sigma"]) for row in told_["rows"])]
    assert len(told_["rows"]) == 8
    assert all(after <= before for before, after in pairwise(sigma))
    assert sigma[0] == pytest.approx(touched.result.predicted_volumetric_rms, rel=0.01)
    assert sigma[-1] < float(told_["at_random"])
    for row in told_["rows"]:
        readings = np.array([float(text.replace("−", "-")) for text in row["readings"]])
        assert np.all((readings > limits[:, 0]) & (readings < limits[:, 1]))
        tip = touched.found.state.model.tcp(KR5.joint_map().model(readings))
        assert np.linalg.norm(tip - CENTRES[["S1", "S2", "S3"].index(row["what"])]) == pytest.approx(REACH, abs=4.0)


def test_what_a_row_narrows_is_named_by_how_much():
    known = {parameter.name: parameter for parameter in RobotModel(KR5.chain()).parameters}
    three = tuple(known[name] for name in ("theta4", "tool_z", "a2"))
    assert narrows(three, np.array([0.69, 0.88, 1.0])) == "θ4 by 31\xa0%, tool Z by 12\xa0%"
    assert narrows(three[:1], np.array([0.999])) == "many a little"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("theta2", "θ2"),
        ("tool_x@cell B", "tool X, cell B"),
        ("compliance2_3x", "A2 sag by link 3, x"),
        ("compliance_load3", "A3 sag by payload"),
        ("harmonic1_c12", "A1 cos 12q"),
        ("backlash4", "A4 half play"),
        ("growth2", "link 2 growth"),
        ("tool_deflection", "tool deflection c_t"),
        ("ball_1_z", "ball_1 Z"),
    ],
)
def test_every_parameter_has_a_label(name, words):
    chain = KR5.chain()
    bend, compliance = ToolDeflection(0.4, 15.0), JointCompliance.of(chain, load_known=True)
    model = RobotModel(chain, (bend, compliance, Harmonics(6), Backlash(6), ThermalExpansion.of(chain)))
    state = State.of_sessions([model, model], [frozenset({"tool"})], np.zeros((1, 3)))
    unknowns = Unknowns.of(state, ["ball_1"], Tolerances(), sessions=["cell B"])
    assert unknowns.parameters[unknowns.names.index(name)].label == words


def test_an_axis_has_labels_of_its_own():
    labels = {parameter.name: parameter.label for parameter in RobotModel(to_poe(KR5.chain())).parameters}
    assert labels["turn_y3"] == "axis 3 tilt y"


def test_units_are_those_that_people_use():
    (turned, *_) = Backlash(1).parameters
    assert (turned.unit.shown, turned.unit.factor) == ("°", pytest.approx(57.29578))


class TestHints:
    """Advice where something is plainly missing, and none where nothing is."""

    def test_nothing_is_missing_in_a_good_set(self, seen):
        assert list(advices.hints(seen)) == []

    def test_a_joint_that_hardly_moved(self):
        region = np.array([[-40, -95, 55, -70, 40, -90], [40, -45, 105, 70, 60, 90]], float)
        (hint,) = advices.hints(told(measured(positions(120, region=region))))
        assert re.fullmatch(r"A5 covered only \d\d° of 234°: spread it\.", hint) or hint.startswith("A5 covered only")

    def test_a_tool_that_was_never_turned(self):
        region = np.array([[-3, -65, 80, -3, 40, -3], [3, -62, 83, 3, 43, 3]], float)
        story = told(measured(positions(120, region=region)))
        assert any("kept its orientation" in hint for hint in advices.hints(story))

    def test_no_length(self):
        first = advices.hints(told(pointed(sockets(60), spacings=None)))[0]
        assert first.startswith("No length was measured")
        first = advices.hints(told(pointed(touches(60), spacings=None)))[0]
        assert first.startswith("No distance between points is certified")

    def test_play_seen_from_one_side_alone(self):
        block = positions(120)
        side = np.ones(block.q.shape)
        side[::2, 1:] = -1.0
        task = measured(PositionRows(Postures(block.q, side), block.xyz, block.sigma)).with_effects((Backlash(6),))
        assert "A1 always came from the same side" in " ".join(advices.hints(told(task)))

    def test_too_few_numbers_and_no_proof(self):
        said = " ".join(advices.hints(told(measured(positions(12)), held_out=0)))
        assert "36 measured numbers for 33 parameters" in said
        assert "No row was held out" in said


def test_an_older_models_values_are_what_the_table_counts_from():
    older = truth(errors={"a2": 0.55})
    task = measured(positions(120))
    story = told(type(task)(older, task.rows, prior=np.diag(np.full(len(older.parameters), 1e-2))))
    line = next(line for group in _parameters.groups(story) for line in group.lines if line.label == "a2")
    assert line.nominal == "600.55"
    assert abs(float(line.deviation.split(" ± ")[0].replace("−", "-"))) < 0.2


def test_sessions_errors_are_turned_into_one_frame():
    """Each session's own instrument turns its errors; the robot's base is where they can be compared."""
    story = told(sessions(60))
    rows = residuals_of(story)
    model = story.found.state.models[1]
    second = rows.session == 1
    q = story.task.rows.q[rows.row[second]]
    assert rows.tip_base[second] == pytest.approx(model.chain.with_base(np.eye(4)).forward(q)[:, :3, 3], abs=1e-6)


def test_a_robot_of_two_joints_is_advised_too():
    region = np.array([[-80.0] * 2, [80.0] * 2])
    robot = arm(2)
    story = told(measured(positions(60, robot=robot, region=region), robot), robot=robot)
    assert len(advice(story, RegionSigma.of(story), candidates(story)[0])["rows"][0]["readings"]) == 2


def test_tolerances_that_the_rows_widened_are_told_as_stated_with_the_factor():
    """Link lengths of a robot 4 mm from its table: in tolerances, that is what was promised, not believed then."""
    lengths = {name: 4.0 * (-1) ** at for at, name in enumerate(("a1", "a2", "a3", "d4", "a4", "d5"))}
    true = truth(errors=lengths)
    story = told(measured(positions(150, true=true)))
    factor = story.result.identification.prior_scale["links"]
    line = next(line for group in _parameters.groups(story) for line in group.lines if line.label == "a2")
    assert factor > 1.5
    assert float(line.assumed_sigma) == pytest.approx(0.5)
    assert float(line.in_assumed_sigmas.replace("−", "-")) == pytest.approx(-8.0, abs=0.5)
    assert f"links: the data show {factor:.1f} times as much" in dict(head(story)["setup"])["assumed σ"]


def test_a_parameter_that_changed_since_the_older_model_is_told_by_what_that_knew():
    rows = positions(80)
    older = identify(measured(rows)).identified
    known = older.covariance[: older.unknowns.robot, : older.unknowns.robot]
    changed = truth(errors={**ERRORS, "theta3": ERRORS["theta3"] + 0.005})
    task = Task(older.state.model, positions(60, seed=1, true=changed), prior=known)
    story = told(task)
    line = next(line for group in _parameters.groups(story) for line in group.lines if line.label == "θ3")
    at = older.state.model.names.index("theta3")
    assert list(story.result.identification.prior_scale) == ["zeros"]
    assert float(line.assumed_sigma) == pytest.approx(np.degrees(np.sqrt(known[at, at])), rel=0.1)
    assert line.wide
