"""`deltact-fab doctor`: what is installed, and what is not."""

from __future__ import annotations

from dataclasses import asdict

import click

from .output import Answer, answers


@click.command()
@answers
def doctor() -> Answer:
    """Say what is installed, what each missing thing would bring, and how to get it.

    Looks at Python, the packages of the core and of each extra, system libraries, serial ports,
    cameras, disk and cache. Nothing is opened or changed. Exit code 1 when the core is broken.
    """
    from ..doctor import is_broken, look

    findings = look()
    broken = is_broken(findings)
    absent = sum(f.state != "ok" for f in findings)
    verdict = f"the core is {'broken' if broken else 'complete'}; {absent} things are not there"
    data = {"ok": not broken, "findings": [asdict(f) for f in findings]}
    return Answer(data, [*(f.line() for f in findings), verdict], "" if broken else None)
