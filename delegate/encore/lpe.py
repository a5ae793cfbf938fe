"""Light path expressions: which of the image's layers one of them stands for.

The grammar is that of Open Shading Language, with alternatives (`|`) that bind loosest and `?`, as in
regular expressions. An expression is no more than a set of paths; it stands for layers where it has all paths
of each of them, and none of any other. docs/aovs.md says which paths a layer has.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

LAYERS = ("direct", "reflection", "refraction")

# Type and scattering, as letters; "x" where there is no scattering.
Event = tuple[str, str]
_TYPES, _SCATTERINGS = "CLBVTRO", "DGSsx"
_NONE = "x"
_ANY = frozenset((t, s) for t in _TYPES for s in _SCATTERINGS)
_MOST_REPEATS, _LONGEST, _MOST_STATES = 64, 4096, 1000

# The paths that there are: state → event → state. A layer is known from its first bounce. What is seen at the
# end is a light, something that glows, or matter under the lights: diffuse, however it scatters.
_BOUNCES: tuple[Event, ...] = (("R", "G"), ("R", "S"), ("T", "G"), ("T", "S"))
_PATHS: dict[str, dict[Event, str]] = {
    "start": {("C", _NONE): "camera"},
    "camera": {
        **{event: "reflection" if event[0] == "R" else "refraction" for event in _BOUNCES},
        ("R", "D"): "direct, lit",
        ("L", _NONE): "direct, seen",
        ("O", _NONE): "direct, seen",
    },
}
for _layer in LAYERS:
    _PATHS[_layer] = {
        **dict.fromkeys(_BOUNCES, _layer),
        ("R", "D"): f"{_layer}, lit",
        ("L", _NONE): f"{_layer}, seen",
        ("O", _NONE): f"{_layer}, seen",
    }
    _PATHS[f"{_layer}, lit"] = {("L", _NONE): f"{_layer}, seen"}
    _PATHS[f"{_layer}, seen"] = {}

# One expression for each layer, for messages and documentation.
EXPRESSIONS = {"direct": "(C<RD>L)|(C[LO])", "reflection": "C<R[GS]>.*", "refraction": "C<T[GS]>.*"}


class LpeError(ValueError):
    """An expression that cannot be read, or that is no union of layers; the text says why."""


@cache
def layers_of(expression: str) -> tuple[str, ...]:
    """The layers whose paths are those of the expression, in the order of LAYERS. Throws LpeError.

    A leading `lpe:` is no part of it. What holds no path of any layer is an error.
    """
    machine = _Parser(expression.removeprefix("lpe:")).parse()
    inside: dict[str, str] = {}  # layer → a path of it that the expression has
    outside: dict[str, str] = {}  # …that it has not
    for state, accepted, path in _walk(machine):
        layer, _, end = state.partition(", ")
        if end == "seen":
            (inside if accepted else outside).setdefault(layer, path)
    for layer in LAYERS:
        if layer in inside and layer in outside:
            raise LpeError(
                f"of the layer {layer} it has {inside[layer]} and not {outside[layer]}, and layers are not "
                "divided"
            )
    if not inside:
        raise LpeError("it has no path of any layer")
    return tuple(layer for layer in LAYERS if layer in inside)


def _walk(machine: _Machine) -> Iterator[tuple[str, bool, str]]:
    """States of the paths with states of the machine: whether they are accepted, and a shortest path."""
    first = ("start", machine.closure({machine.start}))
    seen, waiting = {first}, deque([(first, "")])
    while waiting:
        (state, states), path = waiting.popleft()
        yield state, machine.end in states, path
        for event, following in _PATHS[state].items():
            reached = (following, machine.closure(machine.step(states, event)))
            if reached not in seen:
                if len(seen) >= _MOST_STATES:
                    raise LpeError("it repeats too much")
                seen.add(reached)
                waiting.append((reached, path + _text(event)))


def _text(event: Event) -> str:
    return event[0] if event[1] == _NONE else f"<{event[0]}{event[1]}>"


@dataclass
class _Machine:
    """A nondeterministic automaton over events, under construction. Fragments are pairs (start, end)."""

    free: list[list[int]] = field(default_factory=list)  # per state: states reached without an event
    moves: list[list[tuple[frozenset[Event], int]]] = field(default_factory=list)
    start: int = 0
    end: int = 0

    def state(self) -> int:
        if len(self.free) >= _MOST_STATES:
            raise LpeError("it repeats too much")
        self.free.append([])
        self.moves.append([])
        return len(self.free) - 1

    def one(self, events: frozenset[Event]) -> tuple[int, int]:
        """A fragment that takes one event out of a set."""
        start, end = self.state(), self.state()
        self.moves[start].append((events, end))
        return start, end

    def either(self, fragments: list[tuple[int, int]]) -> tuple[int, int]:
        start, end = self.state(), self.state()
        for first, last in fragments:
            self.free[start].append(first)
            self.free[last].append(end)
        return start, end

    def sequence(self, fragments: list[tuple[int, int]]) -> tuple[int, int]:
        start = end = self.state()
        for first, last in fragments:
            self.free[end].append(first)
            end = last
        return start, end

    def optional(self, fragment: tuple[int, int], *, repeats: bool) -> tuple[int, int]:
        """The fragment not at all or once; with repeats, any number of times."""
        start, end = self.either([fragment])
        self.free[start].append(end)
        if repeats:
            self.free[fragment[1]].append(fragment[0])
        return start, end

    def closure(self, states: set[int]) -> frozenset[int]:
        """The states, and those that are reached from them without an event."""
        found, waiting = set(states), list(states)
        while waiting:
            new = [s for s in self.free[waiting.pop()] if s not in found]
            found.update(new)
            waiting += new
        return frozenset(found)

    def step(self, states: frozenset[int], event: Event) -> set[int]:
        return {target for s in states for events, target in self.moves[s] if event in events}


class _Parser:
    """Recursive descent. Positions in messages count characters from 1."""

    def __init__(self, text: str) -> None:
        if len(text) > _LONGEST:
            raise LpeError(f"it is longer than {_LONGEST} characters")
        self._text = text
        self._at = 0
        self._machine = _Machine()

    def parse(self) -> _Machine:
        if not self._text.strip():
            raise LpeError("it is empty")
        self._machine.start, self._machine.end = self._alternatives()
        if self._head():
            raise self._error(f"'{self._head()}' closes nothing")
        return self._machine

    def _head(self) -> str:
        """The next character that is no space; empty at the end."""
        while self._at < len(self._text) and self._text[self._at].isspace():
            self._at += 1
        return self._text[self._at : self._at + 1]

    def _next(self) -> str:
        head = self._head()
        self._at += 1
        return head

    def _error(self, what: str) -> LpeError:
        return LpeError(f"at character {self._at + 1}, {what}")

    def _expect(self, closing: str) -> None:
        if self._head() != closing:
            raise self._error(f"'{closing}' is missing")
        self._at += 1

    def _alternatives(self) -> tuple[int, int]:
        found = [self._sequence()]
        while self._head() == "|":
            self._at += 1
            found.append(self._sequence())
        return found[0] if len(found) == 1 else self._machine.either(found)

    def _sequence(self) -> tuple[int, int]:
        found = []
        while self._head() not in ("", "|", ")", "]", ">"):
            found.append(self._repeated())
        if not found:
            raise self._error("an event is missing")
        return self._machine.sequence(found)

    def _repeated(self) -> tuple[int, int]:
        begin = self._at
        fragment = self._atom()
        machine = self._machine
        head = self._head()
        if head not in ("*", "+", "?", "{"):
            return fragment
        if head != "{":
            self._at += 1
            if head == "?":
                return machine.optional(fragment, repeats=False)
            if head == "*":
                return machine.optional(fragment, repeats=True)
            return machine.sequence([fragment, machine.optional(self._again(begin), repeats=True)])
        least, most = self._range()
        parts = [fragment] * min(1, least) + [self._again(begin) for _ in range(least - 1)]
        if most is None:
            parts.append(machine.optional(self._again(begin), repeats=True))
        else:
            parts += [machine.optional(self._again(begin), repeats=False) for _ in range(most - least)]
        return machine.sequence(parts)

    def _again(self, begin: int) -> tuple[int, int]:
        """Another copy of the atom that begins there."""
        at, self._at = self._at, begin
        fragment = self._atom()
        self._at = at
        return fragment

    def _range(self) -> tuple[int, int | None]:
        """Of `{2}`, `{2,}` or `{2,5}`; None: no upper bound."""
        self._expect("{")
        least = self._number()
        most: int | None = least
        if self._head() == ",":
            self._at += 1
            most = None if self._head() == "}" else self._number()
        self._expect("}")
        if most is not None and most < least:
            raise self._error(f"{{{least},{most}}} ends before it begins")
        return least, most

    def _number(self) -> int:
        digits = ""
        while self._head().isdigit() and len(digits) < 4:
            digits += self._next()
        if not digits or int(digits) > _MOST_REPEATS:
            raise self._error(f"a number up to {_MOST_REPEATS} is missing")
        return int(digits)

    def _atom(self) -> tuple[int, int]:
        head = self._head()
        if head == "(":
            self._at += 1
            found = self._alternatives()
            self._expect(")")
            return found
        if head == "[":
            self._at += 1
            return self._list()
        if head == "<":
            self._at += 1
            return self._machine.one(self._group())
        return self._machine.one(self._symbol())

    def _list(self) -> tuple[int, int]:
        """`[…]`: any of these; `[^…]`: any event but these."""
        if self._head() == "^":
            self._at += 1
            refused: frozenset[Event] = frozenset()
            while self._head() not in ("]", ""):
                refused |= self._symbol()
            if not refused:
                raise self._error("the list is empty")
            self._expect("]")
            return self._machine.one(_ANY - refused)
        found = []
        while self._head() not in ("]", ""):
            found.append(self._repeated())
        if not found:
            raise self._error("the list is empty")
        self._expect("]")
        return self._machine.either(found)

    def _symbol(self) -> frozenset[Event]:
        """One letter outside of groups: a type or a scattering."""
        letter = self._letter()
        if letter == ".":
            return _ANY
        place = 0 if letter in _TYPES else 1
        return frozenset(event for event in _ANY if event[place] == letter)

    def _letter(self) -> str:
        head = self._head()
        if head in ("'", '"'):
            raise self._error("there is a label, and nothing here has labels")
        if head != "." and (not head or head not in _TYPES + _SCATTERINGS):
            raise self._error(f"'{head}' is no event" if head else "an event is missing")
        self._at += 1
        return head

    def _group(self) -> frozenset[Event]:
        """`<type scattering>`, both of which may be lists; a missing one is any."""
        fields = []
        for letters in (_TYPES, _SCATTERINGS):
            fields.append(frozenset(letters) if self._head() == ">" else self._field(letters))
        if self._head() in ("'", '"', "["):
            raise self._error("there is a label, and nothing here has labels")
        self._expect(">")
        return frozenset(event for event in _ANY if event[0] in fields[0] and event[1] in fields[1])

    def _field(self, letters: str) -> frozenset[str]:
        negated = False
        if self._head() != "[":
            found = [self._letter()]
        else:
            self._at += 1
            negated = self._head() == "^"
            self._at += negated
            found = []
            while self._head() not in ("]", ""):
                found.append(self._letter())
            self._expect("]")
        every = frozenset(letters)
        if not found or not set(found) <= every | {"."}:
            kind = "a type" if letters == _TYPES else "a scattering"
            raise self._error(f"'{''.join(found)}' is not {kind}: one of {', '.join(letters)}")
        chosen = every if "." in found else frozenset(found)
        return every - chosen if negated else chosen
