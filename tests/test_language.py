"""The language of code, output and pages: ceilings that only fall, with the worst places named."""

from __future__ import annotations

import ast
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "deltact_fab"
TREES = {file: ast.parse(file.read_text()) for file in sorted(PACKAGE.rglob("*.py"))}

# Participles, adverbs, pronouns and prepositions; relative words at the head of a docstring. Eleven
# comparable projects have 0 to 1.8 % and 0 to 3 %.
NAMES = re.compile(
    r"^_?(found|asked|given|told|made|said|seen|wanted|kept|known|taken|drawn|held|read|heard|shown"
    r"|left|done|lost|met|moved|placed|sent|written|had|meant|named|called|listed|looked|tried"
    r"|added|solved|grown|used|built|put|judged|felt|tuned|thinned|opened|at|of|by|beyond|beside"
    r"|here|there|more|most|least|much|far|away|apart|alike|off|own|mine|ours|sure|wide|whole|every"
    r"|each|some|both|other|others|one|once|again|before|after|now|still|way|why|where|which|what"
    r"|whose|it|its|their|them|theirs)$"
)
HEADS = re.compile(
    r"(What|Of|As|Whether|Where|How|Which|That|By|With|It|Its|No such|Beside|Beyond|Without|From)\b"
)
CEILINGS = {"names": 0.0006, "functions": 0.0026, "docstrings": 0.0}
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef

# Where a hand-set number comes from: a measurement, a reference, or "by hand" and what it trades.
SOURCE = re.compile(
    r"by hand|measured|paper|\beq\.|decision \d{4}|docs/|benchmarks[./]|tests?/|ISO|DIN\b|\bEN\b"
    r"|IEC|IEEE|RFC|ASTM|VDI|datasheet|definition|format|exact|GRBL|ATI |V4L2|UVC|Net F/T|OpenCV"
    r"|PDF|SVG|glTF|\b(18|19|20)\d\d\b", re.IGNORECASE,
)  # fmt: skip
# Found by these names in each file of their kind, as users' own files have them; a standard name.
BY_NAME = {"ENGINE", "LAWS", "PARTS", "SHAPES", "STUDIES", "_LOG"}


def _words(kind: str, tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Names bound, names of functions, or docstrings, with their lines."""
    for node in ast.walk(tree):
        if kind == "names" and isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno
        elif kind == "names" and isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif kind == "functions" and isinstance(node, FUNCTIONS):
            yield node.name, node.lineno
        elif kind == "docstrings" and isinstance(node, FUNCTIONS | ast.ClassDef | ast.Module):
            yield ast.get_docstring(node) or "none", getattr(node, "lineno", 1)


def _share(kind: str, trees: dict[Path, ast.Module]) -> tuple[float, list[str]]:
    """Share of the offenders, and the five files that have most of them."""
    words = [(file, *word) for file, tree in trees.items() for word in _words(kind, tree)]
    places = defaultdict(list)
    for file, text, line in words:
        if (HEADS if kind == "docstrings" else NAMES).match(text):
            places[file].append(f"{text.split()[0]}:{line}")
    worst = sorted(places.items(), key=lambda item: -len(item[1]))[:5]
    lines = [f"{file}: {len(found)}, as {', '.join(found[:4])}" for file, found in worst]
    return sum(map(len, places.values())) / len(words), lines


@pytest.mark.parametrize("kind", CEILINGS)
def test_words_stay_below_their_ceiling(kind: str) -> None:
    share, worst = _share(kind, TREES)
    assert share <= CEILINGS[kind], f"{kind}: {share:.4f}; worst: " + "; ".join(worst)


def test_translated_module_is_named() -> None:
    text = '"""A module."""\ndef told(at: int) -> int:\n    """Of it."""\n    found = at\n'
    trees = {Path("a.py"): ast.parse(text), Path("b.py"): ast.parse("x = 1\n")}
    assert _share("names", trees) == (2 / 3, ["a.py: 2, as at:2, found:4"])
    assert _share("functions", trees) == (1.0, ["a.py: 1, as told:2"])
    assert _share("docstrings", trees) == (1 / 3, ["a.py: 1, as Of:2"])


def _is_number(node: ast.expr) -> bool:
    """True for numbers, also in a tuple, a sum or the values of a dictionary."""
    tops = node.values if isinstance(node, ast.Dict) else [node]
    parts = [part for top in tops for part in ast.walk(top) if isinstance(part, ast.expr)]
    leaves = [p for p in parts if not isinstance(p, ast.UnaryOp | ast.BinOp | ast.Tuple | ast.List)]
    return bool(leaves) and all(type(getattr(p, "value", "")) in (int, float) for p in leaves)


def _assignments(text: str) -> Iterator[tuple[str, ast.expr, str]]:
    """Names bound at the top of a module, with their value and their comment or docstring.

    A comment above a block without an empty line speaks for the whole block.
    """
    lines, body = text.split("\n"), ast.parse(text).body
    for node, follower in itertools.zip_longest(body, body[1:]):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        above = itertools.takewhile(
            lambda line: line.strip() and not line.endswith('"""'), lines[node.lineno - 2 :: -1]
        )
        inside = itertools.dropwhile(lambda line: not line.startswith("#"), above)
        words = list(itertools.takewhile(lambda line: line.startswith("#"), inside))[::-1]
        words += [line.partition("#")[2] for line in lines[node.lineno - 1 : node.end_lineno]]
        if isinstance(follower, ast.Expr) and isinstance(follower.value, ast.Constant):
            words.append(str(follower.value.value))
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name):
                    yield name.id, node.value, " ".join(words)


