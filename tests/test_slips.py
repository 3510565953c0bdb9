"""Arguments that were swapped, taken whole or of another kind: what is said then."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

import hystjax as hj

pytestmark = pytest.mark.usefixtures("unchecked")

T = np.linspace(0.0, 6.0, 40)
U, W = np.sin(2 * T), 0.3 * np.sin(2 * T - 0.4)
R = hj.Recording(T, U, W)
MAGNET = hj.Recording(T, U, W, units=("A/m", "T"))
TERMS = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
law_of: Any = hj.models.SparseModel.from_terms
LAW = law_of(TERMS)
LAWS = jax.vmap(lambda x: LAW.with_parameters({"du": x}))(jnp.array([0.2, 0.3]))
BATCH = jax.tree.map(lambda *x: jnp.stack(x), R, R)
SOLUTION = hj.Solution(LAW, hj.RESULTS.successful, {})
LIBRARY = hj.library.Polynomial(1)
KEY = jax.random.key(0)
STACK = hj.models.PrandtlIshlinskii([0.0, 0.1], [0.6, 0.4])
PROPERTIES = hj.properties
DRIVE = PROPERTIES.Drive(-1.0, 1.0, 2.0)
GRID = hj.sweeping.Grid(a=[1.0, 2.0])
ONE, ONES, SQUARE = (jnp.ones((1,) * d) for d in range(3))
STABILITY = hj.Stability(("u",), ONES, SQUARE, ONE, ONE)
CERTAINTY = hj.refinement.Certainty(("u",), SQUARE, ONES, SQUARE, SQUARE, ONE)


RUN = hj.simulate(LAW, R)
GRIDDED = xarray.DataArray(np.eye(2), dims=("a", "b"))
LUGRE = hj.models.LuGre(1.0, 0.1, 0.01, 1.0, 1.5, 0.1)


def judged():
    return hj.judge(LAW, R, method=hj.simulation.FixedStep(1))


def lane(a):
    return {"x": a}


def held(reference):
    """What is not known to be constant where it is traced."""
    return hj.control(STACK, reference, T).value


class Sum(hj.models.AbstractSequenceModel):
    interval: jax.Array

    def response(self, u, w0):
        return w0 + self.interval * jnp.cumsum(u)

    def __str__(self):
        return "a sum"


SEQUENCE = Sum(jnp.asarray(T[1]))


class Own(hj.models.AbstractModel):
    """A model whose answers are what it is made with."""

    first: Any = 0.0
    slope: Any = 0.0
    made: Any = 0.0

    def start(self, m, now, seen):
        return self.first

    def rate(self, x, m, now):
        return self.slope

    def output(self, x, m, now):
        return self.made


class ByNumPy(Own):
    def rate(self, x, m, now):
        return np.sin(x)


class ByIf(Own):
    def output(self, x, m, now):
        return x if x > 0 else -x


class Kept(hj.library.AbstractMemory):
    """A memory that goes on as it is told: from what it was, and by the input."""

    following: Any = eqx.field(static=True)

    def start(self, now):
        return now.u

    def after(self, m, before, now):
        return self.following(m, now.u)

    def values(self, m, now):
        return {}


class Keeping(Own):
    kept: Any = None

    @property
    def memory(self):
        return self.kept


def following(following):
    return hj.simulate(Keeping(kept=Kept(following)), R)


class Answering(Sum):
    answer: Any = eqx.field(static=True)

    def response(self, u, w0):
        return self.answer(u)


def answering(answer):
    return hj.simulate(Answering(jnp.asarray(T[1]), answer), R)


class Late(hj.simulation.FixedStep):
    def integrate(self, model, path, w0, scale):
        w, result, stats = super().integrate(model, path, w0, scale)
        return w[1:], result, stats


SLIPS = {
    "regression.aliases(r)": (
        lambda: hj.regression.aliases(R, LIBRARY),
        "`problem`.*a Recording.*`hystjax.aliases`",
    ),
    "STLSQ.fit(r)": (
        lambda: hj.regression.STLSQ().fit(R),
        "`problem`.*a Recording.*`hystjax.identify`",
    ),
    "LeastSquares.fit(r)": (
        lambda: hj.regression.LeastSquares().fit(R),
        "`problem`.*a Recording.*`hystjax.identify`",
    ),
    "simulate(r, law)": (lambda: hj.simulate(R, LAW), "swapped.*simulate.model, rec"),
    "judge(r, law)": (lambda: hj.judge(R, LAW), "swapped.*judge.model, rec"),
    "refine(r, law)": (lambda: hj.refine(R, LAW), "swapped.*refine.model, rec"),
    "refine(law, law)": (lambda: hj.refine(LAW, LAW), "`recordings`.*a SparseModel"),
    "invert(r, law)": (lambda: hj.invert(R, LAW), "swapped.*invert.model, ref"),
    "bootstrap(r, law)": (lambda: hj.bootstrap(R, LAW, key=KEY), "swapped.*bootst"),
    "bootstrap(throw)": (
        lambda: hj.bootstrap(LAW, R, key=KEY, throw=False),
        "`bootstrap` has no `throw`.*`good`",
    ),
    "from_mat(rows)": (
        lambda: hj.Recording.from_mat("x.mat", input="u", output="w", rows=(0, 9)),
        "no argument `rows`",
    ),
    "energy(losses)": (
        lambda: hj.plot.energy(hj.loops.core_loss(MAGNET)),
        r"`dataset` must be what .*summary.*without `damping`.*summary\(recording\)",
    ),
    "cycles(r, several)": (
        lambda: hj.plot.cycles(MAGNET, hj.loops.side_by_side(MAGNET, {"x": MAGNET})),
        r"several runs: .*sel\(source=",
    ),
    "generate(r)": (lambda: hj.generate(R, hj.excitation.Sine(1.0, 1.0), T), "a Rec"),
    "simulate(law, u)": (
        lambda: hj.simulate(LAW, U),
        r"array of shape \(40,\).*Recording\(t, u, w\)",
    ),
    "simulate(law, sine)": (
        lambda: hj.simulate(LAW, hj.excitation.Sine(1.0, 1.0)),
        r"a Sine.*excitation.path\(t\)",
    ),
    "simulate(path, r)": (lambda: hj.simulate("law.json", R), "hystjax.load"),
    "simulate(terms, r)": (lambda: hj.simulate(TERMS, R), "from_terms"),
    "from_terms(list)": (lambda: law_of(["u", "w"]), "`terms`.*names of terms.*a list"),
    "with_parameters(list)": (
        lambda: hj.models.Dahl(2.0, 1.0).with_parameters([3.0, 1.0]),
        r"`values`.*by their names.*\{'stiffness': 1\.0\}.*a list",
    ),
    "from_terms(text)": (lambda: law_of("u"), "`terms`.*the text 'u'"),
    "from_terms(place)": (lambda: law_of({0: 1.0}), r"by its name.*the number 0"),
    "from_terms(word)": (lambda: law_of({"u": "a"}), "real numbers.*the text 'a'"),
    "from_terms(None)": (lambda: law_of({"u": None}), "real numbers.*None"),
    "from_terms(1j)": (lambda: law_of({"u": 1j}), "real numbers.*1j"),
    "from_terms([1, 2])": (lambda: law_of({"u": [1, 2]}), r"must be a number.*\(2,"),
    "library + text": (
        lambda: LIBRARY + "u",
        "`library` must be candidate terms, got the text 'u'",
    ),
    "library * 3": (
        lambda: LIBRARY * 3,
        "`library` must be candidate terms, got the number 3",
    ),
    "Fourier(2)": (lambda: hj.library.Fourier(2.0), "`multiples`"),
    "Custom(function)": (lambda: hj.library.Custom(np.tanh), "`functions`.*by name"),
    "Custom(text)": (lambda: hj.library.Custom({"knee": "u**3"}), "`functions`.*name"),
    "simulate(library, r)": (lambda: hj.simulate(LIBRARY, R), "hystjax.identify"),
    "judge(law, None)": (lambda: hj.judge(LAW, None), "`recording`.*None"),
    "judge(law, [r])": (lambda: hj.judge(LAW, [R]), "one recording at a time"),
    "outliers(file)": (lambda: hj.outliers("a.csv"), "`recording`.*from_csv"),
    "outliers([r])": (lambda: hj.outliers([R]), "one recording at a time"),
    "outliers(batch)": (lambda: hj.outliers(BATCH), "`recording` holds a batch"),
    "steady(file)": (lambda: hj.steady("a.csv", 20), "`recording`.*from_csv"),
    "judge(law, file)": (lambda: hj.judge(LAW, "a.csv"), "from_csv"),
    "identify(r, text)": (
        lambda: hj.identify(R, "polynomial"),
        "Did you mean 'Polynomial'",
    ),
    "identify(l, r)": (lambda: hj.identify(LIBRARY, R), "swapped.*recordings, library"),
    "identify(r, r)": (lambda: hj.identify(R, R), "`library`.*a Recording.*swapped"),
    "discover(l, r)": (lambda: hj.discover(LIBRARY, R), "swapped"),
    "discover(r, text)": (lambda: hj.discover(R, "boucwenn"), "Did you mean 'BoucWen'"),
    "discover by values": (
        lambda: hj.discover(R, LIBRARY, formulation=hj.formulation.Direct()),
        r"WeakForm\(20\)`, got `Direct`.*`identify\(recordings, library",
    ),
    "discover a value of itself": (
        lambda: hj.discover(R, target="value"),
        r"cannot hold w: leave out \['w'.*of `library`.*`library.Play\(radii\)`",
    ),
    "a function of one's own in a law by names": (
        lambda: hj.models.SparseModel.from_terms({"knee": 1.0}),
        r"'knee' in the term.*Functions of your own .* `hystjax\.library\.Custom`",
    ),
    "aliases(l, r)": (
        lambda: hj.aliases(LIBRARY, R),
        r"swapped.*aliases\(recordings, library\)",
    ),
    "suggest(r, law)": (
        lambda: hj.suggest_excitation(R, LAW, LIBRARY),
        "swapped.*law, recording, library",
    ),
    "inclusion of another": (
        lambda: hj.inclusion(SOLUTION, R, key=KEY),
        "what `discover` returned.*another verb",
    ),
    "refine(spread='wide')": (
        lambda: hj.refine(LAW, R, spread="wide"),
        "`spread` must be one number, got the text 'wide'",
    ),
    "refine(free_start='yes')": (
        lambda: hj.refine(LAW, R, free_start="yes"),
        "`free_start` must be True, False .* got the text 'yes'",
    ),
    "inclusion(law)": (lambda: hj.inclusion(LAW, R, key=KEY), "got a SparseModel"),
    "stability by ridge": (
        lambda: hj.stability(R, LIBRARY, hj.regression.Ridge(), key=KEY),
        "`STLSQ`.*a Ridge",
    ),
    "stability, 2.5 samples": (
        lambda: hj.stability(R, LIBRARY, key=KEY, samples=2.5),
        "`samples`.*whole number",
    ),
    "bootstrap, 2.5 samples": (
        lambda: hj.bootstrap(LAW, R, key=KEY, samples=2.5),
        "`samples`.*whole number",
    ),
    "complete, text": (
        lambda: hj.complete(LAW, R, "polynomial", key=KEY),
        "Did you mean 'Polynomial'",
    ),
    "complete, 2.5 units": (
        lambda: hj.models.Hybrid.untrained(LAW, R, key=KEY, width=2.5),
        "`width`.*whole number",
    ),
    "identify long, text": (
        lambda: hj.identify(hj.LongRecording(T, U, W), "duhem"),
        "`library`.*Did you mean 'Duhem'",
    ),
    "window of 5.0": (
        lambda: hj.differentiation.SavitzkyGolay(5.0, 2),
        "`window` must be a whole number, got the number 5.0",
    ),
    "order, text": (
        lambda: hj.differentiation.SavitzkyGolay(5, "2"),
        "`order` must be a whole number, got the text '2'",
    ),
    "penalties": (
        lambda: hj.differentiation.TotalVariation((1.0, 2.0)),
        "`penalty` must be one finite number, got a tuple",
    ),
    "factor of 2.5": (
        lambda: hj.interpolation.BandLimited(2.5),
        "`factor` must be a whole number, got the number 2.5",
    ),
    "factor of 0": (
        lambda: hj.interpolation.BandLimited(0),
        "`factor` must be at least 1, got 0",
    ),
    "input by NumPy": (lambda: R.with_input(np.sin), "`jax.numpy.sin` for `numpy.sin`"),
    "exact by NumPy": (
        lambda: hj.Recording(T, U, W, interpolation=hj.interpolation.Exact(np.sin)),
        "`jax.numpy.sin` for `numpy.sin`",
    ),
    "between dates": (
        lambda: R.between("2026-01-31", 9),
        "`start` must be one number, got the text '2026-01-31'",
    ),
    "between no end": (lambda: R.between(1, None), "`stop` must be one number"),
    "multisine by a seed": (
        lambda: hj.excitation.Multisine([1.0], 1.0, key=0),
        "`key` must be a key of `jax.random`, got the number 0",
    ),
    "noise levels": (
        lambda: hj.generate(LAW, hj.excitation.Sine(1.0, 1.0), T, additive=[0.1, 0.2]),
        "`additive` must be one number, got a list",
    ),
    "a network for two units": (
        lambda: hj.models.Hybrid.untrained(
            LAW, [R, hj.Recording(T, U, W, units=("mV", ""))], key=KEY
        ),
        "Convert the columns to one unit each",
    ),
    "identify by a name": (
        lambda: hj.identify(R, LIBRARY, "STLSQ"),
        r"`AbstractRegression`, such as `regression.STLSQ\(\)`; got the text 'STLSQ'",
    ),
    "identify by many thresholds": (
        lambda: hj.identify(R, LIBRARY, hj.regression.STLSQ(np.array([0.1, 0.2]))),
        r"`threshold` must be one number, got an array of shape \(2,\)",
    ),
    "identify by many ridges": (
        lambda: hj.identify(R, LIBRARY, hj.regression.Ridge(jnp.ones(3))),
        r"`ridge` must be one number, got an array of shape \(3,\)",
    ),
    "identify by a class": (
        lambda: hj.identify(R, LIBRARY, hj.regression.STLSQ),
        "`regression`.*got the class STLSQ",
    ),
    "identify, formulation": (
        lambda: hj.identify(R, LIBRARY, formulation="weak"),
        r"`formulation`.*formulation.WeakForm\(20\)`; got the text 'weak'",
    ),
    "identify, differentiation": (
        lambda: hj.identify(R, LIBRARY, differentiation="central"),
        "`differentiation`.*got the text 'central'",
    ),
    "identify, weighting": (
        lambda: hj.identify(R, LIBRARY, weighting="bisquare"),
        "`weighting`.*got the text 'bisquare'",
    ),
    "identify, one weight": (
        lambda: hj.identify(R, LIBRARY, weights=1.0),
        "`weights` needs one array for each of the 1 recordings, got the number 1.0",
    ),
    "discover around an oscillator, without times": (
        lambda: hj.discover(
            hj.Recording(T, U, W, clocked=False),
            hj.library.Duhem(),
            around=lambda law: hj.models.Oscillator(1.0, 0.1, 2.0, law),
            size=1.0,
            key=KEY,
        ),
        "no clock .*this Oscillator depends on the rate.*Give the recording its times",
    ),
    "discover, formulation": (
        lambda: hj.discover(R, LIBRARY, formulation="weak"),
        "`formulation`.*got the text 'weak'",
    ),
    "discover, seconds": (
        lambda: hj.discover(R, LIBRARY, seconds="60"),
        "`seconds` must be one number, got the text '60'",
    ),
    "discover, seconds twice": (
        lambda: hj.discover(R, LIBRARY, seconds=[60.0, 90.0]),
        "`seconds` must be one number, got a list",
    ),
    "discover, sizes": (
        lambda: hj.discover(
            R, LIBRARY, around=hj.models.Butterfly, size=[1.0, 2.0], key=KEY
        ),
        "`size` must be one number, got a list",
    ),
    "discover, fading": (
        lambda: hj.discover(R, LIBRARY, fading="much"),
        "`fading` must be a share",
    ),
    "discover, seed": (
        lambda: hj.discover(R, LIBRARY, around=hj.models.Butterfly, size=1.0, key=0),
        "jax.random.key",
    ),
    "discover around nothing": (
        lambda: hj.discover(R, LIBRARY, around=lambda law: 3),
        "`around` must make a model of a law.*it made the number 3",
    ),
    "discover around a class that takes more": (
        lambda: hj.discover(R, LIBRARY, around=hj.models.Oscillator),
        "`around` must take a law alone, as `lambda law: .*argument: 'damping'",
    ),
    "with_parameters(list) of a law": (
        lambda: LAW.with_parameters([3.0]),
        "`values` must be parameters by their names",
    ),
    "with_parameters(number) of a whole": (
        lambda: hj.models.Instrumented(LAW, output_offset=0.0).with_parameters(1.0),
        "`values` must be parameters by their names",
    ),
    "with_parameters(several)": (
        lambda: LAW.with_parameters({"du": [1.0, 2.0]}),
        r"'du' must be one number, got an array of shape \(2,\); make a batch .*vmap",
    ),
    "free_start(several)": (
        lambda: hj.refine(LAW, R, free_start=np.ones(2, bool)),  # pyright: ignore
        r"`free_start` must be True, False .*got an array of shape \(2,\)",
    ),
    "fading(several)": (
        lambda: hj.refine(LAW, R, fading=np.ones(2)),  # pyright: ignore
        r"`fading` must be a share from 0 to 1.*got an array of shape \(2,\)",
    ),
    "w0(complex)": (
        lambda: hj.judge(LAW, R, w0=0.1 + 5j),
        "`w0` must be one number.*got the number",
    ),
    "judge(periodic)": (
        lambda: hj.judge(LAW, R, periodic=20),  # pyright: ignore
        "`periodic` must be True or False, got the number 20",
    ),
    "refine(periodic)": (
        lambda: hj.refine(LAW, R, periodic=T),  # pyright: ignore
        r"`periodic` must be True or False, got an array of shape \(40,\)",
    ),
    "bootstrap(periodic)": (
        lambda: hj.bootstrap(LAW, R, key=KEY, periodic=20),  # pyright: ignore
        "`periodic` must be True or False, got the number 20",
    ),
    "discover(odd)": (
        lambda: hj.discover(R, odd=1),  # pyright: ignore
        "`odd` must be True or False, got the number 1",
    ),
    "identify(throw)": (
        lambda: hj.identify(R, throw="no"),  # pyright: ignore
        "`throw` must be True or False, got the text 'no'",
    ),
    "complete(guard)": (
        lambda: hj.complete(LAW, R, key=KEY, guard=0),  # pyright: ignore
        "`guard` must be True or False, got the number 0",
    ),
    "compare(progress)": (
        lambda: hj.compare(R, progress=[]),  # pyright: ignore
        "`progress` must be True or False, got a list",
    ),
    "simulate(throw)": (
        lambda: hj.simulate(LAW, R, throw=None),  # pyright: ignore
        "`throw` must be True or False, got None",
    ),
    "judge by a name": (
        lambda: hj.judge(LAW, R, method="rk4"),
        r"`method`.*`simulation.Adaptive\(\)`; got the text 'rk4'",
    ),
    "simulate by a class": (
        lambda: hj.simulate(LAW, R, method=hj.simulation.FixedStep),
        "`method`.*got the class FixedStep",
    ),
    "a start that is text": (
        lambda: hj.simulate(LAW, R, w0="a"),
        "`w0` must be one number.*got the text 'a'",
    ),
    "load a model": (lambda: hj.load(LAW), "`path` must name a file, got a Sparse"),
    "generate from numbers": (
        lambda: hj.generate(LAW, R.u, R.t),
        r"`excitation`.*`excitation.Sine\(1.0, 1.0\)`; got an array",
    ),
    "export with numbers": (
        lambda: hj.export.to_c(LAW, record=R.u),
        "`record` must be an `Recording`.*got an array",
    ),
    "export under a number": (lambda: hj.export.to_c(LAW, name=3), "`name`.*got 3"),
    "half a digit": (
        lambda: hj.export.to_text(LAW, digits=2.5),
        "`digits` must be a whole number",
    ),
    "refine, solver": (
        lambda: hj.refine(LAW, R, solver="lm"),
        "`solver` must be a solver of Optimistix.*got the text 'lm'",
    ),
    "refine, loss": (
        lambda: hj.refine(LAW, R, loss=hj.refinement.Huber),
        r"`loss`.*`refinement.Huber\(0.1\)`; got the class Huber",
    ),
    "refine, shooting": (
        lambda: hj.refine(LAW, R, shooting=5),
        r"`shooting`.*MultipleShooting\(4\)`; got the number 5",
    ),
    "refine, half a piece": (
        lambda: hj.refinement.MultipleShooting(2.5),
        "`pieces` must be a whole number, got the number 2.5",
    ),
    "refine, gaps that open": (
        lambda: hj.refinement.MultipleShooting(4, (100.0, 1.0)),
        r"`weights` must be positive and increase, got \(100.0, 1.0\)",
    ),
    "refine, 2.5 substeps": (
        lambda: hj.refine(LAW, R, substeps=2.5),
        "`substeps` must be a whole number, got the number 2.5",
    ),
    "a polynomial or not": (
        lambda: hj.library.Polynomial(True),
        "`degree` must be a whole number, got the number True",
    ),
    "periods or not": (
        lambda: hj.excitation.Triangle(1.0, 1.0, True),
        "`periods` must be a whole number, got the number True",
    ),
    "refine, max_steps": (
        lambda: hj.refine(LAW, R, max_steps=2.5),
        "`max_steps` must be a whole number",
    ),
    "split in words": (
        lambda: R.split("half"),
        "`fraction` must be a share from 0 to 1; got the text 'half'",
    ),
    "aliases, tolerance": (
        lambda: hj.aliases(R, LIBRARY, tolerance=-1),
        "`tolerance` must be a share from 0 to 1; got the number -1",
    ),
    "suggest_excitation, tolerance": (
        lambda: hj.suggest_excitation(LAW, R, LIBRARY, tolerance="much"),
        "`tolerance` must be a share from 0 to 1; got the text 'much'",
    ),
    "a guess of recordings": (
        lambda: hj.models.Dahl.guess([R]),
        "`recording` must be a `Recording`, got a list. Give one recording at a time",
    ),
    "a guess of an input": (
        lambda: hj.models.Everett.guess(R.path),
        r"must be a `Recording`.*`Everett.guess\(recording\)`",
    ),
    "half a test function": (lambda: hj.formulation.WeakForm(2.5), "whole number"),
    "a rate of another structure": (
        lambda: hj.simulate(Own(slope=(0.0,)), R),
        r"`rate` of Own.*what `start` does, float\[\]; got \('float\[\]',\)",
    ),
    "a rate of another shape": (
        lambda: hj.refine(Own(slope=jnp.zeros(2)), R),
        r"`rate` of Own.*float\[\]; got float\[2\]",
    ),
    "a rate by NumPy": (lambda: hj.simulate(ByNumPy(), R), "`rate` of ByN.*jax.numpy`"),
    "an output by if": (lambda: hj.judge(ByIf(), R), "`output` of ByIf .*`if x > 0:`"),
    "several outputs": (
        lambda: hj.simulate(Own(made=jnp.zeros(2)), R),
        r"`output` of Own must return one number, a float; got float\[2\]",
    ),
    "a memory by if": (
        lambda: following(lambda m, u: u if u > m else m),
        "`memory.after` of Keeping asks for the value .*`if x > 0:`",
    ),
    "a memory by NumPy": (
        lambda: following(np.maximum),
        "`memory.after` of Keeping .*`jax.numpy` for NumPy",
    ),
    "a memory of another shape": (
        lambda: following(lambda m, u: jnp.stack([m, u])),
        r"`memory.after` of Keeping must return .*float\[\]; got float\[2\]",
    ),
    "no memory": (
        lambda: hj.simulate(Keeping(), R),
        r"`memory` of Keeping must be .*`library.NoMemory\(\)`; got None",
    ),
    "a column of outputs": (
        lambda: answering(lambda u: u[:, None]),
        r"`response` of Answ.*shape \(40,\); got an array of shape \(40, 1\)",
    ),
    "outputs in a list": (lambda: answering(list), r"`response` of Answ.*got a list"),
    "a response by NumPy": (
        lambda: answering(np.asarray),
        "`response` of Answering asks .*`jax.numpy` for",
    ),
    "an output too few": (
        lambda: hj.simulate(LAW, R, method=Late()),
        r"`integrate` of Late must .*\(40,\); got an array of shape \(39,\)",
    ),
    "a batch of models": (
        lambda: hj.simulate(jax.vmap(lambda x: hj.models.Dahl(x, 1.0))(jnp.ones(3)), R),
        r"`rate` of Dahl.*float\[\]; got float\[3\].*a batch.*`jax.vmap`",
    ),
    "no number to fit": (
        lambda: hj.refine(Own(), R),
        "this Own has no number to fit: .* arrays of floats",
    ),
    "refine a sequence": (lambda: hj.refine(SEQUENCE, R), "a Sum maps whole sequences"),
    "to_latex(sequence)": (
        lambda: hj.export.to_latex(SEQUENCE),
        "this Sum is no sum of terms",
    ),
    "stability, formulation by name": (
        lambda: hj.stability(R, LIBRARY, key=KEY, formulation="weak"),
        "`formulation` must be an `AbstractFormulation`.*got the text 'weak'",
    ),
    "stability, seed": (lambda: hj.stability(R, LIBRARY, key=0), "jax.random.key"),
    "refine, seed": (lambda: hj.refine(LAW, R, starts=2, key=0), "jax.random.key"),
    "refine, 2.5 starts": (lambda: hj.refine(LAW, R, starts=2.5), "whole number"),
    "refine, one bound": (
        lambda: hj.refine(LAW, R, bounds={"du": 3}),
        r"`bounds` of 'du'.*pair \(lower, upper\)",
    ),
    "refine, tied to a name": (
        lambda: hj.refine(LAW, R, tied={"du": "u*|du|"}),
        r"`tied` of 'du'.*pair \(factor, parameter\)",
    ),
    "refine, no lower bound": (
        lambda: hj.refine(LAW, R, bounds={"du": (None, 1.0)}),
        r"`bounds` of 'du'.*`{'du': \(-inf, 1.0\)}`; got \(None, 1.0\)",
    ),
    "refine, bounds in a list": (
        lambda: hj.refine(LAW, R, bounds=[(0.0, 1.0)]),
        r"`bounds` must be a dictionary of pairs \(lower, upper\).*got a list",
    ),
    "refine, tied by no factor": (
        lambda: hj.refine(LAW, R, tied={"du": (None, "u*|du|")}),
        r"`tied` of 'du'.*pair \(factor, parameter\)",
    ),
    "refine, nothing fixed": (
        lambda: hj.refine(LAW, R, fixed=None),
        "`fixed` must be a list of names, got None",
    ),
    "one horizon": (
        lambda: hj.refinement.SingleShooting(0.5),
        r"`horizons` must be a list of numbers.*`\[0.5\]`; got the number 0.5",
    ),
    "one gain": (lambda: hj.refinement.Nudging(0.5), "`gains` must be a list of num"),
    "one weight of gaps": (
        lambda: hj.refinement.MultipleShooting(4, 0.5),
        "`weights` must be a list of numbers",
    ),
    "refine, unknown name": (
        lambda: hj.refine(LAW, R, fixed=("u*du",)),
        r"Did you mean 'u\*\|du\|'",
    ),
    "sweep over a dictionary": (lambda: hj.sweep(lane, {"a": [1]}), r"Grid\(\*\*val"),
    "sweep(grid, f)": (lambda: hj.sweep(GRID, lane), "swapped"),
    "sweep, chunk": (lambda: hj.sweep(lane, GRID, chunk=2.5), "`chunk`.*whole.*2.5"),
    "sweep, batch": (lambda: hj.sweep(lane, GRID, batch=2.5), "`batch`.*whole.*2.5"),
    "sweep over texts": (
        lambda: hj.sweeping.Grid(a=["first", "second"]),
        r"an axis is of numbers.*got \['first', 'second'\].*`labels`",
    ),
    "sweep over nothing": (lambda: hj.sweeping.Grid(a=[None, 1]), "axis is of numbers"),
    "sweep over two lengths": (
        lambda: hj.sweeping.Axis((np.ones(2), np.ones(3))),
        "axis is of numbers, or of arrays of equal shapes",
    ),
    "sweep over several records": (lambda: hj.sweeping.Grid(a=[R, R]), "jnp.stack"),
    "sweep over the samples": (
        lambda: hj.sweeping.Grid(a=R),
        "one recording is no axis.*`shared`",
    ),
    "samples between two numbers": (
        lambda: hj.sweeping.Samples.drawn(3, a=(0.0, 1.0)),
        r"`a` must be a range.*Uniform\(0, 1\).*a tuple",
    ),
    "2.5 samples": (
        lambda: hj.sweeping.Samples.drawn(2.5, a=hj.sweeping.Uniform(0.0, 1.0)),
        "`count`.*whole.*2.5",
    ),
    "sweep by another name": (
        lambda: hj.sweep(lambda b: b, GRID),
        "`function` is called by the names 'a'.*'b'",
    ),
    "sweep of what is shared": (
        lambda: hj.sweep(lane, GRID, shared={"a": 1.0}),
        "`shared` has 'a', which is a parameter",
    ),
    "sweep, shared record": (
        lambda: hj.sweep(lane, GRID, shared=R),
        "`shared`.*by nam",
    ),
    "sweep, no device": (
        lambda: hj.sweep(lane, GRID, devices=[]),
        "`devices`.*one dev",
    ),
    "sweep, device": (lambda: hj.sweep(lane, GRID, devices="cpu"), "`devices`.*'cpu'"),
    "sweep, memory": (
        lambda: hj.sweep(lane, GRID, memory="1 GB"),
        "`memory`.*one numb",
    ),
    "sweep into a number": (lambda: hj.sweep(lane, GRID, out=3), "`out`.*a folder"),
    "sweep with an axis named as an array": (
        lambda: hj.sweep(
            lambda a: {"x": jnp.ones(3), "y": a}, GRID, dims={"x": ("y",)}
        ),
        "an axis of 'x' has the name 'y', which is that of another",
    ),
    "report of nothing": (
        lambda: hj.report.write("x", LAW, {}),
        "`judgements`.*hystjax.judge.*none",
    ),
    "report of a law": (lambda: hj.report.write("x", LAW, {"a": LAW}), "`judgements`"),
    "report without a folder": (
        lambda: hj.report.write("", LAW, {"fitted": judged()}),
        "a folder is given by its path, got the text ''",
    ),
    "report of one refined law": (
        lambda: hj.report.write("x", LAW, {"fitted": judged()}, refined=SOLUTION),
        "`refined` must be a pair, the law before.*got a Solution",
    ),
    "report of another verb": (
        lambda: hj.report.write("x", LAW, {"fitted": judged()}, discovered=SOLUTION),
        "`discovered` must be what `discover` returned, got a Solution of another",
    ),
    "report by settings": (
        lambda: hj.report.write("x", LAW, {"fitted": judged()}, settings=["degree"]),
        "`settings` must be values by name, got a list",
    ),
    "table of one judgement": (
        lambda: hj.report.error_table(judged()),
        "`judgements` must hold.*got a Judgement",
    ),
    "report that leaves its folder": (
        lambda: hj.report.write("x", LAW, {"../a": judged()}),
        "`judgements` has the rows '../a'.*without /",
    ),
    "report in a folder of its own": (
        lambda: hj.report.write("x", LAW, {"fitted": judged(), "a/b": judged()}),
        "`judgements` has the rows 'a/b'",
    ),
    "report with a name too long for a file": (
        lambda: hj.report.write("x", LAW, {"fitted": judged(), "ä" * 130: judged()}),
        "Take another name, of at most 200 bytes",
    ),
    "loops in a unit that is far too small": (
        lambda: hj.loops.summary(hj.Recording(T, U, 1e-60 * W)),
        "`w` is about 1e-6.*choose another unit",
    ),
    "compare in a unit that is far too small": (
        lambda: hj.compare(hj.Recording(T, 1e-60 * U, W)),
        "`u` is about 1e-6.*choose another unit",
    ),
    "report over its overview": (
        lambda: hj.report.write("x", LAW, {"Overview": judged()}),
        "'Overview', whose figure.*none of overview, refinement",
    ),
    "examine(drive, law)": (lambda: PROPERTIES.examine(DRIVE, LAW), "`model`.*a Drive"),
    "dissipation along a recording": (
        lambda: PROPERTIES.dissipation(LAW, R),
        r"`drive`.*a Recording.*Drive.like\(recording\)",
    ),
    "dissipation, amplitude": (
        lambda: PROPERTIES.dissipation(LAW, DRIVE, 0.5),
        "`amplitudes` must be 1-D",
    ),
    "rate_dependence, speed": (
        lambda: PROPERTIES.rate_dependence(LAW, DRIVE, 2.0),
        "`speeds` must be 1-D",
    ),
    "drive, 1.5 cycles": (
        lambda: PROPERTIES.Drive(0.0, 1.0, 1.0, cycles=1.5),
        "`cycles`.*whole number.*1.5",
    ),
    "simulate along a batch": (
        lambda: hj.simulate(LAW, BATCH),
        r"`inputs` holds a batch.*\(2, 40\).*vmap",
    ),
    "judge a batch": (lambda: hj.judge(LAW, BATCH), "`recording` holds a batch"),
    "control along a batch": (
        lambda: hj.control(LAW, BATCH),
        "`reference` holds a batch",
    ),
    "examine a batch": (
        lambda: PROPERTIES.examine(LAWS, DRIVE),
        r"SparseModel.*batch of models.*vmap",
    ),
    "rests of a batch": (
        lambda: PROPERTIES.rests(LAWS, 0.0, -1.0, 1.0),
        "batch of models.*vmap",
    ),
    "drive like a law": (
        lambda: PROPERTIES.Drive.like(LAW),
        r"`recording`.*a SparseModel.*Drive.like\(recording\)",
    ),
    "started, a solution": (
        lambda: hj.models.Started.at_rest(SOLUTION, R),
        "`device`.*`value` of a fit.*a Solution",
    ),
    "started(recording, device)": (
        lambda: hj.models.Started.at_rest(R, STACK),
        "`device`.*a Recording",
    ),
    "started, an input": (
        lambda: hj.models.Started.at_rest(STACK, U),
        r"`recording`.*array of shape \(40,\).*at_rest\(device, recording\)",
    ),
    "adaptive, tolerance": (
        lambda: hj.simulation.Adaptive(rtol="1e-6"),
        "`rtol` must be positive.*the text '1e-6'",
    ),
    "adaptive, solver": (
        lambda: hj.simulation.Adaptive(diffrax.Kvaerno5),
        r"`solver`.*diffrax.Kvaerno5\(\).*the class Kvaerno5",
    ),
    "automatic, tolerance": (
        lambda: hj.simulation.Automatic(rtol=-1e-6),
        "`rtol` must be positive.*-1e-06",
    ),
    "automatic, otherwise": (
        lambda: hj.simulation.Automatic(otherwise="Adaptive"),
        "`otherwise`.*the text 'Adaptive'",
    ),
    "invert, Adaptive": (
        lambda: hj.invert(STACK, R, method=hj.simulation.Adaptive()),
        "`method`.*FixedStep`, got an Adaptive",
    ),
    "invert, u0": (lambda: hj.invert(LAW, R, u0=[0.0]), "`u0` must be one number"),
    "invert, limit": (lambda: hj.invert(LAW, R, limits=1.0), "`limits`.*two.*1.0"),
    "invert, limits in text": (
        lambda: hj.invert(LAW, R, limits="xy"),
        "`limits`.*two rising numbers, got 'xy'",
    ),
    "invert, speeds": (
        lambda: hj.invert(LAW, R, speed=np.ones(2)),
        r"`speed` must be one number, got an array of shape \(2,\)",
    ),
    "invert(law, [record])": (
        lambda: hj.invert(LAW, [R]),
        "`reference` must be one recording, got a list of 1.*one at a time",
    ),
    "control(law, (record, record))": (
        lambda: hj.control(STACK, (R, R), T),
        "`reference` must be one recording, got a tuple of 2",
    ),
    "control, one sample": (
        lambda: hj.control(STACK, U[:1], T[:1]),
        "`control` needs at least 2 samples, got 1",
    ),
    "control, a gap in times": (
        lambda: hj.control(STACK, U, np.where(T > 5.0, np.nan, T)),
        "`t` has 7 value.* NaN or inf, the first at row 33",
    ),
    "control, Adaptive": (
        lambda: hj.control(STACK, R, method=hj.simulation.Adaptive()),
        "`method`.*FixedStep`, got an Adaptive",
    ),
    "control, noise of samples": (
        lambda: hj.control(STACK, R, noise=np.ones(40)),
        r"`noise` must be one number, got an array of shape \(40,\)",
    ),
    "control, keys": (
        lambda: hj.control(STACK, R, noise=0.1, key=jax.random.split(KEY, 3)),
        "`key` must be one key, got 3",
    ),
    "2.5 steps": (lambda: hj.simulation.FixedStep(2.5), "`substeps`.*whole.*2.5"),
    "a gain in text": (
        lambda: hj.compensation.PID(kp="high"),
        "parameters must be real numbers, or arrays of them; got the text 'high'",
    ),
    "record(law)": (
        lambda: hj.plot.record(LAW),
        "`recording` of `hystjax.plot.record` must be a Recording, got a SparseModel",
    ),
    "loop(record, law)": (
        lambda: hj.plot.loop(R, LAW),
        "`trajectories` of .* must be a Trajectory, got a SparseModel",
    ),
    "densities of a fit": (
        lambda: hj.plot.densities(hj.Solution(STACK, hj.RESULTS.successful, {})),
        "`models`.*PrandtlIshlinskii or a Mapping, got a Solution; give its `value`",
    ),
    "frontier(law)": (lambda: hj.plot.frontier(LAW), "`found` of.*a Solution, got"),
    "tracking of one run": (lambda: hj.plot.tracking(R), "`runs` of.*a Mapping, got"),
    "tracking of what stays": (
        lambda: hj.plot.tracking({"held": jax.jit(held)(0 * T)}),
        "`runs` does not change",
    ),
    "energy(3)": (lambda: hj.plot.energy(3), "`dataset`.*summary.*got the number 3"),
    "plot of an abstract model": (
        lambda: hj.plot.overview(R, hj.simulate(LAW, R), model=R),
        "`model` of .* must be an AbstractModel, got a Recording",
    ),
    "Curves(3)": (lambda: hj.loops.Curves(3), "`parts`.*field and.*got the number 3"),
    "in_si of several": (lambda: hj.loops.in_si([R]), "a `Recording`, got a list"),
    "creep of several": (lambda: hj.loops.creep([R]), "a `Recording`, got a list"),
    "core_loss of a law": (
        lambda: hj.loops.core_loss(LAW),
        "a `Recording`, got a SparseModel",
    ),
    "core losses at several frequencies": (
        lambda: hj.loops.core_loss(R, frequency=[50.0, 60.0]),
        "`frequency` must be one number, got a list",
    ),
    "without_slope of several": (
        lambda: hj.loops.without_slope([R]),
        "a `Recording`, got a list",
    ),
    "without_demagnetisation of several": (
        lambda: hj.loops.without_demagnetisation([R], 0.1),
        "a `Recording`, got a list",
    ),
    "side by side without a label": (
        lambda: hj.loops.side_by_side(R, hj.simulate(LAW, R)),
        "`simulated` must be a dictionary of trajectories by label.*a Trajectory",
    ),
    "no speeds": (
        lambda: PROPERTIES.rate_dependence(STACK, DRIVE, []),
        "`speeds` is empty",
    ),
    "nrmse(recording, trajectory)": (
        lambda: hj.metrics.nrmse(R, hj.simulate(LAW, R)),
        "`w` must be an array of numbers, such as `recording.w`; got a Recording",
    ),
    "judge with a list of weights": (
        lambda: hj.judge(LAW, R, weights=[np.ones(40)]),
        "`weights` must be an array of one number a sample, got a list of one such",
    ),
    "rmse with weights of others": (
        lambda: hj.metrics.rmse(W, U, [1.0, 1.0]),
        r"`weights` must have one value for each of the 40 samples.*\(2,\)",
    ),
    "draw on a figure": (
        lambda: hj.plot.record(R, axes=[Figure(), Figure()]),
        r"`axes` must be of Matplotlib.*`figure.subplots\(\)`.*got a Figure",
    ),
    "draw on several axes": (
        lambda: hj.plot.loop(R, ax=Figure().subplots(1, 2)),
        "`ax` must be of Matplotlib.*got an array",
    ),
    "eeep of names": (lambda: hj.loops.eeep("a", "b"), "`u`.*column.*the text 'a'"),
    "properties.run to a name": (
        lambda: PROPERTIES.run(LAW, DRIVE, "a"),
        "`turns` must be one number, got the text 'a'",
    ),
    "sweep, coords in a list": (
        lambda: hj.sweep(lane, GRID, coords=[1, 2]),
        "`coords` must be a mapping of names, got a list",
    ),
    "report, aliases by name": (
        lambda: hj.report.write("r", LAW, {"fitted": judged()}, aliases="abc"),
        "`aliases` must be what `hystjax.aliases` returned, got the text 'abc'",
    ),
    "cycles(r, of another)": (
        lambda: hj.plot.cycles(MAGNET.window(0, 10), hj.loops.summary(MAGNET)),
        r"`dataset` is of another recording: its cycles end at row \d+.*10 rows",
    ),
    "backbone, fit of a side that is not there": (
        lambda: hj.plot.backbone(
            R,
            hj.loops.Backbone(*np.eye(2), np.empty(0), np.empty(0)),
            {"a": hj.loops.bilinear(-np.arange(5.0), -np.sqrt(np.arange(5.0)))},
        ),
        "`fits` hold one that yields at -.*`found` has nothing on that side",
    ),
    "overview, one label of two": (
        lambda: hj.plot.overview(R, RUN, R, RUN, labels=("a",)),
        "`labels` must hold one for each of 2 recordings",
    ),
    "heat map, three limits": (
        lambda: hj.plot.heat_map(GRIDDED, "x", limits=(1, 2, 3)),
        r"`limits` must be two numbers that rise, got \(1, 2, 3\)",
    ),
    "friction, two speeds": (
        lambda: hj.plot.friction(LUGRE, fastest=[1, 2]),
        "`fastest` must be one number",
    ),
    "energy(record)": (lambda: hj.plot.energy(R), "`dataset`.*loops.summary"),
    "heat map of a sweep": (
        lambda: hj.plot.heat_map(hj.sweep(lane, GRID)),
        "`values` must be the numbers of one array.*a Dataset",
    ),
    "steady, period in s": (lambda: hj.steady(R, 20.0), "`period`.*whole number.*20.0"),
    "judge, lead-in or not": (
        lambda: hj.judge(LAW, R, lead_in=True),
        "`lead_in`.*whole number.*True",
    ),
    "steady, lead-in in s": (lambda: hj.steady(R, 20, lead_in=1.5), "`lead_in`.*whole"),
    "a misspelt argument of a reader": (
        lambda: hj.Recording.from_csv("x.csv", input="u", output="w", tme="t"),
        r"`Recording.from_csv` has no argument `tme`. Did you mean 'time'\? It has inp",
    ),
    "an argument of another reader": (
        lambda: hj.LongRecording.from_npy(t="t.npy", u="u.npy", w="w.npy", unit="V"),
        "`LongRecording.from_npy` has no argument `unit`. Did you mean 'units'",
    ),
    "a misspelt argument across dropouts": (
        lambda: hj.bridged(T, U, W, name=("V", "x")),
        "`bridged` has no argument `name`. Did you mean 'names'",
    ),
    "a radius that is none": (
        lambda: hj.models.PrandtlIshlinskii([0.0, np.nan], [0.6, 0.4]),
        r"parameters must be numbers, and not NaN; got nan at \[1\]",
    ),
    "a coefficient that is none": (
        lambda: law_of({"du": np.nan}),
        "and not NaN; got nan.",
    ),
    "an infinite rate": (
        lambda: PROPERTIES.Drive(-1.0, 1.0, np.inf),
        "`rate` must be finite, got inf",
    ),
    "thresholds in a list": (
        lambda: hj.refinement.Huber([0.1]),
        "`threshold` must be one number, got a list",
    ),
    "a complex ridge": (
        lambda: hj.regression.Ridge(1j),
        "`ridge` must be a number, got the number 1j",
    ),
    "a ragged ridge": (
        lambda: hj.regression.Ridge([[1.0], [1.0, 2.0]]),
        "`ridge` must be a number, got a list",
    ),
    "split by a ragged list": (
        lambda: R.split([[1.0], [1.0, 2.0]]),
        "`fraction` must be a share.*got a list",
    ),
    "a cut-off in text": (
        lambda: STABILITY.terms("high"),
        "`cutoff` must be one number, got the text 'high'",
    ),
    "a tolerance in text": (
        lambda: CERTAINTY.undetermined("low"),
        "`tolerance` must be one number, got the text 'low'",
    ),
    "report, shares in text": (
        lambda: hj.report.write("r", LAW, {"fitted": judged()}, inclusion={"u": "x"}),
        r"`inclusion\['u'\]` must be a share from 0 to 1; got the text 'x'",
    ),
    "report, names of terms alone": (
        lambda: hj.report.write("r", LAW, {"fitted": judged()}, inclusion=["u"]),
        "`inclusion` must be what `hystjax.inclusion` returned, got a list",
    ),
    "a table of unlike rows": (
        lambda: hj.report.plain_table([["a", "b"], ["c"]]),
        "`table` must be a list of rows.*got rows of 2, 1 cells",
    ),
    "a table of numbers": (
        lambda: hj.report.markdown_table([["a"], [1.0]]),
        "`table` must be.*got the number 1.0 in a cell",
    ),
    "variables in a number": (
        lambda: hj.library.Polynomial(2, 3),
        "`variables` must be a tuple of names, got 3",
    ),
    "a library of names": (
        lambda: hj.library.Library(["u", "w"]),
        r"`terms` must be.*Term.parse\('u\*\|du\|'\).*got the text 'u'",
    ),
    "plays of nothing": (
        lambda: hj.library.Play([0.1], of=None),
        "operators are of the input, `of='u'`; got None",
    ),
    "creep between lists": (
        lambda: hj.library.LogCreep([1.0], 10.0),
        "`shortest` must be one number, got a list",
    ),
    "relays of two numbers": (
        lambda: hj.library.Relays([0.3, 0.4], [0.1]),
        "each relay must have.*got 2 of `up` and 1 of `down`",
    ),
    "negative plays": (
        lambda: hj.library.Plays([0.1, -0.1]),
        r"`radii` must be zero or more, got -0.1 at \[1\]",
    ),
    "a staircase of another past": (
        lambda: hj.library.Staircase([0.0, 1.0, 2.0], "middle"),
        "`initial` must be one of demagnetised, up, down; got 'middle'",
    ),
    "signals of a record": (
        lambda: hj.library.Play([0.1]).signals(R),
        "`path` must be an `AbstractInputPath`, such as `recording.path`; got a Rec",
    ),
    "signals beyond a record": (
        lambda: hj.library.Play([0.1]).signals(R.path, [-1.0, 3.0, 8.0]),
        "`times` runs from -1 s to 8 s, beyond the path's 0 s to 6 s; .*extrapolate",
    ),
    "a number of another library": (
        lambda: hj.library.Play([0.1]).with_numbers({"play(u,0.2).radius": 1.0}),
        r"no number 'play\(u,0.2\).radius'.*Did you mean 'play\(u,0.1\).radius'",
    ),
    "a number of a library without": (
        lambda: LIBRARY.with_numbers({"foo": 1.0}),
        "no number 'foo' in this library. Its numbers are none",
    ),
    "plays without signals": (
        lambda: hj.library.Play([0.1])(U, U, U),
        r"play\(u,0.1\) has memory, and `memory`.*`library.signals\(path\)`",
    ),
    "a play without its signal": (
        lambda: hj.library.Term.parse("u*play(u,0.1)")(U, U, U),
        r"play\(u,0.1\) has memory, and `memory`.*`library.signals\(path\)`",
    ),
    "creep without signals": (
        lambda: hj.library.LogCreep(1.0, 10.0)(U, U, U),
        r"relaxation\(u,.* has memory, and `memory`.*`library.signals\(path\)`",
    ),
    "Custom(places)": (
        lambda: hj.library.Custom({1: np.tanh}),
        "the name 1 of a custom term must be a Python identifier",
    ),
    "load(functions that are none)": (
        lambda: hj.load("law.json", functions={"knee": 3}),
        "`functions` must be functions of .* by name.*got the number 3",
    ),
    "load(one function)": (
        lambda: hj.load("law.json", functions=np.tanh),
        "`functions` must be functions of .* by name.*got a ufunc",
    ),
    "load(functions in a list)": (
        lambda: hj.load("law.json", functions=[np.tanh]),
        "`functions` must be functions of .* by name.*got a list",
    ),
    "a support of numbers": (
        lambda: hj.models.SparseModel(
            LIBRARY, np.ones(6), np.array([1, 0, 0, 1, 0, 0])
        ),
        r"`support` must be a mask.*got an array of shape \(6,\) of int64",
    ),
    "a support in a list": (
        lambda: hj.models.SparseModel(LIBRARY, np.ones(6), [True] * 6),
        "`support` must be a mask, as `numpy.asarray.*got a list",
    ),
    "a support of fewer": (
        lambda: hj.models.SparseModel(LIBRARY, np.ones(6), np.ones(5, bool)),
        r"an entry for each of the 6 terms.*got shapes \(6,\) and \(5,\)",
    ),
    "coefficients of fewer": (
        lambda: hj.models.SparseModel(LIBRARY, np.ones(5), np.ones(6, bool)),
        r"an entry for each of the 6 terms.*got shapes \(5,\) and \(6,\)",
    ),
    "relays in text": (
        lambda: hj.library.Relays("up", [0.1]),
        "`up` must be a 1-D array of numbers",
    ),
    "an input that is no function": (
        lambda: hj.interpolation.Exact("sin"),
        "`function` must be a function of time.*got the text 'sin'",
    ),
    "a differentiation by name": (
        lambda: hj.formulation.Pointwise("spline"),
        "`differentiation` must be an `AbstractDifferentiation`.*got the text 'spline'",
    ),
    "a range of lists": (
        lambda: hj.sweeping.Uniform([1.0], 2.0),
        r"`Uniform\(\[1.0\], 2.0\)` needs low < high",
    ),
    "one label": (
        lambda: hj.sweeping.Axis([1.0], labels=3),
        "`labels` must be a list of names, got the number 3",
    ),
    "window of a long recording in s": (
        lambda: hj.LongRecording(T, U, W).window(3.5, 10),
        "`start` must be a whole number, got the number 3.5",
    ),
    "save(model, path)": (lambda: hj.save(LAW, "x.json"), r"save\(path, model\)"),
    "save(3, model)": (lambda: hj.save(3, LAW), "by its path, got the number 3"),
    "fmu(3, model)": (lambda: hj.export.fmu(3, LAW), "by its path, got the number 3"),
    "fmu(model, path)": (lambda: hj.export.fmu(LAW, "x"), r"fmu\(path, model\)"),
    "to_c, no name": (lambda: hj.export.to_c(LAW, name=None), "becomes part of names"),
    "to_c(record)": (lambda: hj.export.to_c(R), r"a Recording.*to_c\(model\)"),
    "a solution of no law": (
        lambda: hj.simulate(hj.Solution(3.0, hj.RESULTS.successful, {}), R),
        "a Solution whose value is the number 3.0",
    ),
    "cycles(r, one cycle)": (
        lambda: hj.plot.cycles(MAGNET, hj.loops.summary(MAGNET).isel(cycle=0)),
        r"`dataset`.*not over `cycle`.*isel\(cycle=\[0\]\)",
    ),
    "energy(no cycle)": (
        lambda: hj.plot.energy(hj.loops.summary(MAGNET).isel(cycle=[])),
        "`dataset`.*not over `cycle`",
    ),
    "side by side with a number": (
        lambda: hj.loops.side_by_side(MAGNET, {"x": 3}),
        "`simulated` must hold traj.*got the number 3 by the label 'x'",
    ),
    "backbone, a fit in numbers": (
        lambda: hj.plot.backbone(
            R, hj.loops.Backbone(U, W, np.empty(0), np.empty(0)), {"bil": (1, 2)}
        ),
        "`fits` must hold what `bilinear` or `eeep` returned, by label; got a tuple",
    ),
    "preisach, turns by name": (
        lambda: hj.plot.preisach(
            hj.models.Preisach(np.arange(3.0), [0.5, 0.2, 0.3]), ["a"]
        ),
        "`turns` must be inputs in order.*got a list",
    ),
    "read_forc, drift or not": (
        lambda: hj.loops.read_forc("x", drift="no"),
        "`drift` must be True or False, got the text 'no'",
    ),
    "separate, excess or not": (
        lambda: hj.loops.separate([1.0, 2, 3], [1.0, 2, 3], excess="no"),
        "`excess` must be True or False, got the text 'no'",
    ),
    "a network for a constant input": (
        lambda: hj.models.Hybrid.untrained(LAW, hj.Recording(T, 0 * U, W), key=KEY),
        "`u` is constant.*a network cannot be scaled to it. Check the column",
    ),
    "a network for a constant output": (
        lambda: hj.models.Hybrid.untrained(LAW, hj.Recording(T, U, 0 * W), key=KEY),
        "`w` is constant.*a network cannot be scaled to it. Check the column",
    ),
    "rests under inputs in a list": (
        lambda: PROPERTIES.rests(LAW, [0, 1], -2, 2),
        r"`u` must be one real number, got \[0, 1\]",
    ),
    "frontier of what another verb found": (
        lambda: hj.plot.frontier(SOLUTION),
        "`found` must be what `discover` returned, .* of another verb",
    ),
    "refinement of what another verb found": (
        lambda: hj.plot.refinement(R, RUN, RUN, SOLUTION),
        "`solution` must be what `refine` returned, .* of another verb",
    ),
    "tracking of a trajectory": (
        lambda: hj.plot.tracking({"a": RUN}),
        "`runs` must hold what .*control` returned.*a Trajectory by the label 'a'",
    ),
    "tracking of a law": (
        lambda: hj.plot.tracking({"a": SOLUTION}),
        "`runs` must hold what .*control` returned.*a SparseModel by the label 'a'",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_named_with_what_was_likely_meant(slip, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, said = SLIPS[slip]
    with pytest.raises(hj.InputError, match=said):
        call()
    assert not list(tmp_path.iterdir())


def test_what_maps_sequences_is_printed():
    assert hj.export.to_text(SEQUENCE) == "a sum"


def test_a_solution_is_taken_for_its_law(tmp_path):
    once = hj.simulation.FixedStep(1)
    expected = hj.judge(LAW, R, method=once)
    judged = hj.judge(SOLUTION, R, method=once)
    np.testing.assert_array_equal(judged.trajectory.w, expected.trajectory.w)
    own = hj.export
    for writer in (own.to_text, own.to_latex, own.to_python, own.to_numpy):
        assert writer(SOLUTION) == writer(LAW)
    hj.save(tmp_path / "law.json", SOLUTION)
    assert hj.load(tmp_path / "law.json").terms() == LAW.terms()


def test_stages_come_in_any_collection():
    stages = (0.5, 0.1)
    for each in (list(stages), np.array(stages), jnp.asarray(stages)):
        assert hj.refinement.Nudging(each).gains == stages
    shares, gaps, gains = hj.refinement.Nudging(stages).stages()
    np.testing.assert_array_equal([shares, gaps, gains], [(1, 1), (0, 0), stages])
    shares, gaps, gains = hj.refinement.MultipleShooting(2, (1.0, 9.0)).stages()
    np.testing.assert_array_equal([shares, gaps], [(1, 1), (1, 9)])
    assert gains is None
    shares, gaps, gains = hj.refinement.SingleShooting((0.2, 0.6)).stages()
    np.testing.assert_allclose([shares, gaps], [(0.2, 0.6), (0, 0)])
    assert gains is None


def test_counts_of_numpy_are_counts():
    assert hj.library.Polynomial(np.int64(2)) == hj.library.Polynomial(2)
    assert hj.excitation.Triangle(1.0, 1.0, np.int64(2)).periods == 2
    two, three, five = np.array([2, 3, 5])
    how = hj.differentiation.SavitzkyGolay(five, two)
    kept = how.window, how.order, hj.formulation.WeakForm(three).half_width
    assert kept == (5, 2, 3) and {*map(type, kept)} == {int}
    once = hj.simulation.FixedStep(1)
    assert type(hj.judge(LAW, R, lead_in=three, method=once).lead_in) is int
    steps = hj.regression.STLSQ(max_steps=two), hj.regression.NonNegative(max_steps=two)
    kept = (*(way.max_steps for way in steps), hj.simulation.FixedStep(two).substeps)
    assert kept == (2, 2, 2) and {*map(type, kept)} == {int}
    drive = PROPERTIES.Drive(-1, 1, 1, cycles=three, steps=two)
    robust = hj.weighting.Bisquare(trials=two, steps=three)
    kept = (drive.cycles, drive.steps, robust.trials, robust.steps)
    assert kept == (3, 2, 2, 3) and {*map(type, kept)} == {int}
    kept = (
        hj.interpolation.BandLimited(two).factor,
        hj.refinement.MultipleShooting(two).pieces,
        hj.models.RambergOsgood(1.0, 1.0, 5.0, two).depth,
        hj.compensation.Learning(1.0, repetitions=two).repetitions,
    )
    assert kept == (2, 2, 2, 2) and {*map(type, kept)} == {int}


def test_keys_of_both_kinds_are_keys():
    for key in (KEY, jax.random.PRNGKey(0), np.zeros(2, np.uint32)):
        hj._core.checks.key("key", jnp.asarray(key) if key is not KEY else key)


@pytest.mark.parametrize("seed", [np.int32(0), np.uint32(0), np.zeros(2)])
def test_seeds_in_arrays_are_no_keys(seed):
    for array in (np.asarray(seed), jnp.asarray(seed)):
        with pytest.raises(hj.InputError, match=r"must be a key of `jax.random`"):
            hj._core.checks.key("key", array)
