"""Connection to a Net F/T box: RDT records over UDP, stamped by the kernel on arrival, so that a
late host is not mistaken for a late box."""

from __future__ import annotations

import http.client
import math
import socket
import struct
import time
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from collections import Counter
from contextlib import suppress
from select import select
from typing import Any

import numpy as np

from deltact_fab.common import InputError, SensorError

from ..tables import NetFTConfig
from .netft import DatagramArrivals, NetFTSensor, NetFTSettings

RDT_HEADER, CMD_START, CMD_STOP, CMD_BIAS = 0x1234, 2, 0, 0x42  # ATI 9610-05-1022, table 9.1
RDT_RECORD = struct.Struct(">IIIiiiiii")  # number of the record, of the cycle, status word, counts
# By hand (no real box was at hand): longer limits report a dead box later.
FIRST_RECORD_S = 1.0  # from the start of a stream to its first record
BIAS_DELAY_S = 0.02  # from the bias command to the first biased record
START_RECORDS = 10  # read before a start is complete; decision 0031
BIAS_SHARE = 0.01  # of the range may remain after a bias
BIAS_ATTEMPTS = 3
DEFAULT_RANGE_N, DEFAULT_RANGE_NMM = 25.0, 250.0  # if the box reports none: a Nano17 SI-25-0.25
RECEIVE_BUFFER_BYTES = 1 << 22  # in the kernel, for a late host
MAX_RECORDS = 1000  # per read, so that the guard can check in between
MAX_PAGE_BYTES = 1 << 18
PAGE_TIMEOUT_S = 3.0
# Definition in Linux's asm-generic/socket.h, also the type of the ancillary data.
SO_TIMESTAMPNS, SO_RXQ_OVFL = 35, 40
TIMESPEC_FORMAT, OVERFLOW_FORMAT = struct.Struct("@ll"), struct.Struct("@I")
# N and N mm per unit in the box's spelling; pounds and kilograms force by definition.
NEWTONS_PER_UNIT = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605}
NEWTONS_PER_UNIT |= {"kg": 9.80665, "kgf": 9.80665}
NMM_PER_UNIT = {"Nmm": 1.0, "Nm": 1e3, "kNm": 1e6, "kgcm": 98.0665, "kgfcm": 98.0665}
NMM_PER_UNIT |= {"lbfin": 112.9848290276167, "lbfft": 1355.8179483314004}


class RdtLink:
    """Implements rig.force.netft.BoxLink. Stamps are CLOCK_MONOTONIC, like `WallClock`.

    Without kernel stamps (not Linux) a record has the time at which it was read.
    """

    def __init__(self, config: NetFTConfig, settings: NetFTSettings) -> None:
        self._settings = s = settings
        self._address = config.host, config.rdt_port
        self._label = f"{config.host}:{config.rdt_port}: force sensor"
        ranges = [*(s.range_n or [DEFAULT_RANGE_N] * 3), *(s.range_nmm or [DEFAULT_RANGE_NMM] * 3)]
        per_unit = np.repeat([s.counts_per_n, s.counts_per_nmm], 3)
        self._max_residual = BIAS_SHARE * np.array(ranges) * per_unit
        self._bias_due = False
        self._socket: socket.socket | None = None
        self._first_records = np.empty(0, NetFTSensor.RECORD)  # read by `start`, not returned yet
        self._dropped = 0  # by the kernel, since the start
        self._empty_ns = 0  # when nothing was left to read
        self._losses: Counter[str] = Counter()

    def settings(self) -> NetFTSettings:
        return self._settings

    def bias(self) -> None:
        """Bias at the next start: the box accepts it only while it streams."""
        self._bias_due = True

    def start(self) -> None:
        """Start the stream, read its first records, and bias if due."""
        self._restart()
        attempts = BIAS_ATTEMPTS
        while self._bias_due:
            self._send(CMD_BIAS)
            time.sleep(BIAS_DELAY_S)
            self._restart()
            residual = self._bias_residual()
            attempts -= 1
            self._bias_due = bool(residual)
            if self._bias_due and not attempts:
                raise SensorError(
                    f"{self._label}: {residual} left after a bias; something pulls at the sensor, "
                    "or the box ignores commands"
                )

    def stop(self) -> None:
        """Stop the stream and close its socket; datagrams in transit are lost."""
        if self._socket is not None:
            with suppress(SensorError):
                self._send(CMD_STOP)
            self._socket.close()
        self._socket = None

    def receive(self, timeout_s: float) -> DatagramArrivals:
        """Return received records, at most MAX_RECORDS, so that a slow host returns too."""
        if len(self._first_records):
            came, self._first_records = self._first_records, self._first_records[:0]
            return came
        if self._socket is None:
            raise SensorError(f"{self._label}: the stream was not started")
        select([self._socket], [], [], timeout_s)
        since_ns = time.monotonic_ns() - time.time_ns()
        rows: list[tuple[Any, ...]] = []
        try:
            while len(rows) < MAX_RECORDS:
                self._receive(rows, since_ns)
        except BlockingIOError:
            self._empty_ns = time.monotonic_ns()
        return np.array(rows, NetFTSensor.RECORD)

    def pop_losses(self) -> dict[str, int]:
        losses, self._losses = self._losses, Counter()
        return losses

    def close(self) -> None:
        self.stop()

    def _restart(self) -> None:
        """Start anew; several records, as the earliest arrival fixes the times."""
        self.stop()
        self._first_records, self._dropped = np.empty(0, NetFTSensor.RECORD), 0
        self._losses.clear()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        for option in (SO_TIMESTAMPNS, SO_RXQ_OVFL):
            with suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, 1)
        try:
            self._socket.connect(self._address)
        except OSError as error:
            raise SensorError(f"{self._label}: {error}") from error
        self._socket.setblocking(False)
        self._send(CMD_START)
        end_s = time.monotonic() + FIRST_RECORD_S
        parts: list[DatagramArrivals] = []
        while sum(len(part) for part in parts) < START_RECORDS:
            if (left_s := end_s - time.monotonic()) < 0:
                self.stop()
                raise SensorError(
                    f"{self._label}: no record within {FIRST_RECORD_S:g} s of the start; check "
                    "[force.netft] rdt_port, and that no firewall blocks UDP"
                )
            parts.append(self.receive(left_s))
        self._first_records = np.concatenate(parts)

    def _bias_residual(self) -> str:
        """Text of the mean load after a bias, "" within bounds: the command may be lost."""
        residual = np.abs(self._first_records["counts"].mean(axis=0))
        if (residual <= self._max_residual).all():
            return ""
        s = self._settings
        force_n = max(residual[:3]) / s.counts_per_n
        return f"{force_n:.2f} N, {max(residual[3:]) / s.counts_per_nmm:.1f} N mm"

    def _receive(self, rows: list[tuple[Any, ...]], since_ns: int) -> None:
        """Append one datagram to rows. since_ns: monotonic clock minus the kernel's."""
        assert self._socket is not None
        try:
            data, about, _, _ = self._socket.recvmsg(RDT_RECORD.size + 1, 128)
        except BlockingIOError:
            raise
        except OSError as error:
            raise SensorError(f"{self._label}: the stream ended: {error}") from error
        at_ns = time.monotonic_ns()
        for _, kind, words in about:
            if kind == SO_TIMESTAMPNS:
                seconds, ns = TIMESPEC_FORMAT.unpack(words[: TIMESPEC_FORMAT.size])
                # The kernel's clock may be set at any time, and nothing arrived before.
                stamp_ns = max(seconds * 1_000_000_000 + ns + since_ns, self._empty_ns)
                at_ns = min(stamp_ns, at_ns)
            elif kind == SO_RXQ_OVFL:
                dropped = OVERFLOW_FORMAT.unpack(words[: OVERFLOW_FORMAT.size])[0]
                self._losses["overrun"] += dropped - self._dropped
                self._dropped = dropped
        if len(data) == RDT_RECORD.size:
            number, ft, status, *counts = RDT_RECORD.unpack(data)
            rows.append((at_ns, number, ft, status, tuple(counts)))
        else:
            self._losses["garbage"] += 1

    def _send(self, command: int) -> None:
        assert self._socket is not None
        try:
            self._socket.send(struct.pack(">HHI", RDT_HEADER, command, 0))
        except OSError as error:
            raise SensorError(f"{self._label}: {error}") from error


