"""The prediction as a file: JSON for programs, one self-contained HTML page for people."""

import html
import json
import math
from pathlib import Path

import printmend
from printmend.errors import InputError
from printmend.files import replacing
from printmend.repair.prediction import Prediction
from printmend.saved.model import SavedModel

_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 860, 300, 56, 34
_MOST_ROWS = 400  # of the table; the chart has them all
_TYPE_B = ("instrument", "motion", "rounding", "planning")  # known from elsewhere than the scatter of the points
_COLOURS = {"before": "#c2410c", "after": "#15803d"}


def check_report_name(path: Path | None) -> None:
    """Raise `InputError` for a report that is neither .html nor .json, before any work is done."""
    if path is not None and path.suffix.lower() not in (".html", ".htm", ".json"):
        raise InputError(path, wanted="a report in .html or .json", came=repr(path.suffix), todo="change its name")


def write_report(path: Path, source: str, model: SavedModel, prediction: Prediction) -> None:
    """Write the prediction for ``source`` in the form that the name of ``path`` asks for."""
    check_report_name(path)
    as_json = path.suffix.lower() == ".json"
    with replacing(path) as file:
        file.write(_json(source, model, prediction) if as_json else _page(source, model, prediction))


def _json(source: str, model: SavedModel, prediction: Prediction) -> str:
    about = {"source": source, "program": printmend.__version__, "model": model.digest, "printer": model.printer.name}
    return json.dumps({**about, **prediction.json()}, indent=1) + "\n"


def _page(source: str, model: SavedModel, prediction: Prediction) -> str:
    before, after = prediction.before, prediction.after
    headline = f"Expected error of the print: {before.rms_mm:.3f} mm as it is, {after.rms_mm:.3f} mm mended" + (
        f" ({after.rms_low_mm:.3f}–{after.rms_high_mm:.3f} mm in nine of ten)." if after.made_of else "."
    )
    rows = "".join(
        f"<tr><td>{name}</td><td>{e.rms_mm:.3f}</td><td>{e.p95_mm:.3f}</td><td>{e.max_mm:.3f}</td></tr>"
        for name, e in (("as it is", before), ("mended", after))
    )
    for name, height in zip(("as it is", "mended"), prediction.heights or (), strict=False):
        rows += f"<tr><td>{name}, in height</td><td>{height.rms_mm:.3f}</td><td></td><td>{height.max_mm:.3f}</td></tr>"
    findings = "".join(f"<li>{html.escape(line)}</li>" for line in model.findings)
    facts = [
        f"{prediction.length_mm / 1000:.1f} m of extruded path in {len(prediction.layers)} layers",
        f"{prediction.moves} moves became {prediction.commands}",
        f"slack taken up at {prediction.takeups} reversals, at {prediction.stops} of them standing still",
    ]
    if prediction.unknown:
        facts.append(f"{prediction.unknown} extruding moves left as they are: the head's place is unknown there")
    if prediction.clamped:
        facts.append(f"{prediction.clamped} commands held back at the edge of the bed")
    listed = "".join(f"<li>{fact}</li>" for fact in facts)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{html.escape(Path(source).name)} mended</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 900px; margin: 2em auto; padding: 0 1em; color: #1c1917; }}
