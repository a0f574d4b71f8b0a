"""Platform of a model: the joints that carry it, and the chains of motor and rods that move it."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.robotfile.base import COORDINATES
from truepose_mujoco.importers.links import FREE, HINGE, SLIDE, Link, Mechanism, meeting

#: rad, or share of a length: axes and parallel rods that differ less are alike.
ALIKE = 1e-4
_END = "must be a ball, a universal joint or a connect"


@dataclass(frozen=True)
class Chain:
    """A motor and its rod or its two parallel rods, or a leg, to the platform."""

    motor: Link
    near: tuple[Link, ...]  #: link at the motor's side of each rod
    far: tuple[Link, ...]  #: link on the platform of each rod
    rods: tuple[int, ...]  #: bodies: of each rod, or the lower and the upper part of a leg
    moved: int  #: body that the motor moves; for a leg its lower part
    base: int  #: body with the motor's fixed part

    @property
    def leg(self) -> bool:
        """Whether the motor is between the two ends of a leg."""
        return self.moved == self.rods[0]


class Platform:
    """A body moved by chains that stand on one base; InputError names what does not fit."""

    def __init__(self, mechanism: Mechanism, body: str):
        self.m, self.part = mechanism, mechanism.body(body)
        self.body = int(mechanism.body_of[self.part])
        spine = self._spine()
        #: The platform, and those that carry it.
        self.bodies = [self.body, *(link.bodies[0] for link in spine)]
        reached = {b for k in self.m.at(self.body) if k not in spine for b in self._reached(k)}
        base = max(k for k, b in enumerate(self.bodies) if k == 0 or b in reached)
        #: Passive joints that carry it, the base's first. None of a free body: where a motor is
        #: among them, they are the joints of one more chain.
        self.axes = [] if any(map(self._driven, spine[:base])) else spine[:base][::-1]
        if not self.axes:
            self.bodies[1:] = self.bodies[base:] if base else [0]
        inner = {b for link in self.m.links for b in link.bodies} - {*self.bodies}
        while any(map(self._merge_universal, inner)):
            pass
        ends = [
            link
            for link in self.m.at(self.body)
            if link not in self.axes and not self._reached(link).isdisjoint(self.bodies[1:])
        ]
        self.refuse(not ends, "no loop: no rod goes from it to a motor")
        self.chains = self._chains(ends)
        self.base = self.chains[0].base
        #: Normal of the plane in which all bodies move, or None.
        self.normal = self._normal()
        self.mobility = self._mobility()
        self._check()

    def refuse(self, wrong: object, why: str) -> None:
        """Raise InputError, with the body's name, if something is wrong."""
        if wrong:
            raise InputError(f"{self.m.source}: {self.m.name_of(self.part)}: {why}")

    def _spine(self) -> list[Link]:
        """Return the joints that carry the platform, its own first; none of a free body."""
        body, spine = self.body, list[Link]()
        while up := [k for k in self.m.links if k.ids and k.bodies[1] == body and k not in spine]:
            spine.append(up[0])
            body = up[0].bodies[0]
        self.refuse(not spine, "no joint moves it; give the body that the rods move")
        own = spine[0]
        self.refuse(
            self._driven(own), f"{own.name} is driven: an axis of a rotational platform is passive"
        )
        if own.kind == FREE:
            self.m.links.remove(own)
            return []
        return spine

    def _merge_universal(self, body: int) -> bool:
        """Merge the two joints of a body without other links, if their axes meet."""
        links = self.m.at(body)
        if len(links) != 2 or not all(k.turns and not self._driven(k) for k in links):
            return False
        # One axis of each. If one has several axes, use the intersection of those about its point.
        axes = np.vstack([k.axes for k in links])
        ends = [k.point_on(body) for k in links]
        point = meeting(np.repeat(ends, [k.turns for k in links], axis=0), axes)
        if point is None:
            return False
        points = np.array([k.point_on(k.other(body)) for k in links]) + point - ends
        a, b = links
        bodies, name = (a.other(body), b.other(body)), a.name if a.ids else b.name
        self.m.links = [k for k in self.m.links if k not in links]
        self.m.links.append(Link(name, bodies, points, axes[:3], a.ids + b.ids))
        return True

    def _driven(self, link: Link) -> bool:
        return not self.m.actuators.keys().isdisjoint(link.ids)

    def _reached(self, link: Link) -> set[int]:
        """Return the bodies that a link leads to, up to the platform and those that carry it."""
        known, new = set[int](), [link.other(self.body)]
        while new:
            body = new.pop()
            known.add(body)
            if body not in self.bodies:
                new += [b for k in self.m.at(body, link) if (b := k.other(body)) not in known]
        return known

    def _chains(self, ends: list[Link]) -> list[Chain]:
        """Return the chains of the platform's links, in the order of their motors."""
        rods = dict[int, list[Any]]()
        for far in ends:
            rod = far.other(self.body)
            self.refuse(
                rod in self.bodies,
                f"{far.name} joins it to {self.m.name_of(rod)}: no rod is between",
            )
            near = self._only(rod, "a rod has two ends", far)
            rods.setdefault(near.other(rod), []).append((near, rod, far))
        chains = sorted(map(self._chain, rods, rods.values()), key=lambda chain: chain.motor.ids)
        for chain in chains:
            self.refuse(
                chain.base != chains[0].base,
                f"motors {chains[0].motor.name} and {chain.motor.name} stand on two bodies, "
                f"{self.m.name_of(chains[0].base)} and {self.m.name_of(chain.base)}: must be the "
                "same",
            )
        return chains

    def _chain(self, moved: int, parts: list[Any]) -> Chain:
        """Return the chain of rods that end on one body: a crank, a carriage or a leg's part."""
        near, rods, far = zip(*parts, strict=True)
        first, leg = near[0], near[0].slides
        self.refuse(
            len(rods) > 2 - leg, f"{self.m.name_of(moved)} moves {len(rods)} rods: too many"
        )
        self.refuse(
            first.turns == 1 and (self._driven(first) or moved in self.bodies),
            f"{far[0].name} joins it to {self.m.name_of(rods[0])}, turned by {first.name}, without "
            "a rod between",
        )
        last = self._only(moved, "a crank has an axis and one rod, or two alike", *near)
        starts = (last,) if leg else near
        for ends in zip(starts, far, strict=True):
            for link in ends:
                self.refuse(
                    not link.turns,
                    f"{link.name}, a {'slide' if link.slides else 'free joint'}, ends a rod: "
                    f"{_END}",
                )
            self.refuse(
                all(link.turns == 2 for link in ends),
                f"{' and '.join(link.name for link in ends)} are both universal joints, which "
                "hold the rod's spin: one must be a ball",
            )
        if leg:
            return Chain(first, starts, far, (*rods, moved), rods[0], last.other(moved))
        self.refuse(
            last.bodies[1] != moved or not (last.slides or (last.ids and last.turns == 1)),
            f"{last.name}, on which {self.m.name_of(moved)} stands, is neither a hinge nor a slide",
        )
        return Chain(last, near, far, rods, moved, last.bodies[0])

    def _only(self, body: int, expected: str, *links: Link) -> Link:
        """Return the only other link of a body; links to dead ends do not count."""
        found = [
            k
            for k in self.m.at(body)
            if k not in links
            and (len(self.m.at(k.other(body))) > 1 or k.other(body) in self.bodies)
        ]
        self.refuse(
            len(found) != 1,
            f"{self.m.name_of(body)} is joined by {', '.join(k.name for k in links)} and by "
            f"{', '.join(k.name for k in found) or 'nothing'}: {expected}",
        )
        return found[0]

    def _normal(self) -> Array | None:
        """Return the normal of the plane of motion; refuse joints that allow no such plane."""
        flat = sorted(k.kind for k in self.axes) in ([SLIDE, SLIDE], [SLIDE, SLIDE, HINGE])
        for link in self.axes:
            self.refuse(
                not flat and link.kind != HINGE,
                f"{link.name}: a passive axis must be a hinge of its own",
            )
        rods = [ends for chain in self.chains for ends in zip(chain.near, chain.far, strict=True)]
        hinges = [link for ends in rods for link in ends if link.turns == 1]
        if not self.axes and not hinges:
            return None
        moves = [*self.axes, *hinges, *(chain.motor for chain in self.chains)]
        slides, turns = ([k.axes[0] for k in moves if k.slides is of] for of in (True, False))
        n = np.cross(*slides[:2]) if flat else turns[0]
        n = n / np.linalg.norm(n)
        odd = [
            link.name
            for link in moves
            for axis in link.axes
            if (abs(axis @ n) if link.slides else np.linalg.norm(np.cross(axis, n))) > ALIKE
        ]
        if not self.axes:  # only hinges hold it in the plane
            odd += [near.name for near, far in rods if 1 not in (near.turns, far.turns)]
        self.refuse(
            odd and (hinges or flat),
            f"{hinges[0].name}, a hinge, ends a rod: {_END}, or a hinge parallel to all axes, and "
            f"{', '.join(odd[:1])} is not"
            if hinges
            else f"{', '.join(odd[:1])} moves out of the plane of its slides",
        )
        return None if odd else n

    def _mobility(self) -> str:
        if self.normal is not None and (not self.axes or any(k.slides for k in self.axes)):
            return "planar_translation" if len(self.axes) == 2 else "planar"
        if self.axes:
            return "rotational"
        pairs = all(len(chain.near) == 2 for chain in self.chains)
        return "translation" if pairs else "spatial"

    def _check(self) -> None:
        """Raise InputError for features that a robot file does not support."""
        parts = [*self.axes]
        self.refuse(
            self.axes and self.base != self.axes[0].bodies[0],
            f"its motors stand on {self.m.name_of(self.base)}, which does not carry it",
        )
        needed = len(COORDINATES.get(self.mobility, self.axes))
        self.refuse(
            len(self.chains) < needed,
            f"{needed} freedoms, {len(self.chains)} motors with a rod or leg: too few motors",
        )
        for chain in self.chains:
            self.refuse(
                len(chain.near) == 2 and self.mobility != "translation",
                f"{self.m.name_of(chain.moved)} moves two rods: only a delta has such pairs",
            )
            self.refuse(
                self.m.actuators and not self._driven(chain.motor),
                f"{chain.motor.name}, which moves a rod, is not driven",
            )
            parts += [chain.motor, *chain.near, *chain.far]
        for joint in itertools.chain(*(link.ids for link in parts)):
            self.refuse(
                by := self.m.coupled.get(joint),
                f"{self.m.model.joint(joint).name} is coupled by {by}: motors must move "
                "independently",
            )
        cranks = (chain.moved for chain in self.chains if not chain.motor.slides)
        apart = {self.base, self.body, *cranks} & self.m.moved
        self.refuse(
            apart, f"{self.m.name_of(min(apart, default=0))} is welded from parts apart at zero"
        )
