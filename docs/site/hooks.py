"""What the site needs beside the pages: the two at the top, notebooks, a reference from the docstrings."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
TOP = {"README.md": "start.md", "CONTRIBUTING.md": "contributing.md"}


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that do not lie in docs/."""
    for origin, name in TOP.items():
        text = (ROOT / origin).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, name, content=text))
    for notebook in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        for name, content in _shown(notebook).items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    for title, modules in config.extra["reference"].items():
        shown = "\n\n".join(f"::: {module}" for module in modules)
        text = f"# Reference: {title}\n\n{shown}\n"
        files.append(File.generated(config, f"reference/{title}.md", content=text))
    return files


def _shown(notebook: Path) -> dict[str, str | bytes]:
    """Return a page of what is in a notebook and came out of it, and its pictures, by name."""
    pictures: dict[str, str | bytes] = {}
    lines = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        lines.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        for output in cell.get("outputs", ()):
            data: dict[str, Any] = output.get("data", {})
            if "image/png" in data:
                name = f"{notebook.stem}_{len(pictures)}.png"
                pictures[name] = base64.b64decode("".join(data["image/png"]))
                lines.append(f"![What the cell above draws]({name})")
            elif text := "".join(output.get("text", data.get("text/plain", ""))).rstrip():
                lines.append(f"```text\n{text}\n```")
    return {f"{notebook.stem}.md": "\n\n".join(lines) + "\n", **pictures}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of the reference into the navigation."""
    *_, last = config.nav or [{}]
    last["Reference"] = [f"reference/{title}.md" for title in config.extra["reference"]]
    return config


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links to pages at the top find them; what is no page, such as a file of code, is named only."""
    for origin, name in TOP.items():
        markdown = re.sub(rf"\]\((?:\.\./)?{origin}", f"]({name}", markdown)
    markdown = re.sub(r"\]\((notebooks/\w+)\.ipynb\)", r"](\1.md)", markdown)
    if page.file.src_uri.startswith("notebooks/"):
        return markdown  # whose links lead to pages
    there = r"\[([^\]]*)\]\((?:\.\./[^)]*|LICENSE|NOTICE|CITATION\.cff)\)"
    return re.sub(there, r"\1", markdown)


STYLE = """<style>[data-md-color-scheme="default"] {
  --md-primary-fg-color: #00695c; --md-typeset-a-color: #00695c; --md-accent-fg-color: #004d40;
  --md-default-fg-color--light: #555; --md-default-fg-color--lighter: #767676;
  --doc-symbol-module-fg-color: #2f6b00; --doc-symbol-attribute-fg-color: #8a3300;
}
.md-typeset a:not(.headerlink):not(.md-button) { text-decoration: underline; }
.md-typeset pre > code { white-space: pre-wrap; }</style></head>"""


def on_post_page(output: str, *, page: Page, config: MkDocsConfig) -> str:
    """Mend what the theme lacks for who sees little or uses a keyboard: contrast, names, focus."""
    output = output.replace("</head>", STYLE, 1)
    output = output.replace('role="dialog"', 'role="dialog" aria-label="Search"')
    output = re.sub(
        r'<nav class="md-nav" aria-label="[^"]*">', '<nav class="md-nav" role="none">', output
    )
    output = output.replace("<table>", '<table tabindex="0">')  # a wide one scrolls
    return re.sub(r"(<pre[^>]*>(?:<span></span>)?)<code", r'\1<code tabindex="0"', output)
