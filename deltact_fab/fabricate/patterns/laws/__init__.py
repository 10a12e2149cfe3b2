"""Laws that colour the patches, by name; a file of this folder with LAWS adds its own.

    law          keys                                patches
    algorithm1   patch_mm, r, [channels]             neighbours differ by sqrt(r) (the paper's)
    iid          patch_mm, [channels]                independent, uniform on 0..255
    binary       patch_mm, [channels]                independent, 0 or 255
    octave       patch_mm, scales_mm, [weights],     blocks of several sizes added, then spread
                 [channels]                          evenly over 0..255
    chessboard   patch_mm                            black and white in turn
    dot-matrix   dots                                clear film under dots
    transparent  -                                   clear film

A seed identifies a printed sticker: a law that draws differently needs a new name.
"""

from __future__ import annotations

from deltact_fab.common import collect_entries

from .law import LAW_KEYS, Law

PATTERN_LAWS: dict[str, Law] = collect_entries(__package__, "LAWS", besides=("law",))


def check_key(name: str, key: str, is_given: bool) -> None:
    """Raise ValueError for a key that a law needs and lacks, or has and does not use."""
    law = PATTERN_LAWS[name]
    if key in law.needs and not is_given:
        missing = "a [dots] table" if key == "dots" else "this key"
        raise ValueError(f"law {name!r} needs {missing}")
    if is_given and key not in law.needs + law.may:
        if key == "dots":
            raise ValueError(f"law {name!r} has no dots: remove them, or use law 'dot-matrix'")
        if not law.has_patches:
            raise ValueError(f"law {name!r} has no patches: remove this key")
        takes = ", ".join(k for k in LAW_KEYS if k in law.needs + law.may)
        raise ValueError(f"law {name!r} does not use this key: remove it (used: {takes})")