table {{ border-collapse: collapse; }}
td, th {{ padding: .15em .9em; text-align: right; border-bottom: 1px solid #e7e5e4; }}
td:first-child, th:first-child {{ text-align: left; }} .big {{ font-size: 1.25em; }} small {{ color: #78716c; }}
details table {{ font-size: .85em; }}
</style></head><body>
<h1>{html.escape(Path(source).name)}</h1>
<p class="big">{headline}</p>
<table><tr><th>distance from the wanted path [mm]</th><th>RMS</th><th>95 % below</th><th>largest</th></tr>{rows}</table>
{_budget(prediction)}
<h2>Layer by layer</h2>
{_chart(prediction)}
<ul>{listed}</ul>
<h2>The printer</h2>
<p>{html.escape(model.printer.name)}, model {model.digest}</p><ul>{findings}</ul>
{_table(prediction)}
<p><small>printmend {printmend.__version__}. Predicted by the learned model, not measured.</small></p>
</body></html>
"""


def _budget(prediction: Prediction) -> str:
    """Return the uncertainty budget of the mended print after the GUM (JCGM 100): type A is from the scatter of the
    measurement, type B from elsewhere; combined as the root of the sum of squares, expanded with k = 2."""
    after = prediction.after
    if prediction.gain_mm is None:
        return ""
    rows = "".join(
        f"<tr><td>{html.escape(name)}</td><td>{'B' if name in _TYPE_B else 'A'}</td><td>{share:.4f}</td></tr>"
        for name, share in sorted(after.made_of.items(), key=lambda item: -item[1])
    )
    advice = "".join(f"<p>Before you print: {html.escape(each)}</p>" for each in prediction.advice)
    head = "<tr><th>cause</th><th>type</th><th>standard uncertainty [mm]</th></tr>"
    total = f"<tr><td>combined</td><td></td><td>{after.rms_mm:.4f}</td></tr>"
    twice = f"<tr><td>expanded, k = 2</td><td></td><td>{2 * after.rms_mm:.4f}</td></tr>"
    return f"<h2>What the expectation is made of</h2><table>{head}{rows}{total}{twice}</table>{advice}"


def _chart(prediction: Prediction) -> str:
    """Draw the RMS error of each layer as SVG."""
    layers = prediction.layers
    if not layers:
        return "<p>No layers.</p>"
    step = _round_up(max(max(layer["before_rms_mm"], layer["after_rms_mm"]) for layer in layers) / 4)
    top = 4 * step
    wide, high = _WIDTH - _LEFT - 10, _HEIGHT - _BOTTOM - 10

    def x(i: float) -> float:
        return _LEFT + wide * (i + 0.5) / len(layers)

    def y(value: float) -> float:
        return 10 + high * (1 - value / top)

    parts = [f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="typical error of each layer">']
    for tick in range(5):
        value = step * tick
        parts.append(
            f'<line x1="{_LEFT}" x2="{_WIDTH - 10}" y1="{y(value):.1f}" y2="{y(value):.1f}" stroke="#e7e5e4"/>'
            f'<text x="{_LEFT - 6}" y="{y(value) + 4:.1f}" text-anchor="end" font-size="12">{value:.3g}</text>'
        )
    places = {0: "start", len(layers) // 2: "middle", len(layers) - 1: "end"} if len(layers) > 2 else {0: "start"}
    for i, anchor in places.items():
        parts.append(
            f'<text x="{x(i):.1f}" y="{_HEIGHT - 12}" text-anchor="{anchor}" font-size="12">'
            f"layer {i + 1}, z {layers[i]['z_mm']:g}</text>"
        )
    for j, (name, label) in enumerate((("before", "as it is"), ("after", "mended"))):
        points = " ".join(f"{x(i):.1f},{y(layer[f'{name}_rms_mm']):.1f}" for i, layer in enumerate(layers))
        colour = _COLOURS[name]
        if len(layers) == 1:
            parts.append(f'<circle cx="{points.split(",")[0]}" cy="{points.split(",")[1]}" r="4" fill="{colour}"/>')
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        parts.append(
            f'<text x="{_WIDTH - 14}" y="{24 + 16 * j}" text-anchor="end" font-size="13" fill="{colour}">{label}</text>'
        )
    return (
        "".join(parts)
        + "</svg><p><small>Typical distance (root mean square) from the wanted path [mm] over the layers.</small></p>"
    )


def _round_up(value: float) -> float:
    """Return 1, 2, 2.5 or 5 times a power of ten, at least ``value``."""
    if value <= 0:
        return 0.25
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= value * (1 - 1e-9))


def _table(prediction: Prediction) -> str:
    rows = "".join(
        f"<tr><td>{i + 1}</td><td>{layer['z_mm']:g}</td><td>{layer['length_mm'] / 1000:.2f}</td>"
        f"<td>{layer['before_rms_mm']:.3f}</td><td>{layer['before_max_mm']:.3f}</td>"
        f"<td>{layer['after_rms_mm']:.3f}</td><td>{layer['after_max_mm']:.3f}</td></tr>"
        for i, layer in enumerate(prediction.layers[:_MOST_ROWS])
    )
    more = len(prediction.layers) - _MOST_ROWS
    note = f"<p><small>and {more} more; --report FILE.json has them all</small></p>" if more > 0 else ""
    return (
        "<details><summary>All layers</summary><table><tr><th>layer</th><th>z [mm]</th><th>path [m]</th>"
        f"<th>as it is, typical</th><th>largest</th><th>mended, typical</th><th>largest</th></tr>{rows}"
        f"</table>{note}</details>"
    )
