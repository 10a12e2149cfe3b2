"""What docs/architecture.md takes from the code.

python -m benchmarks.reference    writes the diagram and the table of packages.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Mapping
from itertools import islice, pairwise
from pathlib import Path

import grimp

from deltact_fab.door import door_imports

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
DIAGRAM = DOCS / "architecture.svg"
PAGE = DOCS / "architecture.md"
PACKAGE = "deltact_fab"

# The lowest wing that is about the sensor. Everything may use what stands below it in the contract,
# and nearly everything does: that is drawn as one block, without arrows.
LOWEST = "sensor"

STEP = 66  # px from row to row
BOX = 30  # px
LETTER = 8.4  # px of a letter of the boxes' font, at most
GAP = 26  # px between boxes of a row, at least
LANE = 20  # px that an arrow takes where it passes a row
STRAIGHT = 6.0  # how much more a lane than a box resists being moved aside
MARGIN = 28
WIDTH = 380  # px at least, which the legend needs

Graph = dict[str, set[str]]


def rows_of_contract() -> list[list[str]]:
    """The rows of the contract of the wings, highest first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layered = next(c for c in contracts["contracts"] if c["name"].startswith("The wings"))
    return [[name.strip() for name in row.split("|")] for row in layered["layers"]]


def layers() -> list[list[str]]:
    """The rows that are drawn with arrows: down to LOWEST."""
    below = ground()
    kept = [[name for name in row if name not in below] for row in rows_of_contract()]
    return [row for row in kept if row]


def ground() -> list[str]:
    """What all may use, in the order of the layers."""
    rows = rows_of_contract()
    (lowest,) = [i for i, row in enumerate(rows) if LOWEST in row]
    return [name for row in rows[lowest:] for name in row if name != LOWEST]


