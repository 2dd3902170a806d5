"""Which contacts does an engine find beside C, by types of geoms, and what do they change?"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np

from mjbench.commands.compare.accelerated_tolerances import (
    BORDER,
    CLOSE_EFFECT,
    CLOSE_QUANTILE,
    LACKING_EFFECT,
    ONE_ANSWER,
    ONE_ANSWER_EFFECT,
    SAME_PLACE,
    SAME_TANGENT_DEGREES,
)
from mjbench.simulation.accelerated_judgement import (
    EngineAnswer,
    PairContacts,
    Precision,
    finite_or_none,
)
from mjbench.simulation.constraint_problem import ConstraintProblem
from mjbench.simulation.contacts import Contacts

# What a contact without a geom is of.
_FLEX = "flex"

Types = tuple[str, str]


class _Apart(NamedTuple):
    """How far a contact is from C's nearest one of the same geoms."""

    distance_m: float
    position_m: float
    normal_degrees: float
    tangent_degrees: float


@dataclass
class _PairStates:
    """What was seen of two types of geoms.

    Attributes:
      counts: of the engine and of C, an entry a state.
      effects: of the states where C can be given the contacts.
      lacking_effects: those of them in which the engine's contacts are C's own, but fewer.
      aligned_effects: those of `effects` where tangents are C's.
      beside_flex: states in which C cannot be given contacts because a flex touches, too.
      unmet: states in which geoms touch that touch in no judged state of C.
      has_deep_unmet: whether one of these contacts is more than a contact that begins to touch.
    """

    counts: list[tuple[int, int]] = field(default_factory=list)
    effects: list[float] = field(default_factory=list)
    lacking_effects: list[float] = field(default_factory=list)
    aligned_effects: list[float] = field(default_factory=list)
    apart: list[_Apart] = field(default_factory=list)
    beside_flex: int = 0
    unmet: int = 0
    has_deep_unmet: bool = False


class ContactJudge:
    """Collects the contacts of one state after the other."""

    def __init__(self, model: mujoco.MjModel, precision: Precision):
        self._precision, self._size = precision, float(model.stat.meansize)
        names = {int(value): name for name, value in mujoco.mjtGeom.__members__.items()}
        self._type = [names[int(t)].removeprefix("mjGEOM_").lower() for t in model.geom_type]
        self._order = {name: int(value) for value, name in enumerate(names.values())}
        self._pairs: dict[Types, _PairStates] = {}

    def add(self, problem: ConstraintProblem, contacts: Contacts) -> None:
        """Compare an engine's contacts with those of the state to which `problem` has gone."""
        types, types_in_c = self._types(contacts), self._types(problem.contacts)
        for pair in sorted({*types, *types_in_c}):
            own = contacts.select(_where(types, pair))
            in_c = problem.contacts.select(_where(types_in_c, pair))
            if not self._is_borderline(problem, own, in_c):
                rest = problem.contacts.select(~_where(types_in_c, pair))
                self._add_pair(problem, pair, own, in_c, rest)

    def _add_pair(
        self, problem: ConstraintProblem, pair: Types, own: Contacts, in_c: Contacts, rest: Contacts
    ) -> None:
        states = self._pairs.setdefault(pair, _PairStates())
        states.counts.append((len(own.simulation), len(in_c.simulation)))
        apart = _apart(own, in_c)
        states.apart += apart
        has_fewer = len(own.simulation) < len(in_c.simulation)
        is_own = len(apart) == len(own.simulation) and all(
            each.position_m < SAME_PLACE * self._size for each in apart
        )
        both = Contacts.together(rest, own)
        if _has_flex(both):
            states.beside_flex += 1
        elif not problem.has_examples(both):
            states.unmet += 1
            room = problem.margins(own) - own.distance
            is_unmet = ~problem.are_examples(own)
            states.has_deep_unmet |= bool((room[is_unmet] > SAME_PLACE * self._size).any())
        else:
            effect = problem.acceleration_error(problem.solve(both).qacc, problem.own)
            states.effects.append(effect)
            if has_fewer and is_own:
                states.lacking_effects.append(effect)
            if all(each.tangent_degrees < SAME_TANGENT_DEGREES for each in apart):
                states.aligned_effects.append(effect)

    def pairs(self, limit: float) -> tuple[PairContacts, ...]:
        """Return what was seen of each pair of types; larger effects than `limit` disagree."""
        return tuple(_pair(types, states, limit) for types, states in self._pairs.items())

    def _types(self, contacts: Contacts) -> list[Types]:
        """Return the types of the geoms of each contact, in MuJoCo's order."""
        types = []
        for pair in contacts.geom.tolist():
            names = (self._type[geom] if geom >= 0 else _FLEX for geom in pair)
            low, high = sorted(names, key=lambda name: self._order.get(name, 0))
            types.append((low, high))
        return types

    def _is_borderline(self, problem: ConstraintProblem, own: Contacts, in_c: Contacts) -> bool:
        """Return whether numbers of contacts differ by those alone that begin to touch."""
        if len(own.simulation) == len(in_c.simulation):
            return False
        more = max(own, in_c, key=lambda each: len(each.simulation))
        surplus = abs(len(own.simulation) - len(in_c.simulation))
        if _has_flex(more):
            return False
        room = np.sort(problem.margins(more) - more.distance)[:surplus]
        size = self._size + float(np.abs(more.position).max(initial=0.0))
        return bool((room < BORDER[self._precision] * size).all())


