"""Build the documentation as a site, by each of the two builders, and check what they wrote.

``python tools/site.py`` builds ``site/mkdocs`` and ``site/zensical``, as far as they are installed. A dead
link ends it, and so does anything that a reader's browser would fetch from elsewhere.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUILDERS = {"mkdocs": ["build", "--strict", "--quiet"], "zensical": ["build", "--strict"]}
_QUIET = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}

_FETCHED = re.compile(
    r"""<(?:script|link|img|iframe|source|object|embed|video)\b[^>]*?["'](?:https?:)?//[^>]*>"""
    r"""|(?:url\(|@import)\s*["']?(?:https?:)?//[^)\s]*"""
    # The themes fetch a library of diagrams, and others, for pages that ask for them.
    r"""|class=["'][^"']*\b(?:mermaid|glightbox|pyodide)\b[^>]*"""
)
_UNREAD = re.compile(
    r"<p>(?:(?!</p>|<pre).)*\n(?:- |\d+\. |\|)[^\n]*|</pre></div>\n(?:- |\d+\. |\|)[^\n]*", flags=re.DOTALL
)
"""A list or a table that the builder took for prose: GitHub reads it without a blank line before it."""


def faults(site: Path) -> list[str]:
    """Return what is wrong with a built site: what is fetched from elsewhere, what was not laid out."""
    found = []
    for page in sorted((*site.rglob("*.html"), *site.rglob("*.css"))):
        text = page.read_text(encoding="utf-8")
        found += [f"{page.relative_to(site)} fetches {match[0][:120]}" for match in _FETCHED.finditer(text)]
        if page.suffix == ".html":
            found += [
                f"{page.relative_to(site)} has a list without a blank line before it: {match[0][-80:]}"
                for match in _UNREAD.finditer(text)
            ]
    return found


def main() -> int:
    """Build with what is there; 1 where a builder or a check complains, 2 where there is no builder."""
    built = 0
    for name, arguments in BUILDERS.items():
        program = shutil.which(name, path=str(Path(sys.executable).parent))
        if program is None:
            print(f"{name} is not installed: python -m pip install -e '.[docs]'")
            continue
        site = ROOT / "site" / name
        shutil.rmtree(site, ignore_errors=True)
        # Both write where the configuration says; one of them takes no other place on its command line.
        settings = ROOT / "mkdocs.yml"
        text = settings.read_text(encoding="utf-8").replace("site_dir: site\n", f"site_dir: site/{name}\n")
        of_builder = ROOT / f".mkdocs-{name}.yml"
        of_builder.write_text(text, encoding="utf-8")
        try:
            command = [program, *arguments, "-f", str(of_builder)]
            code = subprocess.run(command, cwd=ROOT, env=_QUIET, check=False).returncode
        finally:
            of_builder.unlink()
        wrong = faults(site) if site.exists() else ["it wrote no site"]
        for fault in wrong:
            print(f"{name}: {fault}")
        if code or wrong:
            return 1
        print(f"{name}: {len(list(site.rglob('*.html')))} pages in {site.relative_to(ROOT)}/")
        built += 1
    return 0 if built else 2


if __name__ == "__main__":
    sys.exit(main())