def sides() -> tuple[set[str], set[str]]:
    """The wings that estimate, and those that they must not know, by the contract."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    leak = next(c for c in contracts["contracts"] if c["name"].startswith("Simulated truth"))
    estimators, truth = (
        {name.removeprefix(f"{PACKAGE}.") for name in leak[key]}
        for key in ("source_modules", "forbidden_modules")
    )
    return estimators, truth


def imports() -> Graph:
    """Which package imports which, the ground left out."""
    graph = grimp.build_graph(PACKAGE, cache_dir=None)
    found: Graph = {name: set() for row in layers() for name in row}
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            ends = [name.split(".")[1] for name in (module, other) if "." in name]
            if len(ends) == 2 and ends[0] != ends[1] and set(ends) <= set(found):
                found[ends[0]].add(ends[1])
    return found


def reachable(graph: Mapping[str, set[str]], start: str) -> set[str]:
    """Everything that `start` imports, directly or not."""
    found: set[str] = set()
    todo = [start]
    while todo:
        new = graph[todo.pop()] - found
        found |= new
        todo += new
    return found


def reduced(graph: Mapping[str, set[str]]) -> Graph:
    """The fewest arrows from which the same packages can be reached (transitive reduction)."""
    below = {name: reachable(graph, name) for name in graph}
    return {
        name: {end for end in ends if not any(end in below[other] for other in ends)}
        for name, ends in graph.items()
    }


class Layout:
    """Places of boxes, and the lanes in which arrows pass the rows between their ends.

    Rows are those of the contract. Orders in a row are chosen for few crossings and short arrows,
    by repeated passes over all pairs of neighbours; places follow from the orders.
    """

    def __init__(self, rows: list[list[str]], arrows: Mapping[str, set[str]]) -> None:
        self.rows = [list(row) for row in rows]
        level = {name: i for i, row in enumerate(rows) for name in row}
        self.chains: list[list[str]] = []
        for start in level:
            for end in sorted(arrows[start], key=lambda n: (level[n], n)):
                chain = [start]
                for i in range(level[start] + 1, level[end]):
                    chain.append(f"{start}>{end}@{i}")
                    self.rows[i].append(chain[-1])
                self.chains.append([*chain, end])
        self.level = {name: i for i, row in enumerate(self.rows) for name in row}
        self.near: dict[str, list[str]] = {name: [] for name in self.level}
        for chain in self.chains:
            for a, b in pairwise(chain):
                self.near[a].append(b)
                self.near[b].append(a)
        self._order()
        self.x = self._places()

    def width(self, name: str) -> float:
        return LANE if "@" in name else 24 + LETTER * len(name)

    def _crossings(self, i: int) -> int:
        """Crossings between row i and row i + 1."""
        if not 0 <= i < len(self.rows) - 1:
            return 0
        place = {name: k for k, name in enumerate(self.rows[i + 1])}
        lines = [
            (k, place[other])
            for k, name in enumerate(self.rows[i])
            for other in self.near[name]
            if other in place
        ]
        return sum(
            (a[0] - b[0]) * (a[1] - b[1]) < 0 for n, a in enumerate(lines) for b in lines[n + 1 :]
        )

    def _order(self) -> None:
        def total() -> int:
            return sum(self._crossings(i) for i in range(len(self.rows)))

        best, kept = total(), [list(row) for row in self.rows]
        for turn in range(24):
            down = turn % 2 == 0
            steps = range(1, len(self.rows)) if down else range(len(self.rows) - 2, -1, -1)
            for i in steps:
                other = self.rows[i - 1 if down else i + 1]
                at = {name: (k + 0.5) / len(other) for k, name in enumerate(other)}
                here = {name: k for k, name in enumerate(self.rows[i])}
                mean = {}
                for name in self.rows[i]:
                    seen = [at[n] for n in self.near[name] if n in at]
                    mean[name] = sum(seen) / len(seen) if seen else (here[name] + 0.5) / len(here)
                self.rows[i].sort(key=lambda n: (round(mean[n], 6), here[n]))
                self._swap(i)
            if (now := total()) < best:
                best, kept = now, [list(row) for row in self.rows]
        self.rows = kept

    def _swap(self, i: int) -> None:
        """Exchange neighbours of row i as long as that saves crossings."""
        row = self.rows[i]
        for _ in row:
            for k in range(len(row) - 1):
                before = self._crossings(i - 1) + self._crossings(i)
                row[k], row[k + 1] = row[k + 1], row[k]
                if self._crossings(i - 1) + self._crossings(i) >= before:
                    row[k], row[k + 1] = row[k + 1], row[k]

    def _places(self) -> dict[str, float]:
        """x of each middle: as near to the neighbours' mean as the order and the gaps allow."""
        x: dict[str, float] = {}
        for row in self.rows:
            at = 0.0
            for name in row:
                x[name] = at + self.width(name) / 2
                at += self.width(name) + GAP
            for name in row:
                x[name] -= at / 2
        for turn in range(200):
            steps = self.rows if turn % 2 == 0 else self.rows[::-1]
            for row in steps:
                wanted = {name: self._wanted(name, x) for name in row}
                self._settle(row, wanted, x)
        return x

    def _wanted(self, name: str, x: Mapping[str, float]) -> float:
        """The mean of the neighbours' places, in which a lane counts for more: it runs straight."""
        weights = {n: STRAIGHT if "@" in name and "@" in n else 1.0 for n in self.near[name]}
        total = sum(weights.values())
        return sum(w * x[n] for n, w in weights.items()) / total if total else x[name]

    def _settle(self, row: list[str], wanted: Mapping[str, float], x: dict[str, float]) -> None:
        """Least squares to the wanted places, the order kept (pool adjacent violators)."""
        offset = [0.0]
        for a, b in pairwise(row):
            offset.append(offset[-1] + (self.width(a) + self.width(b)) / 2 + GAP)
        pools: list[tuple[float, float, int]] = []  # weight x place, weight, members
        for name, shift in zip(row, offset, strict=True):
            weight = STRAIGHT if "@" in name else 1.0
            pools.append((weight * (wanted[name] - shift), weight, 1))
            while len(pools) > 1 and pools[-2][0] / pools[-2][1] >= pools[-1][0] / pools[-1][1]:
                last = pools.pop()
                first = pools.pop()
                pools.append((first[0] + last[0], first[1] + last[1], first[2] + last[2]))
        names = iter(zip(row, offset, strict=True))
        for total, weight, members in pools:
            for name, shift in islice(names, members):
                x[name] = total / weight + shift


