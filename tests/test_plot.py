import functools
import io
import itertools
import subprocess
import sys
import textwrap
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.image
import numpy as np
import pytest
import xarray
from fits import fit_of
from IPython.core.formatters import PNGFormatter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import hystjax as hj
from hystjax import InputError, plot, search
from hystjax.comparison import Compared, Comparison
from hystjax.discovery import Discovered
from hystjax.models import (
    Butterfly,
    Duhem,
    FittedRange,
    Instrumented,
    Oscillator,
    SparseModel,
    Started,
)

T = np.linspace(0, 3, 301)
U = 2 * np.sin(2 * np.pi * T)
W = U - 0.5 * np.cos(2 * np.pi * T)
NAMES, UNITS = ("drive", "stroke"), ("V", "µm")
REC = hj.Recording(T, U, W, names=NAMES, units=UNITS)
LATER = hj.Recording(T + 3, U, 1.5 * W, names=NAMES, units=UNITS)
CLOCKLESS = hj.Recording(None, U, W, names=NAMES, units=UNITS)
LAW = Duhem(0.8, 0.5, 0.9, names=NAMES, units=UNITS)
TRAJ, LATER_TRAJ = hj.simulate(LAW, REC), hj.simulate(LAW, LATER)
DOUBLE = eqx.tree_at(lambda s: s.w, TRAJ, 2 * TRAJ.w)
DIVERGED = eqx.tree_at(lambda s: s.w, TRAJ, TRAJ.w.at[100:].set(jnp.nan) * 1e6)
THRESHOLDS = np.geomspace(1e-3, 1, 5)
PATH = np.array(
    [[5.0, -300, 0.1], [5, -300, 0.1], [5, -310, 0], [0, -310, 0], [0, -310, 0]]
)
NAMED = ("u", "w*|du|", "|w|")

SPELT_OUT = ("the voltage across the stack, measured at the amplifier's output", "U")
AWKWARD = hj.Recording(T, U, W, names=SPELT_OUT, units=("$V", "$_{µ}$m"))
LONG = SparseModel.from_terms(
    {name: 1.2345e-7 * 7**i for i, name in enumerate(hj.library.Polynomial(2).names)}
)
TRIED = tuple(
    search.Trial(dict.fromkeys(names, 1.0), rmse, criterion)
    for names, rmse, criterion in (
        (("u", "du"), 0.05, -40.0),
        (("u", "du", "w*|du|"), 0.049, -38.0),
        (("du",), 0.9, 7.0),
        (("u",), 3.0, 60.0),
    )
)


def found(law, tried):
    """What a search would return that tried these, the first of them chosen."""
    rest = (), 0.0, False, 0.0, "", None, ()
    good, best = hj.RESULTS.successful, search.frontier(tried)
    return Discovered(law, good, tried, best, *rest).solution()


FOUND = found(LAW, TRIED)
MAP = xarray.DataArray(
    np.arange(24.0).reshape(2, 3, 4) / 24,
    {
        "samples": [300, 1000],
        "noise": ("noise", [0.0, 0.05, 0.1], {"units": "µm"}),
        "threshold": np.geomspace(1e-3, 1, 4),
    },
    ("samples", "noise", "threshold"),
)
SHARES = {"du": 1.0, "u": 0.62, "w*|du|": 0.005, "w": 0.0}
STABLE = hj.Stability(
    NAMED,
    jnp.array([1.0, 0.1, 0.5]),
    jnp.array([[0.0, 0.8, 0.1], [1.0, 0.5, 0.2], [0.95, 0.9, 0.3]]),
    jnp.array(2.5),
    jnp.array(3.0),
)
LED = {
    name: hj.Tracking(
        *map(jnp.asarray, (T, W, U, W + error, W + error, error)),
        names=NAMES,
        units=UNITS,
    )
    for name, error in (
        ("constant gain", 0.3 * np.cos(T)),
        ("inverse and a loop around it", 0.01 * np.sin(9 * T)),
    )
}
SPRING = {"du": 3.0, "w*|du|": -2.0, "du*|w|": 1.5}
SHAKER = Oscillator(1.0, 0.2, 2.0, SparseModel.from_terms(SPRING))
OTHER = Oscillator(1.0, 0.2, 2.0, SparseModel.from_terms({**SPRING, "du": 2.9}))
TICKS = 0.1 * np.arange(150)
PUSHED = hj.Recording(
    TICKS, 0 * TICKS, 0.3 + 0 * TICKS, names=("force", "place"), units=("N", "m")
).with_input(lambda t: 2 * jnp.sin(1.3 * t) + jnp.sin(0.4 * t))


def known(model, covariance, names, **more):
    """What a fit would return that found these parameters with this covariance."""
    return fit_of(model, names, covariance, substeps=4, **more).solution()


NUMBERS = {"mass": 1.0, "damping": 0.2, "stiffness": 2.0} | SPRING
ROOT = np.random.default_rng(3).normal(size=(6, 6)) * 1e-3 * list(NUMBERS.values())
COVARIANCE = np.pad(ROOT.T @ ROOT, (0, 1))  # and that of a start
SHAKEN = known(SHAKER, COVARIANCE, NUMBERS)
WINGS = known(
    Butterfly(SparseModel.from_terms({"du": 0.7}), y0=0.2),
    np.array([[4e-4, -1e-4, 0], [-1e-4, 9e-4, 0], [0, 0, 1]]),
    ("du", "y0"),
)
FIGURES = {
    "record": lambda: plot.record(REC),
    "record without a clock": lambda: plot.record(CLOCKLESS),
    "loop": lambda: plot.loop(REC, TRAJ, TRAJ, DIVERGED),
    "fit": lambda: plot.fit(REC, TRAJ),
    "fit of one that diverges": lambda: plot.fit(REC, DIVERGED),
    "error": lambda: plot.error(REC, TRAJ, TRAJ),
    "path": lambda: plot.coefficient_path(THRESHOLDS, PATH, NAMED),
    "empty path": lambda: plot.coefficient_path(THRESHOLDS, 0 * PATH, NAMED),
    "overview": lambda: plot.overview(REC, TRAJ, LATER, LATER_TRAJ, model=LAW),
    "small overview": lambda: plot.overview(REC, TRAJ),
    "long law": lambda: plot.overview(REC, TRAJ, LATER, LATER_TRAJ, model=LONG),
    "longer law": lambda: plot.overview(REC, TRAJ, model=LONG),
    "refinement": lambda: plot.refinement(REC, DOUBLE, TRAJ, refined()),
    "frontier": lambda: plot.frontier(FOUND),
    "inclusion": lambda: plot.inclusion(SHARES),
    "stability": lambda: plot.stability(STABLE),
    "heat map": lambda: plot.heat_map(MAP[0], "share"),
    "heat maps": lambda: plot.heat_map(MAP, "share", limits=(0, 1)),
    "tracking": lambda: plot.tracking(LED),
    "hidden": lambda: plot.hidden(PUSHED, SHAKEN, OTHER, labels=["found", "other"]),
    "hidden alone": lambda: plot.hidden(PUSHED, OTHER),
    "hidden by a butterfly": lambda: plot.hidden(REC, WINGS),
    "tracking under long names": lambda: plot.tracking(
        {8 * f"{name} ": run for name, run in LED.items()}
    ),
    "loops of laws": lambda: plot.loop(REC, TRAJ, DOUBLE, labels=[str(LAW), str(LONG)]),
    "awkward loop": lambda: plot.cycles(AWKWARD),
    "awkward record": lambda: plot.record(AWKWARD),
    "awkward overview": lambda: plot.overview(AWKWARD, hj.simulate(LAW, AWKWARD)),
    "overview under long names": lambda: plot.overview(
        REC,
        TRAJ,
        LATER,
        LATER_TRAJ,
        labels=[f"friction_damper_1.0in_0.5Hz_test_0{i}" for i in (3, 4)],
    ),
}
ENDS = ((0.0, 5e4), (0.0, 1e-4), (1.0, 5e-4))  # middle, and volts a volt
FIGURES |= {
    f"{name} about {middle:g} to {2 * size:g}": lambda make=make, x=middle + size * U: (
        make(hj.Recording(T, x, W, names=NAMES, units=UNITS))
    )
    for name, make in (
        ("loop", plot.loop),
        ("cycles", plot.cycles),
        ("backbone", lambda record: plot.backbone(record, SIDES)),
        ("overview", lambda record: plot.overview(record, TRAJ)),
    )
    for middle, size in ENDS
}
NOTHING = np.empty(0)
SIDES = hj.loops.Backbone(NOTHING, NOTHING, NOTHING, NOTHING)


