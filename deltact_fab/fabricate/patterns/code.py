"""Encode a recipe as the short text of a sheet's QR code, and decode it.

    DELTACT1/LAW:ALGORITHM1/SEED:7/SIZE-MM:35/PATCH-MM:0.075/R:0.6/CHANNELS:3/<patches>-<text>

Only characters of the QR code's dense alphanumeric set (ISO/IEC 18004, 7.4.4); case does not
matter, so it can be typed from paper. Every key of the recipe that has a value is written, defaults
too: a later default cannot change an old sticker. A list ends each entry in `*`, a table (the dots)
joins its entries by `+`, `%` stands for `#`.

Two checks stand at the end: 12 digits of the SHA-256 of the drawn patches, and 6 of the text
before. The second tells a misread text from a program that draws other patches.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Any

from deltact_fab.common import InputError, validate

from .recipe import PatternRecipe

CODE_PREFIX = "DELTACT1"
HASH_DIGITS, CHECK_DIGITS = 12, 6  # format of the code; a change makes printed codes unreadable
_CHECKED_CODE = re.compile(rf"(.+)/([0-9a-f]{{{HASH_DIGITS}}})-([0-9a-f]{{{CHECK_DIGITS}}})")


def patches_hash(recipe: PatternRecipe) -> str:
    """First digits of the SHA-256 of the patches: rows, columns, RGB, one byte per value."""
    return hashlib.sha256(recipe.patches().tobytes()).hexdigest()[:HASH_DIGITS]


def encode(recipe: PatternRecipe) -> str:
    """Encode a recipe as a line of text."""
    data = recipe.model_dump(mode="json", exclude_none=True)
    body = "/".join([CODE_PREFIX, *(f"{_encoded(k)}:{_encode_value(v)}" for k, v in data.items())])
    return f"{body}/{patches_hash(recipe)}-{_check_digits(body)}".upper()


def read_code(text: str) -> PatternRecipe | None:
    """Read the text of a sheet's QR code; None for a name or a path. Raises as `decode_recipe`."""
    return decode_recipe(text) if text.upper().startswith(CODE_PREFIX) else None


def decode_recipe(text: str) -> PatternRecipe:
    """Decode a code to the recipe that draws the identical patches; both checks are made.

    Raises InputError for other text, a damaged code, or patches that this version draws
    differently.
    """
    excerpt = ascii(text if len(text) <= 40 else text[:37] + "...")
    if not text.isascii():
        raise InputError(f"code {excerpt}: only 0-9, A-Z and $ % * + - . / : are allowed")
    clean = "".join(text.split()).lower()
    if not clean.startswith(CODE_PREFIX.lower() + "/"):
        raise InputError(f"code {excerpt}: not a sheet's code, which begins with {CODE_PREFIX}/")
    ending = _CHECKED_CODE.fullmatch(clean)
    if ending is None:
        raise InputError(
            f"code {excerpt}: truncated or damaged; a code ends in / and {HASH_DIGITS} digits, "
            f"- and {CHECK_DIGITS} digits (0-9, A-F)"
        )
    body, code_hash, check = ending.groups()
    if _check_digits(body) != check:
        raise InputError(
            f"code {excerpt}: damaged or mistyped: check digits {check.upper()}, expected "
            f"{_check_digits(body).upper()}; read it again"
        )
    try:
        data = _parse_table(body.split("/")[1:])
    except ValueError as error:
        raise InputError(f"code {excerpt}: {error}") from error
    recipe = validate(PatternRecipe, data, "code")
    drawn_hash = patches_hash(recipe)
    if drawn_hash != code_hash:
        raise InputError(
            f"code {excerpt}: patch hash {code_hash.upper()}, but this version draws "
            f"{drawn_hash.upper()}: made by another version"
        )
    return recipe


def _check_digits(body: str) -> str:
    return hashlib.sha256(body.lower().encode()).hexdigest()[:CHECK_DIGITS]


def _encoded(key: str) -> str:
    return key.replace("_", "-")


def _encode_value(value: Any) -> str:
    if isinstance(value, dict):
        return "+".join(f"{_encoded(k)}:{_encode_value(v)}" for k, v in value.items())
    if isinstance(value, list):
        return "".join(f"{_encode_value(v)}*" for v in value)
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    return str(value).replace("#", "%")


def _parse_table(entries: list[str], inner: bool = False) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for entry in entries:
        key, colon, value = entry.partition(":")
        if not (key and colon and value):
            raise ValueError(f"{entry.upper()!r} is not KEY:VALUE")
        name = key.replace("-", "_")
        if name in data:
            raise ValueError(f"{key.upper()} occurs twice")
        if ":" in value and inner:
            raise ValueError(f"{key.upper()} is a table within a table")
        table = ":" in value
        data[name] = _parse_table(value.split("+"), inner=True) if table else _parse_value(value)
    return data


def _parse_value(text: str) -> Any:
    if text.endswith("*"):
        return [_parse_value(part) for part in text[:-1].split("*")]
    try:
        return json.loads(text)
    except (ValueError, RecursionError):  # also of "nan" and "1_0"
        return text.replace("%", "#")
