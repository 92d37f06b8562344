"""Search for the strip of the picture that shows the beam, from the clamp outward.

The search extends many strips step by step, and keeps the strips with the best scores after each step (beam search). A
score is the sum of the gains of all steps:

    gain = support - 0.8 - 0.42 misfit - 0.6 (shift / 0.35)² - (cost of bend and width) + (gain of the centre line).

support                  how clearly the colour changes at both sides of the strip, 0 to 2
misfit                   difference between the colours inside the strip, in this step and in earlier steps, 0 to 2
shift                    sideways shift of the strip in this step, in beam widths
cost of bend and width   large for a sudden or strong bend and for an unusual width
gain of the centre line  positive near an expected centre line, negative far from the line; 0 without such a line
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following import hypotheses as hypothesis
from eimi_lab.vision.following.centre_line import CLICKED_PX
from eimi_lab.vision.following.hypotheses import Hypotheses
from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]

WIDTH_PX = 16.0  # of the beam in the working picture, in which the places across it are 1.6 px apart
_KEPT = 300  # strips after each step
_BEHIND = 4.0  # a strip is dropped if its score is lower than the best score by this gain of several full steps
_CELL = 0.2  # widths: of several strips that end in the same cell and direction only the best is kept
_CELL_RAD = math.radians(6.0)
_SEED_AT = 0.5  # widths from the clamp; the other ranges of the seeds follow
_SEED_OFFSET = np.linspace(-1.0, 1.0, 7)
_SEED_ANGLE = np.radians(np.linspace(-24.0, 24.0, 9))
_SEED_BEND = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
_SEED_WIDTH = np.array([0.75, 0.85, 0.95, 1.05, 1.15])
_POINTED_PX = 4.0  # error of a clamp that a person pointed at by eye
# The ways in which a strip may continue: with another curvature, with another width, or shifted sideways.
_MORE_BEND = 0.35 * np.array([0.0, -0.12, 0.12, -0.4, 0.4, -1.0, 1.0, 0.0, 0.0, -0.4, 0.4, 0.0, 0.0])
_MORE_WIDTH = np.array([1.0] * 7 + [0.96, 1.04] + [1.0] * 4)
_MORE_ASIDE = np.array([0.0] * 9 + [-0.08, 0.08, -0.08, 0.08])
_WIDTH_COST = 4.0  # times the squared logarithm of the width: a deviation of a tenth costs 0.04
_STIFFEST = 0.8  # largest curvature times the width
_NEEDED = 0.8  # support of the two sides together at which a step gains nothing
_OTHER_POLARITY = 100.0  # cost of the wrong polarity, more than any strip gains
_ANOTHER = 0.6  # widths: a strip at this distance beside the best one is another body
_FARTHEST = 1.15  # of the stated length: the longest strip
_TIE = 0.93  # of the best strip's score: a body with at least this score is equally likely


@dataclass(frozen=True)
class Strip:
    """The strip of the picture that shows the beam, at k points from the clamp outward.

    Attributes
    ----------
    place : ndarray, shape (k, 2)
        Points on the centre line of the strip, px.
    angle : ndarray, shape (k,)
        Direction of the strip, rad, clockwise from +x.
    width : ndarray, shape (k,)
        Width of the strip, px.
    gain : ndarray, shape (k,)
        Clarity of both edges between a point and the point before, less the cost of bends.
    step_px : float
        Distance between neighbouring points.
    variance : float
        Variance of the colours inside the strip, summed over the colour channels.
    rival : float
        Sum of the gains of the best strip along another body (such as a cable), divided by that of this strip.
    """

    place: Array
    angle: Array
    width: Array
    gain: Array
    step_px: float
    variance: float
    rival: float

    @property
    def length_px(self) -> float:
        """Length of the strip of the picture that contains the beam, px."""
        return self.step_px * (len(self.gain) - 1)


@dataclass(frozen=True)
class _Stiffness:
    """How strongly the beam is expected to bend.

    `bend`: usual change of the curvature over one beam width, 1/px. `most`: largest permitted curvature, 1/px.
    """

    bend: float
    most: float


def find_strip(picture: WorkingPicture, polarity: str | None, earlier: Callable[[], Array | None]) -> Strip | None:
    """Search for the strip of the picture that shows the beam.

    Parameters
    ----------
    picture : WorkingPicture
        The picture.
    polarity : {"dark", "bright"}, optional
        Whether the beam is darker or brighter than its surroundings at the clamp; None if either is possible.
    earlier : callable
        Returns n points of the beam in an earlier picture, in pixels of this picture, shape (n, 2), or None. Called
        only if several bodies are about equally likely; the body nearest to these points is then chosen.

    Returns
    -------
    Strip or None
        None if no strip has clear edges.
    """
    beam = picture.beam
    width, length = beam.width_px, beam.length_px
    slenderness_factor = min(1.0, 8.0 * width / length)
    stiffness = _Stiffness(slenderness_factor / width, _STIFFEST * min(1.0, 10.0 * width / length) / width)
    step = max(width / 3.0, length / 90.0)
    strips = _seeds(picture, stiffness, polarity)
    trail = [_Generation(strips, np.arange(len(strips)), strips.score)]
    for count in range(1, round(max(_FARTHEST * length, beam.clicked_px) / step) + 1):
        along = _SEED_AT * width + count * step
        strips, parent, gain = _extended(picture, strips, stiffness, step, along)
        trail.append(_Generation(strips, parent, gain))
    clicked = min(round((beam.clicked_px - CLICKED_PX * picture.factor) / step), len(trail) - 1)
    return _best_strip(trail, step, width, earlier, max(0, clicked))


@dataclass(frozen=True)
class _Generation:
    # The possible strips after one step of the search.
    # `parent`: index of the shorter strip from which each strip was extended. `gain`: increase of the score by this
    # step.

    strips: Hypotheses
    parent: NDArray[np.int64]
    gain: Array


def _seeds(picture: WorkingPicture, stiffness: _Stiffness, polarity: str | None) -> Hypotheses:
    beam, width = picture.beam, picture.beam.width_px
    aside = max(0.3 * width, min(_POINTED_PX * picture.factor, 0.5 * width))
    stated = float(beam.relative_width(_SEED_AT * width)) * width
    grid = np.meshgrid(aside * _SEED_OFFSET, _SEED_ANGLE, stiffness.bend * _SEED_BEND, stated * _SEED_WIDTH)
    offset, turn, bend, wide = (axis.ravel() for axis in grid)
    across = np.array([-beam.ahead[1], beam.ahead[0]])
    angle = beam.axis_rad + turn
    root = beam.clamp_px + _SEED_AT * width * beam.ahead + offset[:, None] * across
    lines = []
    for along in (-0.25 * width, 0.0, 0.25 * width):
        middle = angle + 0.5 * bend * along
        place = root + along * np.column_stack([np.cos(middle), np.sin(middle)])
        lines.append(hypothesis.read_across(picture, place[:, 0], place[:, 1], angle + bend * along, wide))
    line_colours = np.stack(lines)
    colours = line_colours.mean(axis=0)
    template = hypothesis.inside_of(colours)
    squares = ((line_colours - colours) ** 2)[:, :, 3:12].sum(axis=3).mean(axis=(0, 2))
    scatter = squares * len(lines) / (len(lines) - 1)
    variance = hypothesis.assumed_variance(hypothesis.least_variance(picture), scatter, template)
    score = hypothesis.side_support(colours, variance) - _NEEDED
    score -= _implausible(np.zeros(len(bend)), wide / stated, bend, width)
    score -= 0.5 * (offset / aside) ** 2  # the clamp is close to its stated place
    if polarity is not None:
        brighter = hypothesis.brightness_step(colours) > 0.0
        score = np.where(brighter == (polarity == "bright"), score, -_OTHER_POLARITY)
    return Hypotheses(root, angle, bend, wide, template, variance, variance, score)


def _extended(
    picture: WorkingPicture, strips: Hypotheses, stiffness: _Stiffness, step: float, along: float
) -> tuple[Hypotheses, NDArray[np.int64], Array]:
    """Extend strips by one step; return the best new strips, the index of the old strip of each, and added scores."""
    # All arrays are (n, ways): only the best ways become strips of their own.
    bend = strips.bend[:, None] + stiffness.bend * _MORE_BEND
    stated = float(picture.beam.relative_width(along)) * picture.beam.width_px
    before = float(picture.beam.relative_width(along - step)) * picture.beam.width_px
    width = strips.width[:, None] * (stated / before * _MORE_WIDTH)
    begin_angle, aside = strips.angle[:, None], picture.beam.width_px * _MORE_ASIDE
    begin_x = strips.place[:, :1] - np.sin(begin_angle) * aside
    begin_y = strips.place[:, 1:] + np.cos(begin_angle) * aside
    lines = max(1, min(3, round(step / (0.5 * picture.beam.width_px))))
    read = []
    for share in (np.arange(lines) + 1.0) / lines:
        middle = begin_angle + 0.5 * share * step * bend
        x, y = begin_x + share * step * np.cos(middle), begin_y + share * step * np.sin(middle)
        angle = begin_angle + share * step * bend
        read.append(hypothesis.read_across(picture, x, y, angle, width))
    colours = read[0] if lines == 1 else np.stack(read).mean(axis=0)
    variance = strips.variance[:, None]
    gain = hypothesis.side_support(colours, variance) - _NEEDED
    gain -= 0.42 * hypothesis.misfit(colours, strips.template[:, None], strips.tolerance[:, None])
    gain -= 0.6 * (_MORE_ASIDE / 0.35) ** 2
    gain -= _implausible(_MORE_BEND, width / stated, bend, picture.beam.width_px)
    if picture.beam.line is not None:
        gain += picture.beam.line.gain(x, y, along, picture.beam.width_px)
    high, wide = picture.pixels.shape[:2]
    gain[(x < -0.5) | (y < -0.5) | (x > wide - 0.5) | (y > high - 0.5)] = -_NEEDED - 0.42 * 2.0
    score = np.where(np.abs(bend) <= stiffness.most, strips.score[:, None] + gain, -np.inf)
    best = _best_of_each_cell(x.ravel(), y.ravel(), angle.ravel(), score.ravel(), picture.beam.width_px)
    parents = best // len(_MORE_BEND)
    place = np.column_stack([x.ravel()[best], y.ravel()[best]])
    template, variances = hypothesis.updated_templates(
        colours.reshape(-1, *colours.shape[2:])[best],
        strips.template[parents],
        strips.tolerance[parents],
        strips.variance[parents],
        hypothesis.least_variance(picture),
    )
    bends, widths, scores = bend.ravel()[best], width.ravel()[best], score.ravel()[best]
    grown = Hypotheses(
        place, angle.ravel()[best], bends, widths, template, strips.tolerance[parents], variances, scores
    )
    return grown, parents, gain.ravel()[best]


def _implausible(more_bend: Array, width: Array, bend: Array, width_px: float) -> Array:
    """Return the cost of a piece of the beam with a changed curvature, a strong curvature or an unusual width."""
    return np.asarray(0.6 * more_bend**2 + _WIDTH_COST * np.log(width) ** 2 + 0.03 * (bend * width_px / 0.6) ** 2)


def _best_of_each_cell(x: Array, y: Array, angle: Array, score: Array, width: float) -> NDArray[np.int64]:
    """Return the indices of the strips with the highest scores, without near duplicates of a better strip."""
    near = np.flatnonzero(score > score.max() - _BEHIND)
    order = near[np.argsort(-score[near])]
    key = np.zeros(len(order), dtype=np.int64)
    for value, step in ((x, _CELL * width), (y, _CELL * width), (angle, _CELL_RAD)):
        cell = np.floor(value[order] / step).astype(np.int64)
        cell -= cell.min()
        key = key * (int(cell.max()) + 1) + cell
    first = np.unique(key, return_index=True)[1]
    return np.asarray(order[np.sort(first)[:_KEPT]])


def _best_strip(
    trail: list[_Generation], step: float, width: float, earlier: Callable[[], Array | None], least: int
) -> Strip | None:
    best = [float(generation.strips.score.max()) for generation in trail]
    last = least + int(np.argmax(best[least:]))
    if last == 0 or best[last] <= 0.0:
        return None
    ends = trail[last].strips
    index = _index_of_best(trail[: last + 1], earlier, width)
    variance, lead = float(ends.variance[index]), best[last] / float(ends.score[index])
    places, angles, widths, gains = [], [], [], []
    for generation in reversed(trail[: last + 1]):
        strips = generation.strips
        places.append(strips.place[index])
        angles.append(strips.angle[index])
        widths.append(strips.width[index])
        gains.append(generation.gain[index])
        index = int(generation.parent[index])
    values = [np.array(value[::-1]) for value in (places, angles, widths, gains)]
    rival = _rival(trail[: last + 1], values[0], values[1], values[3], width)
    rival = max(rival, lead) if lead > 1.0 else rival
    return Strip(values[0], values[1], values[2], values[3], step, variance, rival)


def _index_of_best(trail: list[_Generation], earlier: Callable[[], Array | None], width: float) -> int:
    score = trail[-1].strips.score
    best = int(score.argmax())
    equals = np.flatnonzero(score >= _TIE * score[best])
    index, places = equals, []
    for generation in reversed(trail):
        places.append(generation.strips.place[index])
        index = generation.parent[index]
    paths = np.stack(places, axis=1)  # (equals, steps, 2)

    def of_body(path: Array) -> NDArray[np.bool_]:
        return np.asarray(np.linalg.norm(paths - path, axis=2).max(axis=1) < _ANOTHER * width)

    if of_body(paths[equals == best][0]).all():
        return best
    earlier_places = earlier()
    if earlier_places is None or not len(earlier_places):
        return best
    distances = np.linalg.norm(paths[:, :, None] - earlier_places, axis=3).min(axis=1).mean(axis=1)
    nearest_body = of_body(paths[distances.argmin()])
    same_body = nearest_body[equals == best].any()
    return best if same_body else int(equals[nearest_body][score[equals[nearest_body]].argmax()])


def _rival(trail: list[_Generation], place: Array, angle: Array, gain: Array, width: float) -> float:
    """Return the score of the best strip along another body (such as a cable), divided by that of the chosen strip."""
    half = max(1, len(trail) // 2)
    across = np.array([-np.sin(angle[half]), np.cos(angle[half])])
    strips, score = trail[half].strips, float(gain[: half + 1].sum())
    beside = np.abs((strips.place - place[half]) @ across) > _ANOTHER * width
    return float(strips.score[beside].max(initial=0.0)) / max(score, 1e-9)
