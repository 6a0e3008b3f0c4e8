"""A page of its own in HTML: one style, escaped words, drawings within it. Readable from 360 pixels on."""

import base64
import html
import re
from collections.abc import Sequence

from printmend.draw.document import svg
from printmend.report.pictures import Group

_STYLE = """
:root { --ink: #1c1917; --soft: #57534e; --line: #e7e5e4; --paper: #ffffff; --card: #fafaf9; }
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, "Segoe UI", Roboto, sans-serif; max-width: 1000px; margin: 0 auto;
  padding: 2.2em 1.4em; color: var(--ink); background: var(--paper); overflow-wrap: anywhere; }
h1 { font-size: 1.9em; line-height: 1.2; margin: 0 0 .2em; } h2 { margin: 2.2em 0 .6em; font-size: 1.3em; }
.big { font-size: 1.15em; margin: .3em 0 1.2em; } small { color: #57534e; }
.strip { display: grid; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); gap: .8em; margin: 1.2em 0; }
.strip div { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: .8em 1em; }
.strip b { display: block; font-size: 1.55em; line-height: 1.25; } .strip span { color: var(--soft); font-size: .9em; }
.fault { border: 1px solid var(--line); border-left: 7px solid #86868b; border-radius: 10px; background: var(--card);
  padding: .4em 1.2em .7em; margin: .9em 0; break-inside: avoid; }
.fault h3 { margin: .4em 0 .2em; font-size: 1.1em; } .fault p { margin: .3em 0; }
.tag { font-size: .72em; font-weight: 600; border-radius: 1em; padding: .2em .8em; margin-left: .5em; color: #fff;
  white-space: nowrap; vertical-align: .12em; }
.repair { border-left-color: #c2410c; } .soon { border-left-color: #ca8a04; } .software { border-left-color: #15803d; }
.repair .tag { background: #c2410c; } .soon .tag { background: #a16207; } .software .tag { background: #15803d; }
dt { font-weight: 600; color: var(--soft); } dd { margin: 0; }
dl { display: grid; grid-template-columns: 8.5em 1fr; gap: .2em 1em; margin: .5em 0; }
.wide { overflow-x: auto; margin: .8em 0; } table { border-collapse: collapse; font-size: .95em; }
td, th { padding: .3em .8em; text-align: right; border-bottom: 1px solid var(--line); overflow-wrap: normal; }
td:first-child, th:first-child { text-align: left; padding-left: 0; font-weight: 600; }
table.words td:nth-child(2), table.words th:nth-child(2) { text-align: left; }
figure { margin: 1.2em 0; padding: 1em; border: 1px solid var(--line); border-radius: 10px; break-inside: avoid; }
figure > div { display: flex; flex-wrap: wrap; gap: .6em; justify-content: center; }
figure img { flex: 1 1 320px; min-width: 0; max-width: 100%; height: auto; } figcaption { color: var(--soft); }
figure.one img { flex: 0 1 560px; } figure.long img { flex: 1 1 100%; }
@media (max-width: 600px) { body { padding: 1.2em .8em; } dl { grid-template-columns: 1fr; } dd { margin-bottom: .5em; }
  figure { padding: .5em; } }
@media (max-width: 600px) { figure.long > div { overflow-x: auto; justify-content: start; }
  figure.long img { flex: 0 0 620px; max-width: none; } }
"""
_WIDE_RATIO = 2.0  # times as wide as high: on a narrow screen it is moved sideways, so that it stays legible


def say(text: str) -> str:
    """Return words as HTML; what stands in backticks is code."""
    return re.sub(r"`(.+?)`", r"<code>\1</code>", html.escape(text))


def table(rows: Sequence[Sequence[str]], *, words: bool = False) -> str:
    """Return a table whose first row is the head; with ``words`` its second column is text, too."""
    head = "".join(f"<th>{say(cell)}</th>" for cell in rows[0])
    body = "".join("<tr>" + "".join(f"<td>{say(cell)}</td>" for cell in row) + "</tr>" for row in rows[1:])
    return f'<div class="wide"><table{" class=words" if words else ""}><tr>{head}</tr>{body}</table></div>'


def strip(numbers: Sequence[tuple[str, str]]) -> str:
    """Return the few numbers that matter, each with its words."""
    return '<div class="strip">' + "".join(
        f"<div><b>{say(value)}</b><span>{say(about)}</span></div>" for value, about in numbers
    ) + "</div>"  # fmt: skip


def picture(group: Group) -> str:
    """Return drawings and their caption; each is an image of its own, for the names inside inline drawings clash."""
    images = ""
    for i, figure in enumerate(group.figures):
        data = base64.b64encode(svg(figure).encode()).decode()
        about = say(group.caption) if i == 0 else ""
        images += f'<img alt="{about}" src="data:image/svg+xml;base64,{data}">'
    wide, high = group.figures[0].get_size_inches()
    kind = "" if len(group.figures) > 1 else ' class="long"' if wide > _WIDE_RATIO * high else ' class="one"'
    return f"<figure{kind}><div>{images}</div><figcaption>{say(group.caption)}</figcaption></figure>"


def page(title: str, body: str) -> str:
    """Return the whole page."""
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{say(title)}</title><style>{_STYLE}</style></head><body>
<h1>{say(title)}</h1>
{body}
</body></html>
"""