def _has_flex(contacts: Contacts) -> bool:
    return bool((contacts.geom < 0).any())


def _where(types: Sequence[Types], pair: Types) -> np.ndarray:
    return np.array([each == pair for each in types], dtype=bool)


def _apart(own: Contacts, in_c: Contacts) -> list[_Apart]:
    rows = []
    for i, geom in enumerate(own.geom):
        same = in_c.select((in_c.geom == geom).all(axis=1))
        if len(same.simulation):
            away = np.linalg.norm(same.position - own.position[i], axis=1)
            nearest = int(np.nan_to_num(away, nan=np.inf).argmin())
            distance = abs(float(same.distance[nearest] - own.distance[i]))
            normal, tangent, _ = (own.frame[i] * same.frame[nearest]).sum(axis=1)
            turned = _degrees(abs(tangent))
            rows.append(
                _Apart(distance, float(away[nearest]), _degrees(normal), min(turned, 90.0 - turned))
            )
    return rows


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _pair(types: Types, states: _PairStates, limit: float) -> PairContacts:
    counts = np.array(states.counts)
    other = int((counts[:, 0] != counts[:, 1]).sum())
    effect = largest = None
    if states.effects:
        usual = np.quantile(states.effects, CLOSE_QUANTILE, method="higher")
        effect, largest = finite_or_none(float(usual)), finite_or_none(max(states.effects))
    apart = np.array(states.apart or [_Apart(*[np.nan] * 4)]).max(axis=0)
    distance_m, position_m, normal_degrees, tangent_degrees = map(finite_or_none, apart)
    return PairContacts(
        types=types,
        states=len(counts),
        other_counts=other,
        count=float(counts[:, 0].mean()),
        count_in_c=float(counts[:, 1].mean()),
        distance_m=distance_m,
        position_m=position_m,
        normal_degrees=normal_degrees,
        tangent_degrees=tangent_degrees,
        effect=effect,
        largest_effect=largest,
        beside_flex=states.beside_flex,
        unmet=states.unmet,
        answer=_answer(types, states, limit),
    )


def _answer(types: Types, states: _PairStates, limit: float) -> EngineAnswer:
    """Return whether contacts agree: `close` is the best answer where some effects are unknown."""
    if states.has_deep_unmet or _is_fault(types, states, limit):
        return EngineAnswer.NO
    unknown = len(states.counts) - len(states.effects)
    if states.beside_flex or unknown > (1 - CLOSE_QUANTILE) * len(states.counts):
        return EngineAnswer.NOT_JUDGED
    return EngineAnswer.YES if not unknown and max(states.effects) <= limit else EngineAnswer.CLOSE


def _is_fault(types: Types, states: _PairStates, limit: float) -> bool:
    if not states.effects:
        return False
    one_answer = max(states.aligned_effects, default=0.0) if types in ONE_ANSWER else 0.0
    if one_answer > max(limit, ONE_ANSWER_EFFECT):
        return True
    usual = np.quantile(states.effects, CLOSE_QUANTILE, method="higher")
    return bool(usual > CLOSE_EFFECT or max(states.lacking_effects, default=0) > LACKING_EFFECT)
