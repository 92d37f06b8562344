"""The search for the strip: hypotheses from the clamp outward, the best of them kept at every step (a beam search)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following import hypotheses as hypothesis
from eimi_lab.vision.following.hypotheses import Hypotheses
from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]

WIDTH_PX = 16.0  # of the beam in the working picture: the places across it are then about a pixel and a half apart
_KEPT = 300
_BEHIND = 4.0  # of score, several whole steps: a strip so far behind the best one does not catch up
_CELL = 0.2  # widths: of two strips that end in the same cell and direction the better goes on
_CELL_RAD = math.radians(6.0)
_SEED_AT = 0.5  # widths from the clamp
_SEED_OFFSET = np.linspace(-1.0, 1.0, 7)
_SEED_ANGLE = np.radians(np.linspace(-24.0, 24.0, 9))
_SEED_BEND = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
_SEED_WIDTH = np.array([0.75, 0.85, 0.95, 1.05, 1.15])
_POINTED_PX = 4.0  # a clamp pointed at by eye is so far off
# The ways in which a strip may go on: bent more, wider, or a little beside where it was thought to be.
_MORE_BEND = 0.35 * np.array([0.0, -0.12, 0.12, -0.4, 0.4, -1.0, 1.0, 0.0, 0.0, -0.4, 0.4, 0.0, 0.0])
_MORE_WIDTH = np.array([1.0] * 7 + [0.96, 1.04] + [1.0] * 4)
_MORE_ASIDE = np.array([0.0] * 9 + [-0.08, 0.08, -0.08, 0.08])
_WIDTH_COST = 4.0  # times the squared logarithm: a tenth, as an eye has it, costs a twentieth of a side's support
_STIFFEST = 0.8  # width times the largest curvature
_NEEDED = 0.8  # of the two sides' support together, for a step to gain
_OTHER_POLARITY = 100.0  # more than any strip gains
_ANOTHER = 0.6  # widths: a strip so far beside the best one is another body
_FARTHEST = 1.15  # of the stated length
_TIE = 0.93  # of the best strip's score: another body with so much is doubted to be another, and is no worse


@dataclass(frozen=True)
class Strip:
    """What was followed: k places from the clamp outward, in pixels of the working picture.

    place: (k, 2). angle: (k,) rad. width: (k,). gain: (k,) of each step. step_px: their distance. variance: of a
    colour that is the same. rival: score of the best strip of another body, as a share of this one's; 1 or more where
    an earlier picture decided.
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
        return self.step_px * (len(self.gain) - 1)


@dataclass(frozen=True)
class _Stiffness:
    """bend: by how much curvature may change, a width's turn. most: the largest curvature."""

    bend: float
    most: float


def find_strip(picture: WorkingPicture, polarity: str | None, earlier: Callable[[], Array | None]) -> Strip | None:
    """The strip that gains most, cut where it gained most; None where none gains anything.

    polarity: "dark" or "bright" against what is beside it at the root; else either. earlier: gives places (n, 2) of the
    beam in an earlier picture, in pixels of this one, if there are any. Of bodies for which the picture itself speaks
    alike the one nearest to them is taken; where it speaks for one, they are not asked for.
    """
    beam = picture.beam
    width, length = beam.width_px, beam.length_px
    slender = min(1.0, 8.0 * width / length)
    stiffness = _Stiffness(slender / width, _STIFFEST * min(1.0, 10.0 * width / length) / width)
    step = max(width / 3.0, length / 90.0)
    now = _seeds(picture, stiffness, polarity)
    trail = [_Generation(now, np.arange(len(now)), now.score)]
    for _ in range(round(_FARTHEST * length / step)):
        now, parent, gain = _grown(picture, now, stiffness, step)
        trail.append(_Generation(now, parent, gain))
    return _best(trail, step, width, earlier)


@dataclass(frozen=True)
class _Generation:
    strips: Hypotheses
    parent: NDArray[np.int64]
    gain: Array


def _seeds(picture: WorkingPicture, stiffness: _Stiffness, polarity: str | None) -> Hypotheses:
    """Strips half a width ahead of the clamp."""
    beam, width = picture.beam, picture.beam.width_px
    aside = max(0.3 * width, min(_POINTED_PX * picture.factor, 0.5 * width))
    grid = np.meshgrid(aside * _SEED_OFFSET, _SEED_ANGLE, stiffness.bend * _SEED_BEND, width * _SEED_WIDTH)
    offset, turn, bend, wide = (axis.ravel() for axis in grid)
    across = np.array([-beam.ahead[1], beam.ahead[0]])
    angle = beam.axis_rad + turn
    root = beam.clamp_px + _SEED_AT * width * beam.ahead + offset[:, None] * across
    lines = []
    for along in (-0.25 * width, 0.0, 0.25 * width):
        middle = angle + 0.5 * bend * along
        place = root + along * np.column_stack([np.cos(middle), np.sin(middle)])
        lines.append(hypothesis.read_across(picture, place[:, 0], place[:, 1], angle + bend * along, wide))
    seen = np.stack(lines)
    colours = seen.mean(axis=0)
    template = hypothesis.inside_of(colours)
    scatter = ((seen - colours) ** 2)[:, :, 3:12].sum(axis=3).mean(axis=(0, 2)) * len(seen) / (len(seen) - 1)
    lateral = template.var(axis=1).sum(axis=1)
    variance = hypothesis.least_variance(picture) + scatter + 0.15 * lateral
    score = hypothesis.side_support(colours, variance) - _NEEDED
    score -= _implausible(np.zeros(len(bend)), wide / width, bend, width)
    score -= 0.5 * (offset / aside) ** 2  # the clamp is nearly where it is said to be
    if polarity is not None:
        brighter = hypothesis.brightness_step(colours) > 0.0
        score = np.where(brighter == (polarity == "bright"), score, -_OTHER_POLARITY)
    return Hypotheses(root, angle, bend, wide, template, variance, score)