LENGTHY = "play(u,0.21961860386352342)*|du|*|w|^-1.2797641026441053"
FIGURES |= {"inclusion of long terms": lambda: plot.inclusion({LENGTHY: 0.5, "u": 1.0})}
WORDY = {
    "samples of each of the recordings": [300, 1000, 3000],
    "candidates of the law": ["Polynomial(2)", "Polynomial(3) * Play([0.1])", "$u$"],
    "what else differs between the sweeps": ["first of many", "second of many", "c"],
}
FIGURES |= {
    "wordy heat map": lambda: plot.heat_map(
        xarray.DataArray(np.eye(3), dict([*WORDY.items()][:2]), [*WORDY][:2]),
        "share of the laws that were exactly right, of all seeds that were drawn",
    ),
    "wordy heat maps": lambda: plot.heat_map(
        xarray.DataArray(np.ones((3, 3, 3)) * T[1:4], WORDY, [*WORDY])
    ),
}


@functools.cache
def refined():
    noise = 0.05 * np.random.default_rng(0).normal(size=T.size)
    noisy = eqx.tree_at(lambda r: r.w, REC, TRAJ.w + noise)
    return hj.refine(LAW, noisy)


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def drawn(ax):
    """Data of the lines that belong to the recording and its simulations."""
    return [line.get_data() for line in ax.lines if len(line.get_xdata()) > 2]


def assert_drawn(ax, *expected):
    lines = drawn(ax)
    assert len(lines) == len(expected)
    for line, (x, y) in zip(lines, expected, strict=True):
        np.testing.assert_array_equal(line[0], x)
        np.testing.assert_array_equal(line[1], y)