STYLE = """\
  text { font: 13px ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace; fill: #1d2530 }
  text.note { font: 13px system-ui, 'DejaVu Sans', Arial, sans-serif; fill: #4d5866 }
  .page { fill: #ffffff }
  .row { fill: #f4f6f8 }
  .box { fill: #ffffff; stroke: #6b7785; stroke-width: 1.3 }
  .estimator { fill: #d9ecff; stroke: #1f6fb5 }
  .truth { fill: #ffe3cf; stroke: #c05a12 }
  .arrow { fill: none; stroke: #6b7785; stroke-width: 1.3; marker-end: url(#head) }
  #head path { fill: #6b7785 }
  @media (prefers-color-scheme: dark) {
    text { fill: #e6eaef }
    text.note { fill: #aab4c0 }
    .page { fill: #14181d }
    .row { fill: #1b2127 }
    .box { fill: #242c35; stroke: #8a96a5 }
    .estimator { fill: #123a5c; stroke: #6db3f2 }
    .truth { fill: #57290b; stroke: #f0a06a }
    .arrow { stroke: #8a96a5 }
    #head path { fill: #8a96a5 }
  }"""


def diagram() -> str:
    """The packages in their layers as SVG; the same bytes for the same imports."""
    rows = layers()
    layout = Layout(rows, reduced(imports()))
    estimators, truth = sides()
    left = min(layout.x[n] - layout.width(n) / 2 for n in layout.x)
    right = max(layout.x[n] + layout.width(n) / 2 for n in layout.x)
    width = max(WIDTH, round(right - left + 2 * MARGIN))
    shift = (width - right - left) / 2
    top = 98
    base = _lines(ground(), width - 2 * MARGIN, layout)
    height = top + STEP * len(rows) + 22 + 42 * len(base)

    def y(i: int) -> int:
        return top + STEP * i

    def box(name: str, middle: float, line: int, kind: str = "") -> list[str]:
        wide = round(layout.width(name))
        place = f'x="{round(middle - wide / 2)}" y="{line - BOX // 2}"'
        return [
            f'<rect class="box{kind}" {place} width="{wide}" height="{BOX}" rx="5"/>',
            f'<text x="{round(middle)}" y="{line + 5}" text-anchor="middle">{name}</text>',
        ]

    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" role="img" aria-labelledby="title">',
        '<title id="title">Wings of deltact_fab in their layers</title>',
        f"<style>\n{STYLE}\n</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8z"/></marker></defs>',
        f'<rect class="page" width="{width}" height="{height}"/>',
    ]
    for i in range(0, len(rows), 2):
        out.append(
            f'<rect class="row" x="0" y="{y(i) - STEP // 2}" width="{width}" height="{STEP}"/>'
        )
    for k, (kind, said) in enumerate(
        (
            (" estimator", "estimators: no arrows lead from these"),
            (" truth", "to these: no simulated truth in an estimate"),
        )
    ):
        at = 14 + 24 * k
        out.append(f'<rect class="box{kind}" x="{MARGIN}" y="{at}" width="22" height="16" rx="3"/>')
        out.append(f'<text class="note" x="{MARGIN + 30}" y="{at + 13}">{said}</text>')
    for chain in layout.chains:
        points = [(layout.x[n] + shift, y(layout.level[n])) for n in chain]
        out.append(f'<path class="arrow" d="{_path(points)}"/>')
    for i, row in enumerate(rows):
        for name in sorted(row, key=lambda n: layout.x[n]):
            kind = " estimator" if name in estimators else " truth" if name in truth else ""
            out += box(name, layout.x[name] + shift, y(i), kind)
    line = y(len(rows)) + 14
    said = "used by all layers, no arrows drawn:"
    out.append(f'<text class="note" x="{MARGIN}" y="{line - 26}">{said}</text>')
    for k, names in enumerate(base):
        edge: float = MARGIN
        for name in names:
            out += box(name, edge + layout.width(name) / 2, line + 8 + 42 * k)
            edge += layout.width(name) + 14
    return "\n".join([*out, "</svg>"]) + "\n"


