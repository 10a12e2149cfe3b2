"""The language of code, output and pages: ceilings that only fall, with the worst places named."""

from __future__ import annotations

import ast
import itertools
import re
from collections import Counter, defaultdict
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
    r"|left|done|lost|met|moved|placed|sent|written|had|meant|named|called|listed|looked|tried|added|solved|grown|used|built|put|judged"
    r"|felt|tuned|thinned|opened|at|of|by|beyond|beside|here|there|more|most|least|much|far|away|apart|alike|off|own"
    r"|mine|ours|sure|wide|whole|every|each|some|both|other|others|one|once|again|before|after|now|still|way|why|where"
    r"|which|what|whose|it|its|their|them|theirs)$"
)
HEADS = re.compile(
    r"(What|Of|As|Whether|Where|How|Which|That|By|With|It|Its|No such|Beside|Beyond|Without|From)\b"
)
CEILINGS = {"names": 0.02, "functions": 0.02, "docstrings": 0.02}

# Where a hand-set number comes from: a measurement, a reference, or "by hand" and what it trades.
SOURCE = re.compile(
    r"by hand|measured|paper|\beq\.|decision \d{4}|docs/|benchmarks[./]|tests?/|ISO|DIN\b|\bEN\b"
    r"|IEC|IEEE|RFC|ASTM|VDI|datasheet|definition|format|exact|GRBL|ATI |V4L2|UVC"
    r"|Net F/T|OpenCV|PDF|SVG|glTF"
    r"|\b(18|19|20)\d\d\b",
    re.IGNORECASE,
)
# Found by these names in each file of their kind, as users' own files have them; a standard name.
BY_NAME = {"ENGINE", "LAWS", "PARTS", "SHAPES", "STUDIES", "_LOG"}


def _bound_names(tree: ast.Module) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno


def _functions(tree: ast.Module) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, node.lineno


def _docstrings(tree: ast.Module) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module):
            text = ast.get_docstring(node)
            if text:
                yield text, getattr(node, "lineno", 1)


READERS = {
    "names": (_bound_names, NAMES), "functions": (_functions, NAMES),
    "docstrings": (_docstrings, HEADS),
}  # fmt: skip


def _share(kind: str, trees: dict[Path, ast.Module]) -> tuple[float, list[str]]:
    """Share of the offenders, and the five files that have most of them."""
    reader, pattern = READERS[kind]
    total, places = 0, defaultdict(list)
    for file, tree in trees.items():
        for text, line in reader(tree):
            total += 1
            if pattern.match(text):
                places[file].append(f"{text.split()[0]}:{line}")
    worst = sorted(places.items(), key=lambda item: -len(item[1]))[:5]
    lines = [f"{file}: {len(found)}, as {', '.join(found[:4])}" for file, found in worst]
    return sum(map(len, places.values())) / max(total, 1), lines


@pytest.mark.parametrize("kind", CEILINGS)
def test_words_stay_below_their_ceiling(kind: str) -> None:
    share, worst = _share(kind, TREES)
    assert share <= CEILINGS[kind], f"{kind}: {share:.4f}; worst: " + "; ".join(worst)


def test_translated_module_is_named() -> None:
    text = 'def told(at: int) -> int:\n    """Of it."""\n    found = at\n    return found\n'
    trees = {Path("a.py"): ast.parse(text), Path("b.py"): ast.parse("x = 1\n")}
    assert _share("names", trees) == (2 / 3, ["a.py: 2, as at:1, found:3"])
    assert _share("functions", trees)[0] == _share("docstrings", trees)[0] == 1


def _is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return bool(node.elts) and all(map(_is_number, node.elts))
    if isinstance(node, ast.Dict):
        return bool(node.values) and all(map(_is_number, node.values))
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _assignments(text: str) -> Iterator[tuple[str, ast.expr, str]]:
    """Names bound at the top of a module, with their value and their comment or docstring.

    A comment above a block without an empty line speaks for the whole block.
    """
    lines, body = text.split("\n"), ast.parse(text).body
    for node, follower in itertools.zip_longest(body, body[1:]):
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets = [node.target]
        else:
            continue
        top = node.lineno - 1
        while top and lines[top - 1].strip() and not lines[top - 1].startswith(('"""', "#")):
            if lines[top - 1].endswith('"""'):
                break
            top -= 1
        first = top
        while first and lines[first - 1].startswith("#"):
            first -= 1
        words = lines[first:top]
        words += [line.partition("#")[2] for line in lines[node.lineno - 1 : node.end_lineno]]
        if isinstance(follower, ast.Expr) and isinstance(follower.value, ast.Constant):
            words.append(str(follower.value.value))
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name):
                    yield name.id, node.value, " ".join(words)


