"""Reads ArduPilot logs (DataFlash, .bin): inertial sensors and the aiding sensors beside them, by their own stamps.

Names and units of the messages are those of https://ardupilot.org/copter/docs/logmessages.html; vehicle axes are
forward, right, down. A field with the sensor's own time (`S`, `SMS`, `SampleUS`) is preferred to the time of logging.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.log.readers.flight.counter import rate_of_counter
from kfgen.log.readers.flight.dataflash import Messages, messages
from kfgen.log.readers.tables.aiding import above_first_fix, gnss_stream
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn

Array = NDArray[np.float64]

SUFFIXES = (".bin",)
MAGIC = b"\xa3\x95\x80"
ENOUGH_HZ = 100.0
"""Rate at which a source is fast enough: a faster one is not preferred to it."""
DOWN = 25
"""Orientation of a range finder that looks down (MAV_SENSOR_ROTATION_PITCH_270)."""
LEAST_FIX = 3
"""`Status` of a GNSS solution in three dimensions."""
THROTTLE_FUNCTIONS = frozenset((70, 73, 74, *range(33, 41), *range(82, 86)))
"""`SERVOn_FUNCTION` of outputs that are throttles or motors."""
MICROTESLA_PER_MILLIGAUSS = 0.1
INSTANCE_FIELDS = ("I", "Instance", "Inst", "IMU")
"""Fields that count the sensors of a kind."""
SECOND_NAMES = {"BARO": "BAR", "ARSP": "ASP"}
"""How a message's name begins where the second sensor has a message of its own (`BAR2`)."""
_STAMPS = {"SampleUS": (1e-6, 2**64), "S": (1e-6, 2**32), "SMS": (1e-3, 2**32)}
"""Fields with the sensor's time: unit [s], and where the counter begins again."""
_TRIADS = {"gyro": "rad/s", "accel": "m/s^2"}