@pytest.mark.parametrize("make", FIGURES.values(), ids=FIGURES)
def test_nothing_is_clipped_or_on_top_of_each_other(make):
    figure = make()
    assert isinstance(figure, Figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    inside, whole = figure.get_tightbbox(renderer), figure.bbox_inches
    slack = 0.02  # inches, less than a line's width
    assert inside.x0 > whole.x0 - slack and inside.x1 < whole.x1 + slack
    assert inside.y0 > whole.y0 - slack and inside.y1 < whole.y1 + slack
    boxes = [ax.get_tightbbox(renderer) for ax in figure.axes]
    for i, one in enumerate(boxes):
        assert one.width > 0 and one.height > 0
        for other in boxes[:i]:
            overlap = one.intersection(one, other)
            assert overlap is None or min(overlap.width, overlap.height) < 5  # pixels
    for ax in figure.axes:
        for one, other in itertools.pairwise(places_below(ax, renderer)):
            assert one.x1 < other.x0


def places_below(ax, renderer):
    """Where numbers stand below an axis, in their order, but for those that lean."""
    low, high = sorted(ax.get_xlim())
    ticks = zip(
        ax.get_xticks(), ax.get_xticklabels(), strict=False
    )  # or there are none
    inside = [label for at, label in ticks if low <= at <= high]
    shown = [each for each in inside if each.get_text() and not each.get_rotation()]
    places = [each.get_window_extent(renderer) for each in shown]
    return sorted(places, key=lambda box: box.x0)


def test_record():
    top, bottom = plot.record(REC).axes
    assert_drawn(top, (T, U))
    assert_drawn(bottom, (T, W))
    assert top.get_ylabel() == "drive (V)"
    assert bottom.get_ylabel() == "stroke (µm)"
    assert bottom.get_xlabel() == "time (s)"
    assert top.get_shared_x_axes().joined(top, bottom)


def test_samples_are_counted_where_there_is_no_clock():
    run = eqx.tree_at(lambda s: s.t, TRAJ, CLOCKLESS.t)
    lost = eqx.tree_at(lambda s: s.t, DIVERGED, CLOCKLESS.t)
    for figure in (
        plot.record(CLOCKLESS),
        plot.fit(CLOCKLESS, run),
        plot.error(CLOCKLESS, run),
        plot.overview(CLOCKLESS, run),
        plot.refinement(CLOCKLESS, run, run, refined()),
    ):
        labels = {ax.get_xlabel() for ax in figure.axes}
        assert "sample" in labels and "time (s)" not in labels
    top, _ = plot.fit(CLOCKLESS, lost).axes
    assert top.get_title(loc="right") == "diverges at sample 100"


def test_loop():
    (ax,) = plot.loop(REC, TRAJ, DOUBLE, labels=["one", "two"]).axes
    assert_drawn(ax, (U, W), (TRAJ.u, TRAJ.w), (TRAJ.u, 2 * TRAJ.w))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("drive (V)", "stroke (µm)")
    assert texts(ax.get_legend()) == ["recorded", "one", "two"]
    assert len({line.get_color() for line in ax.lines}) == 3


def test_fit():
    top, bottom = plot.fit(REC, TRAJ).axes
    assert_drawn(top, (T, W), (T, TRAJ.w))
    assert_drawn(bottom, (T, TRAJ.w - W))
    assert texts(top.get_legend()) == ["recorded", "simulated"]
    assert top.get_ylabel() == "stroke (µm)"
    assert (bottom.get_xlabel(), bottom.get_ylabel()) == ("time (s)", "error (µm)")
    rms = np.sqrt(np.mean((np.asarray(TRAJ.w) - W) ** 2))
    _, shown, unit = top.get_title(loc="right").split()
    assert float(shown) == pytest.approx(100 * rms / np.ptp(W), rel=5e-3)
    assert unit == "%"


def test_inputs_beyond_one_end_stand_out_too():
    low, high = float(np.min(U)), float(np.max(U))
    for known in (FittedRange(0.7 * low, high), FittedRange(low, 0.7 * high)):
        figure = plot.overview(REC, TRAJ, model=LAW.fitted_on(known))
        loop = next(ax for ax in figure.axes if ax.get_label() == "loop")
        assert any(each.get_label().startswith("inputs") for each in loop.patches)


def test_what_was_not_measured_sets_no_scale():
    """Where a law diverges, and outputs of weight 0 are rubbish."""
    wrong = np.arange(len(T)) % 50 == 7
    rubbish = hj.Recording(T, U, np.where(wrong, 1e5, W), names=REC.names)
    run = replace(TRAJ, w=TRAJ.w.at[-3:].set(np.inf))
    figure = plot.fit(rubbish, run, weights=np.where(wrong, 0.0, 1.0))
    for ax in figure.axes:
        assert np.ptp(ax.get_ylim()) < 3 * np.ptp(W)


@pytest.mark.parametrize("order", [1, -1])
def test_a_run_that_diverges_leaves_the_rows_beside_it_in_view(order):
    larger = hj.Recording(T + 3, U, 10 * W, names=NAMES, units=UNITS)
    fitted = replace(LATER_TRAJ, w=jnp.asarray(9 * W))
    pairs = [(REC, DIVERGED), (larger, fitted)][::order]
    figure = plot.overview(*pairs[0], *pairs[1])
    panels = {ax.get_label(): ax for ax in figure.axes}
    for name in ("first", "second"):
        for shown, ax in ((10 * W, panels[name]), (W, panels[f"{name}: error"])):
            low, high = ax.get_ylim()
            assert low < np.min(shown) and high > np.max(shown)
            assert high - low < 3 * np.ptp(10 * W)


def test_a_run_that_diverges_from_an_output_that_stands_still_leaves_it_in_view(
    recwarn,
):
    for size in (5.0, 0.0):
        still = hj.Recording(T, U, 0 * T + size)
        top, bottom = plot.fit(still, DIVERGED).axes
        for ax, shown in ((top, size), (bottom, 0.0)):
            low, high = ax.get_ylim()
            assert low < shown < high and high - low < 10
    assert not recwarn.list


def test_error_of_several():
    (ax,) = plot.error(REC, TRAJ, DOUBLE).axes
    assert_drawn(ax, (T, TRAJ.w - W), (T, 2 * TRAJ.w - W))
    assert texts(ax.get_legend()) == ["simulated 1", "simulated 2"]


def test_tracking():
    top, bottom = plot.tracking(LED).axes
    first, second = LED.values()
    assert_drawn(top, (T, W), (T, first.w), (T, second.w))
    shares = [100 * np.asarray(each.error) / np.ptp(W) for each in LED.values()]
    assert_drawn(bottom, *((T, share) for share in shares))
    assert (top.get_ylabel(), bottom.get_xlabel()) == ("stroke (µm)", "time (s)")
    reference, *schemes = texts(top.get_legend())
    assert reference == "reference"
    for text, name, share in zip(schemes, LED, shares, strict=True):
        label, score = text.rsplit(": ", 1)
        assert label == name
        rms = np.sqrt(np.mean(share**2))
        assert float(score.split()[0]) == pytest.approx(rms, rel=0.05)
    low, high = bottom.get_ylim()
    assert low < -np.max(shares) and high > np.max(shares)
    clockless = {
        name: replace(
            run, t=jnp.arange(float(len(T))), w=run.w.at[9].set(w), clocked=False
        )
        for (name, run), w in zip(LED.items(), (0.0, jnp.nan), strict=True)
    }
    top, bottom = plot.tracking(clockless).axes
    assert bottom.get_xlabel() == "sample"
    assert texts(top.get_legend())[-1].endswith("diverges at sample 9")
    other = eqx.tree_at(lambda run: run.reference, first, jnp.asarray(2 * W))
    with pytest.raises(InputError, match="'other' was led along another reference"):
        plot.tracking({**LED, "other": other})
    with pytest.raises(InputError, match="`runs` is empty"):
        plot.tracking({})


def test_long_legends_leave_their_panels_as_high_as_they_are():
    def height(figure):
        FigureCanvasAgg(figure).draw()
        return figure.axes[0].get_position().height * figure.get_figheight()

    long = 12 * "a long name "
    for few, many in (
        (plot.loop(REC, TRAJ), plot.loop(REC, *12 * [TRAJ], labels=12 * [long])),
        (
            plot.tracking({"a": LED["constant gain"]}),
            plot.tracking({f"{i} {long}": LED["constant gain"] for i in range(8)}),
        ),
    ):
        assert height(many) > 0.8 * height(few)
    own = Figure(figsize=(5, 4))
    plot.loop(REC, *12 * [TRAJ], labels=12 * [long], ax=own.add_subplot())
    assert own.get_figheight() == 4


def test_a_run_that_diverges_leaves_the_others_visible():
    first, second = LED.values()
    lost = eqx.tree_at(
        lambda run: (run.w, run.error),
        second,
        tuple(x.at[100:].set(jnp.nan) * 1e9 for x in (second.w, second.error)),
    )
    top, bottom = plot.tracking({"one": first, "other": lost}).axes
    assert texts(top.get_legend())[-1] == "other: diverges at 1 s"
    for ax, size in ((top, np.ptp(W)), (bottom, 100.0)):
        low, high = ax.get_ylim()
        assert size < high - low < 4 * size


def test_names_with_dollars_are_no_mathematics():
    odd = hj.Recording(T, U, W, names=("$u$", "$w$"))
    stack = hj.models.PrandtlIshlinskii([0.0, 0.5], [0.7, 0.3])
    legends = plot.cycles(odd), plot.densities({"$a$": stack})
    for figure, expected in zip(legends, (r"at \$u\$ 0", r"\$a\$"), strict=True):
        assert expected in texts(figure.axes[0].get_legend())


def test_labels_of_an_overview_with_dollars_are_no_mathematics():
    figure = plot.overview(REC, TRAJ, labels=["5 $ to 6 $ runs"])
    loop, rows = (ax.get_title() for ax in figure.axes[:2])
    assert loop == r"loop, 5 \$ to 6 \$ runs"
    assert rows.startswith(r"5 \$ to 6 \$ runs: NRMSE ")


def test_no_line_ends_between_a_dollar_and_its_backslash():
    stack = hj.models.PrandtlIshlinskii([0.0, 0.5], [0.7, 0.3])
    for count in range(20, 28):
        name = f"{count * 'x'}${count * 'y'}$"
        _, bottom = plot.record(hj.Recording(T, U, W, names=("u", name))).axes
        (ax,) = plot.densities({4 * name: stack}).axes
        for text in (bottom.get_ylabel(), *texts(ax.get_legend())):
            assert "\n" in text and "\\\n" not in text
            assert text.replace("\n", "").replace(r"\$", "$").startswith(name)


def test_a_loop_that_is_far_from_zero_fills_its_figure():
    (ax,) = plot.cycles(hj.Recording(T, U - 1e3, W + 1e6)).axes
    for limits, x in ((ax.get_xlim(), U), (ax.get_ylim(), W)):
        assert np.ptp(limits) < 1.2 * np.ptp(x)


def test_numbers_of_cycles_and_terms_are_whole():
    once = plot.energy(hj.loops.summary(REC).isel(cycle=[0])).axes[1].xaxis
    none = plot.coefficient_path(THRESHOLDS, 0 * PATH, NAMED).axes[1].yaxis
    for axis, number in ((once, 1), (none, 0)):
        low, high = axis.get_view_interval()
        ticks = [tick for tick in axis.get_majorticklocs() if low <= tick <= high]
        assert ticks == [number]


def test_bars_of_energies_are_two_standard_errors():
    known = hj.loops.summary(REC)
    count = len(known["cycle"])
    known["energy_error"] = "cycle", 0.1 * np.arange(1, count + 1)
    top, _ = plot.energy(known).axes
    spans = [np.ptp(bar[:, 1]) for bar in top.collections[0].get_segments()]
    np.testing.assert_allclose(spans, 0.4 * np.arange(1, count + 1), rtol=1e-9)


def test_a_loop_is_marked_where_it_passes_the_axis():
    """2 sin x - 0.5 cos x is 0 at the tangent 1/4."""
    (ax,) = plot.cycles(hj.Recording(T, U + 0.3, W)).axes
    marks = next(each for each in ax.lines if each.get_marker() == "D")
    across = 2 * np.sin(np.arctan(0.25))
    np.testing.assert_allclose(
        np.sort(marks.get_xdata()), [0.3 - across, 0.3 + across], atol=2e-3
    )


def test_two_lines_in_place_of_a_backbone_end_where_it_does():
    side = np.array([0.0, 1.0, 3.0])
    found = hj.loops.Backbone(side, side, -side, -side)
    for sign in (1, -1):
        fit = hj.loops.Bilinear(2.0, 0.5, sign * 1.0, sign * 2.0, 0.0)
        (ax,) = plot.backbone(REC, found, {"fit": fit}).axes
        x, y = ax.lines[-1].get_data()
        np.testing.assert_allclose(x, sign * side)
        np.testing.assert_allclose(y, [0, sign * 2, sign * 3])


def edges(ax):
    """Where the bands in a panel end, above and below each place that they are at."""
    points = np.concatenate([p.vertices for p in ax.collections[0].get_paths()])
    places = np.unique(points[:, 0])
    ends = [points[points[:, 0] == x, 1] for x in places]
    return places, *np.array([[np.min(y), np.max(y)] for y in ends]).T


def pushed_by_numpy(numbers, t, steps=8, start=0.3):
    """Position and hidden force of oscillators, one for each row of numbers, by
    Runge-Kutta steps of our own."""
    m, c, k, *law = numbers.T

    def rate(time, x):
        y, v, z = x
        u = 2 * np.sin(1.3 * time) + np.sin(0.4 * time)
        dz = law[0] * v + law[1] * z * np.abs(v) + law[2] * v * np.abs(z)
        return np.stack([v, (u - c * v - k * y - z) / m, dz])

    x = np.stack([start + 0 * m, 0 * m, 0 * m])
    h, path = (t[1] - t[0]) / steps, [x]
    for i in range(steps * (len(t) - 1)):
        time = t[0] + i * h
        k1 = rate(time, x)
        k2 = rate(time + h / 2, x + h / 2 * k1)
        k3 = rate(time + h / 2, x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(time + h, x + h * k3))
        path.append(x)
    return np.stack(path[::steps])


def test_a_hidden_force_and_its_band_are_what_drawn_parameters_make():
    time, loop, below = plot.hidden(PUSHED, SHAKEN).axes
    rng, count = np.random.default_rng(0), 4000
    truth = np.array(list(NUMBERS.values()))
    covariance = COVARIANCE[:6, :6]
    drawn_ones = rng.multivariate_normal(truth, covariance, count)
    y, _, z = np.moveaxis(pushed_by_numpy(truth[None], TICKS)[..., 0], 1, 0)
    spread = np.std(pushed_by_numpy(drawn_ones, TICKS)[:, 2], axis=1)
    for ax, x in ((time, TICKS), (loop, y)):
        (line,) = drawn(ax)
        np.testing.assert_allclose(line[0], x, atol=2e-4)
        np.testing.assert_allclose(line[1], z, atol=5e-4)
    # A standard deviation of so many is itself known to 1.1 %.
    for ax, middle in ((time, z), (below, 0 * z)):
        t, low, high = edges(ax)
        np.testing.assert_array_equal(t, TICKS)
        np.testing.assert_allclose((low + high) / 2, middle, atol=5e-4)
        bound = 0.01 * np.max(spread)
        np.testing.assert_allclose((high - low) / 3.92, spread, rtol=0.05, atol=bound)
    labels = [ax.get_ylabel() for ax in (time, loop, below)]
    assert labels == ["hidden force z (N)"] * 2 + ["deviation (N)"]
    assert (loop.get_xlabel(), below.get_xlabel()) == ("place (m)", "time (s)")


@pytest.mark.parametrize("start", ["measured", "fitted", "given"])
def test_the_band_of_a_hidden_force_is_of_its_start_too(start):
    """Which was fitted with the parameters; or has the noise of all outputs; or is
    known."""
    rng, count = np.random.default_rng(1), 4000
    truth = np.array([*NUMBERS.values(), 0.3])
    # As it is with numbers that all the record tells, and one that its begin does.
    root = np.vstack([np.c_[ROOT, np.zeros(6)], [*ROOT[0], 0.01]])
    covariance = root.T @ root
    more = {"rmse": jnp.array([0.02]), "w0": jnp.array([0.3])}
    fit = known(SHAKER, covariance, NUMBERS, **more)
    w0 = {"measured": None, "fitted": fit.stats["w0"][0], "given": 0.2}[start]
    if start != "fitted":
        covariance[-1] = covariance[:, -1] = 0
        covariance[-1, -1] = 0.02**2 if start == "measured" else 0
        truth[-1] = 0.3 if start == "measured" else 0.2
    *drawn_ones, starts = rng.multivariate_normal(truth, covariance, count).T
    forces = pushed_by_numpy(np.transpose(drawn_ones), TICKS, start=starts)[:, 2]
    spread = np.std(forces, axis=1)
    _, low, high = edges(plot.hidden(PUSHED, fit, w0=w0).axes[2])
    bound = 0.01 * np.max(spread)
    np.testing.assert_allclose((high - low) / 3.92, spread, rtol=0.05, atol=bound)


def test_a_band_over_what_turns_back_covers_each_way():
    _, loop, _ = plot.hidden(REC, WINGS).axes
    change = U - U[0]
    (line,) = drawn(loop)
    np.testing.assert_allclose(line, (U, 0.2 + 0.7 * change), atol=1e-9)
    spread = 1.96 * np.sqrt(4e-4 * change**2 - 2e-4 * change + 9e-4)
    pieces = [path.vertices for path in loop.collections[0].get_paths()]
    assert len(pieces) == 7  # a sine of three periods
    for points in pieces:
        rows = np.argmin(np.abs(points[:, :1] - U), axis=1)
        np.testing.assert_allclose(points[:, 0], U[rows], atol=1e-9)
        away = np.abs(points[:, 1] - line[1][rows])
        np.testing.assert_allclose(away, spread[rows], atol=1e-9)
    assert loop.get_ylabel() == "hidden output y (√(µm))"
    assert loop.get_xlabel() == "drive (V)"


def test_further_models_are_drawn_beside_the_first_as_what_they_differ_by():
    time, loop, below = plot.hidden(
        PUSHED, SHAKEN, OTHER, labels=["found", "other"]
    ).axes
    assert texts(time.get_legend()) == ["found", "other"]
    assert texts(below.get_legend()) == ["95 % band"]
    first, other = (z for _, z in drawn(time))
    assert_drawn(below, (TICKS, 0 * first), (TICKS, other - first))
    assert np.max(np.abs(other - first)) > 1e-3 and len(drawn(loop)) == 2
    time, loop = plot.hidden(PUSHED, OTHER).axes
    assert_drawn(time, (TICKS, other)) and time.get_xlabel() == "time (s)"


def test_a_settled_device_is_taken_through_what_came_before():
    whole, _ = plot.hidden(PUSHED, OTHER).axes
    later, _ = plot.hidden(PUSHED.window(100, 150), OTHER, settled=True).axes
    np.testing.assert_allclose(drawn(later), np.array(drawn(whole))[..., 100:])
    again, _ = plot.hidden(PUSHED.window(100, 150), OTHER).axes
    assert drawn(again)[0][1][0] == 0
    _, there = plot.hidden(PUSHED, OTHER, w0=0.1).axes
    assert drawn(there)[0][0][0] == 0.1  # and not at 0.3, as recorded


def test_what_is_around_a_device_shows_what_that_hides():
    """Twice the force for a volt, and a position that is measured from elsewhere."""
    inside, _ = plot.hidden(PUSHED, OTHER).axes
    volts = hj.Recording(TICKS, 0 * TICKS, 0.8 + 0 * TICKS, units=("V", "m"))
    volts = volts.with_input(lambda t: jnp.sin(1.3 * t) + jnp.sin(0.4 * t) / 2)
    device = Oscillator(1.0, 0.2, 2.0, OTHER.spring, units=("N", "m"))
    behind = Instrumented(device, input_gain=2.0, output_offset=0.5)
    for record, model in (
        (volts, behind),
        (volts, Started.at_rest(behind, volts)),
    ):
        seen, _ = plot.hidden(record, model).axes
        np.testing.assert_allclose(drawn(seen), drawn(inside), atol=1e-9)
        assert seen.get_ylabel() == "hidden force z (N)"


def test_divergence_is_told_and_leaves_the_measurement_visible():
    for figure in (plot.loop(REC, DIVERGED), plot.error(REC, DIVERGED)):
        (ax,) = figure.axes
        assert texts(ax.get_legend())[-1] == "simulated (diverges at 1 s)"
        low, high = ax.get_ylim()
        assert high - low < 3 * np.ptp(W)
    top, _ = plot.fit(REC, DIVERGED).axes
    assert top.get_title(loc="right") == "diverges at 1 s"


def test_powers_of_ten_beside_an_axis_stay_clear_of_its_legend():
    small = hj.Recording(T, U, 1e-6 * W)
    run = eqx.tree_at(lambda s: s.w, TRAJ, 1.1e-6 * W)
    figure = plot.error(small, run)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (ax,) = figure.axes
    power = ax.yaxis.get_offset_text()
    assert power.get_text() == "1e\N{MINUS SIGN}7"
    renderer = canvas.get_renderer()
    legend = ax.get_legend().get_window_extent(renderer)
    assert power.get_window_extent(renderer).x1 <= legend.x0


def test_coefficient_path():
    top, bottom = plot.coefficient_path(THRESHOLDS, PATH, NAMED).axes
    assert texts(top.get_legend()) == list(NAMED)
    for line, values in zip(drawn(top), PATH.T, strict=True):
        np.testing.assert_array_equal(line[0], THRESHOLDS)
        np.testing.assert_array_equal(np.nan_to_num(line[1]), values)
        np.testing.assert_array_equal(np.isnan(line[1]), values == 0)
    assert_drawn(bottom, (THRESHOLDS, [3, 3, 2, 1, 1]))
    assert top.get_xscale() == bottom.get_xscale() == "log"
    assert top.get_yscale() == "symlog"
    assert bottom.get_xlabel() == "threshold"


def test_one_threshold_is_drawn_as_dots():
    figure = plot.coefficient_path(THRESHOLDS[:1], PATH[:1], NAMED)
    values = [*PATH[0], 3]
    lines = [
        each for ax in figure.axes for each in ax.lines if len(each.get_xdata()) == 1
    ]
    np.testing.assert_array_equal([each.get_ydata()[0] for each in lines], values)
    assert all(each.get_marker() == "o" for each in lines)


@pytest.mark.parametrize(
    "draw",
    [
        lambda label: plot.loop(REC, TRAJ, labels=[label]),
        lambda label: plot.error(REC, TRAJ, labels=[label]),
        lambda label: plot.densities({label: STACK}),
        lambda label: plot.coefficient_path(THRESHOLDS, np.ones((5, 1)), [label]),
    ],
)
def test_labels_that_begin_with_an_underscore_are_in_the_legend(draw):
    legends = [ax.get_legend() for ax in draw("_old").axes]
    texts = [each.get_text() for one in legends if one for each in one.get_texts()]
    assert texts[-1].endswith("_old")


def test_coefficients_are_drawn_in_the_order_of_their_thresholds():
    mixed = [3, 0, 4, 1, 2]
    figure = plot.coefficient_path(THRESHOLDS[mixed], PATH[mixed], NAMED)
    expected = plot.coefficient_path(THRESHOLDS, PATH, NAMED)
    for ax, other in zip(figure.axes, expected.axes, strict=True):
        np.testing.assert_array_equal(drawn(ax), drawn(other))


def test_frontier():
    (ax,) = plot.frontier(FOUND).axes
    assert sorted(map(tuple, ax.collections[0].get_offsets())) == [
        (1, 0.9),
        (1, 3.0),
        (2, 0.05),
        (3, 0.049),
    ]
    best, chosen = ax.lines
    assert [list(x) for x in best.get_data()] == [[1, 2, 3], [0.9, 0.05, 0.049]]
    assert [list(x) for x in chosen.get_data()] == [[2], [0.05]]
    assert texts(ax.get_legend())[-1] == "chosen: u, du"
    assert "error" in ax.get_ylabel() and ax.get_xlabel() == "number of terms"


def test_a_law_without_error_is_seen_on_the_frontier():
    exact = search.Trial({"u": 1.0}, 0.0, -90.0)
    tried = (exact, *TRIED, search.Trial({"w": 1.0}, np.inf, 99.0))
    law = Duhem(0.8, 0.5, 0.9, units=("V", "$µ_1$"))
    (ax,) = plot.frontier(found(law, tried)).axes
    chosen = ax.lines[1]
    assert chosen.get_xydata().tolist() == [[1, 0]]
    places = ax.transData.transform([[1, error] for error in (0, 0.049, 0.9, 3.0)])
    assert np.all(np.diff(places[:, 1]) > 0.1 * ax.bbox.height)
    assert ax.get_ylim()[0] < 0 and ax.get_ylim()[1] > 3
    assert ax.get_ylabel() == r"rms error of the free run (\$µ_1\$)"


def test_inclusion_shows_shares_in_per_cent():
    (ax,) = plot.inclusion(SHARES).axes
    assert [bar.get_width() for bar in ax.patches] == [100.0, 62.0, 0.5]
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["du", "u", "w*|du|"]
    assert [label.get_text() for label in ax.texts] == ["100", "62", "0.5"]


def test_stability_names_what_reaches_the_cut_off():
    (ax,) = plot.stability(STABLE, cutoff=0.95).axes
    assert texts(ax.get_legend()) == ["u", "other terms"]
    ordered = [0.1, 0.5, 1.0]
    expected = ([1.0, 0.95, 0.0], [0.5, 0.9, 0.8], [0.2, 0.3, 0.1])
    assert_drawn(ax, *((ordered, line) for line in expected))
    assert ax.get_xscale() == "log" and ax.get_xlabel() == "threshold"
    (ax,) = plot.stability(STABLE).axes
    assert texts(ax.get_legend()) == ["u", "w*|du|", "other terms"]


def test_heat_map_has_a_panel_for_each_value_of_the_first_axis():
    low, high, bar = plot.heat_map(MAP, "share", limits=(0, 1)).axes
    assert [ax.get_title() for ax in (low, high)] == ["samples = 300", "samples = 1000"]
    assert bar.get_ylabel() == "share"
    for ax, values in zip((low, high), MAP.values, strict=True):
        (image,) = ax.images
        np.testing.assert_array_equal(image.get_array(), values)
        assert image.get_clim() == (0, 1) and image.origin == "lower"
    assert (low.get_ylabel(), high.get_ylabel()) == ("noise (µm)", "")
    assert [t.get_text() for t in low.get_yticklabels()] == ["0", "0.05", "0.1"]
    assert [t.get_text() for t in high.get_xticklabels()] == [
        "0.001",
        "0.01",
        "0.1",
        "1",
    ]
    (panel, _) = plot.heat_map(MAP[1]).axes
    assert panel.images[0].get_clim() == (12 / 24, 23 / 24)


def test_heat_map_labels_some_of_many_cells():
    many = xarray.DataArray(
        np.zeros((20, 13)), {"a": [str(i) for i in range(20)]}, ("a", "b")
    )
    ax = plot.heat_map(many).axes[0]
    assert [t.get_text() for t in ax.get_yticklabels()] == ["0", "4", "8", "12", "16"]
    assert [t.get_text() for t in ax.get_xticklabels()] == ["0", "3", "6", "9", "12"]
    with pytest.raises(InputError, match="two axes, or, without `ax`, three; got a"):
        plot.heat_map(many[:, 0])
    with pytest.raises(InputError, match="got samples, noise, threshold"):
        plot.heat_map(MAP, ax=ax)


def test_heat_map_keeps_to_finite_numbers_and_tells_coordinates_apart():
    values = np.array([[1.0, np.inf, 3.0], [np.nan, 2.0, -np.inf]])
    far = {"a": 1e9 + np.arange(2.0), "b": [0.1, 0.1001, 1e-9]}
    panel, _ = plot.heat_map(xarray.DataArray(values, far, ("a", "b"))).axes
    (image,) = panel.images
    assert image.get_clim() == (1, 3)
    np.testing.assert_array_equal(
        np.ma.getmaskarray(image.get_array()), ~np.isfinite(values)
    )
    for labels, expected in (
        (panel.get_yticklabels(), far["a"]),
        (panel.get_xticklabels(), far["b"]),
    ):
        assert [float(label.get_text()) for label in labels] == list(expected)
    low, high, _ = plot.heat_map(
        xarray.DataArray(
            values[None] * [[[1]], [[2]]], {"c": far["a"]}, ("c", "a", "b")
        )
    ).axes
    assert low.get_title() != high.get_title()
    with pytest.raises(InputError, match="`values` has no finite number"):
        plot.heat_map(MAP[0] * np.nan)


def test_overview():
    law = r"$\dot{w} = 0.9\,\dot{u} + 0.8\,u\,|\dot{u}| - 0.5\,w\,|\dot{u}|$"
    figure = plot.overview(REC, TRAJ, LATER, LATER_TRAJ, model=LAW)
    assert figure.get_suptitle() == law
    panels = {ax.get_label(): ax for ax in figure.axes}
    assert_drawn(panels["loop"], (U, 1.5 * W), (LATER_TRAJ.u, LATER_TRAJ.w))
    assert_drawn(panels["first"], (T, W), (T, TRAJ.w))
    assert_drawn(panels["first: error"], (T, TRAJ.w - W))
    assert_drawn(panels["second"], (T + 3, 1.5 * W), (T + 3, LATER_TRAJ.w))
    assert_drawn(panels["second: error"], (T + 3, LATER_TRAJ.w - 1.5 * W))
    assert panels["loop"].get_title() == "loop, rows not fitted"
    for name, label in (("first", "fitted rows"), ("second", "rows not fitted")):
        assert panels[name].get_title().startswith(f"{label}: NRMSE ")
        assert panels[f"{name}: error"].get_ylabel() == "error (µm)"
        low, high = panels[name].get_ylim()  # one scale, on which all can be seen
        assert low < min(1.5 * W) and high > max(1.5 * W)
    assert texts(figure.legends[0]) == ["recorded", "law"]


def test_inputs_beyond_those_that_were_fitted_stand_out():
    low, high = float(np.min(U)), float(np.max(U))
    for share, seen in ((1.0, False), (0.7, True)):
        known = FittedRange(share * low, share * high)
        law = LAW.fitted_on(known)
        figure = plot.overview(REC, TRAJ, model=law)
        loop = next(ax for ax in figure.axes if ax.get_label() == "loop")
        bands = [each for each in loop.patches if each.get_label().startswith("inputs")]
        assert len(bands) == seen
        if seen:
            ends = bands[0].get_window_extent().transformed(loop.transData.inverted())
            np.testing.assert_allclose(ends.intervalx, [0.7 * low, 0.7 * high])
            assert "inputs that it was fitted on" in texts(figure.legends[0])


def test_a_law_too_long_for_the_title_is_counted():
    assert plot.overview(REC, TRAJ, model=LONG).get_suptitle() == "a law of 21 terms"


@pytest.mark.parametrize(
    ("draw", "count"),
    [
        (lambda axes: plot.record(REC, axes=axes), 2),
        (lambda axes: plot.fit(REC, TRAJ, axes=axes), 2),
        (lambda axes: plot.coefficient_path(THRESHOLDS, PATH, NAMED, axes=axes), 2),
        (lambda axes: plot.loop(REC, TRAJ, ax=axes[0]), 1),
        (lambda axes: plot.error(REC, TRAJ, ax=axes[0]), 1),
        (lambda axes: plot.frontier(FOUND, ax=axes[0]), 1),
        (lambda axes: plot.stability(STABLE, ax=axes[0]), 1),
    ],
)
def test_given_axes_are_drawn_into(draw, count):
    figure = Figure()
    part, _ = figure.subfigures(1, 2)
    axes = part.subplots(2, 1)
    assert draw(axes) is figure
    assert len(figure.axes) == 2
    assert all(drawn(ax) for ax in axes[:count])


def test_figures_leave_nothing_global_and_matplotlib_is_lazy(tmp_path):
    script = """
        import sys
        import numpy as np
        import hystjax as hj
        import hystjax.cli

        assert "matplotlib" not in sys.modules
        t = np.arange(9.0)
        figure = hj.plot.record(hj.Recording(t, np.sin(t), np.cos(t)))
        hj.plot.save(figure, sys.argv[1])
        import matplotlib
        # Their own items: to ask for the backend would import pyplot, to choose one.
        now, first = matplotlib.rcParams, matplotlib.rcParamsOrig
        assert repr(sorted(dict.items(now))) == repr(sorted(dict.items(first)))
        assert "matplotlib.pyplot" not in sys.modules
    """
    command = [sys.executable, "-c", textwrap.dedent(script), tmp_path / "figure.png"]
    outcome = subprocess.run(command, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stderr


@pytest.mark.parametrize(
    ("name", "start"),
    [("f.png", b"\x89PNG"), ("f.pdf", b"%PDF"), ("f.SVG", b"<?xml")],
)
def test_save(tmp_path, name, start):
    path = tmp_path / name
    plot.save(plot.record(REC), path)
    assert path.read_bytes().startswith(start)
    assert [file.name for file in tmp_path.iterdir()] == [name]


# 4.6 inches are 919.99... pixels in binary, which Matplotlib cut before it rounded.
LOST = matplotlib.__version_info__ < (3, 11)


def test_saved_pixels(tmp_path):
    plot.save(plot.record(REC), tmp_path / "f.png")
    pixels = matplotlib.image.imread(tmp_path / "f.png")
    assert pixels.shape[:2] == (920 - LOST, 1400)
    assert np.ptp(pixels) > 0.5


def test_long_records_stay_small_as_svg(tmp_path):
    t = np.linspace(0, 1, 100_000)
    noise = np.random.default_rng(0).normal(size=t.size)
    plot.save(plot.record(hj.Recording(t, noise, noise)), tmp_path / "f.svg")
    assert (tmp_path / "f.svg").stat().st_size < 1e6


def test_notebooks_show_figures():
    pixels = matplotlib.image.imread(io.BytesIO(PNGFormatter()(plot.record(REC))))
    assert pixels.shape[:2] == (460 - LOST, 700)


STACK = hj.models.PrandtlIshlinskii([0.0, 0.5], [0.7, 0.3], units=UNITS)
IN_MM = hj.models.PrandtlIshlinskii([0.0, 0.5], [7e-4, 3e-4], units=("V", "mm"))
SLIDER = hj.models.LuGre(1e5, 300.0, 0.4, 1.0, 1.5, 1e-3)
AT_REST = hj.Recording(T, 0 * T + 2, W)
RELAYS = hj.models.Preisach([-1.0, 0.0, 1.0], [[1.0, 0.0], [0.5, 1.0]])


def test_a_stribeck_curve_is_drawn_both_ways():
    (ax,) = plot.friction(SLIDER, fastest=0.01).axes
    ahead, back = drawn(ax)
    for v, force in (ahead, back):
        steady = np.sign(v) * (1 + 0.5 * np.exp(-((v / 1e-3) ** 2))) + 0.4 * v
        np.testing.assert_allclose(force, steady, rtol=1e-12)
    np.testing.assert_array_equal(back[0], -ahead[0])
    assert 0 < ahead[0][0] < 1e-4 and ahead[0][-1] == pytest.approx(0.01)
    # As far as a record goes, whichever way.
    (ax,) = plot.friction(SLIDER, hj.Recording(T, -0.5 * T, W)).axes
    assert max(ax.lines[-4].get_xdata()) == pytest.approx(0.5)


def compared(*errors):
    rows = (
        Compared(f"family {i}", LAW, (error, error), error, 1.0, 3, 1.0, "")
        for i, error in enumerate(errors)
    )
    return Comparison(tuple(rows), {}, 0.01)


@pytest.mark.parametrize("errors", [(0.014,), (0.0101, 0.0102), (1e-9, 0.3)])
def test_errors_of_families_are_between_ticks(errors):
    left, *_ = plot.comparison(compared(*errors), REC).axes
    low, high = left.get_xlim()
    shown = [100 * error for error in errors if error < 50 * errors[0]]
    assert low < 0.9 * min(shown) and high > 1.1 * max(shown)
    ticks = [tick for tick in left.get_xticks() if low <= tick <= high]
    assert len(ticks) >= 2
    # Those that are far off are named too, with their errors.
    assert len(left.get_yticklabels()) == len(errors)
    told = [f"{100 * error:.3g} % →" for error in errors if error >= 50 * errors[0]]
    assert [text.get_text() for text in left.texts] == told


def test_long_numbers_below_the_loops_of_families_do_not_touch():
    """Of positions far from zero."""
    far = hj.Recording(T, 0.12 * np.asarray(U) - 109.9, W)
    figure = plot.comparison(compared(0.01, 0.02, 0.03), far)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for ax in figure.axes[1:]:
        places = places_below(ax, canvas.get_renderer())
        assert len(places) >= 2
        for one, other in itertools.pairwise(places):
            assert one.x1 < other.x0


def test_an_error_bar_on_a_logarithmic_axis_does_not_reach_zero():
    """The standard error of two blocks is half of their logarithms' difference."""
    row = Compared("one", LAW, (1e-4, 1.0), 0.01, 1.0, 3, 1.0, "")
    left, *_ = plot.comparison(Comparison((row,), {}, 0.01), REC).axes
    (ends,) = left.collections[0].get_segments()
    np.testing.assert_allclose(ends[:, 0], [0.1, 1 + np.log(1e4) / 2], rtol=1e-9)


def test_errors_of_all_sizes_have_ticks_that_do_not_touch():
    lost = eqx.tree_at(
        lambda run: run.error, LED["constant gain"], 1e9 * jnp.asarray(W)
    )
    _, bottom = plot.tracking({"far": lost}).axes
    ticks = bottom.get_yticks()
    assert len(ticks) <= 11 and 0 in ticks
    size = np.max(np.abs(100 * np.asarray(lost.error) / np.ptp(W)))
    assert size / 1e3 < np.max(ticks) < 10 * size
    heights = bottom.transData.transform(np.stack([0 * ticks, ticks], 1))[:, 1]
    assert np.min(np.diff(heights)) > 10  # pixels


BATCHED = eqx.tree_at(lambda model: model.mass, SHAKER, jnp.ones(2))
STACKS, SLIDERS, PLANES = (
    jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), model)
    for model in (STACK, SLIDER, RELAYS)
)
IRON = hj.models.JilesAtherton(1.6e6, 1100.0, 400.0, 1.6e-3, 0.2)
IRONS = jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), IRON)
BATCH = jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), eqx.filter(TRAJ, eqx.is_array))


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: plot.loop(REC, LATER_TRAJ), "times of the recording, of 301 rows"),
        (lambda: plot.fit(REC.window(0, 9), TRAJ), "times of the recording, of 9 rows"),
        (lambda: plot.error(REC, BATCH), r"a batch, of shape \(2, 301\); pick one"),
        (lambda: plot.densities(STACKS), "`models` of .*densities` is a batch.*pick"),
        (lambda: plot.densities({"a": STACK, "b": STACKS}), "a batch, or a PrandtlIsh"),
        (lambda: plot.friction(SLIDERS), "`model` of .*friction` is a batch.*pick one"),
        (lambda: plot.preisach(PLANES), "`model` of .*preisach` is a batch.*pick one"),
        (lambda: plot.magnetisation(IRONS, TRAJ), "`model` of .* is a batch.*pick one"),
        (
            lambda: plot.magnetisation(IRON, BATCH),
            r"`trajectory` of .*\(2, 301\); pick",
        ),
        (
            lambda: plot.fit(REC, DIVERGED, weights=0 * T),
            "`weights` are all 0: no sample is left",
        ),
        (lambda: plot.loop(REC, TRAJ, labels=["a", "b"]), "each of 1 traj.*'a', 'b'"),
        (lambda: plot.loop(REC, TRAJ, labels="a"), "`labels` must hold"),
        (lambda: plot.record(REC, axes=[Figure().add_subplot()]), "two axes.*got 1"),
        (lambda: plot.overview(REC, TRAJ, LATER), "both `test_recording` and"),
        (
            lambda: plot.coefficient_path(THRESHOLDS, PATH.T, NAMED),
            r"\(m, k\); got \(5,\), 3 names and \(3, 5\)",
        ),
        (
            lambda: plot.coefficient_path(0 * THRESHOLDS, PATH, NAMED),
            "`thresholds` must be positive",
        ),
        (lambda: plot.hidden(REC, LAW), "a `models.Oscillator` or.*got a Duhem"),
        (lambda: plot.hidden(REC), "got none"),
        (lambda: plot.hidden(REC, OTHER, WINGS), "one kind at a time"),
        (
            lambda: plot.hidden(REC, BATCHED),
            "`found` of .*hidden` is a batch.*pick one",
        ),
        (lambda: plot.hidden(REC, OTHER, settled=True), "none is known.*by `window`"),
        (lambda: plot.hidden(CLOCKLESS, OTHER), "no clock .* this Oscillator depends"),
        (lambda: plot.hidden(PUSHED, OTHER, labels=["a", "b"]), "`labels` must hold"),
        (lambda: plot.densities({"a": STACK, "b": IN_MM}), "V', 'µm'.*V', 'mm'.*'b'"),
        (lambda: plot.friction(SLIDER, fastest=0.0), "`fastest` must be positive"),
        (lambda: plot.friction(SLIDER, AT_REST), "does not move; give `fastest`"),
        (lambda: plot.preisach(RELAYS, np.array([0.5, np.nan])), "`turns` has 1 value"),
        (lambda: plot.inclusion({}), "`shares` has no term .* among 0"),
        (lambda: plot.inclusion({"u": 0.0, "w": 0.004}), "0.5% or more .* among 2"),
        (lambda: plot.comparison(compared(np.inf), REC), "no family of `found` stays"),
        (lambda: plot.save(Figure(), "figure.jpg"), r"`path`.*\.png.*'figure\.jpg'"),
        (lambda: plot.save(Figure(), "no/such.png"), "no folder"),
    ],
)
def test_what_does_not_fit_is_refused(draw, message):
    with pytest.raises(InputError, match=message):
        draw()


