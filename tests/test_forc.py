"""First-order reversal curves: files, distributions and the model made of them."""

import re

import jax
import numpy as np
import pytest

import hystjax as hj
from benchmarks.loops import on_even_fields
from hystjax import InputError
from hystjax.loops import _forc
from hystjax.loops._surface import steps_of, surface

loops = hj.loops

STEP = 1e-3
CENTRE, WIDTH = 0.04, 0.012


def simulated(moment, n=70, low=-0.06, high=0.08, seed=None, noise=0.0):
    """Curves of a device whose moment is a function of (Ha, Hb), at uneven fields."""
    rng = np.random.default_rng(seed)
    parts = []
    for ha in np.linspace(0.01, low, n):
        hb = np.arange(ha, min(high, 0.02 * 2 - ha + 1e-9), STEP)
        hb = hb + 0.1 * STEP * np.sin(1e4 * hb)
        parts.append((hb, moment(hb[0], hb) + noise * rng.standard_normal(len(hb))))
    return loops.Curves(parts)


def quadratic(ha, hb):
    """With a mixed derivative that is exactly -2 times 3."""
    return 2.0 - 6 * ha * hb + 40 * ha**2 - 70 * hb**2 + ha + 5 * hb


def bump(ha, hb):
    """Relays whose thresholds are independent, each spread as the slope of a tanh."""
    down = (1 - np.tanh((ha + CENTRE) / WIDTH)) / 2
    return 1 - 2 * down * (1 - np.tanh((hb - CENTRE) / WIDTH)) / 2


def density(ha, hb):
    def slope(x):
        return (1 - np.tanh(x) ** 2) / 2 / WIDTH

    return slope((ha + CENTRE) / WIDTH) * slope((hb - CENTRE) / WIDTH)


FACTORS = [
    loops.Varying(2.0, 0.0, 2.0),
    loops.Varying((2.0, 1.0), (0.5, 0.05), (20.0, 3.0)),  # long in Hc
    loops.Varying((1.0, 2.0), (0.05, 0.5), (3.0, 20.0)),  # long in Hu
]


@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize("weights", ["equal", "tricube"])
@pytest.mark.parametrize("smoothing", [2, *FACTORS])
def test_a_quadratic_surface_is_exact_on_uneven_fields(smoothing, weights, bits):
    with jax.enable_x64(bits == 64):
        found = loops.forc(simulated(quadratic), smoothing=smoothing, weights=weights)
    known = np.isfinite(found.density)
    assert known.mean() > 0.5
    np.testing.assert_allclose(found.density[known], 3.0, rtol=3e-8)


def by_loop(curves, ha, hb, smoothing):
    """The mixed derivative at one place, by NumPy's least squares, without windows
    found by search, common scales or hats."""
    steps = [
        np.median(np.diff(np.unique(curves.reversal))),
        np.median(
            np.concatenate(
                [
                    np.diff(curves.field[a:b])
                    for a, b in zip(curves.starts[:-1], curves.starts[1:], strict=True)
                ]
            )
        ),
    ]
    wide, long = [(smoothing + 0.5) * step for step in steps]
    near = np.abs(curves.reversal - ha) <= wide
    near &= np.abs(curves.field - hb) <= long
    x = (curves.reversal[near] - ha) / wide
    y = (curves.field[near] - hb) / long
    if len(np.unique(x)) < 3 or near.sum() < 10:
        return np.nan, np.nan
    terms = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
    found, *_ = np.linalg.lstsq(terms, curves.moment[near], rcond=None)
    return -found[4] / (2 * wide * long), np.linalg.cond(terms)


