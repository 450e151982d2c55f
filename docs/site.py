"""What the site is made of besides its pages: results of their blocks, examples, the API reference.

Pages that are written here stand in docs/generated, which git ignores.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import json
import runpy
import shutil
import tempfile
from pathlib import Path
from typing import Any

import curvcasadi
from docs import api, formats, pages

FOLDER = Path(__file__).parent
GENERATED = FOLDER / "generated"
EXAMPLES = FOLDER.parent / "ocp_examples"


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_pages)
    app.connect("source-read", show_results)
    # After numpydoc, which reads the sections.
    app.connect("autodoc-process-docstring", escape_bars, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_pages(app: Any) -> None:
    """The file formats, the API reference and a page for each example."""
    for folder in ("api", "examples"):
        (GENERATED / folder).mkdir(parents=True, exist_ok=True)
    generated = {"formats.md": formats.page(), **api.pages(curvcasadi), **example_pages()}
    for name, text in generated.items():
        path = GENERATED / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")  # Sphinx reads again what is newer


def example_pages() -> dict[str, str]:
    """For each example a page with its question, what it prints and draws, and its code."""
    made, names = {}, []
    for path in sorted(EXAMPLES.glob("*.py")):
        question, _, text = (ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n")
        output, pictures = run_example(path)
        made[f"examples/{path.stem}.md"] = EXAMPLE.format(
            question=question,
            text=_formulas(text),
            name=path.stem,
            output=output.strip(),
            pictures="\n\n".join(f"![{question}](/{place})" for place in pictures),
        )
        names.append(path.stem)
    made["examples/index.md"] = GALLERY.format(names="\n".join(names))
    return made


def run_example(path: Path) -> tuple[str, list[str]]:
    """What an example prints, and its pictures; run again only if it or the package has changed."""
    sources = [path, *EXAMPLES.glob("*.toml"), *Path(curvcasadi.__file__).parent.rglob("*.py")]
    state = hashlib.sha256(b"".join(source.read_bytes() for source in sorted(sources))).hexdigest()
    kept = GENERATED / "pictures" / path.stem
    record = kept / "run.json"
    if record.exists():
        run = json.loads(record.read_text())
        if run["state"] == state:
            return run["output"], run["pictures"]
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
        runpy.run_path(str(path))["main"](kept)
    for other in (file for file in kept.iterdir() if file.suffix != ".png"):
        other.unlink()
    pictures = [str(picture.relative_to(FOLDER)) for picture in sorted(kept.glob("*.png"))]
    run = {"state": state, "output": printed.getvalue(), "pictures": pictures}
    record.write_text(json.dumps(run))
    return run["output"], run["pictures"]


GALLERY = """\
# Examples

Each example answers one question in a file of its own, `ocp_examples/<name>.py`. Output and figures
come from a run of that file.

```{{toctree}}
:maxdepth: 1

{names}
```
"""

EXAMPLE = """\
# {question}

{text}

`python ocp_examples/{name}.py` prints

```text
{output}
```

and draws

{pictures}

## Code

```{{literalinclude}} /../ocp_examples/{name}.py
:language: python
```
"""


def _formulas(text: str) -> str:
    """Indented lines of a docstring as literal blocks."""
    parts = []
    for paragraph in text.strip("\n").split("\n\n"):
        indented = paragraph.startswith("    ")
        parts.append(f"```none\n{paragraph}\n```" if indented else paragraph)
    return "\n\n".join(parts)


def show_results(app: Any, name: str, source: list[str]) -> None:
    """Run the blocks of a Markdown page and show below each what it printed and drew."""
    text = source[0]
    if not any(block.language in ("python", "shell") for block in pages.blocks(text)):
        return
    with tempfile.TemporaryDirectory() as folder:
        parts, end = [], 0
        for result in pages.run(text, f"{name}.md", Path(folder)):
            parts.append(text[end : result.block.end])
            end = result.block.end
            if result.output.strip():
                parts.append(f"\n\n```text\n{result.output.rstrip()}\n```\n")
            for picture in result.pictures:
                kept = GENERATED / "pictures" / name.replace("/", "-") / picture.name
                kept.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(picture, kept)
                place = "/" + str(kept.relative_to(FOLDER))
                parts.append(f"\n\n![{picture.stem.replace('_', ' ')}]({place})\n")
    source[0] = "".join(parts) + text[end:]


def escape_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """A bar is that of |q|, not of a substitution of reStructuredText; so is an asterisk."""
    lines[:] = [line.replace("|", r"\|") for line in lines]