def test_a_figure_comes_before_its_path(unchecked):
    with pytest.raises(InputError, match=r"'f\.png'.*`save\(figure, path\)`"):
        plot.save("f.png", Figure())


class Muffled(hj.models.Duhem):
    """A device of one's own, of which a tenth is measured."""

    def output(self, x, m, now):
        return x / 10

    def inner(self, x, m, now):
        return now.u, x

    def inner_axes(self, names, units):
        return (names[0], units[0]), ("what is muffled", "V")


def test_a_model_of_ones_own_shows_what_it_hides():
    time, loop = plot.hidden(REC, Muffled(0.4, 0.5, 0.25)).axes[:2]
    law = hj.models.Duhem(0.4, 0.5, 0.25)
    whole = hj.simulate(law, REC, method=hj.simulation.FixedStep(16)).w
    for ax, across in ((time, T), (loop, U)):
        ((x, y),) = drawn(ax)
        np.testing.assert_allclose(x, across, rtol=0, atol=1e-14)
        np.testing.assert_allclose(y, whole, rtol=0, atol=1e-14)
    assert loop.get_ylabel() == "what is muffled (V)"


def test_refinement_shows_the_fit_and_its_certainty():
    solution = refined()
    figure = plot.refinement(REC, DOUBLE, TRAJ, solution)
    before_after, correlation, band, autocorrelation = figure.axes[:4]
    assert_drawn(before_after, (T, DOUBLE.w - REC.w), (T, TRAJ.w - REC.w))
    ((shade,), stats) = band.collections, solution.stats
    edge = np.max(np.abs(shade.get_paths()[0].vertices[:, 1]))
    certain = 1.959964 * np.asarray(stats["certainty"].output)[0]
    np.testing.assert_allclose(edge, np.max(certain), rtol=1e-4)
    assert_drawn(band, (T, stats["residuals"][0]))
    names = [label.get_text() for label in correlation.get_xticklabels()]
    assert names == ["alpha", "beta", "gamma"]
    map_of = np.asarray(correlation.images[0].get_array())
    errors = np.sqrt(np.diag(stats["covariance"]))[:3]
    expected = stats["covariance"][:3, :3] / np.outer(errors, errors)
    np.testing.assert_allclose(map_of, expected, rtol=1e-12)
    assert autocorrelation.get_xlabel() == "lag (samples)"
    limit = 1.959964 / np.sqrt(len(T))
    white = np.unique(autocorrelation.patches[0].get_corners()[:, 1])
    np.testing.assert_allclose(white, [-limit, limit], rtol=1e-4)


