"""What the pages of reports have in common: one file each that needs nothing else, dark or light as its reader is."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

STYLE = """
:root{color-scheme:light dark;--line:#8884;--soft:#8882}
body{font:15px/1.5 system-ui,sans-serif;max-width:1040px;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}
td,th{padding:.25rem .6rem;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
section{border-top:1px solid var(--line);margin-top:2rem;padding-top:.5rem}
svg{width:100%;height:auto}
.good{color:#2a9d5c}.bad{color:#d1382c}.lead{font-size:17px}a{color:inherit}
ul{margin:.3rem 0}details{background:var(--soft);padding:.3rem .8rem;border-radius:6px}
"""


def page(title: str, body: str, style: str = "") -> str:
    """A whole page. title: plain text; body: HTML; style: what is added to STYLE."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}{style}</style></head><body>{body}</body></html>\n"
    )


def table(titles: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """A table of plain text. kind: its class."""
    head = "".join(f"<th>{escape(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    name = f' class="{kind}"' if kind else ""
    return f"<table{name}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
