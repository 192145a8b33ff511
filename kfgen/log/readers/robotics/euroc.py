"""Reads folders of EuRoC and TUM-VI (``mav0/imu0/data.csv``): the inertial sensor, and a pose as reference.

Each sensor has a folder with ``data.csv``, stamps in nanoseconds first, and often a ``sensor.yaml``. The axes of the
inertial sensor are as logged. The world of a pose has its third axis up; its first axis is taken as north.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn
from kfgen.log.readers.text.published_layouts import EUROC_IMU

Array = NDArray[np.float64]

FOLDER = "a folder of EuRoC or TUM-VI (mav0 with imu0/data.csv)"
TABLE = "data.csv"
SETTINGS = "sensor.yaml"
NANOSECOND_S = 1e-9
HEADER_BYTES = 400
"""Bytes of a table in which its header stands."""
REFERENCES = ("state_groundtruth_estimate0", "mocap0", "vicon0", "leica0")
"""Folders of poses, the preferred one first."""
NED_OF_WORLD = np.diag([1.0, -1.0, -1.0])
"""A half turn about the first axis: third axis up to third axis down."""
_HEADER_CELL = re.compile(r"#?\s*([^\[]*?)\s*(?:\[([^\]]*)\])?\s*$")
_NUMBER = re.compile(r"(?m)^\s*(\w+):\s*([-+.\deE]+)\s*(?:#.*)?$")
_POSE = re.compile(r"(?s)T_BS:.*?data:\s*\[([^\]]*)\]")


def parts(path: Path) -> list[Path]:
    """The tables and settings in such a folder; none where it is another kind of folder.

    Also its ``mav0`` itself may be given, or the folder of one sensor.
    """
    root = path / "mav0" if (path / "mav0").is_dir() else path
    tables = [t for t in (root / TABLE, *sorted(root.glob(f"*/{TABLE}"))) if t.is_file() and _is_table(t)]
    settings = [t.with_name(SETTINGS) for t in tables]
    return [*tables, *(s for s in settings if s.is_file())]


def _is_table(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(HEADER_BYTES).lstrip(b"\xef\xbb\xbf").startswith(b"#timestamp")


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The streams of a folder, each with its own clock.

    Parameters
    ----------
    path : Path
        The folder, its ``mav0``, or the folder of one sensor.
    choice : LogChoice
        Folder of a sensor, or which of several inertial sensors by their names' order.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        A table is damaged: with file and line.
    """
    tables = [_SensorTable.read(part) for part in parts(path) if part.name == TABLE]
    clocks = {table.name: Clock.of(table.t) for table in tables}
    words = [w for table in tables for w in table.words]
    inertial = [t for t in tables if set(EUROC_IMU) <= set(t.columns)]
    streams = []
    if inertial:
        imu = _chosen(inertial, choice, str(path))
        columns = {c: TableColumn(*imu.columns[name]) for name, c in EUROC_IMU.items()}
        streams.append(LogStream(imu.name, imu.t, columns))
        words.append(f"{imu.name}: axes as logged, which need not be forward, right, down")
        words += imu.stated()
    pose = _reference([t for t in tables if "p_RS_R_x" in t.columns], choice)
    if pose is not None:
        stream, said = _pose_stream(pose)
        streams.append(stream)
        words.append(said)
    return LogRecording(str(path), streams, clocks, tuple(words))


def _chosen(inertial: Sequence[_SensorTable], choice: LogChoice, source: str) -> _SensorTable:
    named = [t for t in inertial if t.name == choice.topic]
    k = choice.instance or 0
    if not 0 <= k < len(inertial):
        raise InputError(
            f"there is no inertial sensor of instance {k}",
            where=source,
            remedy=f"Count from 0: {', '.join(t.name for t in inertial)}",
        )
    return (named or inertial[k:])[0]


def _reference(poses: Sequence[_SensorTable], choice: LogChoice) -> _SensorTable | None:
    order = (choice.topic, *REFERENCES)
    ranked = sorted(poses, key=lambda t: order.index(t.name) if t.name in order else len(order))
    return ranked[0] if ranked else None


