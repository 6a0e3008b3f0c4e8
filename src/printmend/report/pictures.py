"""Make the pictures of a report: drawings side by side, above one caption."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from printmend.diagnosis.portrait import Circle, Portrait
from printmend.draw import new_figure
from printmend.draw.document import Pictures
from printmend.draw.figure import (
    INK,
    LEAST_UNROUND_MM,
    draw_circle_test,
    draw_coloured,
    draw_errors,
    draw_fit,
    draw_hull,
    draw_layer_errors,
    draw_play,
)
from printmend.messages import Tell, say, together
from printmend.report.examination import Examination
from printmend.report.part_view import DrawnLayer, PartView

MOST_POINTS = 3000  # most points of a curve
_EVEN_MM = 0.02  # play that varies less along the axis is stated as a number
_LEAST_PERCENT = 0.005  # a smaller scale error is not said
_FINEST_MM = 0.005  # half of the colours are for errors of at least this


def pictures(examination: Examination, tell: Tell) -> list[Pictures]:
    """Return drawings of the measured and learned errors of each motor, and of the bed."""
    return [*(_motor(one, tell) for one in examination.portraits), _bed(examination, tell)]


def layers_picture(layers: Sequence[dict[str, float]], part: str, tell: Tell) -> Pictures:
    """Return the drawing of a part's expected error over its layers."""
    figure, axes = new_figure(1, width_in=4.6, height_in=2.4)
    draw_layer_errors(
        axes[0], *([layer[f"{which}_rms_mm"] for layer in layers] for which in ("before", "after")), tell=tell
    )
    figure.subplots_adjust(left=0.13, right=0.985, top=0.95, bottom=0.2)
    return Pictures([figure], say("picture-layers", part))


def part_picture(view: PartView, tell: Tell) -> Pictures:
    """Return the drawings of one layer of a part, as it is and mended, in the same colours."""
    before_mm, after_mm = (float(np.quantile(each.off_mm, 0.95)) if len(each.off_mm) else 0.0
                           for each in (view.before, view.after))  # fmt: skip
    worst_mm, left_mm = max(before_mm, after_mm, 0.04), max(after_mm, _FINEST_MM)
    fine_mm = left_mm if left_mm < worst_mm / 2 else None
    both = np.concatenate([np.concatenate(each.lines) for each in (view.before, view.after) if len(each.lines)])
    corners = both.min(axis=0), both.max(axis=0)

    def draw(drawn: DrawnLayer, title: str, seams: np.ndarray) -> Figure:
        high_in = 3.7 * float(np.clip((wide := corners[1] - corners[0])[1] / max(wide[0], 1e-6), 0.3, 1.4)) + 1.15
        figure, axes = new_figure(1, width_in=3.8, height_in=high_in)
        figure.subplots_adjust(left=0.02, right=0.98, top=1 - 0.35 / high_in, bottom=0.8 / high_in)
        draw_coloured(axes[0], drawn.lines, drawn.off_mm, corners_mm=corners, worst_mm=worst_mm, title=title,
                      fine_mm=fine_mm, tell=tell)  # fmt: skip
        if len(seams):
            axes[0].plot(
                *seams.T, "o", markersize=3.5, markerfacecolor="none", color=INK, markeredgewidth=0.8, zorder=9
            )
        return figure

    caption = say("picture-part", view.layer + 1, f"{view.z_mm:.2f}")
    if len(view.seams_mm):
        caption = together(" ", [caption, say("picture-seams", len(view.seams_mm))])
    return Pictures(
        [draw(view.before, say("as-it-is"), np.empty((0, 2))), draw(view.after, say("mended"), view.seams_mm)], caption
    )


def _motor(one: Portrait, tell: Tell) -> Pictures:
    """Draw a motor as learned. A round pulley and uniform play get no picture."""
    unround = float(np.abs(np.hypot(*one.outline_mm.T) - one.radius_mm).max())
    figures = [_fit(one, tell)]
    words = [say("picture-motor", one.name)]
    if unround > LEAST_UNROUND_MM:
        words.append(say("picture-pulley"))
        figures.append(
            _square(lambda axes: draw_hull(axes, one.outline_mm, radius_mm=one.radius_mm, name=one.name, tell=tell))
        )
    play = float(one.play_mm.mean())
    if np.ptp(one.play_mm) > _EVEN_MM:
        words.append(say("picture-play-differs"))
        figures.append(
            _square(lambda axes: draw_play(axes, one.motor_mm, one.play_mm, one.play_sd_mm, name=one.name, tell=tell))
        )
    elif play > 0:
        words.append(say("picture-play-gap", f"{play:.2f}"))
    words.append(say("picture-bands"))
    if not _shows_scale(one):
        words.append(say("picture-no-stretch", f"{one.scale_percent:+.2f}"))
    return Pictures(figures, together(" ", words))


def _shows_scale(one: Portrait) -> bool:
    """Tell whether a motor's picture includes its scale error: one too small to be told is left in."""
    return abs(one.scale_percent) < _LEAST_PERCENT


def _fit(one: Portrait, tell: Tell) -> Figure:
    figure, axes = new_figure(1, width_in=4.0, height_in=3.0)
    thin = slice(None, None, max(1, len(one.point_side) // MOST_POINTS))
    off = one.point_error_mm - one.level(one.point_motor_mm)
    points = (one.point_motor_mm[thin], off[thin], one.point_side[thin])
    band = 2 * np.hypot(one.sd_mm, one.noise_mm)
    level = one.level(one.motor_mm)
    draw_fit(
        axes[0], one.motor_mm, one.error_mm - level, band, points, name=one.name, mm_per_turn=one.period_mm,
        shows_scale=_shows_scale(one), tell=tell,
    )  # fmt: skip
    figure.subplots_adjust(left=0.15, right=0.985, top=0.9, bottom=0.17)
    return figure


def _square(draw: Callable[[Axes], Axes]) -> Figure:
    figure, axes = new_figure(1, width_in=3.2, height_in=3.0)
    draw(axes[0])
    figure.subplots_adjust(left=0.17, right=0.97, top=0.9, bottom=0.17)
    return figure


def _bed(examination: Examination, tell: Tell) -> Pictures:
    printer = examination.saved.printer
    bed = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    figures = []
    shown = (examination.before_mm, say("draw-as-printed")), (examination.after_mm, say("draw-unexplained"))
    for errors, title in shown[examination.is_healthy :]:
        figure, axes = new_figure(1, width_in=3.7, height_in=3.7)
        draw_errors(axes[0], examination.places_mm, errors, bed_mm=bed, title=title, tell=tell)
        figure.subplots_adjust(left=0.14, right=0.985, top=0.92, bottom=0.13)
        figures.append(figure)
    caption = say("picture-bed-healthy" if examination.is_healthy else "picture-bed")
    return Pictures(figures, together(" ", [caption, say("picture-bed-walls")]) if examination.has_walls else caption)


def circle_picture(run: Circle, tell: Tell) -> Pictures:
    """Return the drawing of the circular test."""
    figure, axes = new_figure(1, width_in=3.3, height_in=3.4)
    draw_circle_test(axes[0], run.angle_rad, (run.clockwise_mm, run.counter_mm), radius_mm=run.radius_mm, tell=tell)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.99, bottom=0.01)
    return Pictures([figure], say("picture-circle"))