def _constant_faults(texts: dict[str, str]) -> Iterator[str]:
    """One-word constants, numbers without a source, and names with several values."""
    values: dict[str, dict[str, str]] = defaultdict(dict)
    for file, text in texts.items():
        for name, value, words in _assignments(text):
            constant = re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name)
            alias = re.fullmatch(r"[A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*", name)
            if constant and "_" not in name.strip("_") and name not in BY_NAME:
                yield f"{file}: {name}: one word; say of what"
            if constant and _is_number(value) and not SOURCE.search(words):
                yield f"{file}: {name}: no source beside the number"
            if (constant or alias) and name not in BY_NAME | {"NS_PER_S"}:
                values[name].setdefault(ast.dump(value), file)
    for name, files in values.items():
        if len(files) > 1:
            yield f"{name}: several values, in {', '.join(files.values())}"


CONSTANT_FAULTS = 0


def test_constants_say_of_what_and_why() -> None:
    texts = {str(file.relative_to(ROOT)): file.read_text() for file in TREES}
    faults = list(_constant_faults(texts))
    assert len(faults) <= CONSTANT_FAULTS, "\n".join(faults[:5])


def test_bad_constants_are_found() -> None:
    texts = {"a": "AIM = 1\nMAX_N = 2  # by hand: slower\n", "b": "MAX_N = 3\n"}
    assert list(_constant_faults(texts)) == [
        "a: AIM: one word; say of what", "a: AIM: no source beside the number",
        "b: MAX_N: no source beside the number", "MAX_N: several values, in a, b",
    ]  # fmt: skip


# ---- output and pages ---------------------------------------------------------------------------

TURNS = (
    "by all their rules", "by lying there", "goes on at once", "in another way: one of",
    "do not tell", "taken as made", "which a simulated press leaves out", "that can be kept",
    "of the tip's way", " hold, closest", "nobody has measured", "were not run:", "are not there",
    "To be trusted", "has it |", "Hold a ", "Hold SCAN", "tells no ", "another one:",
    "done again:", "of rig time in", "whole (finished)", "not in the catalogue",
    "is a file; expected", "is off by", "of that off by", "what came out", "and can be read",
    "predicting zero", "built for a computer", "Beside other", "it cannot do without",
    "believes", "BEYOND ITS", "a name from here first", "How the time goes", "paper's gaps",
    "Where to add what", "to be judged", "dead man", "dead-man", "the knee", "left out",
    "leaves out", "by their rules", "it knows", "is told", "are told", "of CPU a", "ms a frame",
    "frames a second", "images a second", "a hand lays",
)  # fmt: skip
BARE_POINT = re.compile(r"(?<![\w.)\]/\\}%:#+-])[+-]?\.\d")


def _message_templates(tree: ast.Module) -> Iterator[str]:
    """String constants but docstrings; the holes of f-strings are empty."""
    bare = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    inner = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            inner |= {id(part) for part in node.values}
            yield "".join(
                str(p.value) if isinstance(p, ast.Constant) else "{}" for p in node.values
            )
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in bare | inner:
            yield node.value


def _page_texts() -> Iterator[tuple[str, str]]:
    for file, tree in TREES.items():
        for text in _message_templates(tree):
            yield str(file.relative_to(ROOT)), text
    files = [ROOT / "README.md", *(PACKAGE / "assets").rglob("*.html")]
    files += [*(PACKAGE / "assets").rglob("*.md"), *(PACKAGE / "assets").rglob("*.toml")]
    for folder in (
        "docs/how-to",
        "docs/tutorials",
        "docs/reference",
        "cad",
        "patterns",
        "protocols",
    ):
        files += [file for ext in ("md", "toml") for file in (ROOT / folder).rglob(f"*.{ext}")]
    for file in files:
        for line in file.read_text().splitlines():
            if not line.startswith("| `study run"):  # sentences of stored results
                yield str(file.relative_to(ROOT)), line


def _turns(texts: Iterable[tuple[str, str]]) -> Iterator[str]:
    for place, text in texts:
        for turn in TURNS:
            if turn in text:
                yield f"{place}: {turn!r} in {text[:90]!r}"
        if " " in text and BARE_POINT.search(text):
            yield f"{place}: no leading zero in {text[:90]!r}"


TURN_COUNT = 0


def test_output_has_none_of_the_turns() -> None:
    found = list(_turns(_page_texts()))
    worst = Counter(line.partition(":")[0] for line in found).most_common(5)
    assert len(found) <= TURN_COUNT, f"{len(found)}; worst {worst}:\n" + "\n".join(found[:40])


def test_a_bad_sentence_is_found() -> None:
    tree = ast.parse('"""Docs are told."""\nprint(f"{n} frames a second, .5 mm, X{x:.2f}")\n')
    found = list(_turns(("a", text) for text in _message_templates(tree)))
    assert len(found) == 2
    assert "'frames a second'" in found[0]
    assert "leading zero" in found[1]


# ---- tests --------------------------------------------------------------------------------------


def test_names_of_tests_are_short() -> None:
    long = [
        f"{file.name}:{line}: {name}"
        for file in sorted((ROOT / "tests").rglob("*.py"))
        for name, line in _functions(ast.parse(file.read_text()))
        if name.startswith("test_") and name.count("_") > 6
    ]
    assert not long, f"{len(long)} with over six words, as " + ", ".join(long[:5])
