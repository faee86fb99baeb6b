"""Which navigators a recording can feed, which are not run and why."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.navigators.registry import label_of

Inputs = Mapping[str, bool]
"""Source to required?, as :class:`~lowcostnav_ros.navigators.base.Navigator` declares it."""


class SelectionError(ValueError):
    """A choice of navigators that cannot run; the message is one sentence that says what to do."""


@dataclasses.dataclass(frozen=True, slots=True)
class Selection:
    """Names to run, and a reason for each that is not run."""

    chosen: tuple[str, ...]
    left_out: dict[str, str]


def missing_inputs(inputs: Inputs, sources: Collection[str], others: Collection[str]) -> list[str]:
    """Required sources that neither the recording nor another running navigator provides.

    Parameters
    ----------
    inputs : mapping of source to required?
    sources : collection of str
        What the recording holds.
    others : collection of str
        Names of the other navigators that run.
    """
    available = {*sources, *(topic for name in others for topic in fused_topics(name))}
    return [source for source, required in inputs.items() if required and source not in available]


def check_names(wanted: Sequence[str], known: Collection[str]) -> None:
    """Refuse a navigator that does not exist, naming the nearest.

    Raises
    ------
    SelectionError
    """
    for name in wanted:
        if name not in known:
            raise SelectionError(f"There is no navigator '{name}'{nearest(name, known)}.")


def select(inputs: Mapping[str, Inputs], sources: Collection[str], insist: bool) -> Selection:
    """Choose the navigators to run.

    Parameters
    ----------
    inputs : mapping of name to inputs
        The navigators to choose from.
    sources : collection of str
        What the recording holds.
    insist : bool
        True when each of them was asked for, so that one that cannot run is a refusal.

    Raises
    ------
    SelectionError
        When one that was asked for lacks a required input, or when nothing can run.
    """
    chosen = list(inputs)
    left_out: dict[str, str] = {}
    while True:
        lacking = {n: missing_inputs(inputs[n], sources, [o for o in chosen if o != n]) for n in chosen}
        short = [n for n in chosen if lacking[n]]
        if not short:
            break
        for name in short:
            left_out[name] = f"the recording has no {' and no '.join(lacking[name])}"
            chosen.remove(name)
    if insist and left_out:
        name, reason = next(iter(left_out.items()))
        raise SelectionError(f"{name} cannot run: {reason}; the recording holds {_listed(sources)}.")
    if not chosen:
        raise SelectionError(f"No navigator can run on this recording, which holds {_listed(sources)}.")
    return Selection(tuple(chosen), left_out)


def spared(selection: Selection, inputs: Mapping[str, Inputs]) -> Selection:
    """Leave out those that add nothing: one that another outdoes, and one that only chooses where there is no choice."""
    left_out, chosen = dict(selection.left_out), list(selection.chosen)
    for name in selection.chosen:
        better = next((other for other in label_of(name).outdone_by if other in chosen), None)
        if better is not None:
            left_out[name] = f"{better} flies on the same sensors and more"
            chosen.remove(name)
    for name in [name for name in chosen if label_of(name).chooses]:
        others = [other for other in chosen if other != name and not inputs[name].keys().isdisjoint(fused_topics(other))]
        if len(others) < 2 and len(chosen) > 1:
            left_out[name] = f"it has {others[0] if others else 'nothing'} to choose from"
            chosen.remove(name)
    return Selection(tuple(chosen), left_out)


def _listed(sources: Collection[str]) -> str:
    return ", ".join(sorted(sources)) or "no topic a navigator could use"
