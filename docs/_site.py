"""Hooks of MkDocs: the README is the home page, what pages link to beside the guides
(notebooks, a figure, the claims) is on the site too, notebooks as pages with what they
showed when they ran, formulas are MathML, for which nothing is fetched, and of a folder
of the package the reference has all public names, which its `__init__` takes from the
files inside."""

import ast
import base64
import html
import json
import re
from pathlib import Path

from latex2mathml import converter
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
DISPLAYED = r"\displaystyle "  # as IPython begins formulas
BESIDE = (
    "notebooks/*.ipynb",
    "benchmarks/scaling*.png",
    "hystjax/reproduce/CLAIMS.md",
)


def on_files(files, config):
    """Add what is not in this folder."""
    home = (ROOT / "README.md").read_text(encoding="utf-8")
    home = home.replace("](docs/", "](")
    files.append(File.generated(config, "index.md", content=home))
    for pattern in BESIDE:
        for path in sorted(ROOT.glob(pattern)):
            name = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, name, abs_src_path=str(path)))
    for path in sorted(ROOT.glob("notebooks/*.ipynb")):
        for name, content in _as_page(path).items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    return files


def on_page_markdown(markdown, page, config, files):
    """Links out of this folder lead to what was added; folders get their names."""
    name = page.file.src_uri
    if name.startswith("api/"):
        return re.sub(r"^::: hystjax\.(\w+)$", _with_members, markdown, flags=re.M)
    if name.startswith(("notebooks/", "hystjax/")):
        return markdown
    inside = "../" * name.count("/")
    markdown = markdown.replace(f"](../{inside}", f"]({inside}")
    return re.sub(r"(\]\(\S*notebooks/\w+)\.ipynb\)", r"\1.md)", markdown)


def on_page_content(content, page, config, files):
    """Formulas, which the Markdown extension has left as TeX."""
    left = r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>'
    return re.sub(left, _formula, content, flags=re.S)


def _formula(found: re.Match[str]) -> str:
    tex = html.unescape(found[2])
    if found[1] == "span":
        return converter.convert(tex)
    # Wider than a phone it is moved, and not the page.
    displayed = converter.convert(tex, display="block")
    return f'<div style="overflow-x: auto">{displayed}</div>'


def _as_page(path: Path) -> dict[str, str | bytes]:
    """The page of a notebook that was run, and its figures, by file name."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    parts, figures = [], {}
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            parts.append(f"```python\n{source}\n```")
        else:
            # Tables of contents show the text of headings, and no formulas.
            plain = re.sub(r"^#.*", lambda x: x[0].replace("$", ""), source, flags=re.M)
            plain = plain.replace("](../docs/", "](../")
            parts.append(plain)
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{path.stem}_{len(figures)}.png"
                figures[name] = base64.b64decode(data["image/png"])
                parts.append(f"![What the cell above draws]({name})")
            elif "text/latex" in data:
                tex = "".join(data["text/latex"]).strip("$")
                parts.append(f"$${tex.removeprefix(DISPLAYED)}$$")
            else:
                said = "".join(output.get("text") or data.get("text/plain", ""))
                parts.append(f"```text\n{said.rstrip()}\n```")
    parts.insert(1, f"[The notebook]({path.name}), to run it yourself.")
    return {f"{path.stem}.md": "\n\n".join(parts) + "\n", **figures}


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
