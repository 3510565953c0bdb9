"""Tables of text."""

from collections.abc import Sequence


def markdown_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in Markdown, in which `|u'|` does not end a cell."""
    cells = [[cell.replace("|", r"\|") for cell in row] for row in table]
    head, *body = [f"| {' | '.join(row)} |" for row in cells]
    return "\n".join([head, "|---" * len(table[0]) + "|", *body])


def plain_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in columns, for a terminal."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)
