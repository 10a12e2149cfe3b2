"""The configuration page of a Net F/T box, `/netftapi2.xml`: units, counts, rate and numbers."""

from __future__ import annotations

import http.client
import math
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from ...errors import InputError, SensorError
from .config import NetFTConfig
from .netft import NetFTSettings

MAX_BYTES = 1 << 18
ANSWER_S = 3.0
# Newtons in a unit of force, newton millimetres in a unit of torque, as the box writes them.
FORCE_N = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605}
FORCE_N |= {"kg": 9.80665, "kgf": 9.80665}
TORQUE_NMM = {"Nmm": 1.0, "Nm": 1e3, "kNm": 1e6, "kgcm": 98.0665, "kgfcm": 98.0665}
TORQUE_NMM |= {"lbfin": 112.9848290276167, "lbfft": 1355.8179483314004}


@dataclass(frozen=True)
class NetFTPage:
    """What the box says of itself. range: rated maximum of the transducer, N and N mm, or None."""

    settings: NetFTSettings
    range_n: tuple[float, float, float] | None
    range_nmm: tuple[float, float, float] | None


def fetch(config: NetFTConfig) -> NetFTPage:
    """Read the page of a box. Raises SensorError: out of reach, no such page, unknown units."""
    where = f"http://{config.host}:{config.http_port}/netftapi2.xml"
    # A box on the bench is never behind the institute's proxy.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(where, timeout=ANSWER_S) as answer:
            text = answer.read(MAX_BYTES)
    except (OSError, http.client.HTTPException, ValueError) as why:
        if isinstance(why, urllib.error.HTTPError):
            why.close()
        raise SensorError(
            f"{where}: cannot be read ({why}); check the box's power, cable and address, and "
            "[force.netft] host of the rig file"
        ) from why
    page = parse(text, where)
    if config.serial is not None and page.settings.serial != config.serial:
        raise InputError(
            f"{where}: the transducer has serial number {page.settings.serial!r}, and the rig file "
            f"[force.netft] serial = {config.serial!r}: another sensor, or another calibration is "
            "active in the box"
        )
    return page


def parse(text: bytes, where: str) -> NetFTPage:
    """Read the page. Raises SensorError naming the element that cannot be used."""
    try:
        root = ET.fromstring(text)
    except ET.ParseError as why:
        raise SensorError(f"{where}: not the page of a Net F/T box: {why}") from why

    def word(name: str) -> str:
        return (root.findtext(f".//{name}") or "").strip()

    def number(name: str) -> float:
        try:
            value = float(word(name))
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value > 0):
            raise SensorError(f"{where}: {name}: {word(name)!r}, a positive number expected")
        return value

    def scale(name: str, known: dict[str, float]) -> float:
        # Spelled N-mm or Nmm, kg-cm or kgf-cm by firmware.
        unit = word(name).replace("-", "").replace("lbin", "lbfin").replace("lbft", "lbfft")
        if unit not in known:
            raise SensorError(
                f"{where}: {name}: unit {word(name)!r} is not known, so the counts mean nothing; "
                "set N and N-mm on the box's configurations page"
            )
        return known[unit]

    if word("comrdte").lower() == "disabled":
        raise SensorError(
            f"{where}: comrdte: RDT is disabled; enable it on the box's communications page"
        )
    newtons, newton_mm = scale("scfgfu", FORCE_N), scale("scfgtu", TORQUE_NMM)
    about = [("product", "prodname"), ("box_serial", "mfgdigsn"), ("firmware", "mfgdigver")]
    settings = NetFTSettings(
        number("cfgcpf") / newtons,
        number("cfgcpt") / newton_mm,
        number("comrdtrate"),
        word("cfgcalsn") or word("setserial") or "unknown",
        tuple((name, word(tag)) for name, tag in about if word(tag)),
    )
    ratings = _numbers(word("cfgmr"))
    range_n = range_nmm = None
    if len(ratings) == 6:
        range_n = (ratings[0] * newtons, ratings[1] * newtons, ratings[2] * newtons)
        range_nmm = (ratings[3] * newton_mm, ratings[4] * newton_mm, ratings[5] * newton_mm)
    return NetFTPage(settings, range_n, range_nmm)


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.replace(",", ";").split(";")]
    except ValueError:
        return []
