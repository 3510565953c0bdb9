"""What `hystjax data list` prints."""

from . import _fetch
from ._entry import Dataset
from ._registry import REGISTRY


def listing() -> str:
    """All datasets in plain text: what each is, its columns, units and rate, its
    licence, citation and source, and whether it is on disk.
    """
    return "\n\n".join(_described(dataset) for dataset in REGISTRY.values())


def _described(dataset: Dataset) -> str:
    facts = {
        "columns": dataset.columns,
        "rate": dataset.rate,
        "records": ", ".join(dataset.records),
        "licence": dataset.licence,
        "cite": dataset.citation,
        "source": dataset.source,
        "on disk": _whereabouts(dataset),
    }
    lines = [f"  {key:<8} {fact}" for key, fact in facts.items() if fact]
    return "\n".join([f"{dataset.name}: {dataset.what}", *lines])


def _whereabouts(dataset: Dataset) -> str:
    places = [_fetch.on_disk(dataset.name, file) for file in dataset.files]
    found = [place for place in places if place is not None]
    if not found:
        return f"no; `hystjax data fetch {dataset.name}` downloads it"
    share = (
        "" if len(found) == len(places) else f"{len(found)} of {len(places)} files, "
    )
    return share + ", ".join(sorted({str(place.parent) for place in found}))