def fetch_settings(config: NetFTConfig) -> NetFTSettings:
    """Read the settings page of a box. Raises SensorError: unreachable, no page, unknown units."""
    url = f"http://{config.host}:{config.http_port}/netftapi2.xml"
    # The box is in the local network: no proxy.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(url, timeout=PAGE_TIMEOUT_S) as answer:
            text = answer.read(MAX_PAGE_BYTES)
    except (OSError, http.client.HTTPException, ValueError) as error:
        if isinstance(error, urllib.error.HTTPError):
            error.close()
        raise SensorError(
            f"{url}: cannot be read ({error}); check the box's power, cable and address, and "
            "[force.netft] host of the rig file"
        ) from error
    page = parse_settings(text, url)
    if config.serial is not None and page.serial != config.serial:
        raise InputError(
            f"{url}: the transducer has serial number {page.serial!r}, and the rig file "
            f"[force.netft] serial = {config.serial!r}: wrong sensor, or wrong active calibration "
            "in the box"
        )
    return page


def parse_settings(text: bytes, url: str) -> NetFTSettings:
    """Parse the settings page. Raises SensorError naming the invalid element."""
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise SensorError(f"{url}: not the settings page of a Net F/T box: {error}") from error

    def word(name: str) -> str:
        return (root.findtext(f".//{name}") or "").strip()

    def number(name: str) -> float:
        try:
            value = float(word(name))
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value > 0):
            raise SensorError(f"{url}: {name}: {word(name)!r}, a positive number expected")
        return value

    def scale(name: str, factors: dict[str, float]) -> float:
        # The spelling depends on the firmware: N-mm or Nmm, kg-cm or kgf-cm.
        unit = word(name).replace("-", "").replace("lbin", "lbfin").replace("lbft", "lbfft")
        if unit not in factors:
            raise SensorError(
                f"{url}: {name}: unknown unit {word(name)!r}; "
                "set N and N-mm on the box's configurations page"
            )
        return factors[unit]

    if word("comrdte").lower() == "disabled":
        raise SensorError(
            f"{url}: comrdte: RDT is disabled; enable it on the box's communications page"
        )
    newtons, newton_mm = scale("scfgfu", NEWTONS_PER_UNIT), scale("scfgtu", NMM_PER_UNIT)
    about = [("product", "prodname"), ("box_serial", "mfgdigsn"), ("firmware", "mfgdigver")]
    range_n = range_nmm = None
    with suppress(ValueError):
        x, y, z, a, b, c = map(float, word("cfgmr").replace(",", ";").split(";"))
        range_n = (x * newtons, y * newtons, z * newtons)
        range_nmm = (a * newton_mm, b * newton_mm, c * newton_mm)
    return NetFTSettings(
        number("cfgcpf") / newtons,
        number("cfgcpt") / newton_mm,
        number("comrdtrate"),
        word("cfgcalsn") or word("setserial") or "unknown",
        tuple((name, word(tag)) for name, tag in about if word(tag)),
        range_n,
        range_nmm,
    )
