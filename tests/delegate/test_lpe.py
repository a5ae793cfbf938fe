"""Light path expressions against the layers that they stand for, found by listing paths."""

import itertools
import re

import pytest
from encore.lpe import EXPRESSIONS, LAYERS, LpeError, layers_of

ALL = ("direct", "reflection", "refraction")


@pytest.mark.parametrize(
    ("expression", "layers"),
    [
        ("C.*", ALL),
        ("C.*[<L.>O]", ALL),
        ("C.*[LO]", ALL),
        ("C.*[LOB]", ALL),
        ("lpe:C.*[LO]", ALL),
        ("C[DSG]*[LO]", ALL),
        ("C.*|C.*L", ALL),
        (".*", ALL),
        ("C .* [L O]", ALL),
        ("C.{1,}", ALL),
        ("C.+", ALL),
        ("C(<RD>|[GS])*[LO]", ALL),
        ("C<R[GS]>.*", ("reflection",)),
        ("C<R[^D]>.*", ("reflection",)),
        ("C<R[^Ds]>.*[LO]", ("reflection",)),
        ("C(<RG>|<RS>).*", ("reflection",)),
        ("C[<RG><RS>].*", ("reflection",)),
        ("C<T[GS]>.*", ("refraction",)),
        ("CT.*", ("refraction",)),
        ("C<T.>.+", ("refraction",)),
        ("C<T>.*[LO]", ("refraction",)),
        ("C<RD>.*|C[LOB]", ("direct",)),
        ("(C<RD>L)|(C[LO])", ("direct",)),
        ("C<RD>?.{1}", ("direct",)),
        ("C<.D>?[LO]", ("direct",)),
        ("CD?[LO]", ("direct",)),
        ("C[^GS].*", ("direct",)),
        ("C[SG].*", ("reflection", "refraction")),
        ("C<[RT][GS]>.*", ("reflection", "refraction")),
        ("C(<RD>.*|[LO]|T.*)", ("direct", "refraction")),
        ("C[^T].*", ("direct", "reflection")),
        ("C<[^T].>.*", ("direct", "reflection")),
    ],
)
def test_expressions_that_are_layers(expression: str, layers: tuple[str, ...]) -> None:
    assert layers_of(expression) == layers


def test_the_expression_of_a_layer_is_that_layer() -> None:
    assert tuple(EXPRESSIONS) == LAYERS
    for layer, expression in EXPRESSIONS.items():
        assert layers_of(expression) == (layer,)


@pytest.mark.parametrize(
    ("expression", "layer", "path", "missing"),
    [
        ("C<RD>L", "direct", "C<RD>L", "CL"),
        ("C.*L", "direct", "CL", "CO"),
        ("C<RG>.*", "reflection", "C<RG>L", "C<RS>L"),
        ("C<R[GS]>[LO]", "reflection", "C<RG>L", "C<RG><RG>L"),
        ("CS*[LO]", "direct", "CL", "C<RD>L"),
        ("C<R[GS]>{1,3}.*O", "reflection", "C<RG>O", "C<RG>L"),
    ],
)
def test_what_divides_a_layer_is_shown_by_a_path(
    expression: str, layer: str, path: str, missing: str
) -> None:
    with pytest.raises(LpeError) as caught:
        layers_of(expression)
    text = str(caught.value)
    assert f"the layer {layer} it has {path} and not {missing}" in text


@pytest.mark.parametrize("expression", ["CB", "C<V.>.*", "C<TD>.*", "L.*C", "CC", "C", "C<Ts>.*", "[^C]"])
def test_expressions_without_a_path(expression: str) -> None:
    with pytest.raises(LpeError, match="no path of any layer"):
        layers_of(expression)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("", "empty"),
        ("lpe:", "empty"),
        ("C.*<L.'key'>", "label"),
        ("C.*'key'", "label"),
        ("C<RD", "'>' is missing"),
        ("C<DR>.*", "not a type"),
        ("C<RL>.*", "not a scattering"),
        ("C[LO", "'\\]' is missing"),
        ("C(LO", "'\\)' is missing"),
        ("C)", "closes nothing"),
        ("C[]", "empty"),
        ("C[^]", "empty"),
        ("C.*|", "event is missing"),
        ("*C", "no event"),
        ("CX", "character 2, 'X' is no event"),
        ("C.{3,1}", "ends before"),
        ("C.{999}", "up to"),
        ("C.{}", "up to"),
        ("C." * 4000, "longer"),
        ("C(.{0,64}){0,64}(.{0,64}){0,64}", "repeats too much"),
    ],
)
def test_what_is_no_expression(expression: str, message: str) -> None:
    with pytest.raises(LpeError, match=message):
        layers_of(expression)


def paths(bounces: int) -> dict[str, set[str]]:
    """The paths of every layer with up to so many bounces, one letter per event."""
    # r: <RG>, m: <RS>, t: <TG>, g: <TS>, d: <RD>.
    ends = ("L", "O", "dL")
    found: dict[str, set[str]] = {layer: set() for layer in ALL}
    for count in range(bounces + 1):
        for chain in itertools.product("rmtg", repeat=count):
            layer = "direct" if not chain else "reflection" if chain[0] in "rm" else "refraction"
            found[layer] |= {f"C{''.join(chain)}{end}" for end in ends}
    return found


@pytest.mark.parametrize(
    ("expression", "regular"),
    [
        ("C<R[GS]>.*", "C[rm].*"),
        ("C[GS]{1,3}D?[LO]", "C[rmtg]{1,3}d?[LO]"),
        ("C(<R.><T.>)*L", "C([rmd][tg])*L"),
        ("C.*D.*", "C.*d.*"),
        ("C[^D]*[LO]", "C[^d]*[LO]"),
        ("C<[RT]S>+.{2}", "C[mg]+.{2}"),
        ("CR?T?.+", "C[rmd]?[tg]?.+"),
        ("C(L|<RD>L|O)", "C(L|dL|O)"),
        ("C.{1,2}", "C.{1,2}"),
    ],
)
def test_against_regular_expressions_over_listed_paths(expression: str, regular: str) -> None:
    """Up to four bounces, Python's own regular expressions tell which paths are meant."""
    meant: list[str] | None = []
    for layer, known in paths(4).items():
        hits = sum(bool(re.fullmatch(regular, path)) for path in known)
        if hits == len(known) and meant is not None:
            meant.append(layer)
        elif hits:
            meant = None
    if not meant:
        with pytest.raises(LpeError):
            layers_of(expression)
    else:
        assert list(layers_of(expression)) == meant