def _constant_faults(texts: dict[str, str]) -> Iterator[str]:
    """One-word constants, numbers without a source, and names with several values."""
    values: dict[str, dict[str, str]] = defaultdict(dict)
    for file, text in texts.items():
        for name, value, words in _assignments(text):
            constant = re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name)
            if constant and "_" not in name.strip("_") and name not in BY_NAME:
                yield f"{file}: {name}: one word; say of what"
            if constant and _is_number(value) and not SOURCE.search(words):
                yield f"{file}: {name}: no source beside the number"
            if re.fullmatch(r"_?[A-Z]\w*", name) and name not in BY_NAME | {"NS_PER_S"}:
                values[name].setdefault(ast.dump(value), file)
    for name, files in values.items():
        if len(files) > 1:
            yield f"{name}: several values, in {', '.join(files.values())}"


def test_constants_say_of_what_and_why() -> None:
    assert list(_constant_faults({str(file): file.read_text() for file in TREES}))[:5] == []


def test_bad_constants_are_found() -> None:
    texts = {"a": "AIM = 1\nMAX_N = 2  # by hand: slower\n", "b": "# by hand\n\nMAX_N = 3\n"}
    assert list(_constant_faults(texts)) == [
        "a: AIM: one word; say of what", "a: AIM: no source beside the number",
        "b: MAX_N: no source beside the number", "MAX_N: several values, in a, b",
    ]  # fmt: skip


TURNS = """by all their rules; by lying there; goes on at once; in another way: one of;
do not tell; taken as made; which a simulated press leaves out; that can be kept;
of the tip's way; hold, closest; nobody has measured; were not run:; are not there;
To be trusted; has it |; Hold a finished; Hold SCAN; tells no scale; another one:;
done again:; of rig time in; whole (finished); not in the catalogue; expected a folder;
is off by; of that off by; what came out; and can be read; predicting zero;
built for a computer; Beside other; it cannot do without; believes; BEYOND ITS;
a name from here first; How the time goes; paper's gaps; Where to add what;
to be judged; dead man; dead-man; the knee; left out; leaves out; by their rules;
it knows; is told; are told; of CPU a; ms a frame; frames a second; images a second;
a hand lays"""
BARE_POINT = re.compile(r"(?<![\w.)\]/\\}%:#+-])[+-]?\.\d")


def _message_templates(tree: ast.Module) -> Iterator[str]:
    """String constants but docstrings; an f-string is one template with empty holes."""
    skipped = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(part) for part in node.values}
            yield "".join(p.value if isinstance(p, ast.Constant) else "{}" for p in node.values)
        elif isinstance(node, ast.Constant) and id(node) not in skipped:
            yield str(node.value)


def _page_texts() -> Iterator[tuple[str, str]]:
    for file, tree in TREES.items():
        yield from ((str(file.relative_to(ROOT)), text) for text in _message_templates(tree))
    folders = "deltact_fab/assets docs/how-to docs/tutorials docs/reference cad patterns protocols"
    files = [file for folder in folders.split() for file in (ROOT / folder).rglob("*.*")]
    for file in [ROOT / "README.md", *(f for f in files if f.suffix in (".html", ".md", ".toml"))]:
        for line in file.read_text().splitlines():
            if not line.startswith("| `study run"):  # sentences of stored results
                yield str(file.relative_to(ROOT)), line


def _turns(texts: Iterable[tuple[str, str]]) -> Iterator[str]:
    turns = [turn.strip() for turn in TURNS.split(";")]
    for place, text in texts:
        yield from (f"{place}: {turn!r} in {text[:90]!r}" for turn in turns if turn in text)
        if " " in text and BARE_POINT.search(text):
            yield f"{place}: no leading zero in {text[:90]!r}"


def test_output_has_none_of_the_turns() -> None:
    assert list(_turns(_page_texts()))[:5] == []


def test_a_bad_sentence_is_found() -> None:
    tree = ast.parse('"""Docs are told."""\nprint(f"{n} frames a second, .5 mm, X{x:.2f}")\n')
    turn, point = _turns(("a", text) for text in _message_templates(tree))
    assert "'frames a second'" in turn
    assert "leading zero" in point


def test_docs_are_short() -> None:
    pages = [p for p in (ROOT / "docs").rglob("*.md") if p.parent.name != "reference"]
    assert sum(len(p.read_text().split()) for p in [ROOT / "README.md", *pages]) <= 60_000
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


def test_names_of_tests_are_short() -> None:
    trees = {file: ast.parse(file.read_text()) for file in (ROOT / "tests").rglob("*.py")}
    names = [
        f"{f.name}: {name}" for f, tree in trees.items() for name, _ in _words("functions", tree)
    ]
    assert [name for name in names if re.search(r": test(_[^_]+){7}", name)][:5] == []
