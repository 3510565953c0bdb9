"""Numbers in the terms of laws, such as radii: given on a grid, on which laws are
looked for, and then set free."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

from ..library import AbstractVariable, Library, Term, variables_of
from ._setting import Setting
from .search import Trial


def off_grid(setting: Setting, law: Trial) -> Iterator[Trial]:
    """What a law on the grid may stand for: laws with one operator between the places
    of two neighbours; and the law itself, where its own numbers lead."""
    if free_numbers(setting, law.terms):
        for guess in (*_merged(setting, law), law):
            yield free(setting, guess, law.numbers | guess.numbers)


def free(setting: Setting, law: Trial, known: Mapping[str, float]) -> Trial:
    """A law whose numbers are fitted with its coefficients, from those that are known
    or else from the grid; as it is, where it has none, or more than there is room for.
    """
    names = free_numbers(setting, law.terms)
    if len(names) > setting.numbers:
        return law
    grid = setting.library.numbers
    return replace(law, numbers={n: known.get(n, float(grid[n])) for n in names})


def free_numbers(setting: Setting, names: Iterable[str]) -> list[str]:
    """The numbers in some terms, by name, but for those in the known part."""
    fixed = {name for name, _ in _numbered(setting.library, setting.known)}
    return [name for name, _ in _numbered(setting.library, names) if name not in fixed]


def _numbered(
    library: Library, names: Iterable[str]
) -> list[tuple[str, AbstractVariable]]:
    """The numbers in some terms by name, and the variable that each is in."""
    terms = _by_name(library)
    every = variables_of(tuple(terms[name] for name in names))
    return [(f"{v.name}.{what}", v) for v in every for what in v.numbers]


def _by_name(library: Library) -> dict[str, Term]:
    return dict(zip(library.names, library.terms, strict=True))


def _merged(setting: Setting, law: Trial) -> Iterator[Trial]:
    """Of every two neighbours on the grid that do the same in a law, the law with one
    number half way between them."""
    grids = _grids(setting.library)
    inside: dict[AbstractVariable, dict[float, str]] = {}
    for name in free_numbers(setting, law.terms):
        kind, number = grids[name]
        inside.setdefault(kind, {})[number] = name
    for kind, names in inside.items():
        every = sorted(number for each, number in grids.values() if each == kind)
        for low, high in pairwise(every):
            if low not in names or high not in names:
                continue
            merged = _renamed(setting, law, {names[low]: high})
            if merged is None or len(merged.terms) == len(law.terms):
                continue
            between = sum(law.numbers.get(names[x], x) for x in (low, high)) / 2
            yield replace(merged, numbers=merged.numbers | {names[high]: between})


def nearest(setting: Setting, law: Trial) -> Trial:
    """A law under the names of the numbers on the grid that its own have come closest
    to, if each is there once: then it is the same law, whatever it was found from."""
    grids = _grids(setting.library)
    closest = {}
    for name, number in law.numbers.items():
        kind, _ = grids[name]
        every = [x for each, x in grids.values() if each == kind]
        closest[name] = min(every, key=lambda x, number=number: abs(x - abs(number)))
    renamed = _renamed(setting, law, closest)
    whole = renamed is not None and len(renamed.numbers) == len(law.numbers)
    return renamed if whole and len(renamed.terms) == len(law.terms) else law


def _grids(library: Library) -> dict[str, tuple[AbstractVariable, float]]:
    """What numbers are of, but for themselves, and what their names show."""
    return {
        f"{v.name}.{what}": (v.with_numbers({what: 1.0}), float(number))
        for v in variables_of(library.terms)
        for what, number in v.numbers.items()
    }


def _renamed(setting: Setting, law: Trial, grid: Mapping[str, float]) -> Trial | None:
    """A law in terms with other numbers of the grid, the coefficients of those that
    become one added up; `None` where these are no candidates."""
    library, terms, found = setting.library, _by_name(setting.library), {}
    for name, x in law.terms.items():
        new = terms[name].with_numbers(grid).name
        found[new] = found.get(new, 0.0) + x
    if not found.keys() <= terms.keys() - setting.known.keys():
        return None
    numbers = {
        f"{variable.renamed(grid).name}.{name.rpartition('.')[2]}": law.numbers[name]
        for name, variable in _numbered(library, law.terms)
        if name in law.numbers
    }
    ordered = {new: found[new] for new in terms if new in found}
    return replace(law, terms=ordered, numbers=numbers)
