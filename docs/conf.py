"""The book: every page of this folder, in Sphinx. `docs/build` makes it."""

import re
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).resolve().parent
_PROJECT = _FOLDER.parent

project = "trocar"
author = "The authors of trocar"
_version = re.search(r'^version = "(.+)"$', (_PROJECT / "Cargo.toml").read_text(encoding="utf-8"), re.MULTILINE)
assert _version is not None
version = release = _version[1]

extensions = ["myst_parser", "sphinx_design", "sphinx_copybutton", "sphinxcontrib.katex"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
# Equations become HTML as the book is built; style and fonts are copied beside it: no page needs a network.
katex_prerender = True
katex_css_path = "katex/katex.min.css"
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True
copybutton_line_continuation_character = "\\"

html_theme = "furo"
html_title = f"trocar {version}"
html_static_path = ["book.css"]
html_css_files = ["book.css"]
html_show_copyright = False
exclude_patterns = ["figures"]

#: A link that leads up at least one folder: to another part of the book, or out of it.
_UP = re.compile(r"\[([^\]]+)\]\((\.\./[^)#\s]+)(?:#[^)]*)?\)")


def _beyond_the_book(_app: Any, page: str, source: list[str]) -> None:
    """A link out of this folder becomes a download of the file; one to a folder, its name."""

    def replaced(link: re.Match[str]) -> str:
        words, path = link[1].strip("`"), (_FOLDER / page).parent.joinpath(link[2]).resolve()
        if path.is_relative_to(_FOLDER):
            return link[0]
        if path.is_file():
            return f"{{download}}`{words} <{link[2]}>`"
        if path.is_dir():
            return f"{words} (`{path.relative_to(_PROJECT)}`)"
        raise FileNotFoundError(f"{page}: no {link[2]} in the repository")

    source[0] = _UP.sub(replaced, source[0])


#: Where a page of a model has it live, by the name of the model.
_LIVE = re.compile(r"^<!-- live: ([a-z-]+) -->$", re.MULTILINE)
_MODELS = _FOLDER / "figures/models"
#: Inside of a page of the book the live model stands alone.
_ALONE = "<style>header, footer, main h2, .skip, .on-paper { display: none } main { padding: 0; margin: 0; max-width: none }</style>"


def _live_frames(app: Any, page: str, source: list[str]) -> None:
    """The place of a live model becomes a frame that shows it, on screens; on paper a remark."""
    up = "../" * page.count("/")

    def framed(place: re.Match[str]) -> str:
        if app.builder.name != "html":
            return "On a screen, the model can be moved here."
        frame = f'<iframe class="live-model" src="{up}_live/{place[1]}.html" title="The model, live" loading="lazy"></iframe>'
        return f"```{{raw}} html\n{frame}\n```"

    source[0] = _LIVE.sub(framed, source[0])


def _live_pages(app: Any, failure: Exception | None) -> None:
    """The page of each live model: the one that is kept, with the numbers of the model in it."""
    if failure is not None or app.builder.name != "html":
        return
    shell = (_MODELS / "live.html").read_text(encoding="utf-8").replace("</head>", f"{_ALONE}</head>")
    kept = (_MODELS / "ems.json").read_text(encoding="utf-8").strip()
    assert shell.count(kept) == 1
    folder = Path(app.outdir) / "_live"
    folder.mkdir(exist_ok=True)
    for model in sorted(_MODELS.glob("*.json")):
        numbers = model.read_text(encoding="utf-8").strip()
        (folder / model.with_suffix(".html").name).write_text(shell.replace(kept, numbers), encoding="utf-8")


def setup(app: Any) -> None:
    app.connect("source-read", _beyond_the_book)
    app.connect("source-read", _live_frames)
    app.connect("build-finished", _live_pages)