Fields = Mapping[str, tuple[str, str]]
_IMU_FIELDS: dict[str, dict[str, str]] = {
    "RISI": {"gyro": "DA", "accel": "DV"},
    "IMT": {"gyro": "DelA", "accel": "DelV"},
    "IMU": {"gyro": "Gyr", "accel": "Acc"},
    "GYR": {"gyro": "Gyr"},
}
"""Messages of inertial sensors, the preferred first, and how the names of their fields begin."""
_INTERVALS = {"RISI": {"gyro": "DADT", "accel": "DVDT"}, "IMT": {"gyro": "DelaT", "accel": "DelvT"}}
"""Fields with the intervals [s] of increments."""
_AIDING: dict[str, Fields] = {
    "MAG": {f"mag_{x.lower()}": (f"Mag{x}", "mG") for x in "XYZ"},
    "BARO": {"baro_height": ("Alt", "m"), "pressure": ("Press", "Pa")},
    "ARSP": {"airspeed": ("Airspeed", "m/s")},
    "BAT": {"current": ("Curr", "A"), "voltage": ("Volt", "V")},
    "CURR": {"current": ("Curr", "A"), "voltage": ("Volt", "V")},
}


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The streams of an ArduPilot log, each with its own clock.

    Parameters
    ----------
    path : Path
    choice : LogChoice
        Message and instance, where there are several.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        It is no DataFlash log, or it has no sensor that is known.
    """
    data = path.read_bytes()
    if not data.startswith(MAGIC):
        raise InputError(
            "it is no DataFlash log of ArduPilot", where=str(path), remedy="Give the .bin file of the vehicle"
        )
    found, skipped = messages(data)
    log = _Messages(found, choice, str(path))
    imu, words = log.imu()
    streams, said = log.aiding()
    if skipped:
        words.append(f"{skipped} of {len(data)} bytes are no message (damaged or cut off) and were skipped")
    if "DSF" in found and found["DSF"].numbers("Dp")[-1] > 0:
        words.append(f"the logger lost {found['DSF'].numbers('Dp')[-1]:.0f} messages (DSF)")
    samples = {"RISI": "before", "IMT": "before"}.get(imu[0].name.split()[0], "at") if imu else ""
    return LogRecording(str(path), (*imu, *streams), log.clocks(), (*words, *said), samples)


class _Messages:
    """The messages of a log, by name and instance."""

    def __init__(self, found: Mapping[str, Messages], choice: LogChoice, source: str) -> None:
        self.found, self.choice, self.source = found, choice, source
        logged = [m for m in found.values() if "TimeUS" in m.fields]
        at = np.concatenate([m.at for m in logged]) if logged else np.zeros(0, np.int64)
        order = np.argsort(at)
        self.at, self.time = (
            at[order],
            np.concatenate([np.zeros(0), *(m.numbers("TimeUS") for m in logged)])[order],
        )

    def clocks(self) -> dict[str, Clock]:
        """The clock of every message and instance."""
        clocks: dict[str, Clock] = {}
        for name, m in sorted(self.found.items()):
            k = self._counted(m)
            parts = {name: m} if k is None else {f"{name} {i}": m.where(k == i) for i in np.unique(k)}
            clocks |= {title: Clock.of(self.logged(part)) for title, part in parts.items()}
        return clocks

    def logged(self, m: Messages) -> Array:
        """When messages were logged [s]; those without a time have that of the last message before them."""
        if "TimeUS" in m.fields:
            return m.numbers("TimeUS") * 1e-6
        if "TimeMS" in m.fields:  # before 2014
            return m.numbers("TimeMS") * 1e-3
        last = np.searchsorted(self.at, m.at) - 1
        return np.where(last >= 0, self.time[np.maximum(last, 0)] if self.time.size else 0.0, np.nan) * 1e-6

    def stamps(self, m: Messages) -> Array:
        """When samples were made [s], by the sensor's own counter where it is logged."""
        t = self.logged(m)
        for field, (unit, size) in _STAMPS.items():
            if field in m.fields and (m.numbers(field) > 0.0).all():
                own = m.numbers(field) * unit
                own += np.round((t - own) / (size * unit)) * size * unit  # counters begin again
                return own if (np.abs(t - own) < 1.0).all() else t
        return t

    def of(self, name: str, instance: int) -> Messages | None:
        """The messages of a sensor: by their field of instances, or by a name of their own (`IMU2`)."""
        m = self.found.get(name)
        counted = self._counted(m) if m is not None else None
        if m is not None and counted is not None:
            part = m.where(counted == instance)
            return part if part.at.size else None
        return m if instance == 0 else self.found.get(f"{SECOND_NAMES.get(name, name)}{instance + 1}")

    def imu(self) -> tuple[tuple[LogStream, ...], list[str]]:
        """The inertial sensor, and what is to be said of it."""
        k = self.choice.instance or 0
        options = {n: m for n in _IMU_FIELDS if (m := self.of(n, k)) is not None and _has(m, n)}
        if not options:
            if k:
                raise InputError(
                    f"there is no inertial sensor of instance {k}", where=self.source, remedy="Leave it out"
                )
            return (), [
                "there is no inertial sensor in the log: no motion between GNSS fixes can be seen; "
                "set LOG_REPLAY = 1, or the bit IMU_RAW of LOG_BITMASK, and fly again"
            ]
        rates = {n: np.nan_to_num(Clock.of(self.stamps(m)).rate) for n, m in options.items()}
        enough = min(0.5 * max(rates.values()), ENOUGH_HZ)
        name = next(n for n, rate in rates.items() if rate >= enough)
        name = self.choice.topic if self.choice.topic in options else name
        streams = [self._inertial(name, options[name], k)]
        if name == "GYR" and (m := self.of("ACC", k)) is not None and "AccX" in m.fields:
            streams.append(LogStream(self._title("ACC", k), self.stamps(m), _triad(m, "accel", "Acc", "")))
        return tuple(streams), []

    def aiding(self) -> tuple[list[LogStream], list[str]]:
        """Streams of aiding sensors and drivers, and what is to be said of them."""
        streams: list[LogStream] = []
        words: list[str] = []
        for name, fields in _AIDING.items():
            m, k = self._chosen(name)
            if m is None or any(c in s.columns for s in streams for c in fields):
                continue
            columns = {c: _column(m.numbers(f), unit) for c, (f, unit) in fields.items() if f in m.fields}
            streams.append(LogStream(self._title(name, k), self.stamps(m), columns))
        if any("airspeed" in s.columns for s in streams):
            words.append(
                "ARSP: airspeed is the equivalent one, smaller than the true one by the root of the density"
            )
        streams += [
            s for s in (self._vibration(), self._clipping(), self._range(), self._throttle()) if s is not None
        ]
        gnss, said = self._gnss()
        streams, zero = above_first_fix(streams, gnss)
        return [*gnss, *streams], words + [w for w in (said, zero) if w]

    def _chosen(self, name: str) -> tuple[Messages | None, int]:
        for k in dict.fromkeys((self.choice.instance or 0, 0)):
            m = self.of(name, k)
            if m is not None:
                return m, k
        return None, 0

    def _counted(self, m: Messages) -> NDArray[np.int64] | None:
        field = next((f for f in INSTANCE_FIELDS if f in m.fields), None)
        if field is None or m.fields[field].dtype.kind not in "iuf":
            return None
        counted = m.numbers(field)
        return np.where(np.abs(counted) < 256.0, counted, -1.0).astype(np.int64)

    def _title(self, name: str, k: int) -> str:
        m = self.found.get(name)
        if m is not None and self._counted(m) is not None:
            return f"{name} {k}"
        return name if k == 0 else f"{SECOND_NAMES.get(name, name)}{k + 1}"

    def _inertial(self, name: str, m: Messages, k: int) -> LogStream:
        columns: dict[str, TableColumn] = {}
        for sensor, begins in _IMU_FIELDS[name].items():
            columns |= _triad(m, sensor, begins, _INTERVALS.get(name, {}).get(sensor, ""))
        if name == "IMU" and "T" in m.fields:
            columns["temperature"] = TableColumn(m.numbers("T"), "degC")
        return LogStream(self._title(name, k), self.stamps(m), columns)

    def _gnss(self) -> tuple[list[LogStream], str]:
        m, k = self._chosen("GPS")
        if m is None or not {"Lat", "Lng", "Alt", "Spd", "GCrs", "VZ", "Status"} <= set(m.fields):
            return [], ""
        t, accuracy = self.stamps(m), self.of("GPA", k)
        if accuracy is not None and np.array_equal(self.logged(accuracy), self.logged(m)):
            t = self.stamps(accuracy)
        course, speed = np.deg2rad(m.numbers("GCrs")), m.numbers("Spd")
        position = [np.deg2rad(m.numbers("Lat")), np.deg2rad(m.numbers("Lng")), m.numbers("Alt")]
        velocity = [speed * np.cos(course), speed * np.sin(course), m.numbers("VZ")]
        stream, said = gnss_stream(
            self._title("GPS", k), t, m.numbers("Status") >= LEAST_FIX, position, velocity
        )
        return ([stream] if stream else []), said

    def _vibration(self) -> LogStream | None:
        m, k = self._chosen("VIBE")
        if m is None:
            return None
        size = np.sqrt(sum(m.numbers(f"Vibe{x}") ** 2 for x in "XYZ"))
        return LogStream(self._title("VIBE", k), self.stamps(m), {"vibration": TableColumn(size, "m/s^2")})

    def _clipping(self) -> LogStream | None:
        """Clipped samples of the accelerometer a second: counted by itself, in older logs in one message for three."""
        m, k = self._chosen("VIBE")
        field = next((f for f in ("Clip", f"Clip{k}") if m is not None and f in m.fields), None)
        if m is None or field is None:
            return None
        return rate_of_counter(
            f"{self._title('VIBE', k)} clips", self.stamps(m), m.numbers(field), "clipping"
        )

    def _range(self) -> LogStream | None:
        m, k = self._chosen("RFND")
        if m is None or "Dist" not in m.fields:
            return None
        good = np.asarray(m.fields.get("Orient", DOWN)) == DOWN
        values = np.where(good & (m.numbers("Dist") > 0.0), m.numbers("Dist"), np.nan)
        return LogStream(self._title("RFND", k), self.stamps(m), {"range": TableColumn(values, "m")})

    def _throttle(self) -> LogStream | None:
        """What the throttle is asked for, 0 to 1: of `CTUN`, else the mean of throttles and motors of `RCOU`."""
        m = self.found.get("CTUN")
        field = next((f for f in ("ThO", "ThrOut") if m is not None and f in m.fields), None)
        if m is not None and field is not None:
            values = m.numbers(field)
            percent = m.fields[field].dtype.kind in "iu" or np.nan_to_num(np.abs(values)).max() > 2.0
            return LogStream(
                "CTUN", self.stamps(m), {"throttle": TableColumn(values * (0.01 if percent else 1.0), "1")}
            )
        m, parameters = self.found.get("RCOU"), self._parameters()
        shares = []
        for n in range(1, 15):
            low, high = parameters.get(f"SERVO{n}_MIN", 1000.0), parameters.get(f"SERVO{n}_MAX", 2000.0)
            if (
                parameters.get(f"SERVO{n}_FUNCTION") in THROTTLE_FUNCTIONS
                and m is not None
                and f"C{n}" in m.fields
            ):
                shares.append(np.clip((m.numbers(f"C{n}") - low) / max(high - low, 1.0), 0.0, 1.0))
        if m is None or not shares:
            return None
        return LogStream("RCOU", self.stamps(m), {"throttle": TableColumn(np.mean(shares, axis=0), "1")})

    def _parameters(self) -> dict[str, float]:
        m = self.found.get("PARM")
        if m is None or not {"Name", "Value"} <= set(m.fields):
            return {}
        names: Sequence[bytes] = m.fields["Name"].tolist()
        return {
            n.decode("ascii", "replace"): float(v) for n, v in zip(names, m.numbers("Value"), strict=True)
        }


def _has(m: Messages, name: str) -> bool:
    """Whether the messages have the fields of an inertial sensor."""
    fields = {f"{begins}{axis}" for begins in _IMU_FIELDS[name].values() for axis in "XYZ"}
    return m.at.size > 1 and fields | set(_INTERVALS.get(name, {}).values()) <= set(m.fields)


def _column(values: Array, unit: str) -> TableColumn:
    """A column, milligauss as microtesla."""
    return (
        TableColumn(values * MICROTESLA_PER_MILLIGAUSS, "uT") if unit == "mG" else TableColumn(values, unit)
    )


def _triad(m: Messages, sensor: str, begins: str, interval: str) -> dict[str, TableColumn]:
    """Three axes of a sensor; increments divided by their intervals."""
    dt = m.numbers(interval) if interval else np.ones(m.at.size)
    columns = {}
    for axis in "xyz":
        values = m.numbers(f"{begins}{axis.upper()}")
        share = np.divide(values, dt, out=np.full(values.shape, np.nan), where=dt > 0.0)
        columns[f"{sensor}_{axis}"] = TableColumn(share, _TRIADS[sensor])
    return columns