def _grown(
    picture: WorkingPicture, now: Hypotheses, stiffness: _Stiffness, step: float
) -> tuple[Hypotheses, NDArray[np.int64], Array]:
    """Every strip a step farther in all its ways, the best of those; whose child each is, and what the step gained."""
    # All are (n, ways): a strip's ways are not written out as strips of their own before the best are known.
    bend = now.bend[:, None] + stiffness.bend * _MORE_BEND
    width = now.width[:, None] * _MORE_WIDTH
    old, aside = now.angle[:, None], picture.beam.width_px * _MORE_ASIDE
    begin_x, begin_y = now.place[:, :1] - np.sin(old) * aside, now.place[:, 1:] + np.cos(old) * aside
    lines = max(1, min(3, round(step / (0.5 * picture.beam.width_px))))
    read = []
    for share in (np.arange(lines) + 1.0) / lines:
        middle = old + 0.5 * share * step * bend
        x, y = begin_x + share * step * np.cos(middle), begin_y + share * step * np.sin(middle)
        angle = old + share * step * bend
        read.append(hypothesis.read_across(picture, x, y, angle, width))
    colours = read[0] if lines == 1 else np.stack(read).mean(axis=0)
    variance = now.variance[:, None]
    gain = hypothesis.side_support(colours, variance) - _NEEDED
    gain -= 0.42 * hypothesis.misfit(colours, now.template[:, None], variance)
    gain -= 0.6 * (_MORE_ASIDE / 0.35) ** 2
    gain -= _implausible(_MORE_BEND, width / picture.beam.width_px, bend, picture.beam.width_px)
    high, wide = picture.pixels.shape[:2]
    gain[(x < -0.5) | (y < -0.5) | (x > wide - 0.5) | (y > high - 0.5)] = -_NEEDED - 0.42 * 2.0
    score = np.where(np.abs(bend) <= stiffness.most, now.score[:, None] + gain, -np.inf)
    kept = _best_of_each_cell(x.ravel(), y.ravel(), angle.ravel(), score.ravel(), picture.beam.width_px)
    at = kept // len(_MORE_BEND)
    place = np.column_stack([x.ravel()[kept], y.ravel()[kept]])
    template = hypothesis.learnt(colours.reshape(-1, *colours.shape[2:])[kept], now.template[at], now.variance[at])
    bends, widths, scores = bend.ravel()[kept], width.ravel()[kept], score.ravel()[kept]
    grown = Hypotheses(place, angle.ravel()[kept], bends, widths, template, now.variance[at], scores)
    return grown, at, gain.ravel()[kept]


def _implausible(more_bend: Array, width: Array, bend: Array, width_px: float) -> Array:
    """What a sudden bend, another width than stated and a strong bend cost.

    more_bend: over the largest usual change. width: over the stated one.
    """
    return np.asarray(0.6 * more_bend**2 + _WIDTH_COST * np.log(width) ** 2 + 0.03 * (bend * width_px / 0.6) ** 2)


def _best_of_each_cell(x: Array, y: Array, angle: Array, score: Array, width: float) -> NDArray[np.int64]:
    """The best hypotheses, best first, one for each cell of place and direction."""
    near = np.flatnonzero(score > score.max() - _BEHIND)
    order = near[np.argsort(-score[near])]
    key = np.zeros(len(order), dtype=np.int64)
    for value, step in ((x, _CELL * width), (y, _CELL * width), (angle, _CELL_RAD)):
        cell = np.floor(value[order] / step).astype(np.int64)
        cell -= cell.min()
        key = key * (int(cell.max()) + 1) + cell
    first = np.unique(key, return_index=True)[1]
    return np.asarray(order[np.sort(first)[:_KEPT]])


def _best(trail: list[_Generation], step: float, width: float, earlier: Callable[[], Array | None]) -> Strip | None:
    best = [float(generation.strips.score.max()) for generation in trail]
    last = int(np.argmax(best))
    if last == 0 or best[last] <= 0.0:
        return None
    ends = trail[last].strips
    index = _nearest_of_equals(trail[: last + 1], earlier, width)
    variance, behind = float(ends.variance[index]), best[last] / float(ends.score[index])
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
    rival = max(rival, behind) if behind > 1.0 else rival
    return Strip(values[0], values[1], values[2], values[3], step, variance, rival)


def _nearest_of_equals(trail: list[_Generation], earlier: Callable[[], Array | None], width: float) -> int:
    """Of the strips at the last step: the best of that body among equally good ones which is nearest to ``earlier``."""
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
    before = earlier()
    if before is None or not len(before):
        return best
    apart = np.linalg.norm(paths[:, :, None] - before, axis=3).min(axis=1).mean(axis=1)
    own = of_body(paths[apart.argmin()])
    same_body = own[equals == best].any()
    return best if same_body else int(equals[own][score[equals[own]].argmax()])


def _rival(trail: list[_Generation], place: Array, angle: Array, gain: Array, width: float) -> float:
    """Score of the best other body half way along the strip, as a share of the strip's own there."""
    half = max(1, len(trail) // 2)
    across = np.array([-np.sin(angle[half]), np.cos(angle[half])])
    strips, score = trail[half].strips, float(gain[: half + 1].sum())
    beside = np.abs((strips.place - place[half]) @ across) > _ANOTHER * width
    return float(strips.score[beside].max(initial=0.0)) / max(score, 1e-9)