@pytest.mark.parametrize("smoothing", [4, pytest.param(2, marks=pytest.mark.thorough)])
def test_density_is_that_of_least_squares_place_by_place(smoothing):
    curves = simulated(bump, n=35, seed=1, noise=1e-3)
    found = loops.forc(curves, smoothing=smoothing)
    across, along = np.meshgrid(found.hc, found.hu)
    each = [
        by_loop(curves, u - c, u + c, smoothing)
        for c, u in zip(across.ravel(), along.ravel(), strict=True)
    ]
    wanted, condition = np.moveaxis(np.reshape(each, (*across.shape, 2)), -1, 0)
    both = np.isfinite(found.density) & np.isfinite(wanted)
    assert both.mean() > 0.4
    apart = np.abs(found.density - wanted)[both] / np.abs(wanted[both]).max()
    # Normal equations lose twice the digits that the terms do.
    lost = np.finfo(float).eps * condition[both] ** 2
    assert np.all(apart < np.maximum(4 * lost, 1e-12))
    assert np.median(apart) < 1e-13


@pytest.mark.parametrize("smoothing", FACTORS)
def test_varying_densities_are_those_of_least_squares_along_hc_and_hu(smoothing):
    curves = simulated(bump, n=35, seed=1, noise=1e-3)
    hc, hu = np.linspace(0.005, 0.06, 9), np.linspace(-0.018, 0.012, 7)
    found = loops.forc(curves, smoothing=smoothing, hc=hc, hu=hu)
    across = (curves.field - curves.reversal) / 2
    along = (curves.field + curves.reversal) / 2
    assert np.isfinite(found.density).mean() > 0.8
    cut = []
    for row, column in zip(*np.nonzero(np.isfinite(found.density)), strict=True):
        smoothing = found.smoothing[:, row, column] + 0.5
        wide, high = smoothing * max(steps_of(curves)) / np.sqrt(2)
        ha, hb = hu[row] - hc[column], hu[row] + hc[column]
        ends = curves.reversal.min(), curves.reversal.max()
        cut.append(ha - wide - high < ends[0] or ha + wide + high > ends[1])
        if cut[-1]:
            wanted, _ = by_loop(curves, ha, hb, np.sqrt(smoothing.prod()) - 0.5)
        else:
            x, y = (across - hc[column]) / wide, (along - hu[row]) / high
            near = (np.abs(x) <= 1) & (np.abs(y) <= 1)
            x, y = x[near], y[near]
            terms = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
            fit = np.linalg.lstsq(terms, curves.moment[near], rcond=None)[0]
            wanted = -(fit[5] / high**2 - fit[3] / wide**2) / 4
        apart = np.abs(found.density[row, column] - wanted)
        assert apart < 1e-9 * np.nanmax(found.density)
    assert 0 < np.mean(cut) < 1


def test_a_moment_of_the_field_alone_has_no_density_at_the_edges():
    fields = STEP * np.arange(-40, 60)
    moment = np.tanh((fields + 0.01) / 0.004)
    curves = loops.Curves([(fields[n:], moment[n:]) for n in range(60)])
    found = loops.forc(curves, smoothing=loops.Varying((5.0, 3.0), 0.0))
    ha = found.hu[:, None] - found.hc
    reach = 9 / np.sqrt(2)  # of these two half widths, in steps
    low, high = -0.04 + reach * STEP, 0.019 - reach * STEP
    edge = np.isfinite(found.density) & (found.hc > 6 * STEP)
    edge &= (ha < low) | (ha > high)
    assert edge.sum() > 400
    size = 1 / 0.004**2  # of the second derivative of the moment
    assert np.all(np.abs(found.density[edge]) < 1e-12 * size)


@pytest.mark.parametrize("numbers", [[99, 1, 2], [-1, 1, 2], [0.0, 1.0, 2.0], "all"])
def test_curves_are_picked_by_numbers_that_there_are(numbers, unchecked):
    curves = simulated(bump, n=5)
    with pytest.raises(InputError, match=r"`numbers` must be .* from 0 to 4; got"):
        curves.pick(numbers)


