"""What the site needs beside the pages: the two at the top, and a reference from the docstrings."""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
TOP = {"README.md": "start.md", "CONTRIBUTING.md": "contributing.md"}
MODULES = {  # the public ones, by the page of the reference that shows them
    "environments": [
        "rcare_marl.envs.registry",
        "rcare_marl.envs.care_env",
        "rcare_marl.envs.gym",
        "rcare_marl.envs.torchrl",
        "rcare_marl.envs.learning",
        "rcare_marl.envs.episode",
    ],
    "tasks": [
        "rcare_marl.envs.task",
        "rcare_marl.envs.task_options",
        "rcare_marl.envs.state",
        "rcare_marl.envs.broadcast",
        "rcare_marl.envs.reach",
        "rcare_marl.envs.safety",
    ],
    "agents": [
        "rcare_marl.agents.agent",
        "rcare_marl.agents.policy",
        "rcare_marl.agents.people.human",
        "rcare_marl.agents.people.avatar",
        "rcare_marl.agents.people.physiology",
        "rcare_marl.agents.robots.robot",
        "rcare_marl.agents.robots.robot_config",
        "rcare_marl.agents.sensing.suite",
    ],
    "places": [
        "rcare_marl.envs.place",
        "rcare_marl.envs.homes.care_home",
        "rcare_marl.envs.devices.device",
    ],
    "world": [
        "rcare_marl.world",
        "rcare_marl.body",
        "rcare_marl.pose",
        "rcare_marl.rendering.camera",
        "rcare_marl.rendering.renderer",
        "rcare_marl.soft.soft_world",
        "rcare_marl.errors",
    ],
    "learning": [
        "rcare_marl.baselines.training.config",
        "rcare_marl.baselines.training.trainer",
        "rcare_marl.baselines.evaluation.protocol",
        "rcare_marl.baselines.evaluation.cross_play",
        "rcare_marl.baselines.partners",
        "rcare_marl.baselines.policy_file",
    ],
}


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that do not lie in docs/."""
    for origin, name in TOP.items():
        text = (ROOT / origin).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, name, content=text))
    for title, modules in MODULES.items():
        shown = "\n\n".join(f"::: {module}" for module in modules)
        text = f"# Reference: {title}\n\n{shown}\n"
        files.append(File.generated(config, f"reference/{title}.md", content=text))
    return files


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of the reference into the navigation."""
    *_, last = config.nav or [{}]
    last["Reference"] = [f"reference/{title}.md" for title in MODULES]
    return config


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links to pages at the top find them; what is no page, such as a file of code, is named only."""
    for origin, name in TOP.items():
        markdown = re.sub(rf"\]\((?:\.\./)?{origin}", f"]({name}", markdown)
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
    return re.sub(r"(<pre[^>]*>(?:<span></span>)?)<code", r'\1<code tabindex="0"', output)