@dataclass(frozen=True)
class _SensorTable:
    """The table of one sensor: stamps [s], columns with their units, settings, and what is to be said."""

    name: str
    t: Array
    columns: Mapping[str, tuple[Array, str]]
    settings: str
    words: tuple[str, ...]

    @staticmethod
    def read(path: Path) -> _SensorTable:
        """A ``data.csv``; a last line that is cut off is left out."""
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        matches = [_HEADER_CELL.match(cell) for cell in lines[0].split(",")]
        names = [(m.group(1), m.group(2) or "") if m else ("", "") for m in matches]
        numeric = [k for k, (name, _) in enumerate(names) if k and name != "filename"]
        rows, words = _rows(path, lines, [0, *numeric])
        columns = {names[k][0]: (rows[:, j], names[k][1]) for j, k in enumerate(numeric, 1)}
        settings = path.with_name(SETTINGS)
        text = settings.read_text(encoding="utf-8-sig", errors="replace") if settings.is_file() else ""
        return _SensorTable(path.parent.name, rows[:, 0] * NANOSECOND_S, columns, text, tuple(words))

    def stated(self) -> list[str]:
        """The noise that the settings state, which is not that of this log."""
        found = [f"{k} {v}" for k, v in _NUMBER.findall(self.settings) if "noise" in k or "walk" in k]
        return (
            [f"{self.name}: {SETTINGS} states {', '.join(found)}; compare with 'identify'"] if found else []
        )

    def mounting(self) -> tuple[Array, Array]:
        """Rotation and position of the sensor in the body; those of the body itself where nothing is stated."""
        match = _POSE.search(self.settings)
        try:
            numbers = [float(c) for c in match.group(1).split(",")] if match else list(np.eye(4).reshape(-1))
        except ValueError:
            numbers = []
        if len(numbers) != 16:
            raise InputError(
                "T_BS is no matrix of 16 numbers", where=f"{self.name}/{SETTINGS}", remedy="Correct the file"
            )
        T = np.reshape(numbers, (4, 4))
        return T[:3, :3], T[:3, 3]


def _rows(path: Path, lines: Sequence[str], wanted: Sequence[int]) -> tuple[Array, list[str]]:
    """The numbers of the wanted columns, shape (n, k)."""
    rows: list[list[float]] = []
    for k, line in enumerate(lines[1:], 2):
        if not line.strip() or line.startswith("#"):
            continue
        cells = line.split(",")
        try:
            rows.append([float(cells[c]) for c in wanted])
        except (ValueError, IndexError):
            if k == len(lines) and rows:
                return np.array(rows), [f"{path.parent.name}: the last line is cut off and was left out"]
            raise InputError(
                "it is no line of numbers", where=f"{path}: line {k}", remedy="Correct or remove that line"
            ) from None
    return np.array(rows, np.float64).reshape(len(rows), len(wanted)), []


def _pose_stream(table: _SensorTable) -> tuple[LogStream, str]:
    """A pose as a reference: the body in axes with the third one down."""
    from scipy.spatial.transform import Rotation  # heavy: only for logs with poses

    def triad(name: str) -> Array:
        return np.stack([table.columns[f"{name}_{a}"][0] for a in "xyz"])

    p = triad("p_RS_R")
    turned, offset = table.mounting()
    columns: dict[str, TableColumn] = {}
    said = f"{table.name}: its third axis is up; north is its first axis, down the opposite of its third"
    if "q_RS_w" in table.columns:
        q = np.stack([table.columns[f"q_RS_{a}"][0] for a in "wxyz"])
        good = np.isfinite(q).all(axis=0) & (np.abs(q).max(axis=0) > 0.0)
        attitude, out = np.full(q.shape, np.nan), np.full(p.shape, np.nan)
        body = Rotation.from_quat(q[:, good].T, scalar_first=True) * Rotation.from_matrix(turned.T)
        out[:, good] = p[:, good] - body.apply(offset).T
        p = out
        ned = Rotation.from_matrix(NED_OF_WORLD) * body
        attitude[:, good] = ned.as_quat(scalar_first=True).T
        columns |= {f"ref_q_{a}": TableColumn(v, "") for a, v in zip("wxyz", attitude, strict=True)}
    elif np.any(offset):
        said += (
            f"; it is the point {np.array2string(offset, precision=4)} m of the body, no attitude is logged"
        )
    columns |= {f"ref_p_{a}": TableColumn(v, "m") for a, v in zip("NED", NED_OF_WORLD @ p, strict=True)}
    if "v_RS_R_x" in table.columns:
        v = NED_OF_WORLD @ triad("v_RS_R")
        columns |= {f"ref_v_{a}": TableColumn(x, "m/s") for a, x in zip("NED", v, strict=True)}
    return LogStream(table.name, table.t, columns), said