def _lines(names: list[str], most: float, layout: Layout) -> list[list[str]]:
    """Names in lines of at most so many px."""
    lines: list[list[str]] = [[]]
    for name in names:
        if sum(layout.width(n) + 14 for n in lines[-1]) + layout.width(name) > most:
            lines.append([])
        lines[-1].append(name)
    return lines


def _path(points: list[tuple[float, int]]) -> str:
    """From the lower edge of the first box to the upper one of the last, upright at each row."""
    half = BOX // 2
    stops = [(points[0][0], points[0][1] + half)]
    for x, y in points[1:-1]:
        stops += [(x, y - half), (x, y + half)]
    stops.append((points[-1][0], points[-1][1] - half))
    said = f"M{round(stops[0][0])} {stops[0][1]}"
    for (ax, ay), (bx, by) in pairwise(stops):
        if round(ax) == round(bx):
            said += f"V{by}"
        else:
            bend = (ay + by) // 2
            said += f"C{round(ax)} {bend} {round(bx)} {bend} {round(bx)} {by}"
    return said


def packages() -> str:
    """The purpose of each wing and of what it holds, in the order of the layers, as a table."""
    lines = ["| wing | holds | names at its door | purpose |", "|---|---|---|---|"]
    for wing in [name for row in layers() for name in row] + ground():
        folder = ROOT / PACKAGE / wing
        names = f" {len(door(wing))}" if door(wing) else ""
        lines.append(f"| **`{wing}`** | |{names} | {purpose(folder)} |")
        rooms = {file.parent.name for file in folder.glob("*/__init__.py")}
        rooms |= {file.stem for file in folder.glob("*.py")} - {"__init__"}
        lines += [f"| | `{room}` | | {purpose(folder / room)} |" for room in sorted(rooms)]
    return "\n".join(lines)


def door(wing: str) -> dict[str, tuple[str, str]]:
    """The names at the door of a wing, each with the module that defines it and its name there."""
    file = ROOT / PACKAGE / wing / "__init__.py"
    if not file.is_file():
        return {}
    names = door_imports(ast.parse(file.read_text()), f"{PACKAGE}.{wing}")
    return {name: home for name, home in names.items() if home[0].startswith(f"{PACKAGE}.{wing}.")}


def purpose(path: Path) -> str:
    """The first line of the docstring of a package's folder or a module's path without suffix."""
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    said = ast.get_docstring(ast.parse(file.read_text())) or ""
    return said.partition("\n")[0]


def pages() -> dict[Path, str]:
    """The text of each file as it should be."""
    return {DIAGRAM: diagram(), PAGE: _filled(PAGE, "packages", packages())}


def _filled(file: Path, block: str, text: str) -> str:
    start, end = f"<!-- {block}: written by python -m benchmarks.reference -->", "<!-- end -->"
    pattern = re.compile(f"{re.escape(start)}.*?{re.escape(end)}", re.DOTALL)
    made, found = pattern.subn(lambda _: f"{start}\n{text}\n{end}", file.read_text())
    assert found == 1, f"{file}: {start} is not there once"
    return made


def write() -> None:
    """Write all of it."""
    for file, text in pages().items():
        file.write_text(text)