def test_units_of_curves_are_a_pair(unchecked):
    parts = [(np.arange(3.0) + i, np.arange(3.0)) for i in range(3)]
    assert loops.Curves(parts, ["Oe", "emu"]).units == ("Oe", "emu")
    for units in ("T", "mT", ("T", None)):
        with pytest.raises(InputError, match="`units` must be a pair of texts"):
            loops.Curves(parts, units)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [40, pytest.param(500, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("weights", ["equal", "tricube"])
@pytest.mark.parametrize("smoothing", [3, loops.Varying((4.0, 2.0), (0.02, 0.1), 6.0)])
def test_standard_errors_cover_a_known_device(smoothing, seeds, weights):
    hc, hu = np.array([0.02, 0.03, 0.04, 0.05]), np.array([-0.01, 0.0, 0.01])
    across, along = np.meshgrid(hc, hu)
    truth = density(along - across, along + across)
    hits = []
    for seed in range(seeds):
        curves = simulated(bump, n=140, seed=seed, noise=0.02)
        found = loops.forc(curves, smoothing=smoothing, weights=weights, hc=hc, hu=hu)
        hits.append(np.abs(found.density - truth) < 1.96 * found.error)
    assert 0.93 < np.nanmean(hits) < 0.97


def grid_of_a_bump():
    """Reversal fields, fields, and moments with noise where they can be measured."""
    ha, hb = -0.06 + STEP * np.arange(70), -0.06 + STEP * np.arange(130)
    rng = np.random.default_rng(0)
    moment = bump(ha[:, None], hb) + 1e-3 * rng.standard_normal((70, 130))
    moment[hb < ha[:, None] - STEP / 2] = np.nan
    return ha, hb, moment


def grid_of_a_sediment():
    return on_even_fields(loops.read_forc(hj.datasets.path("forc_md00") / "MD00-2361"))


@pytest.mark.parametrize(
    "grid",
    [
        grid_of_a_bump,
        pytest.param(
            grid_of_a_sediment, marks=[pytest.mark.recordings, pytest.mark.slow]
        ),
    ],
)
def test_tricube_weights_are_those_of_pmagpy(grid):
    """On a regular grid of fields, where both mean the same neighbourhood."""
    pmagpy = pytest.importorskip("pmagpy.forc")
    ha, hb, moment = grid()
    span = 5 * (hb[1] - hb[0])
    spans = {"span_Ha_T": span, "span_Hb_T": span}
    wanted = pmagpy.loess_rho_from_grid_fast(ha, hb, moment, **spans)
    parts = [(hb[~np.isnan(each)], each[~np.isnan(each)]) for each in moment]
    a, b = np.meshgrid(ha, hb, indexing="ij")
    known = np.isfinite(wanted)
    assert known.sum() > 0.9 * np.isfinite(moment).sum()
    place = a[known], b[known], np.full(known.sum(), 4.5)
    ours = -surface(loops.Curves(parts), *place, tricube=True).mixed / 2
    atol = 1e-9 * np.nanmax(wanted)
    np.testing.assert_allclose(ours, wanted[known], rtol=0, atol=atol)


@pytest.mark.slow
def test_points_left_out_choose_more_smoothing_under_more_noise():
    chosen = [
        float(np.nanmax(loops.forc(simulated(bump, seed=0, noise=noise)).smoothing))
        for noise in (1e-5, 0.1)
    ]
    assert chosen[0] < chosen[1]
    found = loops.forc(simulated(bump, seed=0, noise=0.1))
    assert 0.09 < found.noise < 0.11
    assert list(found.compared) == [2, 3, 4, 5, 6, 7, 8]


def test_leaving_out_by_the_hat_is_leaving_out():
    curves = simulated(bump, n=20, seed=2, noise=0.01)
    steps = steps_of(curves)
    row = _forc._sample(curves)
    errors = _forc._left_out(curves, 2.0, steps, False)
    number = int(np.flatnonzero(np.isfinite(errors))[len(errors) // 3])
    place = row[number]
    ha, hb = curves.reversal[place], curves.field[place]
    # Without it, the field and all else as they are.
    wide, long = [2.5 * step for step in steps]
    near = (np.abs(curves.reversal - ha) <= wide) & (np.abs(curves.field - hb) <= long)
    near[place] = False
    x, y = (curves.reversal[near] - ha) / wide, (curves.field[near] - hb) / long
    terms = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
    without = np.linalg.lstsq(terms, curves.moment[near], rcond=None)[0][0]
    np.testing.assert_allclose(
        errors[number], curves.moment[place] - without, rtol=1e-8
    )


def test_varying_smoothing_grows_away_from_each_axis():
    varying = loops.Varying(least=(3.0, 2.0), growth=(0.1, 0.2), most=(5.0, 3.5))
    found = loops.forc(simulated(bump), smoothing=varying)
    assert found.smoothing.shape == (2, *found.density.shape)
    known = np.isfinite(found.density)
    assert np.array_equal(np.isfinite(found.smoothing), [known, known])
    step = found.hc[1]
    across, along = np.meshgrid(found.hc, np.abs(found.hu))
    wanted = (
        np.minimum(3 + 0.1 * across / step, 5),
        np.minimum(2 + 0.2 * along / step, 3.5),
    )
    for smoothing, each in zip(found.smoothing, wanted, strict=True):
        np.testing.assert_allclose(smoothing[known], each[known])
    assert "smoothing 3 to 5 in Hc and 2 to 3.5 in Hu" in str(found)


def test_a_central_ridge_is_sharper_with_little_smoothing_across_it():
    """Relays without bias: the density is half that of their Hc, at Hu = 0 alone."""
    broad = 0.03

    def ridge(ha, hb):
        up = np.tanh((np.minimum(hb, -ha) - CENTRE) / broad)
        return 1 - np.maximum(np.tanh((-ha - CENTRE) / broad) - up, 0.0)

    curves = simulated(ridge, n=140, low=-0.09)
    step = max(steps_of(curves))
    hc, hu = np.array([0.035, 0.045]), step / 4 * np.arange(-60, 61)
    wanted = (1 - np.tanh((hc - CENTRE) / broad) ** 2) / 2 / broad / 2
    heights, widths = [], []
    # 45 points each.
    one = (np.sqrt(45) - 1) / 2
    for smoothing in (
        one,
        loops.Varying(one, 0.0, one),
        loops.Varying((7.0, 1.0), 0.0),
    ):
        density = loops.forc(curves, smoothing=smoothing, hc=hc, hu=hu).density
        # However it is smoothed, as many relays are there.
        np.testing.assert_allclose(density.sum(axis=0) * step / 4, wanted, rtol=0.03)
        heights.append(density.max(axis=0))
        widths.append(np.sum(density > density.max(axis=0) / 2, axis=0))
    for other in (0, 1):
        assert np.all(heights[2] > 1.7 * heights[other])
        assert np.all(widths[2] < 0.6 * widths[other])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"least": 0.5}, "`least` must be 1 or more"),
        ({"least": (3.0, np.nan)}, "`least` must be 1 or more"),
        ({"least": (1.0, 2.0, 3.0)}, "`least` must be a number, or a pair"),
        ({"growth": (0.1, -0.1)}, "`growth` must be 0 or more"),
        ({"growth": "fast"}, "`growth` must be a number, or a pair"),
        ({"most": (9.0, 2.0)}, "`most` must be `least` or more"),
    ],
)
def test_bad_factors_are_named(given, says, unchecked):
    with pytest.raises(InputError, match=says):
        loops.Varying(**given)