def test_refinement_shows_the_fit_of_a_law_that_was_discovered():
    solution = refined()
    told = replace(solution, stats=solution.stats | {"weights": None})
    band = plot.refinement(REC, DOUBLE, TRAJ, told).axes[2]
    assert_drawn(band, (T, solution.stats["residuals"][0]))


@pytest.mark.parametrize("periodic", (True, False))
def test_refinement_shows_residuals_where_they_are_and_no_lead_in(periodic):
    noise = 0.05 * np.random.default_rng(1).normal(size=T.size)
    rows = slice(200, 300) if periodic else slice(None)
    record = hj.Recording(T[rows], U[rows], (np.asarray(TRAJ.w) + noise)[rows])
    lead_in = 300 if periodic else 200
    solution = hj.refine(
        LAW, record, free_start=False, periodic=periodic, lead_in=lead_in
    )
    judged = hj.judge(solution, record, periodic=periodic, lead_in=lead_in)
    run = judged.trajectory
    band = plot.refinement(judged.recording, run, run, solution).axes[2]
    ((across, residuals),) = drawn(band)
    np.testing.assert_allclose(across, T[rows][-len(across) :], rtol=0, atol=1e-14)
    # By other steps.
    np.testing.assert_allclose(residuals, run.w - judged.recording.w, rtol=0, atol=1e-6)
    edge = np.max(np.abs(band.collections[0].get_paths()[0].vertices[:, 1]))
    assert edge < np.std(noise)  # three numbers, told by a hundred samples


@pytest.mark.parametrize("count", (12, 13, 75))
def test_names_beside_a_map_of_many_parameters_do_not_cover_each_other(count):
    names = [f"weights[{i}]" for i in range(count)]
    nothing = jnp.zeros((1, len(REC)))
    known = {"lengths": np.array([len(REC)]), "residuals": nothing}
    fit = fit_of(LAW, names, np.eye(count + 1), **known)
    fit = eqx.tree_at(lambda each: each.certainty.output, fit, nothing)
    figure = plot.refinement(REC, DOUBLE, TRAJ, fit.solution())
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    labels = figure.axes[1].get_yticklabels()
    heights = [each.get_window_extent(canvas.get_renderer()) for each in labels]
    for above, below in itertools.pairwise(heights):
        assert above.y0 > below.y1
    shown = [each.get_text() for each in labels]
    step = int(figure.axes[1].get_yticks()[1])
    assert shown == names[::step] and len(shown) > 5


@pytest.mark.slow
def test_refinement_of_another_recording_is_refused():
    short = fit_of(LAW, ("alpha",), lengths=np.array([201])).solution()
    with pytest.raises(InputError, match=r"has 301 rows.*refined on 201"):
        plot.refinement(REC, DOUBLE, TRAJ, short)
