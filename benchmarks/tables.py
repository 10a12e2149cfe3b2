"""The rows of evidence, as kept in their file, written up as markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from deltact_fab.common.files import write_whole

COMMAND = "make evidence"
AGAIN = "python -m benchmarks.evidence --stale"
STALE = "†"


def write_up(
    out: Path, entries: Mapping[str, dict[str, Any]], keys: Sequence[dict[str, str]]
) -> None:
    """The tables of the rows that are there.

    keys: of all rows as they would be made now, in the order in which they are written up. A row
    with another key is stale and marked.
    """
    known = [entries[key["row"]] | {"now": key} for key in keys if key["row"] in entries]
    stale = sum(map(_is_stale, known))
    tables: dict[str, list[dict[str, Any]]] = {}
    for e in known:
        tables.setdefault(e["key"]["row"].partition(":")[0], []).append(e)
    lines = [
        "# Evidence", "",
        f"Written by `{COMMAND}` from `evidence.jsonl`, a line a row; rerun, it goes on where it "
        "stopped. Do not edit.", "",
        *_made_on(known), "",
        f"{len(known)} of {len(keys)} rows are there, {stale} of them stale"
        + (f" ({STALE}): code that they depend on, or what they ask, has changed since; "
           f"`{AGAIN}` runs them again." if stale else "."), "",
    ]  # fmt: skip
    writers: dict[str, Callable[[Sequence[dict[str, Any]]], list[str]]] = {
        "felupe": _felupe, "held": _held, "peer": _peers,
    }  # fmt: skip
    for name, write in writers.items():
        if name in tables:
            lines += [*write(tables[name]), ""]
    write_whole(out, ("\n".join(lines).rstrip() + "\n").encode())


def _is_stale(entry: dict[str, Any]) -> bool:
    return bool(entry["key"] != entry["now"])


def _marked(entry: dict[str, Any], name: Any) -> str:
    return f"{name} {STALE}" if _is_stale(entry) else str(name)


def _made_on(entries: Sequence[dict[str, Any]]) -> list[str]:
    machines = sorted({f"{m['processor']}, {m['cores']} cores" for m in _each(entries, "machine")})
    threads = sorted({str(e["threads"]) for e in entries})
    loads = [e["load"][0] for e in entries if e["load"]]
    names = sorted({f"{k} {v}" for v in _each(entries, "versions") for k, v in v.items()})
    out = [
        f"Machine: {'; '.join(machines)}. Threads: {', '.join(threads)}.",
        f"Versions: {', '.join(names)}.",
    ]
    if loads:
        out.append(
            f"Load of the machine when a row ended: {min(loads):g} to {max(loads):g}; over its "
            "cores, wall times are long and CPU times are the ones to read."
        )
    return out


def _each(entries: Sequence[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    return [e[key] for e in entries]


def _table(head: Sequence[str], body: Sequence[Sequence[Any]]) -> list[str]:
    def cell(value: Any) -> str:
        if value is None:
            return ""
        if isinstance(value, float):
            return f"{value:.4g}"
        return str(value).replace("|", "/").replace("\n", " ")

    return [
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
        *("| " + " | ".join(cell(v) for v in row) + " |" for row in body),
    ]


def _felupe(entries: Sequence[dict[str, Any]]) -> list[str]:
    head = ("press", "cells, mm", "unknowns", "force, N", "felupe, N", "wall, s", "felupe, s",
            "times as fast")  # fmt: skip
    keys = ("spacing_mm", "unknowns", "normal_n", "felupe_n", "wall_s", "felupe_s",
            "times_as_fast")  # fmt: skip
    body = [
        [_marked(e, f"{e['result']['indenter']} to {e['result']['depth_mm']:g} mm"),
         *(e["result"][k] for k in keys)]
        if "failed" not in e["result"]
        else [_marked(e, e["key"]["row"]), e["result"]["failed"]] for e in entries
    ]  # fmt: skip
    text = "One run each on one thread, with the same mesh, law and contact; set-up counts."
    return ["## Beside felupe", "", text, "", *_table(head, body)]


def _held(entries: Sequence[dict[str, Any]]) -> list[str]:
    keys = ("spacing_mm", "unknowns", "force_percent", "in_plane_mm", "cpu_s")
    body: list[Sequence[Any]] = []
    for e in entries:
        r = e["result"]
        if "capped" not in r:
            name = _marked(e, e["key"]["row"].partition(": ")[2])
            body.append((name, *[None] * 7, r.get("failed")))
            continue
        normal_n, largest = -r["force_n"][2], r["largest_in_plane_mm"]
        for c in r["capped"]:
            body.append(
                (_marked(e, r["press"]), r["asked_mm"], normal_n, largest, *(c[k] for k in keys))
            )
    head = ("press", "cells asked, mm", "its normal force, N", "its largest in plane, mm",
            "cells afforded, mm", "unknowns", "force off, %", "in plane off, mm rms",
            "CPU, s")  # fmt: skip
    return [
        "## What a cap on a path's unknowns costs", "",
        "Meshes for the whole way of the pattern selection, pressed in the middle in its "
        "increments, against the cells that the default tolerance asks for (below this press "
        "alone) in half of them. Flagged `mesh`. Where the gel jumps on the way (sharp tips) the "
        "finer solve is itself one of several rests.", "",
        *_table(head, body),
    ]  # fmt: skip


def _peers(entries: Sequence[dict[str, Any]]) -> list[str]:
    out = [
        "## Flow, beside other people's correlators", "",
        "One pair from a cold start, one thread, the same grey images to all (luma, blurred), "
        "drawn by the virtual camera: synthetic. pyvale: subsets of 15 px; al-dic: of 32 px, "
        "global step; nodes 4 px apart on the star, 8 on motions. A preset's time is for every "
        "pixel, best of three; al-dic has compiled before.",
    ]  # fmt: skip
    body: dict[str, list[Sequence[Any]]] = {"stars": [], "motions": []}
    heads: dict[str, Sequence[str]] = {}
    for e in entries:
        r = e["result"]
        name = _marked(e, r.get("method", e["key"]["row"].partition(": ")[2]))
        if "failed" in r:
            for rows in body.values():
                rows.append((name, r["failed"]))
            continue
        heads = {kind: ("method", *r[kind]) for kind in body}
        body["stars"].append((name, *map(_star, r["stars"].values())))
        body["motions"].append((name, *map(_motion, r["motions"].values())))
    titles = {
        "stars": "Star, d 0.15 r 0.1 but for speckle: noise, px / period of 10 % loss, px / CPU, s",
        "motions": "Motions: mean / median / 99th percentile of the error, px / answered, % / "
        "CPU, s",
    }
    for kind, rows in body.items():
        out += ["", f"### {titles[kind]}", "", *_table(heads.get(kind, ("method", "")), rows)]
    return out


def _star(r: dict[str, Any]) -> str:
    loss = "none" if r["loss_px"] is None else f"{r['loss_px']:.0f}"
    return f"{r['noise_px']:.4f} / {loss} / {r['cpu_s']:.3g}"


def _motion(r: dict[str, Any]) -> str:
    off = " / ".join(f"{r[k]:.3g}" for k in ("mean_px", "median_px", "p99_px"))
    return f"{off} / {100 * r['cover']:.3g} / {r['cpu_s']:.3g}"