def test_preisach_model_has_the_curves_it_was_made_of():
    curves = simulated(bump, n=70)
    model = loops.preisach(curves, levels=300)
    assert nrmse(model, curves) < 0.01


def test_few_curves_of_many_points_tell_all_moments():
    """Where curves begin farther apart than their points are, few are near a place."""
    curves = simulated(quadratic, n=12)
    nodes = np.linspace(curves.reversal.min(), curves.field.max(), 9)
    found = _forc._filled(curves, nodes, 2.0)
    np.testing.assert_allclose(found[0], quadratic(nodes[0], nodes), rtol=1e-8)
    assert np.all(np.isfinite(loops.preisach(curves, levels=8).weights))
    few = loops.Curves([(np.arange(3.0) + i, np.arange(3.0)) for i in range(3)])
    with pytest.raises(InputError, match="3 curves of 9 points do not tell"):
        loops.preisach(few, levels=2)


def nrmse(model, curves):
    """Of the model's reversal curves, each after saturation."""
    top = curves.field.max()
    u, rows, n = [], [], 0
    for a, b in zip(curves.starts[:-1], curves.starts[1:], strict=True):
        u += [top, *curves.field[a:b]]
        rows += range(n + 1, n + 1 + b - a)
        n += 1 + b - a
    w = np.asarray(hj.simulate(model, hj.Recording(None, u, u)).w)[rows]
    return float(np.sqrt(np.mean((w - curves.moment) ** 2)) / np.std(curves.moment))


