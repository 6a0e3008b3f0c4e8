"""Write a document as one self-contained HTML page with its style and drawings, readable at 360 pixels and more."""

import base64
import html
import re
from collections.abc import Iterable

from printmend.draw.document import Block, Card, Items, Numbers, Pictures, Strip, Words, sentence, svg
from printmend.messages import Tell

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
.fault { border: 1px solid var(--line); border-left: 7px solid var(--mark); border-radius: 10px;
  background: var(--card); padding: .4em 1.2em .7em; margin: .9em 0; break-inside: avoid; }
.fault h3 { margin: .4em 0 .2em; font-size: 1.1em; } .fault p { margin: .3em 0; }
.tag { font-size: .72em; font-weight: 600; border-radius: 1em; padding: .2em .8em; margin-left: .5em; color: #fff;
  background: var(--mark); white-space: nowrap; vertical-align: .12em; }
dt { font-weight: 600; color: var(--soft); } dd { margin: 0; }
dl { display: grid; grid-template-columns: 8.5em 1fr; gap: .2em 1em; margin: .5em 0; }
.wide { overflow-x: auto; margin: .8em 0; background: /* a shadow at the right, as long as there is more */
  linear-gradient(to left, var(--paper) 50%, transparent) right / 3em 100% no-repeat local,
  linear-gradient(to left, #0004, transparent) right / 1em 100% no-repeat; }
table { border-collapse: collapse; font-size: .95em; }
td, th { padding: .3em .8em; text-align: right; vertical-align: top; border-bottom: 1px solid var(--line);
  overflow-wrap: normal; hyphens: auto; }
td:first-child, th:first-child { text-align: left; padding-left: 0; }
table.words td:nth-child(2), table.words th:nth-child(2) { text-align: left; }
figure { margin: 1.2em 0; padding: 1em; border: 1px solid var(--line); border-radius: 10px; break-inside: avoid; }
figure > div { display: flex; flex-wrap: wrap; gap: .6em; justify-content: center; }
figure img { flex: 1 1 320px; min-width: 0; max-width: 100%; height: auto; } figcaption { color: var(--soft); }
figure.one img { flex: 0 1 560px; }
@media (max-width: 600px) { body { padding: 1.2em .8em; } dl { grid-template-columns: 1fr; } dd { margin-bottom: .5em; }
  figure { padding: .5em; } table { font-size: .85em; } td, th { padding: .3em; } }
"""


def page(title: str, blocks: Iterable[Block], *, tell: Tell, language: str) -> str:
    """Return a complete page with the blocks."""
    body = "\n".join(_html(block, tell) for block in blocks)
    return f"""<!doctype html>
<html lang="{language}"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{_escaped(tell(title))}</title><style>{_STYLE}</style></head><body>
{body}
</body></html>
"""


def _html(block: Block, tell: Tell) -> str:
    def words(text: str) -> str:
        return _escaped(tell(text))

    if isinstance(block, Words):
        text = words(block.text)
        return {
            "title": f"<h1>{text}</h1>", "lead": f'<p class="big">{text}</p>', "heading": f"<h2>{text}</h2>",
            "text": f"<p>{text}</p>", "small": f"<p><small>{text}</small></p>",
        }[block.style]  # fmt: skip
    if isinstance(block, Items):
        return f"<ul>{''.join(f'<li>{_escaped(sentence(tell(text)))}</li>' for text in block.texts)}</ul>"
    if isinstance(block, Strip):
        cells = "".join(
            f"<div><b>{words(value)}</b><span>{words(about)}</span></div>" for value, about in block.numbers
        )
        return f'<div class="strip">{cells}</div>'
    if isinstance(block, Card):
        mark = f' <span class="tag">{words(block.mark)}</span>' if block.mark else ""
        lines = "".join(
            f"<dl><dt>{words(key)}</dt><dd>{words(text)}</dd></dl>" if key else f"<p>{words(text)}</p>"
            for key, text in block.lines
        )
        return f'<div class="fault" style="--mark:{block.colour}"><h3>{words(block.title)}{mark}</h3>{lines}</div>'
    return _table(block, words) if isinstance(block, Numbers) else _picture(block, words)


def _escaped(text: str) -> str:
    """Return words as HTML; text in backticks becomes code."""
    return re.sub(r"`(.+?)`", r"<code>\1</code>", html.escape(text))


def _table(block: Numbers, words: Tell) -> str:
    head, *body = ([words(cell) for cell in row] for row in block.rows)
    rows = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in body)
    kind = " class=words" if block.words > 1 else ""
    shown = (
        f'<div class="wide"><table{kind}><tr>{"".join(f"<th>{cell}</th>" for cell in head)}</tr>{rows}</table></div>'
    )
    if block.folded:
        return f"<details><summary>{words(block.caption)}</summary>{shown}</details>"
    return (f"<p>{words(block.caption)}</p>" if block.caption else "") + shown


def _picture(block: Pictures, words: Tell) -> str:
    """Return drawings and their caption; each is a separate image, because names inside inline drawings would clash."""
    images, caption = "", words(block.caption)
    for i, figure in enumerate(block.figures):
        data = base64.b64encode(svg(figure).encode()).decode()
        images += f'<img alt="{"" if i else caption}" src="data:image/svg+xml;base64,{data}">'
    kind = "" if len(block.figures) > 1 else ' class="one"'
    return f"<figure{kind}><div>{images}</div><figcaption>{caption}</figcaption></figure>"
