"""A fleet as a table for other programs: a row for each number of each log, as Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kfgen.core.errors import InputError
from kfgen.core.files.whole_file import write_whole
from kfgen.core.numbers import finite
from kfgen.core.optional_library import optional_library
from kfgen.fleet.result import FleetResult

SUFFIXES = (".parquet", ".pq")


def fleet_rows(found: FleetResult) -> dict[str, list[Any]]:
    """The columns of the table, of one length.

    Parameters
    ----------
    found : FleetResult

    Returns
    -------
    dict of str to list
        ``log, sha256, channel, effect, place, parameter, value, low95, high95, unit, outlier, error``; values in SI. A
        log without a number has one row with its name, and why where it failed.
    """
    rows: list[dict[str, Any]] = []
    hashes = {o.log: o.sha256 for o in found.done}
    for pooled in found.numbers:
        number = pooled.number
        place = {
            "channel": number.channel,
            "effect": number.effect,
            "place": number.place,
            "parameter": number.parameter,
        }
        for s in pooled.estimates:
            e = s.estimate
            ends = {"low95": finite(e.lo), "high95": finite(e.hi)}
            size = {"value": e.value, **ends, "unit": pooled.unit, "outlier": pooled.is_outlier(s)}
            rows.append({"log": s.log, "sha256": hashes.get(s.log, ""), **place, **size, "error": ""})
    there = {row["log"] for row in rows}
    empty = [o for o in (*found.done, *found.failed) if o.log not in there]
    rows += [{"log": o.log, "sha256": o.sha256, "error": o.error} for o in empty]
    rows.sort(key=lambda row: row["log"])
    return {name: [row.get(name) for row in rows] for name in COLUMNS}


COLUMNS = (
    *("log", "sha256", "channel", "effect", "place", "parameter"),
    *("value", "low95", "high95", "unit", "outlier", "error"),
)


def check_wanted(model: str | None, noise: Path | None, table: Path | None) -> None:
    """Refuse what could not be written at the end, before hours of work.

    Parameters
    ----------
    model : str, optional
        With what every sensor is compared.
    noise, table : Path, optional
        As in `write_fleet`.

    Raises
    ------
    InputError
        A typical sensor beside a model, or a table that is no Parquet.
    MissingExtra
        pyarrow is not installed.
    """
    if noise and model:
        raise InputError("a typical sensor is identified, and no model is given for that", where="--output")
    if table is None:
        return
    if table.suffix.lower() not in SUFFIXES:
        raise InputError(
            "the table of a fleet is written as Parquet", where="--table", remedy="Name it .parquet"
        )
    optional_library("pyarrow.parquet", "parquet", "Parquet is written by", "--table")


def write_fleet(found: FleetResult, noise: Path | None, table: Path | None) -> None:
    """Write the noise file of a typical sensor and the table, those that are wanted.

    Parameters
    ----------
    found : FleetResult
    noise, table : Path, optional

    Raises
    ------
    InputError, MissingExtra
        As `kfgen.fleet.result.FleetResult.save` and `write_fleet_table`.
    """
    if noise is not None:
        found.save(noise)
    if table is not None:
        write_fleet_table(found, table)


def write_fleet_table(found: FleetResult, path: str | Path) -> None:
    """Write the table as Parquet, whole or not at all.

    Parameters
    ----------
    found : FleetResult
    path : path-like

    Raises
    ------
    InputError
        The file cannot be written.
    MissingExtra
        pyarrow is not installed.
    """
    pa = optional_library("pyarrow", "parquet", "Parquet is written by", str(path))
    pq = optional_library("pyarrow.parquet", "parquet", "Parquet is written by", str(path))
    texts = {
        name: pa.string() for name in ("log", "sha256", "channel", "effect", "parameter", "unit", "error")
    }
    kinds = texts | {"place": pa.int32(), "outlier": pa.bool_()}
    schema = pa.schema([(name, kinds.get(name, pa.float64())) for name in COLUMNS])
    with write_whole(path) as temporary:
        pq.write_table(pa.table(fleet_rows(found), schema=schema), temporary)