def test_curves_left_out_are_predicted_by_the_model_of_the_others(unchecked):
    curves, out = simulated(bump, n=15), [2, 7, 12]
    model = loops.preisach(curves.pick(np.delete(np.arange(15), out)), levels=8)
    expected = nrmse(model, curves.pick(out))
    assert loops.left_out(curves, every=5, levels=8) == pytest.approx(expected)
    for every in (1, 30):
        with pytest.raises(InputError, match=f"one in {every} can be .* less than twi"):
            loops.left_out(curves, every=every)


def test_one_coercivity_is_told():
    """That of the largest density, known in closed form."""
    found = loops.forc(simulated(bump), smoothing=2, hc=np.array([CENTRE]))
    assert f"largest at Hc {CENTRE:g}, Hu 0 T" in str(found)


@pytest.mark.parametrize("hc", [np.linspace(0, 0.07, 8), np.array([0, 0.002, 0.2])])
def test_the_ridge_is_as_wide_whatever_the_axis(hc):
    """By the steps that were measured; and all counts where nothing is known beyond."""
    curves = simulated(bump)
    found = loops.forc(curves, smoothing=3, hc=hc)
    assert found.step == pytest.approx(STEP, rel=0.02)  # fields are a little uneven
    beyond = hc > 3 * found.step
    known = np.isfinite(found.density).any(axis=0)
    expected = beyond if np.any(beyond & known) else np.ones(len(hc), bool)
    np.testing.assert_array_equal(found.inner, expected)


def test_nothing_is_told_beyond_what_was_measured():
    curves = simulated(bump)
    found = loops.forc(
        curves,
        smoothing=6,
        hc=np.linspace(-0.02, 0.1, 41),
        hu=np.linspace(-0.06, 0.06, 41),
    )
    across, along = np.meshgrid(found.hc, found.hu)
    ha, hb = along - across, along + across
    inside = hb >= ha - found.step
    for field, values in ((curves.reversal, ha), (curves.field, hb)):
        low, high = np.min(field) - found.step, np.max(field) + found.step
        inside &= (values >= low) & (values <= high)
    for each in (found.density, found.error, *found.smoothing):
        assert np.any(np.isfinite(each[inside]))
        assert not np.any(np.isfinite(each[~inside]))


@pytest.mark.parametrize("hc", [["a"], [0.02, 0.01, 0.03], [0.01, 0.01], [np.nan]])
def test_axes_are_fields_that_rise(hc, unchecked):
    with pytest.raises(InputError, match="`hc` must be a column of finite fields that"):
        loops.forc(simulated(bump, n=5), smoothing=3, hc=hc)


@pytest.mark.usefixtures("unchecked")
def test_the_smoothing_of_a_model_is_one_number():
    with pytest.raises(InputError, match="`smoothing` must be one number"):
        loops.preisach(simulated(bump, n=5), smoothing=[2, 3])


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ([[0.1], [0.2], [0.3]], "field along a curve does not change"),
        ([[0.0, 0.1, 0.2]] * 3, "reversal field does not change"),
    ],
)
def test_curves_without_a_surface_are_refused(fields, says):
    curves = loops.Curves([(each, np.ones(len(each))) for each in fields])
    for verb in (loops.forc, loops.preisach):
        with pytest.raises(InputError, match=says):
            verb(curves)


