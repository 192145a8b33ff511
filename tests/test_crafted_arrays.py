"""Proves that a crafted NPY or NPZ is refused in words: what its header says is checked before numpy acts on it."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.log.readers import read_log

HEADER = "{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}"


def npy(descr: str = "'<f8'", order: str = "False", shape: str = "(3,)", data: bytes = b"\0" * 24) -> bytes:
    """The bytes of an NPY file of version 1.0 whose header says this."""
    head = HEADER.format(descr=descr, order=order, shape=shape).encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


CRAFTED = {
    "elements of no size, as many as there are": npy("'|S0'", shape="(-1,)", data=b""),
    "as many as there are": npy(shape="(-1,)"),
    "voids of no size": npy("'|V0'", shape="(3,)"),
    "texts of no size": npy("'<U0'", shape="(-1, 3)"),
    "negative twice": npy(shape="(-3, -1)"),
    "more than the file has": npy(shape="(4,)"),
    "more than any memory": npy(shape="(4611686018427387904, 4611686018427387904)"),
    "nothing times much": npy(shape="(0, 99999999999999999999999)"),
    "true": npy(shape="(True, 3)"),
    "no tuple": npy(shape="3"),
    "words": npy(shape="('3',)"),
    "a shape that is a formula": npy(shape="(10**9,)"),
    "a hundred dimensions": npy(shape="(" + "1, " * 100 + ")"),
    "order a word": npy(order="'F'"),
    "objects": npy("'|O'"),
    "type unknown": npy("'<q9'"),
    "type nested": npy("[('a', [('b', '<f8')])]"),
    "type a dictionary": npy("{'names': ['a'], 'formats': ['f8'], 'offsets': [-8]}"),
    "header nested": npy("(" * 3000 + ")" * 3000),
    "header garbled": npy("'<f8"),
    "header that ends early": b"\x93NUMPY\x01\x00\xff\xff{",
    "version 3": b"\x93NUMPY\x03\x00" + npy()[8:],
    "version 255": b"\x93NUMPY\xff\x00" + npy()[8:],
    "complex numbers": npy("'<c16'", shape="(1,)"),
}


def refused(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        read_log(path, rate=1.0, columns=None)
    assert caught.value.where == str(path)
    assert caught.value.remedy
    assert "\n" not in str(caught.value)
    assert "ast." not in str(caught.value)  # of numpy's own words
    return caught.value


def test_the_good_ones_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(npy())
    assert read_log(tmp_path / "a.npy", rate=1.0, columns="a=#1 [m]").n == 3
    assert archive(tmp_path, {"gyr.npy": npy(shape="(1, 3)"), "note.txt": b"no array"}).n == 1


@pytest.mark.parametrize("case", CRAFTED)
def test_a_crafted_npy_is_refused(case: str, tmp_path: Path) -> None:
    """In a process of its own: one of these killed it by a division by zero."""
    path = tmp_path / "a.npy"
    path.write_bytes(CRAFTED[case])
    script = "from kfgen.cli import main; main()"
    if case.startswith("elements"):
        words = [sys.executable, "-c", script, "identify", str(path), "--rate", "1", "--columns", "a=#1 [m]"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 2, done.returncode
        assert done.stderr.count("\n") == 1
    refused(path)


def archive(folder: Path, members: dict[str, bytes]) -> object:
    with zipfile.ZipFile(folder / "a.npz", "w") as file:
        for name, data in members.items():
            file.writestr(name, data)
    return read_log(folder / "a.npz", rate=1.0)


@pytest.mark.parametrize("case", CRAFTED)
def test_a_crafted_member_is_refused(case: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        archive(tmp_path, {"gyr.npy": CRAFTED[case]})
    assert str(tmp_path / "a.npz") in str(caught.value)
    assert "ast." not in str(caught.value)  # of numpy's own words


def text(words: str) -> bytes:
    file = io.BytesIO()
    np.save(file, np.array(words))
    return file.getvalue()


MEMBERS = {
    "no array at all": {"gyr": b"rubbish", "acc": b""},
    "an array that is text": {"gyr.npy": b"t,a\n1,2\n"},
    "only texts": {"gyr.npy": text("abc")},
    "a rate that is a text": {"gyr.npy": npy(shape="(1, 3)"), "fs.npy": text("fast")},
    "units nested deeply": {"gyr.npy": npy(), "kfgen_units.npy": text("[" * 9000)},
    "units a list": {"gyr.npy": npy(), "kfgen_units.npy": text("[1]")},
    "units of a text": {"gyr.npy": text("abc"), "kfgen_units.npy": text('{"gyr": "m"}')},
    "units unknown": {"gyr.npy": npy(), "kfgen_units.npy": text('{"gyr": ["m"]}')},
    "two lengths": {
        "a.npy": npy(),
        "b.npy": npy(shape="(2,)"),
        "kfgen_units.npy": text('{"a": "m", "b": "m"}'),
    },
    "two dimensions": {"a.npy": npy(shape="(1, 3)"), "kfgen_units.npy": text('{"a": "m"}')},
}


@pytest.mark.parametrize("case", MEMBERS)
def test_crafted_members_are_refused(case: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        archive(tmp_path, MEMBERS[case])
    assert str(tmp_path / "a.npz") in str(caught.value)


META = ("[" * 9000, json.dumps({"columns": [[1]], "header": {"a": 1}}), json.dumps({"header": [None, []]}))


@pytest.mark.parametrize("meta", META, ids=["nested deeply", "of other kinds", "a list of none"])
def test_crafted_remarks_are_passed_by(meta: str, tmp_path: Path) -> None:
    assert archive(tmp_path, {"gyr.npy": npy(shape="(1, 3)"), "meta.npy": text(meta)}).n == 1


def test_samples_are_a_known_word(tmp_path: Path) -> None:
    members = {
        "a.npy": npy(),
        "kfgen_units.npy": text('{"a": "m"}'),
        "kfgen_samples.npy": text("\x1b[31mevil"),
    }
    assert archive(tmp_path, members).samples == ""


@pytest.mark.parametrize("at", range(0, 200, 7))
def test_a_cut_archive_is_refused(at: int, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, gyr=np.arange(30.0).reshape(10, 3), fs=100.0)
    path.write_bytes(path.read_bytes()[: at + 1])
    refused(path)
