"""JSON keys of 0.3.0 for a check, kept for one version beside those of `Check`."""

from __future__ import annotations

from typing import Any

from deltact_fab.common import Check


def of_part(check: Check) -> dict[str, Any]:
    """Row of `cad check`; its limit ends with the remedy."""
    from deltact_fab.fabricate import shorten_key

    unverified = ", ".join(dict.fromkeys(shorten_key(key) for key in check.basis))
    verdict = {"fail": "FAIL", "pass": f"pass (unverified: {unverified})" if unverified else "pass"}
    return {
        "check": check.name, "part": check.subject, "found": check.value,
        "limit": f"{check.limit}: {check.remedy}" if check.remedy else check.limit,
        "passed": check.status == "pass", "rests_on": check.basis,
        "verdict": verdict.get(check.status, check.status),
    }  # fmt: skip


def of_protocol(check: Check) -> dict[str, Any]:
    """Row of `protocol check`."""
    return {
        "name": check.name, "ok": not check.failed, "what": check.subject, "figure": check.value,
        "bound": check.limit, "where": check.remedy or "; ".join(check.basis),
        "warns": check.status == "warn", "least": check.sign == ">=",
    }  # fmt: skip


def of_device(check: Check) -> dict[str, Any]:
    """Row of `rig check`."""
    text = f"{check.value}; {check.remedy}" if check.remedy else check.value
    verdict = {"warn": "WARN", "fail": "FAIL"}.get(check.status, check.status)
    return {"device": check.name, "verdict": verdict, "text": text}


def of_image(check: Check) -> dict[str, Any]:
    """Row of `pattern verify` and `rig accept`."""
    return {
        "check": check.name, "found": check.value, "limit": check.limit,
        "passed": not check.failed, "advice": check.remedy,
    }  # fmt: skip