@pytest.mark.parametrize("smoothing", [np.nan, np.inf, [2.0, np.nan], [[2.0], [3.0]]])
def test_smoothing_is_finite(smoothing, unchecked):
    with pytest.raises(InputError, match="`smoothing` must be 1 or more, and finite"):
        loops.forc(simulated(bump, n=5), smoothing=smoothing)


@pytest.mark.parametrize("weights", ["equal", "tricube"])
def test_a_smoothing_beyond_all_points_is_one_quadratic(weights):
    curves = simulated(bump, n=12)
    powers = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    terms = [curves.reversal**j * curves.field**k for j, k in powers]
    fit = np.linalg.lstsq(np.stack(terms, axis=1), curves.moment)[0]
    found = loops.forc(curves, smoothing=1e300, weights=weights)
    known = np.isfinite(found.density)  # within what was measured
    assert np.mean(known) > 0.4
    np.testing.assert_allclose(found.density[known], -fit[4] / 2, rtol=1e-6)


def even(curves, points):
    """Curves of a quadratic at even fields, 3 by 3 in a rectangle of smoothing 1."""
    return loops.Curves(
        [(ha + np.arange(points), ha * np.arange(points)) for ha in range(curves)]
    )


def test_points_on_the_rim_count_like_others():
    rng = np.random.default_rng(0)
    parts = [(x + np.arange(30.0), rng.normal(size=30)) for x in range(30)]
    curves = loops.Curves(parts)
    found = surface(curves, np.array([15.0]), np.array([30.0]), np.array([1.5]))
    x, y = curves.reversal - 15, curves.field - 30
    near = np.maximum(np.abs(x), np.abs(y)) <= 2
    terms = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
    fit = np.linalg.lstsq(terms[near], curves.moment[near])[0]
    np.testing.assert_allclose((found.moment[0], found.mixed[0]), fit[[0, 4]])


def test_ten_points_tell_a_quadratic():
    """Of four curves near the diagonal 4, 3, 2 and 1."""
    one, two = np.ones(1), np.full(1, 2.0)
    assert surface(even(30, 30), one, one, two).mixed == pytest.approx(1.0)
    assert np.isnan(surface(even(30, 30), 0 * one, 0 * one, two).mixed)


def test_a_diagram_says_by_what_its_densities_are_multiplied():
    found = loops.forc(simulated(bump), smoothing=2)
    (drawn, *_) = hj.plot.forc(found).axes[0].collections
    power = re.search(r"10\$\^\{(-?\d+)\}", drawn.colorbar.ax.get_ylabel())[1]
    shown = drawn.get_array().filled(np.nan)
    np.testing.assert_allclose(shown * 10.0 ** int(power), found.density)


@pytest.mark.parametrize("points", [3, 30])
def test_a_smoothing_of_too_few_points_is_refused(points):
    with pytest.raises(InputError, match=r"1\.0 holds 10 points.*larger `smoothing`"):
        loops.forc(even(30, points), smoothing=1)


def test_a_smoothing_of_too_few_points_is_not_compared():
    assert list(loops.forc(even(30, 30), smoothing=[1, 2]).compared) == [2.0]


HEAD = """MicroMag 2900/3900 Data File (Series 0016.002)
First-order reversal curves

INSTRUMENT
Units of measure                Hybrid SI
NForc                           3
Number of data                  12

    Field         Moment
     (T)          (Am2)
"""
CALIBRATION = "+100.0000E-03,+{:.6E}\n\n"
ROWS = (
    "+10.00000E-03,+1.000000E-06\n+11.00000E-03,+1.100000E-06\n"
    "+12.00000E-03,+1.200000E-06\n\n"
)
FOOT = "MicroMag 2900/3900 Data File ends\n"


