"""Hooks of MkDocs: the README is the home page, what pages link to beside the guides
(notebooks, a figure, the claims) is on the site too, and of a folder of the package the
reference has all public names, which its `__init__` takes from the files inside."""

import ast
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
BESIDE = ("notebooks/*.ipynb", "benchmarks/scaling.png", "hystjax/reproduce/CLAIMS.md")


def on_files(files, config):
    """Add what is not in this folder."""
    home = (ROOT / "README.md").read_text(encoding="utf-8")
    home = home.replace("](docs/", "](")
    files.append(File.generated(config, "index.md", content=home))
    for pattern in BESIDE:
        for path in sorted(ROOT.glob(pattern)):
            name = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Links out of this folder lead to what was added; folders get their names."""
    if page.file.src_uri.startswith("api/"):
        return re.sub(r"^::: hystjax\.(\w+)$", _with_members, markdown, flags=re.M)
    return markdown if "/" in page.file.src_uri else markdown.replace("](../", "](")


def _with_members(found: re.Match[str]) -> str:
    """What is asked for, and below it the public names of a folder."""
    face = ROOT / "hystjax" / found[1] / "__init__.py"
    if not face.is_file():
        return found[0]
    tree = ast.parse(face.read_text(encoding="utf-8"))
    aliases = (
        alias
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    )
    names = [a.asname for a in aliases if a.asname and not a.asname.startswith("_")]
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            names = ast.literal_eval(node.value)
    return "\n".join([found[0], *(f"{found[0]}.{name}" for name in names)])