def micromag(levels=(2e-6, 2e-6, 2e-6)):
    body = "".join(CALIBRATION.format(each) + ROWS for each in levels)
    return HEAD + "\n" + body + FOOT


def test_micromag_files_are_read_and_drift_is_divided_out(tmp_path):
    path = tmp_path / "device"
    path.write_text(micromag((1e-6, 2e-6, 3e-6)))
    raw, mended = (loops.read_forc(path, drift=drift) for drift in (False, True))
    assert len(raw) == 3
    assert raw.units == ("T", "A m²")
    np.testing.assert_allclose(raw.moment[:3], [1e-6, 1.1e-6, 1.2e-6])
    # Curves keep their order where reversal fields are equal. Calibrations go from
    # 1 to 3, so the first of three rows is measured at 1.25, of a mean of 2.
    np.testing.assert_allclose(mended.moment[0] / raw.moment[0], 2 / 1.25)
    np.testing.assert_allclose(mended.moment[-1] / raw.moment[-1], 2 / 3)


BROKEN = {
    "footer": (micromag().replace(FOOT, ""), "does not end with"),
    "missing": (
        micromag().replace("NForc                           3", "NForc 5"),
        "holds 3 reversal curves where its header promises 5",
    ),
    "units": (micromag().replace("(T)", "(Oe)"), r"fields are in T, and has \(Oe\)"),
    "count": (
        micromag().replace("data                  12", "data 99"),
        "12 rows of field and moment, with 99 promised",
    ),
    "falling": (
        "3 1\n2 2\n1 3\n\n2 1\n1 2\n0 3\n\n1 1\n0 2\n-1 3\n",
        "falls along curve 1, from 3 to 1",
    ),
    "one": ("1 1\n2 2\n3 3\n", "3 reversal curves or more, got 1"),
    "words": ("1 1\n2 2\n\n1 x\n2 2\n", "'x', which is not a number, in line 4 of"),
    "names": ("time,Moment [emu]\n1,2\n2,3\n", "no column with 'field' in its name"),
    "words below": ("A,1\n##DATA TABLE\nField,Moment\n1,1\n2,x\n3,2\n", "line 5 "),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_refused_by_what_is_wrong(name, tmp_path):
    text, says = BROKEN[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        loops.read_forc(path)


@pytest.mark.parametrize("way", ["blank", "falling", "lake shore"])
def test_columns_of_text_are_read(way, tmp_path):
    curves = simulated(bump, n=12)
    parts = [
        np.stack([curves.field[a:b] * 1e4, curves.moment[a:b] * 1e3], axis=1)
        for a, b in zip(curves.starts[:-1], curves.starts[1:], strict=True)
    ][::-1]
    between = "\n" if way == "blank" else ""
    rows = between.join(
        "".join(f"{h!r},{m!r}\n" for h, m in part.tolist()) for part in parts
    )
    head = "Field [Oe],Moment [emu]\n"
    if way == "lake shore":
        above = "#Sample: x\nAveraging time,0.5,s\n##DATA TABLE\n"
        # As the 8600 writes it.
        head = f"{above}Target field [Oe],Field [Oe],Moment (m) [emu]\n"
        rows = "".join(f"1,{line}\n" for line in rows.splitlines())
    path = tmp_path / "curves.csv"
    path.write_text(head + rows)
    read = loops.read_forc(path)
    assert read.units == ("T", "A m²")
    np.testing.assert_allclose(read.field, curves.field)
    np.testing.assert_allclose(read.moment, curves.moment)


fine_inside = np.concatenate(
    [
        np.arange(-0.08, -0.05, 0.004),
        np.arange(-0.05, 0.05, 0.001),
        np.arange(0.05, 0.08, 0.004),
    ]
)


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize(
    "fields",
    [
        [np.append(r, fine_inside[fine_inside > r]) for r in np.linspace(0.05, -0.07)],
        [np.arange(r, 0.0801, 0.0015) for r in np.arange(0.078, -0.07, -0.0015)],
    ],
    ids=["fine inside", "short first"],
)
def test_one_table_is_cut_where_the_field_falls_back(fields, apart, tmp_path):
    """Also with a point at 0.2 T before each curve, which tells of drift."""
    rows = [[0.2, *each] if apart else each for each in fields]
    text = "".join(f"{h:.8g},{1 + h:.8g}\n" for each in rows for h in each)
    path = tmp_path / "curves.csv"
    path.write_text("Field (T),Moment (A m2)\n" + text)
    read = loops.read_forc(path)
    assert len(read) == len(fields)
    np.testing.assert_allclose(read.field, np.concatenate(fields[::-1]), rtol=1e-7)
    np.testing.assert_allclose(read.moment, 1 + read.field)


@pytest.mark.parametrize(
    ("head", "separator", "comma"),
    [
        ("Applied Field [T];Magnetic Moment [A m2]\n", ";", False),
        ("H (T)\tM (A m2)\n", "\t", True),
        ("\N{GREEK SMALL LETTER MU}0 H (T);m (A m2)\n", ";", True),
        ("Sample: a piece of rock\nBy: X\n\nField (T);Moment (A m2)\n", ";", False),
    ],
)
def test_columns_by_other_names_and_below_lines_of_text(
    head, separator, comma, tmp_path
):
    curves = simulated(quadratic, n=5)
    parts = [
        np.stack([curves.field[a:b], curves.moment[a:b]], axis=1).tolist()
        for a, b in zip(curves.starts[:-1], curves.starts[1:], strict=True)
    ]
    rows = "\n".join(
        "".join(f"{h!r}{separator}{m!r}\n" for h, m in part) for part in parts
    )
    path = tmp_path / "curves.csv"
    text = head + (rows.replace(".", ",") if comma else rows)
    path.write_text(text, encoding="utf-8")
    read = loops.read_forc(path)
    assert read.units == ("T", "A m²") and len(read) == 5
    np.testing.assert_array_equal(read.field, curves.field)
    np.testing.assert_array_equal(read.moment, curves.moment)


def test_recordings_are_curves_too(unchecked):
    curves = simulated(quadratic, n=20)
    recordings = [
        hj.Recording(None, curves.field[a:b], curves.moment[a:b])
        for a, b in zip(curves.starts[:-1], curves.starts[1:], strict=True)
    ]
    found = loops.forc(recordings, smoothing=2)
    np.testing.assert_allclose(np.nanmedian(found.density), 3.0, rtol=1e-8)
    other = hj.Recording(None, [1.0, 2, 3], [1.0, 2, 3], units=("Oe", "emu"))
    with pytest.raises(InputError, match="different units"):
        loops.forc([*recordings, other])
    with pytest.raises(InputError, match=r"`curves` must be.*got str"):
        loops.forc("curves.txt")
    with pytest.raises(InputError, match=r"`smoothing` must be 1 or more.*0\.5"):
        loops.forc(recordings, smoothing=0.5)
    with pytest.raises(InputError, match=r"`levels` must be a whole number.*2\.5"):
        loops.preisach(recordings, levels=2.5)
    with pytest.raises(InputError, match="`levels` must be at least 2, got 1"):
        loops.preisach(recordings, levels=1)
    with pytest.raises(InputError, match=r"`every` must be a whole number.*2\.5"):
        loops.left_out(recordings, every=2.5)


@pytest.mark.recordings
def test_measured_curves_left_out_are_predicted():
    curves = loops.read_forc(hj.datasets.path("forc_md00") / "MD00-2361")
    assert len(curves) == 297
    out = np.arange(5, len(curves), 10)
    kept = np.setdiff1d(np.arange(len(curves)), out)
    model = loops.preisach(curves.pick(kept))
    assert nrmse(model, curves.pick(out)) < 0.01
